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


"""Turtle walk: the compiled loop that follows a string in three dimensions."""

import math

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import functions
from procphys_ros.lsystem.symbols import ATTRIBUTE_INDEX, ATTRIBUTES, Op

# Layout of the turtle's state; every bracket saves all of it.
POSITION, HEADING, LEFT, UP, TROPISM, PARENT, LATERAL, VALUES = 0, 3, 6, 9, 12, 16, 17, 18
_COUNT = len(ATTRIBUTES)
RATES = VALUES + _COUNT
STATE_SIZE = RATES + _COUNT
_TEXTURE = VALUES + ATTRIBUTE_INDEX['Texture']
_LEAF = VALUES + ATTRIBUTE_INDEX['Leaf']
# `!` without a width: two equal branches share the area of the wood below.
_THINNER = math.sqrt(0.5)

# numba freezes globals: plain integers, not members of an enumeration
_SEGMENT, _ORNAMENT, _MOVE, _PUSH, _POP = map(int, (
    Op.SEGMENT, Op.ORNAMENT_SEGMENT, Op.MOVE, Op.PUSH, Op.POP))
_CUT, _TURN, _PITCH, _ROLL, _LEVEL = map(int, (Op.CUT, Op.TURN, Op.PITCH, Op.ROLL, Op.LEVEL))
_ORIENT, _TROPISM, _POLYGON, _VERTEX, _FILL = map(int, (
    Op.ORIENT, Op.TROPISM, Op.POLYGON, Op.VERTEX, Op.FILL))
_LEAF_OP, _NEXT, _ATTRIBUTE, _RATE, _QUERY = map(int, (
    Op.LEAF, Op.NEXT_TEXTURE, Op.ATTRIBUTE, Op.RATE, Op.QUERY))


# Indices of the counts of filled rows, and the faults that `walk` returns
SEGMENTS, PIECES, LEAVES, TRIANGLES, QUERIES, CORNERS, POLYGONS = range(7)
_UNOPENED, _UNCLOSED, _NO_DIRECTION = 1, 2, 3
FAULTS = {
    _UNOPENED: 'stands outside a polygon; "{" opens one',
    _UNCLOSED: 'ends the string while a polygon is still open; "}" closes it',
    _NO_DIRECTION: 'gives no direction: heading and up must be neither zero nor parallel',
}


@subroutine(inline='always')
def _copy(source, target):
    """Copy numbers one by one: slice assignments take seconds to compile, for their errors."""
    for k in range(len(source)):
        target[k] = source[k]


@subroutine
def _rotate(state, a, b, angle):
    """Turn the axis at a towards the axis at b by an angle [rad]."""
    c, s = functions.cos(angle), functions.sin(angle)
    for k in range(3):
        x, y = state[a + k], state[b + k]
        state[a + k] = c * x + s * y
        state[b + k] = c * y - s * x


@subroutine
def _cross(state, a, b, to):
    state[to] = state[a + 1] * state[b + 2] - state[a + 2] * state[b + 1]
    state[to + 1] = state[a + 2] * state[b] - state[a] * state[b + 2]
    state[to + 2] = state[a] * state[b + 1] - state[a + 1] * state[b]


@subroutine
def _square_up(state, second, third):
    """Make heading, `second` and `third` orthonormal again; False when they are parallel."""
    size = np.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2)
    if not size > 1e-12:
        return False
    for k in range(3, 6):
        state[k] /= size
    along = (state[3] * state[second] + state[4] * state[second + 1]
             + state[5] * state[second + 2])
    for k in range(3):
        state[second + k] -= state[3 + k] * along
    size = np.sqrt(state[second] ** 2 + state[second + 1] ** 2 + state[second + 2] ** 2)
    if not size > 1e-9:
        return False
    for k in range(3):
        state[second + k] /= size
    if third == UP:
        _cross(state, HEADING, LEFT, UP)
    else:
        _cross(state, UP, HEADING, LEFT)
    return True


@subroutine
def _turn_all(state, axis, angle):
    """Turn the whole frame about a unit axis (Rodrigues)."""
    c, s = functions.cos(angle), functions.sin(angle)
    for at in (HEADING, LEFT, UP):
        x, y, z = state[at], state[at + 1], state[at + 2]
        along = (1.0 - c) * (axis[0] * x + axis[1] * y + axis[2] * z)
        state[at] = c * x + s * (axis[1] * z - axis[2] * y) + along * axis[0]
        state[at + 1] = c * y + s * (axis[2] * x - axis[0] * z) + along * axis[1]
        state[at + 2] = c * z + s * (axis[0] * y - axis[1] * x) + along * axis[2]


