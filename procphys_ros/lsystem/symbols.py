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


"""Symbols that the turtle understands: movement, drawing and the physics of wood."""

from typing import NamedTuple

import numpy as np

from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.environment import KINDS
from procphys_ros.physics.air import SHEDDING_SPEED, VOGEL_EXPONENT


class Op(ArrayEnum):
    """Action of the turtle for a module."""

    NOTHING = 0
    SEGMENT = 1
    ORNAMENT_SEGMENT = 2
    MOVE = 3
    PUSH = 4
    POP = 5
    CUT = 6
    TURN = 7        # about up, + and -
    PITCH = 8       # about left, & and ^
    ROLL = 9        # about heading, \ and /
    LEVEL = 10      # $
    ORIENT = 11     # @R
    TROPISM = 12
    POLYGON = 13
    VERTEX = 14
    FILL = 15
    LEAF = 16
    NEXT_TEXTURE = 17
    ATTRIBUTE = 18
    RATE = 19
    QUERY = 20      # ?P and its like: answered, not drawn


class Range(NamedTuple):
    """
    Range of allowed values, both ends included.

    :ivar low, high: ends.
    :ivar unit: of both; empty = none.
    """

    low: float
    high: float
    unit: str = ''

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Mark the values inside the range, with a tolerance for rounding; NaN is outside."""
        return ((values >= self.low - 1e-9 * abs(self.low))
                & (values <= self.high + 1e-9 * abs(self.high)))

    def __str__(self) -> str:
        return f'from {self.low:g} to {self.high:g} {self.unit}'.rstrip()


class Attribute(NamedTuple):
    """
    Numeric attribute of the turtle's state that segments inherit.

    :ivar name: of the symbol; `<name>Rate` sets the factor applied after each segment.
    :ivar default: value when the grammar says nothing; NaN = derived from other values.
    :ivar allowed: values that a segment may have.
    """

    name: str
    default: float
    allowed: Range


# Ranges exceed anything that grows or is built (the widest trunk measures 14 m, the tallest tree
# 116 m; densities from aerogel to osmium, moduli from gel to diamond), and end before products
# and quotients of them lose their precision.
_STIFFNESS = Range(1e-12, 1e15, 'N·m/rad')  # what E·I/L can give
_DAMPING = Range(0.0, 1e15, 'N·m·s/rad')
LENGTH = Range(1e-4, 1000.0, 'm')           # of one segment
STEP = Range(-1000.0, 1000.0, 'm')          # of `f`, which may go backwards
LEAF_SIZE = Range(1e-4, 100.0, 'm')
UNIT = Range(1e-6, 1e6, 'm')              # in which a grammar gives its lengths
RATE = Range(0.0, 1000.0)
ANGLE = Range(-1e9, 1e9, 'degrees')
TROPISM = Range(-1e6, 1e6)
REACH = Range(-1e4, 1e4, 'm')               # coordinates of everything drawn
TEXTURE_NUMBER = Range(0.0, float(np.iinfo(np.int16).max))

# Green birch (ForestGALES species table: 900 kg/m3, 9.9 GPa) is the default wood. Internal
# damping of trees is below 5 % (Moore and Maguire 2004, Trees 18).
ATTRIBUTES = (
    Attribute('Width', 0.1, Range(1e-4, 30.0, 'm')),
    Attribute('Density', 900.0, Range(0.1, 25e3, 'kg/m³')),
    Attribute('Modulus', 9.9e9, Range(1e3, 2e12, 'Pa')),
    Attribute('Strength', np.inf, Range(1.0, 1e12, 'Pa')),
    Attribute('Yield', np.inf, Range(1.0, 1e12, 'Pa')),
    Attribute('DampingRatio', 0.05, Range(0.0, 10.0)),
    Attribute('SwingLimit', 60.0, Range(1e-3, 180.0, 'degrees')),
    Attribute('SwingForce', np.nan, _STIFFNESS),   # absent: E·I/L
    Attribute('SwingDamper', np.nan, _DAMPING),    # absent: from DampingRatio
    Attribute('TwistForce', np.nan, _STIFFNESS),   # absent: locked
    Attribute('TwistDamper', np.nan, _DAMPING),    # absent: from DampingRatio
    Attribute('StretchForce', np.nan, _STIFFNESS._replace(unit='N/m')),  # absent: locked
    Attribute('StretchDamper', np.nan, _DAMPING._replace(unit='N·s/m')),
    Attribute('BreakForce', np.inf, Range(1e-9, 1e15, 'N')),
    Attribute('BreakTorque', np.inf, Range(1e-9, 1e15, 'N·m')),
    Attribute('RootStiffness', np.nan, _STIFFNESS),  # absent: clamped in the ground
    Attribute('RootMoment', np.inf, Range(1e-9, 1e15, 'N·m')),
    Attribute('Preload', 1.0, Range(0.0, 1.0)),    # 0: drawn as it would be without weight
    Attribute('Cling', 0.0, Range(0.0, 1e9, 'N/m')),  # hold on its support; 0: none
    Attribute('BoneRatio', 0.9, Range(0.8, 0.95)),  # bone length over segment length
    Attribute('Texture', 0.0, TEXTURE_NUMBER),
    Attribute('Vogel', VOGEL_EXPONENT, Range(-2.0, 0.0)),  # foliage drag ~ u^(2 + V)
    Attribute('SheddingSpeed', SHEDDING_SPEED, Range(0.5, 1000.0, 'm/s')),
    Attribute('Leaf', 1.0, Range(0.0, 1e6)),        # factor on the sizes of leaves, for LeafRate
)
ATTRIBUTE_INDEX = {attribute.name: i for i, attribute in enumerate(ATTRIBUTES)}


class Symbol(NamedTuple):
    """
    Symbol with a meaning for the turtle.

    :ivar op: action.
    :ivar arities: numbers of parameters it may have.
    :ivar argument: sign of a turn, or index of an attribute.
    """

    op: Op
    arities: tuple[int, ...]
    argument: int = 0


FRAME_QUERIES = ('?P', '?H', '?L', '?U')  # position, heading, left and up


def asking(kind: str) -> str:
    """Return the name of the module that asks the environment something: `?E(kind; …)`."""
    return f'?E {kind}'


def _symbols() -> dict[str, Symbol]:
    table = {
        'F': Symbol(Op.SEGMENT, (0, 1)), 'G': Symbol(Op.ORNAMENT_SEGMENT, (0, 1)),
        'f': Symbol(Op.MOVE, (0, 1)), '[': Symbol(Op.PUSH, (0,)), ']': Symbol(Op.POP, (0,)),
        '%': Symbol(Op.CUT, (0,)),
        '+': Symbol(Op.TURN, (0, 1), 1), '-': Symbol(Op.TURN, (0, 1), -1),
        '&': Symbol(Op.PITCH, (0, 1), 1), '^': Symbol(Op.PITCH, (0, 1), -1),
        '\\': Symbol(Op.ROLL, (0, 1), 1), '/': Symbol(Op.ROLL, (0, 1), -1),
        '|': Symbol(Op.TURN, (0,), 0), '$': Symbol(Op.LEVEL, (0,)),
        '@v': Symbol(Op.LEVEL, (0,)), '@R': Symbol(Op.ORIENT, (3, 6)),
        'Tropism': Symbol(Op.TROPISM, (4,)),
        '{': Symbol(Op.POLYGON, (0,)), '.': Symbol(Op.VERTEX, (0,)), '}': Symbol(Op.FILL, (0,)),
        '~': Symbol(Op.LEAF, (1, 2)), 'Leaf': Symbol(Op.LEAF, (1, 2)),
        "'": Symbol(Op.NEXT_TEXTURE, (0,)),
    }
    for i, attribute in enumerate(ATTRIBUTES):
        if attribute.name != 'Leaf':
            table[attribute.name] = Symbol(Op.ATTRIBUTE, (1,), i)
        table[attribute.name + 'Rate'] = Symbol(Op.RATE, (1,), i)
    table |= {name: Symbol(Op.QUERY, (3,)) for name in FRAME_QUERIES}
    table |= {asking(kind): Symbol(Op.QUERY, kinds) for kind, kinds in KINDS.items()}
    table['!'] = Symbol(Op.ATTRIBUTE, (0, 1), ATTRIBUTE_INDEX['Width'])
    return table


SYMBOLS = _symbols()
LONG_NAMES = frozenset(name for name in SYMBOLS if len(name) > 1 and name[0].isalpha())


# Allowed values of the parameters of symbols other than attributes.
ARGUMENT_RANGES = {
    Op.SEGMENT: LENGTH, Op.ORNAMENT_SEGMENT: LENGTH, Op.MOVE: STEP, Op.RATE: RATE,
    Op.TURN: ANGLE, Op.PITCH: ANGLE, Op.ROLL: ANGLE, Op.TROPISM: TROPISM,
}


def arity_message(symbol: Symbol, found: int) -> str:
    """Format the allowed numbers of parameters of a symbol, and the number found."""
    wanted = ' or '.join(map(str, symbol.arities))
    return f'takes {wanted} parameter{"s" * (symbol.arities != (1,))}, found {found}'
