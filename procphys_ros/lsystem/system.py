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


"""L-system: from the text of a grammar to strings and blueprints."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.geometry import rotation
from procphys_ros.language import check_length, GrammarFile
from procphys_ros.lsystem.compiler import compile_grammar, CompiledGrammar
from procphys_ros.lsystem.growth import build_drawn, grow, Growth
from procphys_ros.lsystem.modules import Modules
from procphys_ros.lsystem.turtle_reader import Drawing

MAX_MODULES = 2_000_000  # longest string; about 1 GB while the turtle reads it
_NO_DEFINES: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class LSystem(GrammarFile):
    """
    A compiled L-system.

    :ivar grammar: its rules and settings.
    """

    grammar: CompiledGrammar

    @classmethod
    def parse(cls, text: str, source: str = '<text>', max_modules: int = MAX_MODULES,
              folder: Path | None = None) -> 'LSystem':
        """
        Read a grammar.

        :param text: in the language of `grammars/*.lsys`.
        :param source: name for errors.
        :param max_modules: longest string that it may derive.
        :param folder: searched for included files before the shipped ones.
        :raises GrammarError: when the text is not an L-system, or very long.
        """
        check_length(text, source)
        return cls(compile_grammar(text, source, max_modules, folder))

    @property
    def name(self) -> str:
        """Name stated in the grammar."""
        return self.grammar.name

    @property
    def defines(self) -> tuple[str, ...]:
        """Names that `derive` and `build` can override."""
        return tuple(name for name, _ in self.grammar.defines)

    def derive(self, /, steps: int | None = None, seed: int = 0, **defines: float) -> Modules:
        """
        Derive the string, before interpretation.

        :param steps: number of derivation steps; None = that of the grammar.
        :param seed: of all random choices; the same seed gives the same string.
        :param defines: values that replace those of the grammar.
        :raises GrammarError: when growth passes its bounds or an expression has no value.
        """
        return self._grow(steps, seed, defines).modules

    def interpret(self, /, steps: int | None = None, seed: int = 0, **defines: float) -> Modules:
        """Derive the string and apply the interpretation rules; parameters as in `derive`."""
        return self._grow(steps, seed, defines).interpreted()

    def draw(self, /, steps: int | None = None, seed: int = 0, **defines: float) -> Drawing:
        """Let the turtle read the interpreted string; parameters as in `derive`."""
        return self._grow(steps, seed, defines).draw()

    def build(self, /, seed: int = 0, **defines: float) -> Blueprint:
        """
        Build the blueprint of the tree.

        :param seed: of all random choices.
        :param defines: values that replace those of the grammar.
        :returns: parts and bonds at rest, rooted at the origin.
        :raises GrammarError: when the string cannot be derived or drawn.
        """
        return build_drawn(self._grow(None, seed, defines).draw())

    @property
    def asks(self) -> bool:
        """Return whether plants ask where they stand; `build` grows them alone in the open."""
        return any(name[0] == '?' for name in self.grammar.derivation.vocabulary.names)

    def plant(self, root: np.ndarray, seed: int = 0,
              defines: Mapping[str, float] = _NO_DEFINES, steps: int | None = None) -> Growth:
        """
        Plant one that is to grow among others; see `grow`.

        :param root: pose of its origin, turned about the vertical only [m], (7,), world.
        :param seed: of all random choices.
        :param defines: values that replace those of the grammar.
        :param steps: number of derivation steps; None = that of the grammar.
        """
        return Growth(self.grammar, steps, seed, defines, root)

    def _grow(self, steps: int | None, seed: int, defines: Mapping[str, float]) -> Growth:
        growth = self.plant(rotation.ORIGIN, seed, defines, steps)
        grow([growth])
        return growth