@subroutine
def _bend(state, target, elasticity):
    """
    Turn by elasticity·|H×T| about H×T (Prusinkiewicz and Lindenmayer 1990, p. 58).

    :param elasticity: inf turns all the way to the target, others at most that far.
    """
    heading = state[HEADING:LEFT]
    axis = np.empty(3)
    axis[0] = heading[1] * target[2] - heading[2] * target[1]
    axis[1] = heading[2] * target[0] - heading[0] * target[2]
    axis[2] = heading[0] * target[1] - heading[1] * target[0]
    size = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    along = heading[0] * target[0] + heading[1] * target[1] + heading[2] * target[2]
    between = functions.atan2(size, along)
    if size < 1e-12:
        if elasticity == np.inf and along < 0.0:  # straight back: any axis across will do
            for k in range(3):
                axis[k] = state[UP + k]
            _turn_all(state, axis, np.pi)
        return
    # never past the target, nor, repelled, past its opposite
    angle = max(min(elasticity * size, between), between - np.pi)
    for k in range(3):
        axis[k] /= size
    _turn_all(state, axis, angle)


@subroutine
def _level(state):
    """Roll so that left becomes horizontal: L = V×H/|V×H|, U = H×L (p. 57)."""
    size = np.sqrt(state[3] ** 2 + state[4] ** 2)
    if size > 1e-9:  # a vertical heading has no horizontal left
        state[LEFT], state[LEFT + 1], state[LEFT + 2] = -state[4] / size, state[3] / size, 0.0
        _cross(state, HEADING, LEFT, UP)


@subroutine
def _orient(state, given):
    """Set heading, and up if given; return False when they form no frame."""
    size = np.sqrt(given[0] ** 2 + given[1] ** 2 + given[2] ** 2)
    if not size > 0.0:
        return False
    if len(given) == 3:
        target = np.empty(3)
        for k in range(3):
            target[k] = given[k] / size
        _bend(state, target, np.inf)
        return True
    for k in range(3):
        state[HEADING + k] = given[k] / size
        state[UP + k] = given[3 + k]
    return _square_up(state, UP, LEFT)


@subroutine
def _advance(state, length):
    for k in range(3):
        state[POSITION + k] += length * state[HEADING + k]


@subroutine
def _after_segment(state):
    """Apply rates and tropism (also after segments without bone); remove rounding."""
    for k in range(_COUNT):
        if state[RATES + k] != 1.0:
            state[VALUES + k] *= state[RATES + k]
    if state[TROPISM + 3] != 0.0:
        _bend(state, state[TROPISM:TROPISM + 3], state[TROPISM + 3])
    _square_up(state, LEFT, UP)


@subroutine
def _carrier(state, segments):
    """Return the segment that carries an ornament: the one before it, else the next."""
    return state[PARENT] if state[PARENT] >= 0.0 else segments


@subroutine
def _record(rows, number, state, length, carrier, module):
    """Write a row of a table: carrier, module, length, whole state."""
    rows[number, 0] = carrier
    rows[number, 1] = module
    rows[number, 2] = length
    _copy(state, rows[number, 3:])


@subroutine
def _same(a, b):
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@subroutine
def _corner(state, vertices, opened, filled):
    """Add a corner to the innermost polygon, unless it repeats the last one."""
    last = filled[CORNERS] - 1
    position = state[POSITION:POSITION + 3]
    if last < opened[filled[POLYGONS] - 1] or not _same(vertices[last], position):
        _copy(position, vertices[filled[CORNERS]])
        filled[CORNERS] += 1


@subroutine
def _fill(state, vertices, first, triangles, filled, module):
    """Triangulate a closed polygon as a fan."""
    count = filled[CORNERS]
    if count > first and _same(vertices[first], vertices[count - 1]):
        count -= 1  # the polygon was closed by hand
    for corner in range(first + 1, count - 1):
        triangle = triangles[filled[TRIANGLES]]
        triangle[0] = _carrier(state, filled[SEGMENTS])
        triangle[1] = module
        triangle[2] = state[_TEXTURE]
        _copy(vertices[first], triangle[3:6])
        _copy(vertices[corner], triangle[6:9])
        _copy(vertices[corner + 1], triangle[9:12])
        filled[TRIANGLES] += 1
    filled[CORNERS] = first


