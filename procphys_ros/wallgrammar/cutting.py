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

"""Cutting: bricks beside and under arches, cut to outlines."""

from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import hypot
from procphys_ros.geometry.linear import product
from procphys_ros.wallgrammar.polygons import moments

_ROUND = 0.0015  # [m] of a corner that may be cut off, to leave a piece with four
_NARROW = 0.005  # [m] thinner pieces are left out: mortar fills their place
_NOTHING = 1e-7  # [m²] smaller overlaps do not count
_STEEP = 1.0     # rise over run beyond which a side is fitted sideways, not vertically


class Zone(NamedTuple):
    """
    Region outside one side of a convex outline; the zones of an outline fill its exterior.

    :ivar planes: half planes whose intersection it is, rows a b c of a·x + z·b <= c [m], (3, 3);
        the first one is the side.
    :ivar outwards: unit normal of the side, (2,).
    """

    planes: np.ndarray
    outwards: np.ndarray


class Gap(NamedTuple):
    """
    Region that bricks make room for.

    :ivar outline: region without bricks, convex, counter-clockwise [m], (n, 2).
    :ivar inside: region of the bricks inside of it, likewise; None = there are none.
    """

    outline: np.ndarray
    inside: np.ndarray | None


def rectangles(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the outlines of boxes, counter-clockwise, (n, 4, 2), from corners (n, 2)."""
    return np.stack([low, np.column_stack([high[:, 0], low[:, 1]]), high,
                     np.column_stack([low[:, 0], high[:, 1]])], axis=1)


def polygon(planes: np.ndarray) -> np.ndarray:
    """Compute the intersection of half planes, a counter-clockwise polygon, (n, 2)."""
    far = 2.0 * float(np.abs(planes[:, 2]).max()) + 1e3
    return without(within(far * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]),
                          planes), 1e-6)


def is_steep(way: np.ndarray) -> bool:
    """Return whether a side, (2,), is fitted sideways."""
    return bool(abs(way[1]) > _STEEP * abs(way[0]))


def zones(outline: np.ndarray) -> list[Zone]:
    """
    Partition the exterior of a convex, counter-clockwise outline by level and upright rays.

    Rays go out from its corners: upright ones where it is shallow, level ones where it is steep.
    """
    ways = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([ways[:, 1], -ways[:, 0]]) / hypot(*ways.T)[:, None]
    rays = []
    for before, after in zip(np.roll(normals, 1, axis=0), normals):
        out = before + after
        level = abs(out[0]) > 0.999 * abs(out[1])
        rays.append(np.array([np.sign(out[0]), 0.0]) if level
                    else np.array([0.0, np.sign(out[1])]))
    found = []
    for i, normal in enumerate(normals):
        j = (i + 1) % len(outline)
        # Counter-clockwise, the zone lies to the left of its first ray and right of its second.
        planes = [[*-normal, -float(product(normal, outline[i]))]]
        for corner, ray, sign in ((outline[i], rays[i], 1.0), (outline[j], rays[j], -1.0)):
            across = sign * np.array([ray[1], -ray[0]])
            planes.append([*across, float(product(across, corner))])
        found.append(Zone(np.array(planes), normal))
    return found


def half_planes(outline: np.ndarray) -> np.ndarray:
    """Compute the half planes of a convex, counter-clockwise outline, (n, 3)."""
    ways = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([ways[:, 1], -ways[:, 0]]) / hypot(*ways.T)[:, None]
    return np.column_stack([normals, (normals * outline).sum(axis=1)])


def within(outline: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Clip a convex outline by half planes, rows a b c of a·x + z·b <= c, (n, 2)."""
    for a, b, c in planes:
        side = product(outline, np.array([a, b])) - c
        if not (side > 0.0).any():
            continue
        if not (side < 0.0).any():
            return np.zeros((0, 2))
        points = []
        for i, point in enumerate(outline):
            j = (i + 1) % len(outline)
            if side[i] <= 0.0:
                points.append(point)
            if (side[i] < 0.0 < side[j]) or (side[i] > 0.0 > side[j]):
                points.append(point + (outline[j] - point) * side[i] / (side[i] - side[j]))
        outline = np.array(points)
    return outline


def area(outline: np.ndarray) -> float:
    """Compute the area of a counter-clockwise outline [m²]."""
    return moments(outline)[0] if len(outline) > 2 else 0.0


def around(outline: np.ndarray, sides: list[Zone], least: float, joint: float
           ) -> list[np.ndarray]:
    """
    Split the outline of a brick by zones; slivers are merged with the piece beside them.

    :param sides: zones in their order around the gap.
    :param least: width below which a piece is a sliver [m].
    :param joint: [m]; merging a sliver may lose an eighth of it on average.
    """
    pieces: list[np.ndarray] = []
    last: Zone | None = None
    planes = np.array([zone.planes for zone in sides])
    beyond = product(planes[..., :2], outline.T) >= planes[..., 2:]
    for zone, apart in zip(sides, beyond.all(axis=2).any(axis=1).tolist()):
        piece = outline[:0] if apart else within(outline, zone.planes)
        if area(piece) < _NOTHING:
            last = None
            continue
        if pieces and last is not None:
            merged = _merged(outline, (last, zone), (pieces[-1], piece), least, joint)
            if merged is not None:
                pieces[-1], last = merged
                continue
        pieces.append(piece)
        last = zone
    return pieces


def _merged(outline: np.ndarray, pair: tuple[Zone, Zone], pieces: tuple[np.ndarray, np.ndarray],
            least: float, joint: float) -> tuple[np.ndarray, Zone] | None:
    """Merge the pieces of two zones along one side, if nothing is lost or one is a sliver."""
    along = np.abs(pair[0].planes[2, :2])
    thin = min(float(np.ptp(product(piece, along))) for piece in pieces)
    most = _NOTHING + (0.125 * joint * thin if thin < least else 0.0)
    whole = sum(map(area, pieces))
    for zone in pair:
        planes = np.array([zone.planes[0], pair[0].planes[1], pair[1].planes[2]])
        both = within(outline, planes)
        if abs(whole - area(both)) < most:
            return both, Zone(planes, zone.outwards)
    return None


def quads(outline: np.ndarray) -> list[np.ndarray]:
    """
    Split a convex outline into quadrilaterals, without those too thin to lay.

    :param outline: counter-clockwise, (n, 2).
    :returns: outlines of four corners each; the last one twice for a triangle.
    """
    outline = without(outline, 1e-6)
    if not area(outline) or _thinnest(outline) < _NARROW:
        return []
    if len(outline) == 3:
        return [np.concatenate([outline, outline[-1:]])]
    if len(outline) == 4:
        return [outline]
    before, after = np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0)
    way = after - before
    off = np.abs(way[:, 0] * (outline - before)[:, 1] - way[:, 1] * (outline - before)[:, 0])
    off /= hypot(*way.T)
    if off.min() < _ROUND:
        return quads(np.delete(outline, int(np.argmin(off)), axis=0))
    parted = [[_half(outline, axis, sign, line) for sign in (1.0, -1.0)]
              for axis in (0, 1) for line in np.sort(outline[:, axis])[1:-1]]
    best = max(parted, key=_worth)
    return [quad for half in best for quad in quads(half)]


