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

"""Growth: plants whose strings are derived in step, asking their habitat between steps."""

from collections.abc import Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass
import numbers
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from procphys_ros.blueprint import Blueprint, skeleton
from procphys_ros.environment import Plant, Question
from procphys_ros.errors import GrammarError
from procphys_ros.language import Expression, generator_of, resolve_defines
from procphys_ros.lsystem import walk
from procphys_ros.lsystem.compiler import CompiledGrammar
from procphys_ros.lsystem.drawing import HEAD
from procphys_ros.lsystem.modules import Modules
from procphys_ros.lsystem.symbols import FRAME_QUERIES, UNIT
from procphys_ros.lsystem.turtle_reader import Drawing, Turtle
from procphys_ros.schema import short

if TYPE_CHECKING:
    from procphys_ros.environment.habitat import Habitat

_MOST_STEPS = 10_000
_COLUMNS = dict(zip(FRAME_QUERIES, (walk.POSITION, walk.HEADING, walk.LEFT, walk.UP)))


@dataclass
class GrownString:
    """
    All that changes of a plant while its string is derived.

    :ivar key, values, origin: of the string, see `Modules`.
    :ivar identity: number of each module, kept while rules only change it, (M,).
    :ivar named: number of the next new module.
    :ivar steps: derivation steps so far.
    :ivar generator: of all random choices to come.
    """

    key: np.ndarray
    values: np.ndarray
    origin: np.ndarray
    identity: np.ndarray
    named: int
    steps: int
    generator: np.random.Generator


class Drawn(NamedTuple):
    """
    A plant as drawn, with the identities of its segments and leaves.

    :ivar blueprint: in the frame of the plant.
    :ivar segments, leaves: number of the module that drew each, and its place among those of this
        module, (S, 2), (L, 2).
    """

    blueprint: Blueprint
    segments: np.ndarray
    leaves: np.ndarray


