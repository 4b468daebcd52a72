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


"""Manifolds: the contact points of two convex pieces, within reach of a step."""

import math

import numpy as np

from procphys_ros.compilation import subroutine
from procphys_ros.physics.rigid.pieces import EDGES, FACES, ROUND, SLOP
from procphys_ros.physics.rigid.separation import (
    between_edges,
    between_lines,
    CLEARER,
    EDGE,
    middle_of,
    of_axis,
    of_pieces,
)
from procphys_ros.physics.rigid.vectors import (
    at,
    cross,
    dot,
    INLINE,
    LEAN,
    length,
    less,
    plus,
    scaled,
    tangent,
)

MOST = 4  # points of two pieces
_SQUARE = 0.94  # least cosine between a face normal and an edge axis for face contact
_TILT = 0.03  # sine of the largest angle between a round piece and a face or another round piece
#               for contact along a line
_ALONG = math.sqrt(1.0 - _TILT * _TILT)


@subroutine(**INLINE)
def touch(p, q, pieces, margin, points, normal, work):
    """
    Find the points at which two pieces touch.

    :param margin: largest gap that counts [m].
    :param points: written, (MOST, 4): points half-way between the surfaces, and gaps [m].
    :param normal: written, unit, from the second to the first, (3,).
    :param work: two polygons, (2, 16, 4).
    :returns: number of points.
    """
    if pieces.kind[p] == ROUND and pieces.kind[q] == ROUND:
        return _of_two_round(p, q, pieces, margin, points, normal)
    if pieces.kind[p] == ROUND:
        return _of_round(p, q, pieces, margin, points, normal)
    if pieces.kind[q] == ROUND:
        count = _of_round(q, p, pieces, margin, points, normal)
        for i in range(3):
            normal[i] = -normal[i]
        return count
    return _of_solids(p, q, pieces, margin, points, normal, work)


@subroutine(**INLINE)
def _write(points, k, place, gap):
    points[k, 0], points[k, 1], points[k, 2], points[k, 3] = place[0], place[1], place[2], gap


@subroutine(**INLINE)
def _turn(normal, n):
    normal[0], normal[1], normal[2] = n[0], n[1], n[2]


@subroutine(**INLINE)
def _of_solids(p, q, pieces, margin, points, normal, work):
    gap, n, face, other, edge, edge_other = of_pieces(p, q, pieces, margin, work[1, :3, :3])
    if gap > margin:
        return 0
    _turn(normal, n)
    if face == EDGE and other == EDGE:
        count = _of_flat_edges(p, q, pieces, n, gap, margin, points, normal, work)
        if count > 0:
            return count
        return _of_edges(pieces.corners[p], edge, pieces.corners[q], edge_other, gap, points)
    return _of_face(p, q, pieces, n, face, other, margin, points, work)


@subroutine(**LEAN)
def _of_face(p, q, pieces, n, face, other, margin, points, work):
    """Find the contact points of the reference face of one solid with the other solid."""
    if other == EDGE:
        met = _opposite(pieces.normals[q], scaled(-1.0, n))
        count = _clip(pieces.corners[p], face, scaled(-1.0, n), pieces.corners[q], met, margin,
                      work)
    else:
        met = _opposite(pieces.normals[p], n)
        count = _clip(pieces.corners[q], other, n, pieces.corners[p], met, margin, work)
    return _choose(work[0], count, n, points)


@subroutine(**LEAN)
def _of_flat_edges(p, q, pieces, n, gap, margin, points, normal, work):
    """
    Find the contact points of a face nearly normal to the axis of two edges, if there is one.

    A piece across a narrow solid touches two of its edges: on one alone it would teeter.
    """
    face, other = _opposite(pieces.normals[p], n), _opposite(pieces.normals[q], scaled(-1.0, n))
    one, two = scaled(-1.0, at(pieces.normals[p], face)), at(pieces.normals[q], other)
    if max(dot(one, n), dot(two, n)) < _SQUARE:
        return 0
    if dot(one, n) > dot(two, n):
        two, other = one, EDGE
    else:
        face = EDGE
    count = _of_face(p, q, pieces, two, face, other, margin, points, work)
    deepest = np.inf
    for k in range(count):
        deepest = min(deepest, points[k, 3])
    if abs(deepest - gap) > CLEARER:
        return 0
    _turn(normal, two)
    return count


