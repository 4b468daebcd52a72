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

"""Tiling: runs of wall, course by course, are cut into units by the perpends of their bond."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint.column_table import ColumnTable
from procphys_ros.wallgrammar.bonds import Course, Layout
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, split_along
from procphys_ros.wallgrammar.contacts import spread

_SLIVER = 0.2     # of a unit's pitch: a shorter end piece is merged with the unit beside it
_THROUGH, _FLAT = 0.4, 0.2  # share of rubble that reaches through the wall, and of thin stones
_ROUGH = 0.05     # of the thickness: largest setback of rubble faces
LEAST = 15_000   # [µm] a run that leaves less than this between its joints stays empty


@dataclass(frozen=True)
class Runs(ColumnTable):
    """
    Unbroken stretches of one panel type in one course, in the frame of the facade.

    :ivar course: number of the course from the ground, (n,).
    :ivar left, right: ends along the wall [µm], (n,).
    :ivar bottom, top: of the run, which may be less than its course [µm], (n,).
    :ivar left_joint, right_joint: joint inside the ends [µm], (n,).
    :ivar left_filled, right_filled: length of the corner that the run fills and yields in the
        next course, 0 for none [µm], (n,).
    :ivar depth: outer face, measured inwards from the facade plane [µm], (n,).
    """

    course: np.ndarray
    left: np.ndarray
    right: np.ndarray
    bottom: np.ndarray
    top: np.ndarray
    left_joint: np.ndarray
    right_joint: np.ndarray
    left_filled: np.ndarray
    right_filled: np.ndarray
    depth: np.ndarray


class Leaf(NamedTuple):
    """
    A single thickness of units, measured inwards from the outer face of its runs [µm].

    :ivar near, far: its faces, with the joints.
    :ivar near_joint, far_joint: joints inside them.
    """

    near: int
    far: int
    near_joint: int = 0
    far_joint: int = 0


def lay(runs: Runs, layout: Layout, kind: int, joint: int, first_member: int,
        generator: np.random.Generator, leaf: Leaf | None = None) -> Boxes:
    """
    Tile runs; x along the wall, y from the outer face inwards, z up.

    :param runs: stretches to fill.
    :param layout: bond and units.
    :param kind: index of the kind name of the units.
    :param joint: `Joint` of the units.
    :param first_member: number that members may be counted from, when units have pieces.
    :param generator: draws the stones of rubble.
    :param leaf: leaf to lay; None = the whole thickness of the layout.
    """
    room = runs.right - runs.left - runs.left_joint - runs.right_joint
    runs = runs.take(room >= LEAST)
    courses = layout.courses(generator, int(runs.right.max(initial=0)),
                             int(runs.course.max(initial=0)) + 1)
    cut = [_cut(runs.take(runs.course % len(courses) == k), course, layout)
           for k, course in enumerate(courses)]
    columns = _join_courses([np.concatenate(column) for column in zip(*cut)])
    low = columns[6] - columns[5] - layout.joint < min(LEAST, layout.unit[2])
    cells = [column[~low] for column in columns]
    boxes = (_rubble(cells, layout, kind, joint, generator)
             if layout.bond == 'rubble' and leaf is None
             else _units(cells, layout, kind, joint, leaf))
    order = np.lexsort((boxes.low[:, 1], boxes.low[:, 0], boxes.low[:, 2]))
    boxes = boxes.take(order)
    if layout.pieces > 1:
        return split_along(boxes, -(-layout.unit[0] // layout.pieces), first_member)
    return boxes


def _cut(runs: Runs, course: Course, layout: Layout) -> tuple[np.ndarray, ...]:
    """Cut runs of like courses at the perpends, none of them nearer to an end than a sliver."""
    sliver = min(int(_SLIVER * layout.pitch), int(course.widths.min()) // 2)
    first = course.first_beyond(runs.left + sliver)
    cuts = np.maximum(course.first_beyond(runs.right - sliver) - first, 0)
    run, step = spread(cuts + 1)
    number = first[run] + step
    at_left, at_right = step == 0, step == cuts[run]
    half = layout.joint // 2
    left = np.where(at_left, runs.left[run], _perpend(number - 1, run, runs, course, layout))
    right = np.where(at_right, runs.right[run], _perpend(number, run, runs, course, layout))
    header = course.header[(number - 1) % len(course.header)]
    left_joint = np.where(at_left, runs.left_joint[run], half)
    right_joint = np.where(at_right, runs.right_joint[run], layout.joint - half)
    return (left, right, left_joint, right_joint, header, runs.bottom[run], runs.top[run],
            runs.depth[run], runs.course[run])


def _perpend(number: np.ndarray, run: np.ndarray, runs: Runs, course: Course,
             layout: Layout) -> np.ndarray:
    """
    Locate perpends [µm], away from the places where the wall yields its corner.

    There the courses above and below begin. A perpend of a course that fills the corner moves a
    quarter unit away, so that no straight joint cuts the corner off; where headers cross the
    wall it moves less far, as their own perpends stand a quarter off.
    """
    x = course.perpend(number)
    quarter = layout.pitch // 4
    shift = 3 * quarter // 5 if layout.crossed else quarter
    sides = ((runs.left, runs.right, runs.left_filled, 1),
             (runs.right, runs.left, runs.right_filled, -1))
    for end, other, filled, inwards in sides:
        inset = inwards * (filled[run] + layout.joint // 2)
        straight = (filled[run] > 0) & (np.abs(x - end[run] - inset) < quarter // 2)
        straight &= np.abs(other[run] - x) > 2 * quarter  # else there is no wall to move into
        x = np.where(straight, x + inwards * shift, x)
    return x


def _join_courses(columns: list[np.ndarray]) -> list[np.ndarray]:
    """Merge cells of one course that were cut level only because of panels beside them."""
    left, right, left_joint, right_joint, header, bottom, top, depth, course = columns
    keys = (bottom, right_joint, left_joint, depth, right, left, course)
    order = np.lexsort(keys)
    sorted_keys = [key[order] for key in keys[1:]]
    same = np.ones(max(len(order) - 1, 0), bool)
    for key in sorted_keys:
        same &= key[1:] == key[:-1]
    same &= top[order][:-1] == bottom[order][1:]
    starts = np.flatnonzero(np.concatenate([[True], ~same])) if len(order) else order
    ends = np.append(starts[1:], len(order)) - 1 if len(order) else order
    keep, last = order[starts], order[ends]
    return [left[keep], right[keep], left_joint[keep], right_joint[keep], header[keep],
            bottom[keep], top[last], depth[keep]]


def _units(columns: list[np.ndarray], layout: Layout, kind: int, joint: int,
           only: Leaf | None) -> Boxes:
    """Extrude cells to units: one through the wall, or two leaves of stretchers."""
    left, right, left_joint, right_joint, header, bottom, top, depth = columns

    def units(rows: np.ndarray, leaf: Leaf, axis: int) -> Boxes:
        low = np.column_stack([left, depth + leaf.near, bottom])[rows]
        high = np.column_stack([right, depth + leaf.far, top])[rows]
        bed = np.full(len(left), layout.joint)
        zero = np.zeros(len(left), np.int64)
        before = np.column_stack([left_joint, zero + leaf.near_joint, bed])[rows]
        after = np.column_stack([right_joint, zero + leaf.far_joint, zero])[rows]
        return from_cells(low, high, before, after, axis=axis, kind=kind, joint=joint,
                          material=layout.material)

    whole = np.full(len(left), True)
    if only is not None or not layout.crossed:
        return units(whole, only or Leaf(0, layout.thickness), 0)
    half = layout.joint // 2
    return Boxes.stack([
        units(~header, Leaf(0, layout.leaf, 0, half), 0),
        units(~header, Leaf(layout.leaf, layout.thickness, layout.joint - half, 0), 0),
        units(header, Leaf(0, layout.thickness), 1)])


def _rubble(columns: list[np.ndarray], layout: Layout, kind: int, joint: int,
            generator: np.random.Generator) -> Boxes:
    """Fill cells with stones: one through the wall, two thin ones, or one for either face."""
    left, right, left_joint, right_joint, _, bottom, top, depth = columns
    count = len(left)
    sort = generator.random(count)
    rough = np.rint(generator.uniform(0.0, _ROUGH, (2, count)) * layout.thickness).astype(int)
    level = bottom + np.rint(generator.uniform(0.4, 0.6, count) * (top - bottom)).astype(int)
    middle = depth + np.rint(generator.uniform(0.4, 0.6, count) * layout.thickness).astype(int)
    near, far = depth, depth + layout.thickness
    zero, bed, half = np.zeros(count, int), np.full(count, layout.joint), layout.joint // 2

    def stones(rows: np.ndarray, faces: tuple[np.ndarray, np.ndarray],
               levels: tuple[np.ndarray, np.ndarray],
               joints: tuple[np.ndarray, np.ndarray]) -> Boxes:
        low = np.column_stack([left, faces[0], levels[0]])[rows]
        high = np.column_stack([right, faces[1], levels[1]])[rows]
        before = np.column_stack([left_joint, joints[0], bed])[rows]
        after = np.column_stack([right_joint, joints[1], zero])[rows]
        return from_cells(low, high, before, after, kind=kind, joint=joint,
                          material=layout.material)

    thin = (sort < _FLAT) & (top - bottom > 4 * layout.joint + 4 * LEAST)
    through = ~thin & (sort < _FLAT + _THROUGH)
    leaves = ~thin & ~through
    return Boxes.stack([
        stones(through, (near, far), (bottom, top), (rough[0], rough[1])),
        stones(thin, (near, far), (bottom, level), (rough[0], rough[1])),
        stones(thin, (near, far), (level, top), (rough[1], rough[0])),
        stones(leaves, (near, middle), (bottom, top), (rough[0], zero + half)),
        stones(leaves, (middle, far), (bottom, top), (zero + layout.joint - half, rough[1]))])
