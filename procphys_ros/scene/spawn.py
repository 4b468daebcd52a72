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


"""Spawn: an object to add to a running scene, as the parameters `spawn.…` describe it."""

from dataclasses import dataclass
from pathlib import Path
import re

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.scene.objects import read_defines
from procphys_ros.scene.sources import load_grammar, parse_grammar
from procphys_ros.schema import declared, ParameterGroup, short

_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]{0,99}\Z')


@dataclass(frozen=True)
class Spawn(ParameterGroup, group='spawn'):
    """Object to add to a running scene."""

    name: str = declared('', 'of the object that ~/spawn adds and ~/remove takes out; for ~/spawn '
                         'empty = one that is free, such as oak_0')
    grammar: str = declared('', 'file in grammars/, a path, or package://procphys_ros/…; or a '
                            'scanned tree')
    grammar_text: str = declared('', 'the grammar itself; spawn.grammar then names the object')
    defines: tuple[str, ...] = declared(
        (), 'values that override the grammar\'s own, as "name=number"')
    seed: int = declared(0, 'of what is random in the grammar', '', 0, 2**62)
    position: tuple[float, ...] = declared(
        (0.0, 0.0, 0.0), 'where it is put; z counts from the ground', 'm', -1e6, 1e6)
    yaw: float = declared(0.0, 'heading about the vertical', 'rad', -1e3, 1e3)

    @property
    def stem(self) -> str:
        """Return the stem of the names of objects that are given no name."""
        stem = re.sub(r'\W', '_', Path(self.grammar).stem, flags=re.ASCII)
        return stem if _NAME.match(stem) else 'object'

    def check_name(self) -> None:
        """
        Check that the name, if there is one, can name an object.

        :raises CommandError: when it cannot.
        """
        if self.name and not _NAME.match(self.name):
            raise CommandError(f'spawn.name: {short(self.name)} cannot name an object; use up to '
                               '100 letters, digits and _, beginning with a letter')

    def build(self) -> Blueprint:
        """
        Derive the grammar.

        :raises SceneError: when there is no grammar, or a define is invalid.
        :raises GrammarError: when it cannot be read or derived.
        """
        if not self.grammar and not self.grammar_text:
            raise SceneError('spawn: give either spawn.grammar (a file) or spawn.grammar_text '
                             '(the grammar itself)')
        numbers = read_defines(self.defines, 'spawn.defines')
        grammar = (parse_grammar(self.grammar_text, 'spawn.grammar_text') if self.grammar_text
                   else load_grammar(self.grammar, 'spawn.grammar'))
        return grammar.build(seed=self.seed, **numbers)
