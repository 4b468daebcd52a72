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

"""Arching: the arches of a facade: where they stand, their stones, and the bricks cut to them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procphys_ros.hexahedron import box_corners
from procphys_ros.wallgrammar import arches, cutting
from procphys_ros.wallgrammar.arches import Curve, Line
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, MICRO, micros, stack
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.derivation import Piece
from procphys_ros.wallgrammar.footprint import Facade
from procphys_ros.wallgrammar.spec import Panel

_MOST_RINGS = 10
_STEEP = 1.0  # rise over run of an outline beyond which bricks over it are not parted


@dataclass(frozen=True)
class Arch:
    """
    An arch in its facade.

    :ivar piece: the panel: it springs from the lower corners, and what is above it is wall.
    :ivar material: name; None = that of the wall.
    :ivar stones: outlines of the voussoirs, counter-clockwise [m], (n, 4, 2).
    :ivar gap: what bricks keep clear of.
    :ivar bounds: left, bottom, right, top of all of it [µm].
    :ivar shoulder: greatest height of what reaches sideways beyond the panel [µm].
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
    :param panel: what its name stands for.
    :param layout: of the wall; a unit, on end or on edge, is as deep as a ring.
    :param filled: whether masonry stands under the arch.
    :raises GrammarError: for arches that have no room or no form.
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
    ways = np.diff(points, axis=0)
    level = np.abs(ways[:, 1]) < _STEEP * np.abs(ways[:, 0])
    lines_at = points[np.append(level, False) | np.insert(level, 0, False), 0]
    gap = cutting.Gap(
        _moved(arches.extrados(outer, joint), origin),
        _moved(arches.intrados(rings[0], joint), origin) if filled else None,
        np.sort(lines_at) + origin[0])
    stones = np.concatenate([arches.voussoirs(ring, joint) for ring in rings]) + origin
    reach = int(MICRO * (float(np.abs(points[:, 0]).max()) + joint))
    middle = (scope.left + scope.right) // 2
    return Arch(piece, panel.arguments[0] if panel.arguments else None, stones, gap,
                (middle - reach, scope.bottom, middle + reach,
                 scope.bottom + int(MICRO * top)), shoulder)


def _moved(planes: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Move half planes, rows a b c of a·x + z·b <= c."""
    return np.column_stack([planes[:, :2], planes[:, 2] + planes[:, :2] @ origin])


def cut_bricks(site: Site, facade: Facade, boxes: Boxes, found: Sequence[Arch]) -> Boxes:
    """
    Cut bricks to the arches among them; pieces of one brick stay one member.

    :param site: takes the forms of what is cut.
    :param facade: in whose frame the bricks are.
    :param boxes: bricks.
    :param found: arches of the facade.
    """
    if not found or not len(boxes):
        return boxes
    outlines = cutting.rectangles(boxes.low[:, [0, 2]] / MICRO, boxes.high[:, [0, 2]] / MICRO)
    near = np.array([cutting.touched(outlines, arch.gap) for arch in found])
    rows, pieces = [], []
    whole = np.ones(len(boxes), bool)
    for row in np.flatnonzero(near.any(axis=0)).tolist():
        parts, changed = [outlines[row]], False
        for arch in np.flatnonzero(near[:, row]).tolist():
            cuts = [cutting.cut(part, found[arch].gap) for part in parts]
            changed |= any(cut is not None for cut in cuts)
            parts = [quad for part, cut in zip(parts, cuts)
                     for quad in ([part] if cut is None else cut)]
        if changed:
            whole[row] = False
            rows += [row] * len(parts)
            pieces += parts
    if not rows:
        return boxes.take(whole)
    some = boxes.take(np.array(rows))
    member = site.next_member + np.unique(rows, return_inverse=True)[1].reshape(-1)
    return stack([boxes.take(whole), replace(
        _shaped(site, facade, some, np.array(pieces)), member=member)])


def stones(site: Site, facade: Facade, arch: Arch, layout: Layout) -> Boxes:
    """
    Give the voussoirs of an arch.

    :param site: takes their forms.
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
    """Give parts that are as deep as their boxes, but have outlines (n, 4, 2) in the facade."""
    first = np.argmin(outlines.sum(axis=2), axis=1)  # the lower left corner
    order = (first[:, None] + np.arange(4)) % 4
    turned = np.take_along_axis(outlines, order[:, :, None], axis=1)
    corners = box_corners(boxes.low / MICRO, boxes.high / MICRO)
    for corner in range(8):
        at = turned[:, {0: 0, 1: 1, 5: 2, 4: 3}[corner & 5]]
        corners[:, corner, 0], corners[:, corner, 2] = at.T
    form = len(site.forms) + np.arange(len(boxes))
    site.forms += list(facade.place_points(corners))
    return replace(boxes, low=micros(corners.min(axis=1)), high=micros(corners.max(axis=1)),
                   before=np.zeros_like(boxes.before), after=np.zeros_like(boxes.after),
                   form=form)
