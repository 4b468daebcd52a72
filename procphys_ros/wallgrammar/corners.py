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

"""Corners that are not right-angled: bonds between walls that stand in different frames."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.elementary import hypot
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.boxes import Boxes, MICRO
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.footprint import Facade
from procphys_ros.wallgrammar.plan import along_facade
from procphys_ros.wallgrammar.polygons import clip, moments
from procphys_ros.wallgrammar.walls import Elevation

_LEAST_AREA = 1e-4   # [m²] smaller overlaps of beds are ignored
_NEAR = 3            # wall thicknesses from the corner within which beds can overlap


def bond(site: Site, walls: Sequence[Elevation]) -> None:
    """
    Bond the walls at every corner whose angle is not right.

    Within a course, mortar fills the wedge between the two ends; the beds of successive courses
    overlap, because the walls run up to the corner in turn.

    :param site: holds the parts and receives the bonds.
    :param walls: the facades in their order, built.
    """
    if all(wall.facade.end.right for wall in walls):
        return
    boxes = site.boxes()
    for wall, following in zip(walls, [*walls[1:], walls[0]]):
        if not wall.facade.end.right:
            _bond_corner(site, boxes, wall, following)


def _bond_corner(site: Site, boxes: Boxes, wall: Elevation, following: Elevation) -> None:
    ends = _near(boxes, wall, True)
    starts = _near(boxes, following, False)
    beds: list[tuple[int, int]] = []
    wedges: list[tuple[int, int]] = []
    for below, above in ((ends, starts), (starts, ends)):
        for bricks in below.values():
            for row, _, top in bricks:
                beds += [(row, other) for other, _, _ in above.get(top, ())]
    for bottom, bricks in ends.items():
        faces = [row for row, at_end, _ in bricks if at_end]
        opposite = [row for row, at_start, _ in starts.get(bottom, ()) if at_start]
        wedges += zip(faces, opposite)  # leaf by leaf, from the outside
    _beds(site, boxes, beds)
    if wedges:
        _wedges(site, boxes, np.array(wedges), wall.facade, following.facade)


def _near(boxes: Boxes, wall: Elevation, end: bool) -> dict[int, list[tuple[int, bool, int]]]:
    """
    Find the bricks near an end of a wall.

    :returns: by the bottom of their cells: part, whether it reaches the end, top of its cell;
        from the outer face inwards.
    """
    facade = wall.facade
    rows = np.array(wall.rows, int)
    axis = facade.quarter % 2
    low, high = boxes.cells
    near, far = along_facade(facade, low[rows, axis], high[rows, axis])
    distance = facade.length - far if end else near
    kept = distance < _NEAR * wall.layout.thickness
    corner = facade.end if end else facade.start
    reaches = np.isin(-distance, (corner.owned, corner.yielded))
    depth = np.abs(low[rows, 1 - axis] + high[rows, 1 - axis] - 2 * facade.origin[1 - axis])
    order = np.lexsort((rows[kept], depth[kept]))
    found: dict[int, list[tuple[int, bool, int]]] = {}
    for row, at_end in zip(rows[kept][order].tolist(), reaches[kept][order].tolist()):
        found.setdefault(int(low[row, 2]), []).append((row, at_end, int(high[row, 2])))
    return found


def _wedges(site: Site, boxes: Boxes, pairs: np.ndarray, ending: Facade,
            starting: Facade) -> None:
    """Bond the ends of one wall to the starts of the next, over the wedges of mortar."""
    out, ahead, out_width, out_half = _faces(site, boxes, pairs[:, 0], ending, 1)
    into, back, in_width, in_half = _faces(site, boxes, pairs[:, 1], starting, -1)
    normal = (ahead - back) / norm(ahead - back)
    low = boxes.low[pairs, 2].max(axis=1) / MICRO
    high = boxes.high[pairs, 2].min(axis=1) / MICRO
    centre = 0.5 * (out + into)
    centre[:, 2] = 0.5 * (low + high)
    axes = np.column_stack([np.cross([0.0, 0.0, 1.0], normal), [0.0, 0.0, 1.0], normal])
    attitude = np.tile(rotation.from_matrix(axes), (len(pairs), 1))
    extent = np.column_stack([np.minimum(out_width, in_width), high - low])
    site.patches.append(Patches(
        pairs, np.column_stack([centre, attitude]), extent, extent.prod(axis=1),
        np.abs(product(into - out, normal)), np.column_stack([out_half, in_half])))


def _faces(site: Site, boxes: Boxes, rows: np.ndarray, facade: Facade,
           side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Compute centres, normal, widths and half lengths of the end faces of bricks [m]."""
    axis = facade.quarter % 2
    normal = np.zeros(3)
    normal[axis] = side if facade.quarter < 2 else -side
    half = (boxes.high[rows] - boxes.low[rows]) / (2.0 * MICRO)
    centre = (boxes.high[rows] + boxes.low[rows]) / (2.0 * MICRO) + normal * half
    turn = site.frames[facade.frame][3:]
    return (rotation.rotate(turn, centre), rotation.rotate(turn, normal), 2.0 * half[:, 1 - axis],
            half[:, axis])


def _beds(site: Site, boxes: Boxes, pairs: list[tuple[int, int]]) -> None:
    """Bond bricks of successive courses in two frames, by the true overlap of their beds."""
    if not pairs:
        return
    pair = np.array(pairs)
    outlines = np.stack([_outlines(site, boxes, column) for column in pair.T], axis=1)
    meet = (outlines.min(axis=2)[:, ::-1] < outlines.max(axis=2)).all(axis=(1, 2))
    found = []
    for (lower, upper), (below, above) in zip(pair[meet], outlines[meet]):
        outline = clip(below, above)
        if len(outline) < 3:
            continue
        area, centre, _ = moments(outline)
        if area < _LEAST_AREA:
            continue
        along = (below[1] - below[0]) / hypot(*(below[1] - below[0]))
        sides = product(outline, np.array([[along[0], -along[1]], [along[1], along[0]]]))
        extent = sides.max(axis=0) - sides.min(axis=0)
        extent = extent * np.sqrt(area / extent.prod())  # same area, same proportions
        bed = (boxes.high[lower, 2] / MICRO, boxes.low[upper, 2] / MICRO)
        reach = [(boxes.high[r, 2] - boxes.low[r, 2]) / (2.0 * MICRO) for r in (lower, upper)]
        pose = (*centre, 0.5 * sum(bed), *site.frames[boxes.frame[lower]][3:])
        found.append(((lower, upper), pose, extent, area, bed[1] - bed[0], reach))
    if found:
        site.patches.append(Patches(*(np.array(column) for column in zip(*found))))


def _outlines(site: Site, boxes: Boxes, rows: np.ndarray) -> np.ndarray:
    """Return the outlines of bricks in plan, counter-clockwise [m], (n, 4, 2)."""
    low, high = boxes.low[rows] / MICRO, boxes.high[rows] / MICRO
    x = np.stack([low[:, 0], high[:, 0], high[:, 0], low[:, 0]], axis=1)
    y = np.stack([low[:, 1], low[:, 1], high[:, 1], high[:, 1]], axis=1)
    turn = np.array(site.frames)[boxes.frame[rows], None, 3:]
    return rotation.rotate(turn, np.stack([x, y, np.zeros_like(x)], axis=-1))[..., :2]