class Growth:
    """
    A plant while its string is derived.

    :param grammar: its L-system.
    :param steps: number of derivation steps; None = that of the grammar.
    :param seed: of all random choices.
    :param defines: values that replace those of the grammar.
    :param root: pose of the turtle's origin, turned about the vertical only [m], (7,), world.
    :raises GrammarError: when a define or the number of steps is invalid.
    """

    def __init__(self, grammar: CompiledGrammar, steps: int | None, seed: int,
                 defines: Mapping[str, float], root: np.ndarray):
        self._grammar, self._root = grammar, root
        self._generator = generator_of(seed, grammar.source)
        self._values = resolve_defines(grammar.defines, defines, self._generator, grammar.source)
        self._length = self._read_length(steps)
        self._work = grammar.derivation.work()
        self.modules: Modules = grammar.derivation.first(self._values, self._generator, self._work)
        self._identity = np.arange(len(self.modules))
        self._named, self.steps = len(self.modules), 0
        self._is_query = np.array([name[0] == '?' for name in self.modules.vocabulary.names])
        self._asked: dict[str, np.ndarray] = {}  # modules by kind

    def advance(self) -> bool:
        """Derive the next string; return False when this was the last one."""
        if self.steps >= self._length:
            return False
        self.derive()
        return True

    def derive(self) -> None:
        """Derive the next string, also past the derivation length."""
        self.modules, row = self._grammar.derivation.following(
            self.modules, self._values, self._generator, self._work)
        fresh = row < 0
        identity = self._identity[row]
        identity[fresh] = self._named + np.arange(np.count_nonzero(fresh))
        self._identity, self._named = identity, self._named + int(np.count_nonzero(fresh))
        self.steps += 1

    def string(self) -> GrownString:
        """Return what changes while it grows; `resumed` continues from there."""
        modules = self.modules
        return GrownString(modules.key, modules.values, modules.origin, self._identity,
                           self._named, self.steps, self._generator)

    def resumed(self, string: GrownString | None = None) -> 'Growth':
        """Return a plant of its kind and place that continues from a string; None = its own."""
        own = self.string() if string is None else string
        other = copy(self)
        other.modules = Modules(self.modules.vocabulary, own.key, own.values.copy(), own.origin)
        other._identity, other._named, other.steps = own.identity, own.named, own.steps
        other._generator, other._asked = deepcopy(own.generator), {}
        other._work = self._grammar.derivation.work()
        return other

    @property
    def asks(self) -> bool:
        """Return whether there are queries in its grammar."""
        return bool(self._is_query.any())

    def ask(self) -> Plant:
        """Answer the queries for position and attitude, and list those to the environment."""
        generator = deepcopy(self._generator)  # the final drawing draws the same numbers
        interpreted, _ = self._interpret(generator)
        drawing, found = self._turtle(generator).survey(interpreted)
        place = np.cumsum(self._is_query[interpreted.key]) - 1
        rows = np.flatnonzero(self._is_query[self.modules.key])[place[found[:, 1].astype(int)]]
        names = np.array(self.modules.vocabulary.names)[self.modules.key[rows]]
        for name, column in _COLUMNS.items():
            own = names == name
            self._write(rows[own], found[own, HEAD + column:HEAD + column + 3])
        self._asked, questions = {}, []
        for name in dict.fromkeys(names[np.char.startswith(names, '?E')].tolist()):
            own, kind = names == name, name.partition(' ')[2]
            self._asked[kind] = rows[own]
            questions.append(Question(
                kind, found[own, HEAD + walk.POSITION:HEAD + walk.POSITION + 3],
                np.minimum(found[own, 0].astype(np.intp),
                           0 if drawing is None else len(drawing.branches) - 1)))
        built = None if drawing is None else build_drawn(drawing)
        return Plant(built, self._root, questions)

    def tell(self, answers: Mapping[str, np.ndarray]) -> None:
        """Write the answers of the environment into the string; see `Habitat.answer`."""
        for kind, values in answers.items():
            self._write(self._asked[kind], values)

    def interpreted(self) -> Modules:
        """Apply the interpretation rules to the string."""
        return self._interpret(self._generator)[0]

    def draw(self) -> Drawing:
        """Let the turtle read the interpreted string; an error when that draws nothing."""
        modules = self.interpreted()
        return self._turtle(self._generator).draw(modules)

    def drawn(self) -> Drawn | None:
        """Build the blueprint as after the last step; None when nothing of it is left."""
        generator = deepcopy(self._generator)  # the next step draws the same numbers
        modules, source = self._interpret(generator)
        drawing, _ = self._turtle(generator).survey(modules)
        if drawing is None:
            return None
        return Drawn(build_drawn(drawing), *(
            _numbered(self._identity[source[rows]])
            for rows in (drawing.segment_rows, drawing.leaf_rows)))

    def _write(self, rows: np.ndarray, values: np.ndarray) -> None:
        """Write values into as many parameters of modules as there are."""
        starts, counts = self.modules.starts[rows], self.modules.counts[rows]
        for column in range(values.shape[1]):
            taken = counts > column
            self.modules.values[starts[taken] + column] = values[taken, column]

    def _interpret(self, generator: np.random.Generator) -> tuple[Modules, np.ndarray]:
        depth = self._whole('maximum depth', self._grammar.depth, generator)
        return self._grammar.derivation.interpret(self.modules, depth, self._values, generator)

    def _turtle(self, generator: np.random.Generator) -> Turtle:
        angle = self._grammar.angle
        return Turtle(self._grammar.origins, self._grammar.source,
                      None if angle is None else angle.number(self._values, generator),
                      self._grammar.textures, self._read_unit(generator))

    def _read_unit(self, generator: np.random.Generator) -> float:
        unit = self._grammar.unit
        value = 1.0 if unit is None else unit.number(self._values, generator)
        if unit is not None and not UNIT.holds(np.asarray(value)):
            raise unit.place.error(f'the unit is {value:g}, it must be {UNIT}')
        return value

    def _read_length(self, steps: int | None) -> int:
        if steps is None:
            return self._whole('derivation length', self._grammar.steps, self._generator)
        if not isinstance(steps, numbers.Integral) or not 0 <= steps <= _MOST_STEPS:
            raise GrammarError(f'the number of steps must be a whole number, 0 to {_MOST_STEPS}, '
                               f'found {short(steps)}', self._grammar.source)
        return int(steps)

    def _whole(self, name: str, expression: Expression | None,
               generator: np.random.Generator) -> int:
        """Evaluate a count of the grammar, 1 where it says nothing."""
        if expression is None:
            return 1
        number = expression.number(self._values, generator)
        if number != int(number) or not 0 <= number <= _MOST_STEPS:
            raise expression.place.error(
                f'{name} must be a whole number from 0 to {_MOST_STEPS}, found {number:g}')
        return int(number)


def grow(plants: Sequence[Growth], habitat: 'Habitat | None' = None) -> None:
    """
    Derive the strings of plants that grow together to their ends.

    Strings with fewer steps than others wait, and are in the way of these, as is a plant that
    asks nothing.

    :param habitat: where they grow; None = alone, on level ground under an open sky.
    :raises GrammarError: when one cannot be derived or drawn.
    """
    asks = any(plant.asks for plant in plants)
    if asks and habitat is None:
        from procphys_ros.environment.habitat import Habitat  # with the tree kernel
        habitat = Habitat()
    growing = True
    while growing:
        if asks and habitat is not None:
            for plant, answers in zip(plants, habitat.answer([p.ask() for p in plants])):
                plant.tell(answers)
        advanced = [plant.advance() for plant in plants]
        growing = any(advanced)


def _numbered(owner: np.ndarray) -> np.ndarray:
    """Count what each owner has, in its order; return owners and numbers, (K, 2)."""
    order = np.argsort(owner, kind='stable')
    first = np.flatnonzero(np.diff(owner[order], prepend=-1))
    number = np.empty(len(owner), np.intp)
    number[order] = np.arange(len(owner)) - np.repeat(first, np.diff(first, append=len(owner)))
    return np.column_stack([owner, number])


def build_drawn(drawing: Drawing) -> Blueprint:
    """Build the blueprint of a drawing."""
    return skeleton.build(drawing.branches, drawing.leaves, drawing.ornaments, drawing.textures,
                          polygons=drawing.polygons)
