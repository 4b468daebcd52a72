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

"""Report each kernel that is compiled: at a first start dozens take a minute."""

import gc
from typing import Any

from numba.core import event

from procphys_ros import progress

COMPILING = 'compiling kernels'


class _Reporter(event.Listener):
    """Reports numba's compilation events as progress."""

    def on_start(self, event: Any) -> None:
        progress.begin(COMPILING, event.data['dispatcher'].py_func.__name__.lstrip('_'))

    def on_end(self, event: Any) -> None:
        progress.end()


class _GarbageKeeper(event.Listener):
    """
    Suspends garbage collection while a kernel and its callees are compiled.

    numba makes objects by the million and keeps nearly all of them until it is done: looking for
    cycles among them takes a tenth of the time.
    """

    _depth = 0  # numba compiles in one thread at a time

    def on_start(self, _: Any) -> None:
        if not self._depth:
            self._was_collecting = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, _: Any) -> None:
        self._depth -= 1
        if not self._depth and self._was_collecting:
            gc.enable()


event.register('numba:compile', _Reporter())
event.register('numba:compile', _GarbageKeeper())
