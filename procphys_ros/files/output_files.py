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


"""Output files: report early what prevents writing one, and write it atomically."""

from collections.abc import Callable
import fcntl
import os
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import IO


def obstacle(path: Path, beside: bool = True) -> str:
    """
    Return why a file cannot be written; '' = no obstacle is known yet.

    :param path: the file.
    :param beside: whether it is written by `write_beside`, which also makes a file in its
        folder; else an existing file is overwritten.
    """
    try:
        if not path.parent.is_dir():
            return f'there is no folder "{path.parent}"'
        if path.is_dir():
            return 'it is a folder'
        if path.exists() and not path.is_file():
            return 'it is not a regular file'
        if path.exists() and not os.access(path, os.W_OK):
            return 'permission denied'
        if (beside or not path.exists()) and not os.access(path.parent, os.W_OK):
            return f'nothing can be written into its folder "{path.parent}"'
    except (OSError, ValueError) as error:  # ValueError: a null character
        return getattr(error, 'strerror', None) or str(error)
    return ''


def lock(file: IO | int) -> bool:
    """
    Lock a file against other processes that lock it, until it is closed.

    :param file: open, or its descriptor.
    :returns: whether no other process holds it; true, too, where files cannot be locked.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # a file system without locks
    return True


def write_beside(path: Path, write: Callable[[Path], object]) -> None:
    """
    Write a file beside its place, and move it there when it is complete.

    :param write: called with the path to write; the suffix is that of the file.
    :raises OSError: when it cannot be written, or as `write` does; the file is unchanged then.
    """
    part = part_of(path)
    try:
        write(part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def part_of(path: Path) -> Path:
    """Return the temporary path beside a file that it is written to."""
    return path.with_name(f'.{path.stem}.part{path.suffix}')


def write_whole(path: Path, data: bytes) -> None:
    """
    Write a file such that a reader sees either all of it or the former content.

    :raises OSError: when it cannot be written; the file is unchanged then.
    """
    with NamedTemporaryFile(dir=path.parent, prefix='.', delete=False) as file:
        try:
            file.write(data)
            file.close()
            os.replace(file.name, path)
        except OSError:
            os.unlink(file.name)
            raise
