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

"""Errors that a user can cause; each message is one readable line with the remedy in it."""

from collections.abc import Iterable
import difflib
from functools import lru_cache

_LONGEST_NAME = 200  # [characters] of names worth comparing; longer ones take seconds


class ProcPhysError(Exception):
    """Base of every error caused by input; `str(error)` can be shown to a user."""


class GrammarError(ProcPhysError):
    """
    Grammar text that cannot be read, or cannot be derived within its bounds.

    :param message: what is wrong, and what to do about it.
    :param source: name of the file, or of the parameter the text came from.
    :param line: 1-based line, 0 for the whole text.
    :param column: 1-based column, 0 for the whole line.
    """

    def __init__(self, message: str, source: str = '<text>', line: int = 0, column: int = 0):
        self.message = message
        self.source = source
        self.line = line
        self.column = column
        place = source
        if line:
            place += f':{line}'
            if column:
                place += f':{column}'
        super().__init__(f'{place}: {message}')


class GrammarWarning(UserWarning):
    """
    Legal construct in a grammar that is probably a mistake; the text begins with its place.

    Given through Python's `warnings`, so that a library user can filter it and a node can log it
    (`warnings.catch_warnings(record=True)` around the reading of a grammar).
    """


class SceneError(ProcPhysError):
    """A scene that cannot be built: an unknown key, a missing file, a value out of range."""


class ExportError(ProcPhysError):
    """A file that cannot be written: an unknown format, a missing package, no room on the disk."""


class RecordingError(ProcPhysError):
    """A recording that cannot be written or read: no package, no room, a damaged file."""


class CommandError(ProcPhysError):
    """A command that is refused (unknown part, NaN, paused): the simulation is unchanged."""


class SnapshotError(CommandError):
    """A snapshot that cannot be restored: damaged, or of another scene or version."""


def nearest_names(name: str, known: Iterable[str], limit: int = 3) -> str:
    """
    Return the known names most similar to an unknown one, for use inside an error message.

    :param name: the name that was not found.
    :param known: the names that exist.
    :param limit: number of names offered at most.
    """
    if not isinstance(name, str) or len(name) > _LONGEST_NAME:
        return ''
    close = [other for other in _close(name, tuple(known), limit + 1) if other != name][:limit]
    return f'; did you mean {", ".join(close)}?' if close else ''


@lru_cache(maxsize=16)  # rapid commands repeat the same mistake
def _close(name: str, known: tuple[str, ...], limit: int) -> list[str]:
    return difflib.get_close_matches(name, known, n=limit, cutoff=0.5)
