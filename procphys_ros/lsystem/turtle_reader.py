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


"""Turtle: read a string of modules as a branch structure with leaves and ornaments."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.errors import GrammarError
from procphys_ros.language import Place
from procphys_ros.lsystem import walk
from procphys_ros.lsystem.drawing import draw, Drawing, HEAD, leaf_textures, TEXTURE
from procphys_ros.lsystem.modules import Modules
from procphys_ros.lsystem.symbols import (
    ARGUMENT_RANGES,
    arity_message,
    ATTRIBUTE_INDEX,
    ATTRIBUTES,
    LEAF_SIZE,
    LENGTH,
    Op,
    Range,
    REACH,
    Symbol,
    SYMBOLS,
    TEXTURE_NUMBER,
)

DEFAULT_TEXTURES = ('bark', 'leaf')
_DEEPEST = 10_000  # nested brackets; the turtle's whole state is kept for each
_NOTHING = Symbol(Op.NOTHING, ())
_WIDTH = HEAD + walk.VALUES + ATTRIBUTE_INDEX['Width']


@dataclass(frozen=True)
class Turtle:
    """
    Turtle that interprets strings of modules.

    :ivar origins: place and name of every module of the grammar, for errors.
    :ivar source: name of the grammar.
    :ivar angle: of turns without a parameter [degrees]; None = such turns are refused.
    :ivar textures: names of the grammar's textures; empty = the default ones.
    :ivar unit: of all lengths in the grammar [m].
    """

    origins: Sequence[tuple[Place, str]]
    source: str
    angle: float | None
    textures: tuple[str, ...] = ()
    unit: float = 1.0

    def draw(self, modules: Modules) -> Drawing:
        """
        Interpret a string from the origin, heading up.

        :param modules: the string; modules without a meaning are skipped.
        :raises GrammarError: for values out of range, naming symbol and place.
        """
        drawing = self.survey(modules)[0]
        if drawing is None:
            raise GrammarError('the string draws no segment; F(length) draws one', self.source)
        return drawing

    def survey(self, modules: Modules) -> tuple[Drawing | None, np.ndarray]:
        """
        Interpret a string, and find where its queries stand; otherwise as `draw`.

        :returns: the drawing, None when nothing is drawn yet; and for each query that is not cut
            off its carrier, its module, and from column `HEAD` on the turtle's state, (Q, …).
        """
        *tables, queries = self._walk(modules)
        if not len(tables[0]):
            return None, queries
        segments, pieces, leaves, triangles = tables
        textures = self._texture_names(modules, segments, leaves, triangles, pieces)
        return draw(modules, (segments, pieces, leaves, triangles), textures), queries

    def _walk(self, modules: Modules) -> tuple[np.ndarray, ...]:
        """Follow a string; return the checked tables of `walk.walk` that have a module each."""
        meanings = [SYMBOLS.get(name, _NOTHING) for name in modules.vocabulary.names]
        op = np.array([m.op for m in meanings], np.int64)[modules.key]
        argument = np.array([m.argument for m in meanings], np.int64)[modules.key]
        self._check_symbols(modules, op, argument, meanings)
        tables = self._tables(op)
        depth = int(np.max(np.cumsum((op == Op.PUSH) * 1 - (op == Op.POP) * 1), initial=0))
        if depth > _DEEPEST:
            raise GrammarError(f'branches are nested {depth} deep, the limit is {_DEEPEST}',
                               self.source)
        fault, at, filled = walk.walk(
            op, argument, modules.starts, modules.counts, modules.values, _first_state(),
            depth + 1, int(np.count_nonzero(op == Op.POLYGON)) + 1, tables)
        if fault:
            raise self._error(modules, at, walk.FAULTS[fault])
        found = tuple(table[:count] for table, count in zip(tables[:5], filled))
        self._scale_to_metres(*found)
        segments, pieces, leaves, triangles, queries = found
        self._check_segments(modules, segments)
        self._check_reach(modules, segments, leaves, pieces, triangles, queries)
        return found

    def _scale_to_metres(self, *tables: np.ndarray) -> None:
        """Scale lengths, sizes, widths and places, which the walk takes as they are written."""
        if self.unit == 1.0:
            return
        segments, pieces, leaves, triangles, queries = tables
        for table in (segments, pieces, leaves, queries):
            table[:, 2:HEAD + 3] *= self.unit
            table[:, _WIDTH] *= self.unit
        triangles[:, 3:] *= self.unit

    def _tables(self, op: np.ndarray) -> tuple:
        """
        Allocate the tables that the walk fills.

        :returns: segments, boneless segments and leaves (rows of carrier, module, length or size,
            and the whole state), triangles (carrier, module, texture, three corners), queries
            (rows as those of segments), corners of open polygons, and the angle of turns without
            a parameter [rad].
        """
        count = np.bincount(op, minlength=len(Op))
        width = HEAD + walk.STATE_SIZE
        corners = 0
        if count[Op.POLYGON]:
            corners = count[Op.VERTEX] + count[Op.SEGMENT] + count[Op.MOVE]
        angle = np.nan if self.angle is None else np.radians(self.angle)
        return (np.empty((count[Op.SEGMENT], width)),
                np.empty((count[Op.ORNAMENT_SEGMENT], width)), np.empty((count[Op.LEAF], width)),
                np.empty((corners, 12)), np.empty((count[Op.QUERY], width)),
                np.empty((corners, 3)), float(angle))

    def _error(self, modules: Modules, row: int, message: str) -> GrammarError:
        place, name = self.origins[modules.origin[row]]
        return place.error(f'{name} {message}')

    def _check(self, modules: Modules, rows: np.ndarray, values: np.ndarray,
               allowed: Range) -> None:
        """Check that values, one for each row, lie in a range."""
        if allowed.unit == 'm':
            values = values * self.unit
        wrong = np.flatnonzero(~allowed.holds(values))
        if len(wrong):
            raise self._error(modules, int(rows[wrong[0]]),
                              f'is {values[wrong[0]]:g}, it must be {allowed}')

    def _check_symbols(self, modules: Modules, op: np.ndarray, argument: np.ndarray,
                       meanings: Sequence[Symbol]) -> None:
        """Check counts and values of the parameters as written."""
        present = np.bincount(modules.key, minlength=len(meanings)) > 0
        for key in np.flatnonzero(present).tolist():
            arity = modules.vocabulary.arities[key]
            if meanings[key].arities and arity not in meanings[key].arities:
                row = int(np.argmax(modules.key == key))
                raise self._error(modules, row, arity_message(meanings[key], arity))
        counts, starts = modules.counts, modules.starts
        turns = np.isin(op, (Op.TURN, Op.PITCH, Op.ROLL)) & (counts == 0) & (argument != 0)
        if self.angle is None and turns.any():
            raise self._error(modules, int(np.argmax(turns)),
                              'has no angle; write one, or "angle: 25" for all')
        for which, allowed in ARGUMENT_RANGES.items():
            rows = np.repeat(np.flatnonzero(op == which), counts[op == which])
            self._check(modules, rows, modules.values[np.repeat(op == which, counts)], allowed)
        rows = np.flatnonzero((op == Op.LEAF) & (counts > 0))
        self._check(modules, rows, modules.values[starts[rows]], LEAF_SIZE)
        rows = rows[counts[rows] == 2]
        self._check_texture(modules, rows, modules.values[starts[rows] + 1])
        for index, attribute in enumerate(ATTRIBUTES):
            rows = np.flatnonzero((op == Op.ATTRIBUTE) & (argument == index) & (counts == 1))
            values = modules.values[starts[rows]]
            if attribute.name == 'Texture':
                self._check_texture(modules, rows, values)
            else:
                self._check(modules, rows, values, attribute.allowed)

    def _check_texture(self, modules: Modules, rows: np.ndarray, values: np.ndarray) -> None:
        allowed = TEXTURE_NUMBER
        if self.textures:
            allowed = Range(0.0, len(self.textures) - 1.0)
        wrong = np.flatnonzero(~allowed.holds(values) | (values != np.floor(values)))
        if len(wrong):
            raise self._error(
                modules, int(rows[wrong[0]]), f'is {values[wrong[0]]:g}, it must be a texture '
                f'number {allowed}' + (f' ({", ".join(self.textures)})' if self.textures else ''))

    def _check_segments(self, modules: Modules, segments: np.ndarray) -> None:
        """Check lengths in metres, and that rates have not driven values out of range."""
        rows = segments[:, 1].astype(np.int64)
        short = np.flatnonzero(~LENGTH.holds(segments[:, 2]))
        if len(short):
            raise self._error(modules, int(rows[short[0]]), f'is {segments[short[0], 2]:g} m '
                              f'long, it must be {LENGTH}; check the unit')
        for index, attribute in enumerate(ATTRIBUTES):
            values = segments[:, HEAD + walk.VALUES + index]
            wrong = ~attribute.allowed.holds(values)
            if np.isnan(attribute.default):
                wrong &= ~np.isnan(values)
            elif np.isinf(attribute.default):
                wrong &= ~np.isinf(values)
            if wrong.any():
                first = int(np.argmax(wrong))
                raise self._error(
                    modules, int(rows[first]), f'would get a {attribute.name} of '
                    f'{values[first]:g}, it must be {attribute.allowed}; '
                    f'check {attribute.name} and {attribute.name}Rate')

    def _check_reach(self, modules: Modules, *tables: np.ndarray) -> None:
        """Check that coordinates and sizes of leaves lie in their ranges."""
        segments, leaves, pieces, triangles, queries = tables
        for table, first, last in ((segments, HEAD, HEAD + 3), (leaves, HEAD, HEAD + 3),
                                   (pieces, HEAD, HEAD + 3), (triangles, 3, 12),
                                   (queries, HEAD, HEAD + 3)):
            wrong = ~REACH.holds(table[:, first:last]).all(axis=1)
            if wrong.any():
                row = int(np.argmax(wrong))
                where = ', '.join(f'{x:g}' for x in table[row, first:first + 3])
                raise self._error(modules, int(table[row, 1]), f'would stand at ({where}); '
                                  f'coordinates must be {REACH}')
        wrong = ~LEAF_SIZE.holds(leaves[:, 2])
        if wrong.any():
            row = int(np.argmax(wrong))
            raise self._error(modules, int(leaves[row, 1]), f'would get a size of '
                              f'{leaves[row, 2]:g}, it must be {LEAF_SIZE}; check LeafRate')

    def _texture_names(self, modules: Modules, *tables: np.ndarray) -> tuple[str, ...]:
        segments, leaves, triangles, pieces = tables
        names = self.textures or DEFAULT_TEXTURES
        for table, at in ((segments, TEXTURE), (pieces, TEXTURE), (triangles, 2)):
            if len(table) and table[:, at].max() >= len(names):
                if self.textures:
                    row = int(table[np.argmax(table[:, at]), 1])
                    raise self._error(modules, row, f'asks for texture {table[:, at].max():g}; '
                                      f'textures are 0 to {len(names) - 1}')
                names += tuple(f'texture_{i}' for i in range(
                    len(names), int(table[:, at].max()) + 1))
        given = leaf_textures(modules, leaves, len(names))
        return names + tuple(f'texture_{i}' for i in range(
            len(names), int(given.max(initial=0)) + 1))


def _first_state() -> np.ndarray:
    """Return the state at the origin: left, up, heading along the world's x, y, z."""
    state = np.zeros(walk.STATE_SIZE)
    state[walk.HEADING + 2] = state[walk.LEFT] = state[walk.UP + 1] = 1.0
    state[walk.PARENT] = -1.0
    state[walk.VALUES:walk.RATES] = [attribute.default for attribute in ATTRIBUTES]
    state[walk.RATES:] = 1.0
    return state