@subroutine
def _move(state, code, length, segments, pieces, vertices, opened, filled, module):
    """Move, and draw unless inside a polygon, where movements only make its edges."""
    if filled[POLYGONS] > 0:
        _advance(state, length)
        if code != _ORNAMENT:
            _corner(state, vertices, opened, filled)
        return
    if code == _SEGMENT:
        _record(segments, filled[SEGMENTS], state, length, state[PARENT], module)
    elif code == _ORNAMENT:
        carrier = _carrier(state, filled[SEGMENTS])
        _record(pieces, filled[PIECES], state, length, carrier, module)
        filled[PIECES] += 1
    _advance(state, length)
    if code != _MOVE:
        _after_segment(state)
    if code == _SEGMENT:
        state[PARENT], state[LATERAL] = filled[SEGMENTS], 0.0
        filled[SEGMENTS] += 1


@subroutine
def _turn(state, op, sign, given, angle):
    if sign == 0:  # |
        angle = np.pi
    else:
        angle = sign * (np.radians(given[0]) if len(given) else angle)
    a, b = LEFT, UP
    if op == _TURN:
        a, b = HEADING, LEFT
    elif op == _PITCH:
        a, b = UP, HEADING
    _rotate(state, a, b, angle)


@subroutine
def _set(state, op, argument, given):
    """Apply a symbol that only changes the state; return False for an invalid direction."""
    if op == _ATTRIBUTE:
        if len(given):
            state[VALUES + argument] = given[0]
        else:
            state[VALUES + argument] *= _THINNER
    elif op == _RATE:
        state[RATES + argument] = given[0]
    elif op == _TROPISM:
        for k in range(4):
            state[TROPISM + k] = given[k]
    elif op == _NEXT:
        state[_TEXTURE] += 1.0
    elif op == _LEVEL:
        _level(state)
    elif op == _ORIENT:
        return _orient(state, given)
    return True


@subroutine
def _draw(state, op, argument, given, tables, opened, filled, module):
    """Apply one symbol other than a bracket; return the fault, 0 = none."""
    segments, pieces, leaves, triangles, queries, vertices, angle = tables
    if op <= _MOVE:
        length = given[0] if len(given) else 1.0
        _move(state, op, length, segments, pieces, vertices, opened, filled, module)
    elif _TURN <= op <= _ROLL:
        _turn(state, op, argument, given, angle)
    elif op == _LEAF_OP:
        carrier = _carrier(state, filled[SEGMENTS])
        _record(leaves, filled[LEAVES], state, given[0] * state[_LEAF], carrier, module)
        filled[LEAVES] += 1
    elif op == _QUERY:
        carrier = _carrier(state, filled[SEGMENTS])
        _record(queries, filled[QUERIES], state, 0.0, carrier, module)
        filled[QUERIES] += 1
    elif op == _POLYGON:
        opened[filled[POLYGONS]] = filled[CORNERS]
        filled[POLYGONS] += 1
    elif op == _VERTEX:
        if filled[POLYGONS] == 0:
            return _UNOPENED
        _corner(state, vertices, opened, filled)
    elif op == _FILL:
        if filled[POLYGONS] == 0:
            return _UNOPENED
        filled[POLYGONS] -= 1
        _fill(state, vertices, opened[filled[POLYGONS]], triangles, filled, module)
    elif not _set(state, op, argument, given):
        return _NO_DIRECTION
    return 0


@kernel
def walk(op, argument, starts, counts, values, state, depth, polygons, tables):
    """
    Interpret a string.

    :param op: action of each module, (M,).
    :param argument: sign of a turn or index of an attribute, (M,).
    :param starts: index of the first parameter of each module in `values`, (M,).
    :param counts: number of its parameters, (M,).
    :param values: parameters of all modules.
    :param state: initial state of the turtle, (STATE_SIZE,), modified.
    :param depth: deepest nesting of brackets.
    :param polygons: largest number of polygons open at once.
    :param tables: to be filled, see `turtle_reader`; and the angle of turns without one [rad].
    :returns: the fault, its module, and the number of filled rows of each table.
    """
    stack = np.empty((depth, STATE_SIZE))
    opened = np.empty(polygons, np.int64)
    filled = np.zeros(7, np.int64)
    level, cut = 0, -1  # cut: level of the branch whose rest is left out
    for i in range(len(op)):
        code = op[i]
        if code == _PUSH:
            _copy(state, stack[level])
            level += 1
            state[LATERAL] = 1.0 if state[PARENT] >= 0.0 else 0.0
        elif code == _POP:
            level -= 1
            _copy(stack[level], state)
            if level < cut:
                cut = -1
        elif cut >= 0 or code == 0:
            continue
        elif code == _CUT:
            cut = level
        else:
            given = values[starts[i]:starts[i] + counts[i]]
            fault = _draw(state, code, argument[i], given, tables, opened, filled, i)
            if fault:
                return fault, i, filled
    return (_UNCLOSED if filled[POLYGONS] else 0), len(op) - 1, filled
