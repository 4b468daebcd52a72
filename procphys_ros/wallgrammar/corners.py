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

from procphys_ros import rotation
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.boxes import Boxes, MICRO
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.footprint import Facade
from procphys_ros.wallgrammar.plan import along_facade
from procphys_ros.wallgrammar.walls import Elevation

_LEAST_AREA = 1e-4   # [m²] smaller overlaps of beds do not hold anything
_NEAR = 3            # wall thicknesses from the corner within which beds can overlap


def bond(site: Site, walls: Sequence[Elevation]) -> None:
    """
    Bond the walls at every corner whose angle is not right.

    Within a course the wedge between the two ends is mortar; the beds of courses above each other
    overlap, because the walls run up to the corner in turn.

    :param site: holds the parts and takes the bonds.
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
    pairs: list[tuple[int, int]] = []
    for z in sorted(ends):
        for row, _, _ in ends[z]:
            level = boxes.cells[1][row, 2]
            pairs += [(row, other) for other, _, _ in starts.get(level, ())]
        faces = ([e for e in ends[z] if e[1]], [s for s in starts.get(z, ()) if s[1]])
        for first, second in zip(*faces):
            _wedge(site, boxes, first[0], second[0], wall.facade, following.facade)
    for z in sorted(starts):
        for row, _, _ in starts[z]:
            level = boxes.cells[1][row, 2]
            pairs += [(row, other) for other, _, _ in ends.get(level, ())]
    _beds(site, boxes, pairs)


def _near(boxes: Boxes, wall: Elevation, end: bool) -> dict[int, list[tuple[int, bool, int]]]:
    """
    Find the bricks near an end of a wall.

    :returns: by the bottom of their cells: part, whether it reaches the end, depth in the wall.
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
    found: dict[int, list[tuple[int, bool, int]]] = {}
    for row, at_end, deep in sorted(zip(rows[kept], reaches[kept], depth[kept]),
                                    key=lambda item: (item[2], item[0])):
        found.setdefault(int(low[row, 2]), []).append((int(row), bool(at_end), int(deep)))
    return found


def _wedge(site: Site, boxes: Boxes, first: int, second: int, ending: Facade,
           starting: Facade) -> None:
    """Bond the end of one wall to the start of the next, over the wedge of mortar."""
    out = _face(site, boxes, first, ending, 1)
    into = _face(site, boxes, second, starting, -1)
    across = into[0] - out[0]
    normal = out[1] - into[1]
    normal /= np.linalg.norm(normal)
    low = max(boxes.low[first, 2], boxes.low[second, 2]) / MICRO
    high = min(boxes.high[first, 2], boxes.high[second, 2]) / MICRO
    if high - low <= 0.002:
        return
    centre = 0.5 * (out[0] + into[0])
    centre[2] = 0.5 * (low + high)
    width = min(out[2], into[2])
    axes = np.column_stack([np.cross([0.0, 0.0, 1.0], normal), [0.0, 0.0, 1.0], normal])
    site.patches.append(Patches(
        np.array([[first, second]]), np.concatenate([centre, rotation.from_matrix(axes)])[None],
        np.array([[width, high - low]]), np.array([width * (high - low)]),
        np.array([max(abs(float(across @ normal)), 0.001)]), np.array([[out[3], into[3]]])))


def _face(site: Site, boxes: Boxes, row: int, facade: Facade,
          side: int) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Give centre, outward normal, width and half length of the end of a brick [m]."""
    axis = facade.quarter % 2
    direction = side if facade.quarter < 2 else -side
    centre = (boxes.low[row] + boxes.high[row]) / (2.0 * MICRO)
    half = (boxes.high[row] - boxes.low[row]) / (2.0 * MICRO)
    normal = np.zeros(3)
    normal[axis] = direction
    centre = centre + normal * half
    frame = site.frames[boxes.frame[row]]
    return (frame[:3] + rotation.rotate(frame[3:], centre), rotation.rotate(frame[3:], normal),
            2.0 * float(half[1 - axis]), float(half[axis]))


def _beds(site: Site, boxes: Boxes, pairs: list[tuple[int, int]]) -> None:
    """Bond bricks that lie over each other across two frames, by the true overlap."""
    if not pairs:
        return
    pair = np.array(pairs)
    outlines = np.stack([_outlines(site, boxes, column) for column in pair.T], axis=1)
    meet = (outlines.min(axis=2)[:, ::-1] < outlines.max(axis=2)).all(axis=(1, 2))
    found = []
    for (lower, upper), (below, above) in zip(pair[meet], outlines[meet]):
        outline = _clip(below, above)
        if len(outline) < 3:
            continue
        area, centre = _area(outline)
        if area < _LEAST_AREA:
            continue
        frame = site.frames[boxes.frame[lower]]
        turned = rotation.rotate(rotation.conjugate(frame[3:]),
                                 np.column_stack([outline, np.zeros(len(outline))]))
        extent = np.ptp(turned[:, :2], axis=0)
        extent = extent * np.sqrt(area / extent.prod())  # same area, same proportions
        bed = (boxes.high[lower, 2] / MICRO, boxes.low[upper, 2] / MICRO)
        reach = [(boxes.high[r, 2] - boxes.low[r, 2]) / (2.0 * MICRO) for r in (lower, upper)]
        found.append(((lower, upper), (*centre, 0.5 * sum(bed), *frame[3:]), extent, area,
                      bed[1] - bed[0], reach))
    if found:
        site.patches.append(Patches(*(np.array(column) for column in zip(*found))))


def _outlines(site: Site, boxes: Boxes, rows: np.ndarray) -> np.ndarray:
    """Give the corners of bricks in plan, counter-clockwise [m], (n, 4, 2)."""
    low, high = boxes.low[rows] / MICRO, boxes.high[rows] / MICRO
    x = np.stack([low[:, 0], high[:, 0], high[:, 0], low[:, 0]], axis=1)
    y = np.stack([low[:, 1], low[:, 1], high[:, 1], high[:, 1]], axis=1)
    turn = np.array(site.frames)[boxes.frame[rows], None, 3:]
    return rotation.rotate(turn, np.stack([x, y, np.zeros_like(x)], axis=-1))[..., :2]


def _clip(subject: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Intersect convex polygons (Sutherland and Hodgman 1974), (n, 2)."""
    points = list(subject)
    for a, b in zip(window, np.roll(window, -1, axis=0)):
        edge = b - a
        side = [edge[0] * (p[1] - a[1]) - edge[1] * (p[0] - a[0]) for p in points]
        kept = []
        for i, p in enumerate(points):
            j = (i + 1) % len(points)
            if side[i] >= 0.0:
                kept.append(p)
            if (side[i] > 0.0 > side[j]) or (side[i] < 0.0 < side[j]):
                kept.append(p + (points[j] - p) * side[i] / (side[i] - side[j]))
        points = kept
        if len(points) < 3:
            return np.zeros((0, 2))
    return np.array(points)


def _area(outline: np.ndarray) -> tuple[float, np.ndarray]:
    """Give area [m²] and centroid [m] of a polygon."""
    following = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * following[:, 1] - following[:, 0] * outline[:, 1]
    area = 0.5 * cross.sum()
    if area <= 1e-12:
        return 0.0, outline[0]
    return float(area), ((outline + following) * cross[:, None]).sum(axis=0) / (6.0 * area)