def _worth(halves: list[np.ndarray]) -> tuple[int, float]:
    """Rate a split of an outline: few corners first, then no thin half."""
    halves = [without(half, 1e-6) for half in halves]
    if min(map(len, halves)) < 3:
        return (-100, 0.0)
    return (-max(4, *map(len, halves)), min(map(_thinnest, halves)))


def _half(outline: np.ndarray, axis: int, sign: float, line: float) -> np.ndarray:
    plane = np.zeros(3)
    plane[axis], plane[2] = sign, sign * line
    return within(outline, plane[None])


def without(outline: np.ndarray, distance: float) -> np.ndarray:
    """Drop corners that coincide with others, or lie on the line between their neighbours."""
    kept = outline
    changed = True
    while changed and len(kept) > 2:
        before, after = np.roll(kept, 1, axis=0), np.roll(kept, -1, axis=0)
        way = after - before
        length = np.maximum(hypot(*way.T), 1e-12)
        off = np.abs(way[:, 0] * (kept - before)[:, 1] - way[:, 1] * (kept - before)[:, 0])
        flat = (off / length < distance) | (hypot(*(after - kept).T) < distance)
        changed = bool(flat.any())
        kept = np.delete(kept, np.flatnonzero(flat)[:1], axis=0)
    return kept


def _thinnest(outline: np.ndarray) -> float:
    """Compute the least width of an outline across any of its sides [m]."""
    return float(np.ptp(product(outline, half_planes(outline)[:, :2].T), axis=0).min())
