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

"""Find grammars, tell the two languages apart, and build blueprints from them."""

from pathlib import Path
from typing import Protocol

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.lsystem import LSystem
from procphys_ros.resources import shared_folder
from procphys_ros.wallgrammar import WallGrammar

_LANGUAGES: dict[str, type[LSystem] | type[WallGrammar]] = {
    '.lsys': LSystem, '.wall': WallGrammar}
_PACKAGE = 'package://procphys_ros/'


class Grammar(Protocol):
    """What both grammar languages offer once a text has been read."""

    def build(self, seed: int = 0, **defines: float) -> Blueprint: ...


def load_grammar(name: str, key: str) -> Grammar:
    """
    Read a grammar file.

    :param name: file in the shared `grammars/` folder, a path, or package://procphys_ros/….
    :param key: parameter that named the file, for error messages.
    :raises SceneError: when there is no such file, or its ending names no language.
    :raises GrammarError: when its text cannot be read.
    """
    path = _locate(name, key)
    language = _LANGUAGES.get(path.suffix)
    if language is None:
        raise SceneError(f'{key}: "{name}" ends in "{path.suffix}"; '
                         f'grammars end in {" or ".join(_LANGUAGES)}')
    return language.load(path)


def parse_grammar(text: str, key: str) -> Grammar:
    """
    Read a grammar given as text; a wall grammar is known by its `building` line.

    :param text: the grammar itself.
    :param key: parameter that holds the text; errors name it as their source.
    :raises GrammarError: when the text cannot be read.
    """
    words = (line.split('#')[0].split() for line in text.splitlines())
    is_wall = any(word and word[0] == 'building' for word in words)
    return (WallGrammar if is_wall else LSystem).parse(text, source=key)


def _locate(name: str, key: str) -> Path:
    if '\0' in name or not name.strip():
        raise SceneError(f'{key}: {name!r} is not a file name')
    if name.startswith('package://'):
        if not name.startswith(_PACKAGE):
            raise SceneError(f'{key}: "{name}" lies in another package; use a plain path to it')
        candidates = [shared_folder() / name[len(_PACKAGE):]]
    else:
        candidates = [shared_folder() / 'grammars' / name, Path(name).expanduser()]
    for path in candidates:
        if path.is_file():
            return path
    known = sorted(p.name for p in (shared_folder() / 'grammars').glob('*')
                   if p.suffix in _LANGUAGES)
    raise SceneError(f'{key}: there is no grammar "{name}"{nearest_names(name, known)} '
                     f'(shipped: {", ".join(known)}; or give a path)')
