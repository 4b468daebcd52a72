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

"""
Interruption: signal handlers that raise an exception where that is safe.

Compiled code calls Python functions while it turns its results into objects, and so does Python
where it frees one. An exception that a signal raises within one of them is lost, comes out as
another error, or crashes the process.
"""

from collections.abc import Callable
from multiprocessing import parent_process
import os
import signal
from threading import Thread
from types import FrameType
from typing import Any

_AGAIN = 0.001  # [s] until a signal that came at an unsafe moment is retried

# Modules called from C code that does not expect exceptions (numba 0.58 and 0.68, numpy 1.26 and
# 2.4, Python 3.11), and writers of pictures, which count what they have written. All of them
# return within milliseconds.
_UNSAFE = ('enum', 'numba.core.serialize', 'numpy.core._internal', 'numpy._core._internal',
           'weakref', 'procphys_ros.render.writers')

_borrowed: list[tuple[Any, tuple[float, float]]] = []  # handlers and timers of others at SIGALRM


def raising(error: Callable[[], BaseException]) -> Callable[[int, FrameType | None], None]:
    """
    Make a signal handler that raises an exception, as soon as that is safe.

    It borrows SIGALRM and its timer where it has to wait.

    :param error: makes the exception, such as `KeyboardInterrupt`.
    """
    def handle(_: int, frame: FrameType | None) -> None:
        if _is_unsafe(frame):
            theirs = (signal.signal(signal.SIGALRM, handle),
                      signal.setitimer(signal.ITIMER_REAL, _AGAIN))
            if not _borrowed:
                _borrowed.append(theirs)
            return
        if _borrowed:  # a retry that still waits must not disturb the end
            before, timer = _borrowed.pop()
            signal.signal(signal.SIGALRM, signal.SIG_DFL if before is None else before)
            signal.setitimer(signal.ITIMER_REAL, *timer)
        raise error()

    return handle


def end_with_parent() -> None:
    """Let a process of a pool end when the one that has started it is killed."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)
    Thread(target=watch, daemon=True).start()


def _is_unsafe(frame: FrameType | None) -> bool:
    """Return whether a frame, or one of its callers, may have been called from compiled code."""
    while frame is not None:
        if frame.f_code.co_name == '__del__' or frame.f_globals.get('__name__') in _UNSAFE:
            return True
        frame = frame.f_back
    return False
