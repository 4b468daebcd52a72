# Copyright 2026 The procphys_ros authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Free memory: what is left of a scene goes back to the system."""

from contextlib import suppress
import ctypes
from threading import Thread


def return_free_memory() -> None:
    """
    Return free memory to the system, in a separate thread.

    Each thread allocates from its own arena, and glibc keeps free memory within it: where scenes
    are built in one thread and used in another, two thirds of a scene for good.
    """
    Thread(target=_trim, name='free memory', daemon=True).start()


def _trim() -> None:
    with suppress(AttributeError, OSError):  # other C libraries lack it, and do not need it
        ctypes.CDLL(None).malloc_trim(0)
