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


"""Suppress the banner that a library prints when it is imported."""

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
import os
import sys
import tempfile


@contextmanager
def drop_stderr_lines(beginning: str) -> Iterator[None]:
    """
    Drop lines of the standard error that begin with these words; all others get through.

    C has buffers of its own, which are flushed before and after by `fflush(NULL)`
    (ISO C 7.21.5.2).

    :param beginning: of the lines that are dropped.
    """
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error, so nobody reads a banner
        yield
        return
    _flush()
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 2)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, 2)
            os.close(kept)
            said.seek(0)
            for line in said:
                if not line.startswith(beginning.encode()):
                    os.write(2, line)


def _flush() -> None:
    if sys.stderr is not None:
        sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