@subroutine(**LEAN)
def _of_edges(corners, edge, others, other, gap, points):
    """
    Find the contact points of two crossing edges: where they are less than `SLOP` apart.

    Nearly parallel edges touch along a line: on their crossing alone a piece would teeter, as
    the crossing moves along the edges with every small rotation.
    """
    one, two = between_edges(corners, edge, others, other)
    middle = scaled(0.5, plus(one, 1.0, two))
    a, b = at(corners, EDGES[edge, 0]), at(corners, EDGES[edge, 1])
    c, d = at(others, EDGES[other, 0]), at(others, EDGES[other, 1])
    u, v = less(b, a), less(d, c)
    u, v = scaled(1.0 / length(u), u), scaled(1.0 / length(v), v)
    if dot(u, v) < 0.0:
        v, c, d = scaled(-1.0, v), d, c
    reach = SLOP / max(length(cross(u, v)), 1e-9)
    first = max(-reach, dot(less(a, one), u), dot(less(c, two), v))
    last = min(reach, dot(less(b, one), u), dot(less(d, two), v))
    if last - first < SLOP:
        _write(points, 0, middle, gap)
        return 1
    along = plus(u, 1.0, v)
    along = scaled(1.0 / length(along), along)
    _write(points, 0, plus(middle, first, along), gap)
    _write(points, 1, plus(middle, last, along), gap)
    return 2


@subroutine(**LEAN)
def _opposite(normals, n):
    """Return the face whose normal is most opposite to a direction."""
    best, face = np.inf, 0
    for f in range(6):
        along = dot(at(normals, f), n)
        if along < best:
            best, face = along, f
    return face


@subroutine(**LEAN)
def _clip(corners, face, n, others, met, margin, work):
    """
    Clip the incident face of a solid by the side planes of the reference face of another.

    :param face, n: reference face and its normal.
    :param met: incident face.
    :param work: its first polygon becomes the points, as in `touch`.
    :returns: their number.
    """
    start = middle_of(corners, face)
    count, now = 4, 0
    for k in range(4):
        for i in range(3):
            work[0, k, i] = others[FACES[met, k], i]
    for k in range(4):
        corner = at(corners, FACES[face, k])
        along = less(at(corners, FACES[face, (k + 1) % 4]), corner)
        if dot(along, along) > 1e-18:
            count = _cut(work[now], count, cross(along, n), corner, work[1 - now])
            now = 1 - now
    kept = 0
    for k in range(count):
        point = at(work[now], k)
        gap = dot(n, less(point, start))
        if gap < margin:
            _write(work[0], kept, plus(point, -0.5 * gap, n), gap)
            kept += 1
    return kept


@subroutine(**LEAN)
def _cut(polygon, count, outwards, corner, out):
    """Clip a polygon by a plane; return the number of its corners."""
    if count == 0:
        return 0
    kept, limit = 0, dot(outwards, corner)
    one = at(polygon, count - 1)
    a = dot(outwards, one) - limit
    for k in range(count):
        two = at(polygon, k)
        b = dot(outwards, two) - limit
        if (a < 0.0 < b) or (b < 0.0 < a):
            out[kept, 0], out[kept, 1], out[kept, 2] = plus(one, a / (a - b), less(two, one))
            kept += 1
        if b <= 0.0:
            out[kept, 0], out[kept, 1], out[kept, 2] = two
            kept += 1
        one, a = two, b
    return kept


@subroutine(**LEAN)
def _choose(found, count, n, points):
    """Keep at most four points: the deepest, the farthest from it, and the widest beside them."""
    if count <= MOST:
        for k in range(count):
            _write(points, k, at(found, k), found[k, 3])
        return count
    deepest = 0
    for k in range(1, count):
        if found[k, 3] < found[deepest, 3] - 1e-9:
            deepest = k
    first, far, widest = at(found, deepest), -1.0, 0
    for k in range(count):
        away = less(at(found, k), first)
        if dot(away, away) > far + 1e-12:
            far, widest = dot(away, away), k
    across = cross(n, less(at(found, widest), first))
    left = right = 0.0
    one = two = -1
    for k in range(count):
        side = dot(across, less(at(found, k), first))
        if side > left + 1e-12:
            left, one = side, k
        if side < right - 1e-12:
            right, two = side, k
    kept = 0
    for k in (deepest, widest, one, two):
        if k >= 0:
            _write(points, kept, at(found, k), found[k, 3])
            kept += 1
    return kept


