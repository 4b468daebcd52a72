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

"""Find grammars, tell the languages apart, and build blueprints from them."""

import os
from pathlib import Path
import stat
from typing import Protocol, TYPE_CHECKING

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.files.file_bounds import named_by, outside
from procphys_ros.files.resources import shared_folder, shipped_file
from procphys_ros.language import check_length, shorten, TRANSLATED
from procphys_ros.lsystem import LSystem
from procphys_ros.maps import MAPS

if TYPE_CHECKING:
    from procphys_ros.mechanism import MechanismGrammar, RobotGrammar
    from procphys_ros.scans import ScannedTree
    from procphys_ros.wallgrammar import WallGrammar

    Language = type[LSystem] | type[WallGrammar] | type[MechanismGrammar] | type[
        RobotGrammar]

TREE_GRAMMAR, _WALL, _MECHANISM, _ROBOT, PLAN = '.lsys', '.wall', '.mech', '.urdf', '.plan'
SCANS = ('.csv', '.mtg', '.ply')  # of trees
_LANGUAGES = (TREE_GRAMMAR, _WALL, _MECHANISM, _ROBOT, *TRANSLATED)
GRAMMARS = (*_LANGUAGES, *SCANS)
SITES = (PLAN, *MAPS)  # of many objects
_WORDS = {'building': _WALL, 'mechanism': _MECHANISM}  # that begin texts of these languages


class Grammar(Protocol):
    """Common interface of parsed grammars of all languages, and of scanned trees."""

    def build(self, seed: int = 0, **defines: float) -> Blueprint: ...


def load_grammar(name: str, key: str, beside: Path | None = None) -> Grammar:
    """
    Read a grammar file.

    :param name: file beside the scene file or in the shared `grammars/` folder, a path, or
        package://procphys_ros/….
    :param key: parameter that named the file, for error messages.
    :param beside: folder of the scene file, searched first; None = there is none.
    :raises SceneError: when there is no such file, or its ending names no language.
    :raises GrammarError: when its text cannot be read.
    """
    with named_by(key, name):
        path = locate(name, key, beside)
        return _language_of(name, key, path).load(path)


def _language_of(name: str, key: str,
                 path: Path) -> 'Language | type[ScannedTree]':
    if path.name.endswith(SITES):
        raise SceneError(f'{key}: "{shorten(name)}" is a plan of many objects; it can only be '
                         'the grammar of an object in scene.objects')
    if path.suffix in SCANS:
        from procphys_ros.scans import ScannedTree
        return ScannedTree
    if path.suffix == '.xacro':
        raise SceneError(f'{key}: "{shorten(name)}" is not read: run "xacro FILE > robot.urdf" '
                         'first, and name that')
    if path.suffix not in _LANGUAGES:
        raise SceneError(f'{key}: "{shorten(name)}" ends in "{path.suffix}"; grammars end in '
                         f'{", ".join(_LANGUAGES)}, scanned trees in {", ".join(SCANS)}')
    return _language(path.suffix)


def parse_grammar(text: str, key: str) -> Grammar:
    """
    Read a grammar given as text; `building` and `mechanism` lines tell it from an L-system.

    A text that begins with "<" is a URDF.

    :param text: the grammar itself.
    :param key: parameter that holds the text; errors name it as their source.
    :raises GrammarError: when the text cannot be read.
    """
    check_length(text, key)
    words = (line.split('#')[0].split() for line in text.splitlines())
    found = (_WORDS[word[0]] for word in words if word and word[0] in _WORDS)
    bare = text.removeprefix('\ufeff')  # the mark that editors of Windows put in front
    xml = bare.lstrip().startswith('<')
    with named_by(key, text):
        return _language(_ROBOT if xml else next(found, TREE_GRAMMAR)).parse(bare, source=key)


def _language(suffix: str) -> 'Language':
    """Choose a language; all but the first take a tenth of all imports: only on demand."""
    if suffix == TREE_GRAMMAR or suffix in TRANSLATED:
        return LSystem
    if suffix in (_MECHANISM, _ROBOT):
        from procphys_ros.mechanism import MechanismGrammar, RobotGrammar
        return RobotGrammar if suffix == _ROBOT else MechanismGrammar
    from procphys_ros.wallgrammar import WallGrammar
    return WallGrammar


def locate(name: str, key: str, beside: Path | None) -> Path:
    """Find a file of a grammar, a plan or a map; see `load_grammar`."""
    if not name.strip() or not name.isprintable():
        raise SceneError(f'{key}: "{shorten(name)}" is not a file name')
    if name.startswith('package://'):
        if (shipped := shipped_file(name)) is None:
            raise SceneError(f'{key}: "{shorten(name)}" lies in another package; use a plain path '
                             'to it')
        candidates = [shipped]
    else:
        candidates = [shared_folder() / 'grammars' / name, Path(os.path.expanduser(name))]
        if beside is not None:
            candidates.insert(0, beside / name)
    refused = ''
    for path in candidates:
        if refused := outside(path):
            continue
        reason = _unreadable(path)
        if reason is None:
            return path
        if reason:
            raise SceneError(f'{key}: "{shorten(name)}" cannot be read: {reason}')
    if refused and Path(name).name != name:  # a mere name is more likely misspelt
        raise SceneError(f'{key}: "{shorten(name)}" cannot be read: {refused}')
    known = sorted(p.name for p in (shared_folder() / 'grammars').glob('*')
                   if p.name.endswith((*_LANGUAGES, *SITES)))
    raise SceneError(f'{key}: there is no grammar "{shorten(name)}"{nearest_names(name, known)} '
                     f'(shipped: {", ".join(known)}; or give a path)')


def _unreadable(path: Path) -> str | None:
    """Return why a file cannot be read, '' = it does not exist; None when it can."""
    try:
        mode = path.stat().st_mode
    except OSError as problem:
        gone = isinstance(problem, FileNotFoundError | NotADirectoryError)
        return '' if gone else problem.strerror or str(problem)
    except UnicodeEncodeError as problem:
        return f'names of files are {problem.encoding} here'
    if stat.S_ISDIR(mode):
        return 'it is a folder'
    return None if stat.S_ISREG(mode) else 'it is not a regular file'
