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

from enum import IntEnum
from typing import NamedTuple

import numpy as np


class Op(IntEnum):
    """What the turtle does for a module."""

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


class Attribute(NamedTuple):
    """
    A number of the turtle's state that segments take over.

    :ivar name: of the symbol; `<name>Rate` sets the factor applied after each segment.
    :ivar default: value when the grammar says nothing; NaN = derived from other values.
    :ivar positive: whether zero is refused.
    """

    name: str
    default: float
    positive: bool


# Green birch (ForestGALES species table: 900 kg/m3, 9.9 GPa) stands for wood of which a grammar
# says nothing. Internal damping of trees is below 5 % (Moore and Maguire 2004, Trees 18).
ATTRIBUTES = (
    Attribute('Width', 0.1, True),            # [m]
    Attribute('Density', 900.0, True),        # [kg/m3]
    Attribute('Modulus', 9.9e9, True),        # [Pa]
    Attribute('Strength', np.inf, True),      # [Pa]
    Attribute('DampingRatio', 0.05, False),
    Attribute('SwingLimit', 60.0, True),      # [degrees]
    Attribute('SwingForce', np.nan, True),    # [N m/rad], absent: E I / L
    Attribute('SwingDamper', np.nan, False),  # [N m s/rad], absent: from DampingRatio
    Attribute('TwistForce', np.nan, True),    # [N m/rad], absent: locked
    Attribute('TwistDamper', np.nan, False),  # [N m s/rad], absent: from DampingRatio
    Attribute('StretchForce', np.nan, True),  # [N/m], absent: locked
    Attribute('StretchDamper', np.nan, False),  # [N s/m], absent: from DampingRatio
    Attribute('BreakForce', np.inf, True),    # [N]
    Attribute('BreakTorque', np.inf, True),   # [N m]
    Attribute('BoneRatio', 0.9, True),
    Attribute('Texture', 0.0, False),
    Attribute('Leaf', 1.0, True),             # factor on the sizes of leaves, for LeafRate
)
ATTRIBUTE_INDEX = {attribute.name: i for i, attribute in enumerate(ATTRIBUTES)}
BONE_RATIO_RANGE = (0.8, 0.95)  # bone length over segment length


class Symbol(NamedTuple):
    """
    A name with a meaning for the turtle.

    :ivar op: what it does.
    :ivar arities: numbers of parameters it may have.
    :ivar argument: sign of a turn, or index of an attribute.
    """

    op: Op
    arities: tuple[int, ...]
    argument: int = 0


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
    table['!'] = Symbol(Op.ATTRIBUTE, (0, 1), ATTRIBUTE_INDEX['Width'])
    return table


SYMBOLS = _symbols()
LONG_NAMES = frozenset(name for name in SYMBOLS if len(name) > 1 and name[0].isalpha())


def arity_message(symbol: Symbol, found: int) -> str:
    """Say how many parameters a symbol takes, and how many were found."""
    wanted = ' or '.join(map(str, symbol.arities))
    return f'takes {wanted} parameter{"s" * (symbol.arities != (1,))}, found {found}'
