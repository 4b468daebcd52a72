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

"""Arching: the arches of a facade, their voussoirs, and the bricks cut to fit them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procphys_ros.geometry.hexahedron import box_corners
from procphys_ros.wallgrammar import arches, cutting
from procphys_ros.wallgrammar.arches import Curve, Line
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, MICRO, micros
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.courses import Courses
from procphys_ros.wallgrammar.derivation import Piece
from procphys_ros.wallgrammar.fitting import Fit
from procphys_ros.wallgrammar.footprint import Facade
from procphys_ros.wallgrammar.spec import Panel

_MOST_RINGS = 10


@dataclass(frozen=True)
class Arch:
    """
    Arch in its facade.

    :ivar piece: the panel; the arch springs from its lower corners, with wall above it.
    :ivar material: name; None = that of the wall.
    :ivar stones: outlines of the voussoirs, counter-clockwise [m], (n, 4, 2).
    :ivar gap: region that bricks keep clear of.
    :ivar bounds: left, bottom, right, top of the whole arch [µm].
    :ivar shoulder: greatest height of the stones beyond the sides of the panel [µm].
    """

    piece: Piece
    material: str | None
    stones: np.ndarray
    gap: cutting.Gap
    bounds: tuple[int, int, int, int]
    shoulder: int


def plan(piece: Piece, panel: Panel, layout: Layout, filled: bool) -> Arch:
    """
    Divide an arch into voussoirs.

    :param piece: the panel.
    :param panel: its definition.
    :param layout: of the wall; a unit, on end or on edge, is as deep as a ring.
    :param filled: whether masonry stands under the arch.
    :raises GrammarError: for arches without room, or of an invalid shape.
    """
    scope, joint = piece.scope, layout.joint / MICRO
    depth = layout.unit[1 if layout.crossed else 0] / MICRO
    pitch = (layout.unit[2] + layout.joint) / MICRO
    *numbers, rings = piece.numbers
    if not 1 <= rings <= _MOST_RINGS or rings != int(rings):
        raise panel.place.error(f'an arch has a whole number of rings from 1 to {_MOST_RINGS}, '
                                f'found {rings:g}')
    try:
        curve = Curve.of(panel.shape, (scope.right - scope.left) / MICRO, tuple(numbers))
    except ValueError as problem:
        raise panel.place.error(str(problem)) from None
    whole = rings * (depth + joint)
    if layout.pieces > 1 or arches.too_many(curve, whole, pitch):
        raise piece.place.error(f'the arch "{piece.panel}" spans {curve.span:g} m with stones of '
                                f'{pitch - joint:g} m: use larger units of masonry')
    lines = curve.rings(int(rings), depth, joint, pitch)
    return _placed(piece, panel, lines, layout, filled)


def _placed(piece: Piece, panel: Panel, rings: list[list[Line]], layout: Layout,
            filled: bool) -> Arch:
    scope, joint = piece.scope, layout.joint / MICRO
    origin = np.array([0.5 * (scope.left + scope.right) / MICRO, scope.bottom / MICRO
                       + 0.5 * joint])
    outer = [Line(rings[0][0].inner, rings[-1][0].outer), *rings[-1][1:-1],
             Line(rings[0][-1].inner, rings[-1][-1].outer)]
    points = np.array([line.outer for line in outer])
    top = float(points[:, 1].max()) + 1.5 * joint
    room = (scope.top - scope.bottom) / MICRO
    if top > room + layout.gauge / MICRO:  # panels are gauged, which takes up to half a course
        raise piece.place.error(f'the arch "{piece.panel}" is {top:.3f} m high with its rings, '
                                f'the panel has only {room:.3f} m')
    side = points[np.abs(points[:, 0]) >= 0.5 * (scope.right - scope.left) / MICRO - 1e-9]
    shoulder = scope.bottom + int(MICRO * (float(side[:, 1].max()) + joint))
    inside = cutting.polygon(arches.intrados(rings[0], joint)) if filled else np.zeros((0, 2))
    gap = cutting.Gap(cutting.polygon(arches.extrados(outer, joint)) + origin,
                      inside + origin if len(inside) > 2 else None)
    stones = np.concatenate([arches.voussoirs(ring, joint) for ring in rings]) + origin
    reach = int(MICRO * (float(np.abs(points[:, 0]).max()) + joint))
    middle = (scope.left + scope.right) // 2
    return Arch(piece, panel.arguments[0] if panel.arguments else None, stones, gap,
                (middle - reach, scope.bottom, middle + reach,
                 scope.bottom + int(MICRO * top)), shoulder)


def cut_bricks(site: Site, facade: Facade, boxes: Boxes, found: Sequence[Arch],
               layout: Layout) -> Boxes:
    """
    Cut bricks to the arches among them; pieces of one brick stay one member.

    :param site: receives the corners of cut bricks.
    :param facade: whose frame the bricks lie in.
    :param boxes: bricks.
    :param found: arches of the facade.
    :param layout: of the bricks.
    """
    if not found or not len(boxes):
        return boxes
    courses = Courses(boxes.low[:, [0, 2]] / MICRO, boxes.high[:, [0, 2]] / MICRO,
                      layout.joint / MICRO, layout.unit[0] / MICRO)
    rows, pieces, whole = _pieces(courses, [arch.gap for arch in found])
    if not rows:
        return boxes.take(whole)
    some = boxes.take(np.array(rows))
    member = site.next_member + np.unique(rows, return_inverse=True)[1].reshape(-1)
    return Boxes.stack([boxes.take(whole), replace(
        _shaped(site, facade, some, np.array(pieces)), member=member)])


def _pieces(courses: Courses, gaps: Sequence[cutting.Gap]
            ) -> tuple[list[int], list[np.ndarray], np.ndarray]:
    """Cut the bricks of a wall; return brick and outline of each piece, and a mask of the rest."""
    fits = [Fit.of(courses, gap) for gap in gaps]
    left, right = courses.low[:, 0].copy(), courses.high[:, 0].copy()
    for fit in fits:  # both ends of a brick between two arches may move
        left = np.where(fit.left != courses.low[:, 0], fit.left, left)
        right = np.where(fit.right != courses.high[:, 0], fit.right, right)
    near = np.array([fit.touched for fit in fits])
    rows: list[int] = []
    pieces: list[np.ndarray] = []
    changed = near.any(axis=0) | (left != courses.low[:, 0]) | (right != courses.high[:, 0])
    for row in np.flatnonzero(changed).tolist():
        mine = [fits[k] for k in np.flatnonzero(near[:, row])]
        found = [] if left[row] >= right[row] else [cutting.rectangles(
            np.array([[left[row], courses.low[row, 1]]]),
            np.array([[right[row], courses.high[row, 1]]]))[0]]
        for fit in mine:
            found = [piece for outline in found for piece in fit.around(courses, row, outline)]
        for fit in mine:
            found += fit.inside(courses, row)
        found = [quad for outline in found for quad in cutting.quads(outline)]
        if len(found) == 1 and _is_box(found[0], courses.low[row], courses.high[row]):
            changed[row] = False
            continue
        rows += [row] * len(found)
        pieces += found
    return rows, pieces, ~changed


def _is_box(outline: np.ndarray, low: np.ndarray, high: np.ndarray) -> bool:
    """Return whether an outline is still the whole rectangle."""
    same = np.abs(np.concatenate([outline.min(axis=0) - low, outline.max(axis=0) - high])) < 1e-7
    return bool(same.all()) and cutting.area(outline) > (1.0 - 1e-6) * float((high - low).prod())


def stones(site: Site, facade: Facade, arch: Arch, layout: Layout) -> Boxes:
    """
    Make the voussoirs of an arch.

    :param site: receives their corners.
    :param facade: where the arch stands.
    :param layout: of the wall.
    """
    count, near = len(arch.stones), arch.piece.scope.depth
    low = np.column_stack([np.zeros(count), np.full(count, near), np.zeros(count)])
    material = layout.material if arch.material is None else site.material(arch.material)
    blank = from_cells(low, low + [0, layout.thickness, 0], kind=site.kind('voussoir'),
                       material=material)
    return _shaped(site, facade, blank, arch.stones)


def _shaped(site: Site, facade: Facade, boxes: Boxes, outlines: np.ndarray) -> Boxes:
    """Make parts as deep as their boxes, with outlines (n, 4, 2) in the facade."""
    first = np.argmin(outlines.sum(axis=2), axis=1)  # the lower left corner
    order = (first[:, None] + np.arange(4)) % 4
    turned = np.take_along_axis(outlines, order[:, :, None], axis=1)
    corners = box_corners(boxes.low / MICRO, boxes.high / MICRO)
    for corner in range(8):
        at = turned[:, {0: 0, 1: 1, 5: 2, 4: 3}[corner & 5]]
        corners[:, corner, 0], corners[:, corner, 2] = at.T
    shaped = site.hexahedra(facade.place_points(corners))
    return replace(boxes, low=micros(corners.min(axis=1)), high=micros(corners.max(axis=1)),
                   before=shaped.before, after=shaped.after, form=shaped.form)
