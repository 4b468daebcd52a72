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

"""Polygons: overlaps of opposite faces of solids with eight corners."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import GROUND
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import faces
from procphys_ros.geometry.linear import cross, eigen, norm, product
from procphys_ros.wallgrammar.assembly import Patches

_FACING = -0.94    # largest cosine between normals of opposite faces: 20 degrees
_INSIDE = 0.004    # [m] by which such faces may penetrate each other
_TOUCHING = 0.0015  # [m] largest gap between nailed parts; tiles lie further apart
_LEAST = 4e-4      # [m²] smaller patches are dropped
_THINNEST = 0.008  # [m] narrower ones too,
_NARROW = 0.012    # [m] and these, unless a solid has no other
_AT_ONCE = 64      # solids compared with all others at once


def meet(corners: np.ndarray, chosen: np.ndarray, reach: float,
         nailed: np.ndarray | None = None) -> Patches:
    """
    Find the contact polygons of some solids with each other, with all others, and the ground.

    Opposite faces at most `reach` apart meet where they overlap, seen along the mean of their
    normals. The patch lies halfway, with its principal axes, and has the extents
    of the rectangle with the same second moments over its area. Of several patches between two
    solids the widest counts.

    :param corners: of all solids, world [m], (N, 8, 3).
    :param chosen: solids whose contacts are wanted, (N,) bool.
    :param reach: widest joint [m].
    :param nailed: solids without mortar between two of them, which must touch each other,
        (N,) bool; None = there is mortar between all.
    """
    pairs = _near(corners, chosen, reach)
    points, normals, middles = faces(corners)
    if nailed is None:
        nailed = np.zeros(len(corners), bool)
    found = [_patch(pair, points[pair[0], f], points[pair[1], g], normal, gap)
             for pair, f, g, normal, gap in _facing(pairs, normals, middles, reach)
             if gap < _TOUCHING or not (nailed[pair[0]] and nailed[pair[1]])]
    rows = np.flatnonzero(chosen & (corners[:, :, 2].min(axis=1) < reach))
    down = np.array([0.0, 0.0, -1.0])
    for row in rows.tolist():
        for f in np.flatnonzero((product(normals[row], down) > -_FACING)
                                & (middles[row, :, 2] < reach)).tolist():
            flat = points[row, f] * [1.0, 1.0, 0.0]
            found.append(_patch((GROUND, row), flat[::-1], points[row, f], -down,
                                float(middles[row, f, 2])))
    widest: dict[tuple[int, int], tuple] = {}
    for patch in found:
        if patch is not None and (patch[0] not in widest or widest[patch[0]][3] < patch[3]):
            widest[patch[0]] = patch
    return _table(_wide(list(widest.values()), chosen), corners)


def _wide(found: Sequence[tuple], chosen: np.ndarray) -> list[tuple]:
    """Drop narrow patches, except those of solids that have no others."""
    wide = [bool(patch[2].min() >= _NARROW) for patch in found]
    held = ~chosen
    for patch, is_wide in zip(found, wide):
        if is_wide:
            held[[part for part in patch[0] if part != GROUND]] = True
    return [patch for patch, is_wide in zip(found, wide)
            if is_wide or not all(held[part] for part in patch[0] if part != GROUND)]


def _near(corners: np.ndarray, chosen: np.ndarray, reach: float) -> np.ndarray:
    """List pairs of solids whose bounds are within reach, each once, (K, 2)."""
    low, high = corners.min(axis=1) - reach, corners.max(axis=1)
    rows = np.flatnonzero(chosen)
    found = [np.zeros((0, 2), np.intp)]
    for start in range(0, len(rows), _AT_ONCE):
        some = rows[start:start + _AT_ONCE]
        close = np.ones((len(some), len(corners)), bool)
        for axis in range(3):
            close &= low[some, axis, None] <= high[:, axis]
            close &= high[some, axis, None] >= low[:, axis]
        first, second = np.nonzero(close)
        first = some[first]
        once = (first < second) | ~chosen[second]
        found.append(np.column_stack([first, second])[once])
    return np.concatenate(found)


def _facing(pairs: np.ndarray, normals: np.ndarray, middles: np.ndarray, reach: float
            ) -> Sequence[tuple[tuple[int, int], int, int, np.ndarray, float]]:
    """List opposite faces of pairs: pair, face of each, mean normal and gap [m]."""
    first, second = pairs.T
    cosine = np.einsum('pfk,pgk->pfg', normals[first], normals[second])
    pair, f, g = np.nonzero(cosine < _FACING)
    a, b = first[pair], second[pair]
    normal = normals[a, f] - normals[b, g]
    normal /= norm(normal, axis=1, keepdims=True)
    gap = ((middles[b, g] - middles[a, f]) * normal).sum(axis=1)
    keep = np.flatnonzero((gap > -_INSIDE) & (gap < reach))
    return [((int(a[k]), int(b[k])), int(f[k]), int(g[k]), normal[k], float(gap[k]))
            for k in keep]


def _patch(pair: tuple[int, int], face: np.ndarray, other: np.ndarray, normal: np.ndarray,
           gap: float) -> tuple | None:
    """Compute the patch where faces overlap: pair, frame, extents, area, gap and centroid."""
    along = face[1] - face[0] if np.ptp(face[:2], axis=0).max() > 1e-9 else face[2] - face[1]
    along = along - product(along, normal) * normal
    along /= norm(along)
    axes = np.empty((3, 3))
    axes[:, 0], axes[:, 1], axes[:, 2] = along, cross(normal, along), normal
    centre = 0.5 * (face.mean(axis=0) + other.mean(axis=0))
    flat = [product(points - centre, axes[:, :2]) for points in (face, other[::-1])]
    outline = clip(*flat)
    if len(outline) < 3:
        return None
    area, middle, second = moments(outline)
    if area < _LEAST:
        return None
    spread, turn = eigen(second)
    if abs(second[0, 1]) < 1e-6 * np.trace(second):  # also where both sides are alike
        spread, turn = np.diag(second), np.eye(2)
    elif turn[0, 0] * turn[1, 1] < turn[0, 1] * turn[1, 0]:
        turn[:, 0] *= -1.0
    extent = np.sqrt(12.0 * spread / area)
    if extent.min() < _THINNEST:
        return None
    frame = np.column_stack([product(axes[:, :2], turn), normal])
    return pair, frame, extent, area, gap, centre + product(axes[:, :2], middle)


def _table(found: Sequence[tuple], corners: np.ndarray) -> Patches:
    """Collect patches into columns."""
    if not found:
        none = np.zeros(0)
        return Patches(np.zeros((0, 2), np.intp), np.zeros((0, 7)), np.zeros((0, 2)), none, none,
                       np.zeros((0, 2)))
    pair, frame, extent, area, gap, place = (np.array(column) for column in zip(*found))
    pose = np.column_stack([place, rotation.from_matrix(frame)])
    normal = rotation.rotate(pose[:, 3:], np.array([0.0, 0.0, 1.0]))
    along = np.einsum('mpck,mk->mpc', corners[pair], normal)
    reach = 0.5 * np.ptp(along, axis=2)
    reach[pair == GROUND] = 0.0
    return Patches(pair, pose, extent, area, np.maximum(gap, 0.0), reach)


def clip(subject: np.ndarray, window: np.ndarray) -> np.ndarray:
    """
    Intersect convex polygons (Sutherland and Hodgman 1974), (n, 2).

    :param subject, window: corners, counter-clockwise, (n, 2).
    """
    points, corners = subject.tolist(), window.tolist()
    for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1]):
        side = [(u - x) * (q - y) - (v - y) * (p - x) for p, q in points]
        kept = []
        for i, (p, q) in enumerate(points):
            j = (i + 1) % len(points)
            if side[i] >= 0.0:
                kept.append([p, q])
            if (side[i] > 0.0 > side[j]) or (side[i] < 0.0 < side[j]):
                along = side[i] - side[j]
                kept.append([p + (points[j][0] - p) * side[i] / along,
                             q + (points[j][1] - q) * side[i] / along])
        points = kept
        if len(points) < 3:
            return np.zeros((0, 2))
    return np.array(points)


def moments(outline: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """
    Compute area [m²], centroid [m], (2,), and second moments about it [m⁴], (2, 2), of a polygon.

    :param outline: corners, counter-clockwise [m], (n, 2).
    """
    following = np.concatenate([outline[1:], outline[:1]])
    cross = outline[:, 0] * following[:, 1] - following[:, 0] * outline[:, 1]
    area = 0.5 * float(cross.sum())
    if area <= 1e-12:
        return 0.0, outline[0], np.zeros((2, 2))
    middle = ((outline + following) * cross[:, None]).sum(axis=0) / (6.0 * area)
    a, b = outline - middle, following - middle
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    total = a + b
    second = sum(np.einsum('n,ni,nj->ij', cross, u, u) for u in (a, b, total)) / 24.0
    return area, middle, second