@subroutine(**LEAN)
def _of_round(p, q, pieces, margin, points, normal):
    """Find the contact points of a round piece and a solid."""
    radius, corners, normals = pieces.radius[p], pieces.corners[q], pieces.normals[q]
    a, b = at(pieces.corners[p], 0), at(pieces.corners[p], 1)
    far, n, point, face = of_axis(a, b, corners, normals)
    if far > radius + margin:
        return 0
    _turn(normal, n)
    axis = less(b, a)
    if dot(axis, axis) > 1e-12:
        lies = _opposite(normals, scaled(-1.0, n)) if face == EDGE else face
        flat = at(normals, lies)
        level = abs(dot(axis, flat)) < _TILT * length(axis)
        if level and dot(flat, n) > _ALONG:
            count = _of_lying(a, b, radius, corners, lies, flat, margin, points)
            if count > 0:
                _turn(normal, flat)
                return count
    _write(points, 0, plus(point, 0.5 * (far - radius), n), far - radius)
    return 1


@subroutine(**LEAN)
def _of_lying(a, b, radius, corners, face, n, margin, points):
    """Find the two contact points of a round piece that lies along a face."""
    first, last = 0.0, 1.0
    axis = less(b, a)
    for k in range(4):
        corner = at(corners, FACES[face, k])
        outwards = cross(less(at(corners, FACES[face, (k + 1) % 4]), corner), n)
        start, way = dot(outwards, less(a, corner)), dot(outwards, axis)
        if way < 0.0:
            first = max(first, -start / way)
        elif way > 0.0:
            last = min(last, -start / way)
        elif start > 0.0:
            return 0
    if first >= last:
        return 0
    kept = 0
    middle = middle_of(corners, face)
    for share in (first, last):
        place = plus(a, share, axis)
        gap = dot(n, less(place, middle)) - radius
        if gap < margin:
            _write(points, kept, plus(place, -radius - 0.5 * gap, n), gap)
            kept += 1
    return kept


@subroutine(**LEAN)
def _of_two_round(p, q, pieces, margin, points, normal):
    a, b = at(pieces.corners[p], 0), at(pieces.corners[p], 1)
    c, d = at(pieces.corners[q], 0), at(pieces.corners[q], 1)
    one, two = between_lines(a, b, c, d)
    away = less(one, two)
    far, both = length(away), pieces.radius[p] + pieces.radius[q]
    if far > both + margin:
        return 0
    u, v = less(b, a), less(d, c)
    n = scaled(1.0 / far, away) if far > 1e-9 else _across(u, v)
    _turn(normal, n)
    size = length(u) * length(v)
    if size > 1e-12 and abs(dot(u, v)) > _ALONG * size:
        count = _of_parallel(a, u, c, d, one, n, pieces.radius[p], pieces.radius[q], margin,
                             points)
        if count == 2:
            return count
    _write(points, 0, plus(two, pieces.radius[q] + 0.5 * (far - both), n), far - both)
    return 1


@subroutine(**LEAN)
def _across(u, v):
    """Return a unit vector normal to two axes that meet, or to the longer of parallel ones."""
    way, longer = cross(u, v), u if dot(u, u) > dot(v, v) else v
    if length(way) > _TILT * length(u) * length(v):
        return scaled(1.0 / length(way), way)
    size = length(longer)
    return tangent(scaled(1.0 / size, longer)) if size > 1e-9 else (0.0, 0.0, 1.0)


@subroutine(**LEAN)
def _of_parallel(a, u, c, d, one, n, radius, other, margin, points):
    """
    Find the contact points at both ends of the overlap of two parallel round pieces.

    Long ones that cross at a small angle touch only where they are less than `SLOP` beside each
    other, as edges do.

    :param one: point of the first axis that is nearest to the second.
    """
    uu, v = dot(u, u), less(d, c)
    s, t = dot(u, less(c, a)) / uu, dot(u, less(d, a)) / uu
    drift = plus(u, -1.0 / (t - s), v)  # of the first against the second, along all of it
    reach = SLOP / max(length(plus(drift, -dot(drift, n), n)), 1e-9)
    nearest = dot(u, less(one, a)) / uu
    first = max(min(s, t), 0.0, nearest - reach)
    last = min(max(s, t), 1.0, nearest + reach)
    kept = 0
    if first < last:
        for share in (first, last):
            place = plus(a, share, u)
            near = plus(c, (share - s) / (t - s), v)
            gap = dot(n, less(place, near)) - radius - other
            if gap < margin:
                _write(points, kept, plus(place, -radius - 0.5 * gap, n), gap)
                kept += 1
    return kept
