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

"""Tests compute on one thread each: as many as there are cores run beside each other."""

# Imported before numpy and numba. What depends on the number of threads sets it, and nodes that
# tests start have as many as those of users.

from collections.abc import Mapping
import os

_NAMES = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'NUMBA_NUM_THREADS')
_SET = [name for name in _NAMES if os.environ.setdefault(name, '1') == '1']


def as_for_users(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a process with as many threads as there are cores."""
    return {name: value for name, value in environment.items() if name not in _SET}
