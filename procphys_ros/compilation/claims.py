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

"""Claims: locks by which one process compiles the kernels that several need at once."""

from contextlib import suppress
import os
from pathlib import Path
from time import monotonic, sleep

from procphys_ros.compilation.folders import prepare
from procphys_ros.files.output_files import lock

_PATIENCE = 120.0  # [s] of waiting for another process: it may have been stopped
_LOOK = 0.02       # [s] between two looks

_held: list[tuple[Path, int]] = []  # innermost last: callees are compiled within their callers


def claim(path: Path) -> None:
    """
    Claim a file that this process is about to make, or wait until another process has made it.

    The system ends the claims of a process that ends. Processes of low priority wait, but claim
    nothing: others would wait too long for them.

    :param path: of the file, which may be there afterwards; the claim is a locked file beside it.
    """
    try:
        prepare(path.parent)
        file = os.open(path.with_suffix('.lock'), os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        return  # nothing can be kept here, so nothing can be shared
    end = monotonic() + _PATIENCE
    while not lock(file) and monotonic() < end:
        sleep(_LOOK)
    _held.append((path, file))
    if os.getpriority(os.PRIO_PROCESS, 0) > 0:
        release(path)


def release(path: Path) -> None:
    """Release the claim on a file, and those made since, which belong to failed compilations."""
    while any(held == path for held, _ in _held):
        inner, file = _held.pop()
        with suppress(OSError):
            inner.with_suffix('.lock').unlink()
        os.close(file)
