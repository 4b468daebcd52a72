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

from dataclasses import dataclass
import numbers
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Blueprint, skeleton
from procphys_ros.errors import GrammarError
from procphys_ros.language import (
    check_length,
    Expression,
    find_grammar,
    generator_of,
    read_text,
    resolve_defines,
)
from procphys_ros.lsystem.compiler import compile_grammar, CompiledGrammar
from procphys_ros.lsystem.modules import Modules
from procphys_ros.lsystem.turtle_reader import Drawing, Turtle
from procphys_ros.schema import short

MAX_MODULES = 2_000_000  # longest string; about 1 GB while the turtle reads it
_MOST_STEPS = 10_000


@dataclass(frozen=True)
class LSystem:
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

    @classmethod
    def load(cls, path: str | Path, max_modules: int = MAX_MODULES) -> 'LSystem':
        """
        Read a grammar file.

        :param path: of the file, or the name of a shipped grammar, such as oak.lsys.
        :param max_modules: longest string that it may derive.
        :raises GrammarError: when the file cannot be read or is not an L-system.
        """
        found = find_grammar(path)
        return cls.parse(read_text(found), str(path), max_modules, found.absolute().parent)

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
        return self._derive(steps, generator_of(seed, self.grammar.source), defines)[0]

    def interpret(self, /, steps: int | None = None, seed: int = 0, **defines: float) -> Modules:
        """Derive the string and apply the interpretation rules; parameters as in `derive`."""
        return self._interpret(steps, generator_of(seed, self.grammar.source), defines)[0]

    def draw(self, /, steps: int | None = None, seed: int = 0, **defines: float) -> Drawing:
        """Let the turtle read the interpreted string; parameters as in `derive`."""
        return self._draw(steps, seed, defines)

    def _draw(self, steps: int | None, seed: int, overrides: dict[str, float]) -> Drawing:
        generator = generator_of(seed, self.grammar.source)
        modules, values = self._interpret(steps, generator, overrides)
        angle = self.grammar.angle
        turtle = Turtle(self.grammar.origins, self.grammar.source,
                        None if angle is None else angle.number(values, generator),
                        self.grammar.textures)
        return turtle.draw(modules)

    def build(self, /, seed: int = 0, **defines: float) -> Blueprint:
        """
        Build the blueprint of the tree.

        :param seed: of all random choices.
        :param defines: values that replace those of the grammar.
        :returns: parts and bonds at rest, rooted at the origin.
        :raises GrammarError: when the string cannot be derived or drawn.
        """
        drawing = self._draw(None, seed, defines)
        return skeleton.build(drawing.branches, drawing.leaves, drawing.ornaments,
                              drawing.textures, polygons=drawing.polygons)

    def _derive(self, steps: int | None, generator: np.random.Generator,
                overrides: dict[str, float]) -> tuple[Modules, dict[str, float]]:
        grammar = self.grammar
        values = resolve_defines(grammar.defines, overrides, generator, grammar.source)
        if steps is None:
            steps = self._count('derivation length', grammar.steps, 1, values, generator)
        elif not isinstance(steps, numbers.Integral) or not 0 <= steps <= _MOST_STEPS:
            raise GrammarError(f'the number of steps must be a whole number, 0 to {_MOST_STEPS}, '
                               f'found {short(steps)}', grammar.source)
        return grammar.derivation.derive(steps, values, generator), values

    def _interpret(self, steps: int | None, generator: np.random.Generator,
                   overrides: dict[str, float]) -> tuple[Modules, dict[str, float]]:
        modules, values = self._derive(steps, generator, overrides)
        depth = self._count('maximum depth', self.grammar.depth, 1, values, generator)
        modules = self.grammar.derivation.interpret(modules, depth, values, generator)
        return modules, values

    def _count(self, name: str, expression: Expression | None, default: int,
               values: dict[str, float], generator: np.random.Generator) -> int:
        if expression is None:
            return default
        number = expression.number(values, generator)
        if number != int(number) or not 0 <= number <= _MOST_STEPS:
            raise expression.place.error(
                f'{name} must be a whole number from 0 to {_MOST_STEPS}, found {number:g}')
        return int(number)
