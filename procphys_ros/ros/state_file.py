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


"""Files of saved states: written whole or not at all, read only when they are plain files."""

from pathlib import Path
import stat

from procphys_ros.errors import CommandError
from procphys_ros.files.archive import is_archive
from procphys_ros.files.output_files import write_beside

_LARGEST = 2 << 30  # [bytes] of a file to be read
_HEAD = 64  # [bytes] that identify the type of a file


def write_state(path: Path, data: bytes) -> None:
    """
    Write a file atomically: readers see all of it or the previous content.

    :raises CommandError: if it cannot be written; nothing has changed then.
    """
    try:
        if path.exists() and not path.is_file():  # a device would be replaced by a file
            raise CommandError(f'state.file: {path} is not a regular file')
        if path.exists() and not _is_replaceable(path):
            raise CommandError(f'state.file: {path} is no saved state, and is not replaced')
        write_beside(path, lambda part: part.write_bytes(data))
    except (OSError, ValueError) as error:
        raise CommandError(f'state.file: {path} cannot be written: {_reason(error)}') from error


def _is_replaceable(path: Path) -> bool:
    with path.open('rb') as file:
        head = file.read(_HEAD)
    return not head or is_archive(head)


def read_state(path: Path) -> bytes:
    """
    Read a regular file.

    :raises CommandError: if there is none, it is not a regular file, or too large.
    """
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise CommandError(f'state.file: {path} is not a regular file')
        if about.st_size > _LARGEST:
            raise CommandError(f'state.file: {path} is larger than {_LARGEST >> 30} GiB')
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise CommandError(f'state.file: {path} cannot be read: {_reason(error)}') from error


def _reason(error: OSError | ValueError) -> str:
    return getattr(error, 'strerror', None) or str(error)
