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


"""Includes: find and read the grammars from which a grammar includes definitions."""

from collections.abc import Callable, Collection
import os
from pathlib import Path
from typing import Any, ClassVar, Self

from procphys_ros.errors import GrammarError
from procphys_ros.files.file_bounds import outside
from procphys_ros.files.resources import shared_folder
from procphys_ros.language.place import Place
from procphys_ros.language.syntax import read_text, shorten
from procphys_ros.schema import short

TRANSLATED = ('.l', '.lpy')  # of L-systems in the languages of cpfg and L-Py
_GRAMMARS = ('.lsys', '.wall', '.mech', *TRANSLATED)
MOST_INCLUDES = 32  # files that one grammar may include, directly or indirectly


def find_grammar(path: str | Path) -> Path:
    """
    Find a grammar file by its path or shipped name.

    :param path: of the file, or the name of a shipped one where there is no such file.
    :returns: the path unchanged when there is neither.
    :raises GrammarError: if it is no path.
    """
    if not isinstance(path, str | Path):
        raise GrammarError(f'{short(path)} is not the path of a grammar')
    given = Path(path)
    shipped = shared_folder() / 'grammars' / given
    return shipped if not os.path.exists(given) and os.path.isfile(shipped) else given


class GrammarFile:
    """Base of parsed grammars: they come from files, too."""

    parse: ClassVar[Callable[..., Any]]

    @classmethod
    def load(cls, path: str | Path, **bounds: int) -> Self:
        """
        Read a grammar from a file.

        :param path: of the file, UTF-8, or the name of a shipped grammar, such as oak.lsys.
        :param bounds: as `parse` takes them.
        :raises GrammarError: when the file cannot be read or does not fit the language.
        """
        found = find_grammar(path)
        return cls.parse(read_text(found), str(path), folder=found.absolute().parent, **bounds)


def read_include(name: str, folder: Path | None, place: Place,
                 seen: Collection[Path],
                 endings: tuple[str, ...] = _GRAMMARS) -> tuple[Path, str] | None:
    """
    Read a file that a grammar includes.

    :param name: of the file, as written.
    :param folder: of the including grammar, searched first; None = unknown.
    :param place: of the include.
    :param seen: files included already; each is included once.
    :param endings: of the files that may be included.
    :returns: path and text; None when it was included before.
    :raises GrammarError: when the file cannot be included, or there are too many.
    """
    if not name.strip() or not name.isprintable():
        raise place.error(f'"{shorten(name)}" is not a file name')
    folders = [*([] if folder is None else [folder]), shared_folder() / 'grammars']
    for path in (one / name for one in folders):
        if reason := outside(path):
            raise place.error(f'"{shorten(name)}" cannot be included: {reason}')
        try:
            found = path.resolve(strict=True)
        except OSError:
            continue
        if found.suffix not in endings and not found.is_dir():
            raise place.error(f'"{shorten(name)}" cannot be included: grammars end in '
                              f'{", ".join(endings)}')
        if found in seen:
            return None
        if len(seen) >= MOST_INCLUDES:
            raise place.error(f'more than {MOST_INCLUDES} files are included')
        try:
            return found, read_text(found)
        except GrammarError as error:
            raise place.error(f'"{shorten(name)}": {error.message}') from None
    looked = ' and '.join(str(one) for one in folders)
    raise place.error(f'there is no "{shorten(name)}" to include in {shorten(looked)}')
