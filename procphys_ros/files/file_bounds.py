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


"""Bounds of files: which files may be read or written by parameters set from elsewhere."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class FileBounds:
    """
    Files that may be named.

    :ivar folders: all files below these, links followed.
    :ivar given: values of parameters, by name, that may name any file: those of the start.
    """

    folders: tuple[Path, ...]
    given: Mapping[str, Any]

    def __str__(self) -> str:
        return ', '.join(map(str, self.folders))


_PRESENT: ContextVar[FileBounds | None] = ContextVar('file_bounds', default=None)


@contextmanager
def within(bounds: FileBounds | None) -> Iterator[None]:
    """Restrict the files named in this context to bounds; None = any."""
    before = _PRESENT.set(bounds)
    try:
        yield
    finally:
        _PRESENT.reset(before)


@contextmanager
def named_by(parameter: str, value: Any) -> Iterator[None]:
    """
    Lift the bounds for a parameter while its value is that of the start.

    :param parameter: full name.
    :param value: its present value.
    """
    bounds = _PRESENT.get()
    free = bounds is not None and value and bounds.given.get(parameter) == value
    with within(None if free else bounds):
        yield


def outside(path: Path) -> str:
    """
    Return why a file may not be named, '' = it may; its existence is not revealed.

    :param path: of the file.
    """
    bounds = _PRESENT.get()
    if bounds is None:
        return ''
    try:
        found = path.resolve()
    except (OSError, RuntimeError, ValueError) as problem:
        return f'it is no path: {type(problem).__name__}'
    if any(found.is_relative_to(folder) for folder in bounds.folders):
        return ''
    return f'it lies outside of the folders that files.root allows: {bounds}'
