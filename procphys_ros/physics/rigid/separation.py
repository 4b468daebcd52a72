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


"""Separation: the axis of greatest separation, or least penetration, of two convex pieces."""

import math

import numpy as np

from procphys_ros.compilation import subroutine
from procphys_ros.physics.rigid.pieces import BOX, EDGES, FACES
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
)

EDGE = -1  # in place of a face: contact of two edges
CLEARER = 0.001  # [m] least advantage of edge axes over face axes, so that manifolds do not jump
_APART = (np.inf, (0.0, 0.0, 1.0), EDGE, EDGE, 0, 0)  # result for separate pieces
_PARALLEL = 1e-3  # sine of the angle between edges that count as parallel


@subroutine(**LEAN)
def middle_of(corners, f):
    """Return the mean of the corners of a face, flat or not."""
    a, b, c, d = (at(corners, FACES[f, 0]), at(corners, FACES[f, 1]), at(corners, FACES[f, 2]),
                  at(corners, FACES[f, 3]))
    return (0.25 * (a[0] + b[0] + c[0] + d[0]), 0.25 * (a[1] + b[1] + c[1] + d[1]),
            0.25 * (a[2] + b[2] + c[2] + d[2]))


@subroutine(**INLINE)
def _least_along(corners, n):
    """Return the least projection of the corners on a direction."""
    least = np.inf
    for c in range(8):
        least = min(least, dot(at(corners, c), n))
    return least


@subroutine(**LEAN)
def _deepest_face(corners, normals, others):
    """Return the greatest separation of another solid along a face normal, and this face."""
    best, face = -np.inf, 0
    for f in range(6):
        n = at(normals, f)
        if dot(n, n) == 0.0:
            continue
        gap = _least_along(others, n) - dot(n, middle_of(corners, f))
        if gap > best:
            best, face = gap, f
    return best, face


@subroutine(**INLINE)
def _edge_axis(corners, others, e, k):
    """
    Return the gap along the axis normal to two edges, and the axis, from the second to the first.

    :returns: -inf where the edges are parallel or of zero length.
    """
    u, v = _edge(corners, e), _edge(others, k)
    if _are_parallel(u, v):
        return -np.inf, (0.0, 0.0, 0.0)
    n = cross(u, v)
    n = scaled(1.0 / length(n), n)
    back = scaled(-1.0, n)
    one = _least_along(corners, n) + _least_along(others, back)
    other = _least_along(others, n) + _least_along(corners, back)
    if one >= other:
        return one, n
    return other, back


@subroutine(**INLINE)
def _edge(corners, e):
    return less(at(corners, EDGES[e, 1]), at(corners, EDGES[e, 0]))


@subroutine(**INLINE)
def _are_parallel(u, v):
    """Return whether two edges span no plane, as one without length does with any."""
    n = cross(u, v)
    return dot(n, n) <= _PARALLEL * _PARALLEL * dot(u, u) * dot(v, v)


@subroutine(**LEAN)
def _edge_directions(corners):
    """Return the edges that are the first of their direction, a bit each."""
    chosen = 0
    for e in range(12):
        u, is_new = _edge(corners, e), True
        for k in range(e):
            if chosen >> k & 1 and _are_parallel(u, _edge(corners, k)):
                is_new = False
                break
        if is_new and dot(u, u) > 0.0:
            chosen |= 1 << e
    return chosen


@subroutine(**LEAN)
def _furthest_edge(corners, e, n):
    """Return the edge that lies farthest in a direction, of all that are parallel to one."""
    u, best, furthest = _edge(corners, e), -np.inf, e
    for k in range(12):
        v = _edge(corners, k)
        if dot(v, v) > 0.0 and _are_parallel(u, v):
            along = dot(at(corners, EDGES[k, 0]), n) + dot(at(corners, EDGES[k, 1]), n)
            if along > best:
                best, furthest = along, k
    return furthest


@subroutine(**LEAN)
def of_hexahedra(corners, normals, others, other_normals, margin):
    """
    Find the axis of least overlap of two convex hexahedra.

    :returns: gap [m], unit normal from the second to the first, reference face of the first
        or `EDGE`, reference face of the second or `EDGE`, and the two edges, if both are `EDGE`.
    """
    gap, face = _deepest_face(corners, normals, others)
    other_gap, other_face = _deepest_face(others, other_normals, corners)
    if gap > margin or other_gap > margin:
        return _APART
    ways, other_ways = _edge_directions(corners), _edge_directions(others)
    best, first, second, normal = -np.inf, 0, 0, (0.0, 0.0, 1.0)
    for e in range(12):
        for k in range(12):
            if ways >> e & 1 and other_ways >> k & 1:
                found, n = _edge_axis(corners, others, e, k)
                if found > best:
                    best, first, second, normal = found, e, k, n
    if best > margin:
        return _APART
    if best > max(gap, other_gap) + CLEARER:
        return (best, normal, EDGE, EDGE, _furthest_edge(corners, first, scaled(-1.0, normal)),
                _furthest_edge(others, second, normal))
    if gap >= other_gap - CLEARER:
        return gap, scaled(-1.0, at(normals, face)), face, EDGE, 0, 0
    return other_gap, at(other_normals, other_face), EDGE, other_face, 0, 0


@subroutine(**INLINE)
def of_boxes(centre, other_centre, size, other_size, turn, other, margin, cosines):
    """
    Find the axis of least overlap of two boxes, from their axes (Gottschalk 1996, "OBBTree").

    :param cosines: between their axes, written, (3, 3).
    :returns: see `of_hexahedra`.
    """
    way = less(centre, other_centre)
    best, which = -np.inf, 0
    for i in range(3):
        gap = abs(dot(way, at(turn, i))) - 0.5 * size[i]
        for j in range(3):
            cosines[i, j] = dot(at(turn, i), at(other, j))
            gap -= 0.5 * other_size[j] * abs(cosines[i, j])
        if gap > margin:
            return _APART
        if gap > best:
            best, which = gap, i
    for j in range(3):
        gap = abs(dot(way, at(other, j))) - 0.5 * other_size[j]
        for i in range(3):
            gap -= 0.5 * size[i] * abs(cosines[i, j])
        if gap > margin:
            return _APART
        if gap > best + (CLEARER if which < 3 else 0.0):
            best, which = gap, 3 + j
    edge, i, j = _widest_edges(way, size, other_size, turn, other, cosines)
    if edge > margin:
        return _APART
    if edge > best + CLEARER:
        n = cross(at(turn, i), at(other, j))
        normal = scaled((1.0 if dot(n, way) > 0.0 else -1.0) / length(n), n)
        return (edge, normal, EDGE, EDGE, _edge_towards(i, turn, scaled(-1.0, normal)),
                _edge_towards(j, other, normal))
    n = at(turn, which) if which < 3 else at(other, which - 3)
    side = 1 if dot(way, n) > 0.0 else 0  # of the second box that the first lies on
    normal = n if side == 1 else scaled(-1.0, n)
    if which < 3:
        return best, normal, 2 * which + 1 - side, EDGE, 0, 0
    return best, normal, EDGE, 2 * (which - 3) + side, 0, 0


@subroutine(**LEAN)
def _widest_edges(way, size, other_size, turn, other, cosines):
    """Return the widest gap along an axis normal to an edge of each box, and the edges' axes."""
    best, first, second = -np.inf, 0, 0
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        along, across = dot(way, at(turn, i1)), dot(way, at(turn, i2))
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            sine = 1.0 - cosines[i, j] * cosines[i, j]
            if sine < _PARALLEL * _PARALLEL:
                continue
            gap = abs(across * cosines[i1, j] - along * cosines[i2, j])
            gap -= 0.5 * (size[i1] * abs(cosines[i2, j]) + size[i2] * abs(cosines[i1, j])
                          + other_size[j1] * abs(cosines[i, j2])
                          + other_size[j2] * abs(cosines[i, j1]))
            gap /= math.sqrt(sine)
            if gap > best:
                best, first, second = gap, i, j
    return best, first, second


@subroutine(**LEAN)
def _edge_towards(axis, turn, n):
    """Return the edge of a box along an axis that lies farthest in a direction."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    corner = ((1 << one) if dot(at(turn, one), n) > 0.0 else 0) | (
        (1 << two) if dot(at(turn, two), n) > 0.0 else 0)
    for k in range(4 * axis, 4 * axis + 4):
        if EDGES[k, 0] == corner:
            return k
    return 4 * axis


@subroutine(**INLINE)
def of_pieces(p, q, pieces, margin, cosines):
    """Find the axis of least overlap of two pieces with corners, see `of_hexahedra`."""
    if pieces.kind[p] == BOX and pieces.kind[q] == BOX:
        return of_boxes(at(pieces.centre, p), at(pieces.centre, q), at(pieces.size, p),
                        at(pieces.size, q), pieces.axes[p], pieces.axes[q], margin, cosines)
    return of_hexahedra(pieces.corners[p], pieces.normals[p], pieces.corners[q],
                        pieces.normals[q], margin)


@subroutine(**LEAN)
def between_lines(a, b, c, d):
    """
    Find the points of two segments that are nearest to each other (Ericson 2005, 5.1.9).

    :returns: the point on a b, and the one on c d.
    """
    u, v, w = less(b, a), less(d, c), less(a, c)
    uu, vv, uv, uw, vw = dot(u, u), dot(v, v), dot(u, v), dot(u, w), dot(v, w)
    s = t = 0.0
    if uu <= 1e-18 and vv <= 1e-18:
        return a, c
    if uu <= 1e-18:
        t = min(max(vw / vv, 0.0), 1.0)
        return a, plus(c, t, v)
    if vv <= 1e-18:
        s = min(max(-uw / uu, 0.0), 1.0)
        return plus(a, s, u), c
    wide = uu * vv - uv * uv
    if wide > 1e-12 * uu * vv:
        s = min(max((uv * vw - vv * uw) / wide, 0.0), 1.0)
    t = (uv * s + vw) / vv
    if t < 0.0:
        t, s = 0.0, min(max(-uw / uu, 0.0), 1.0)
    elif t > 1.0:
        t, s = 1.0, min(max((uv - uw) / uu, 0.0), 1.0)
    return plus(a, s, u), plus(c, t, v)


@subroutine(**LEAN)
def between_edges(corners, e, others, k):
    """Find the nearest points of an edge of one solid and one of another."""
    return between_lines(at(corners, EDGES[e, 0]), at(corners, EDGES[e, 1]),
                         at(others, EDGES[k, 0]), at(others, EDGES[k, 1]))


@subroutine(**LEAN)
def in_face(corners, f, n, point):
    """Return whether a point lies over a face, seen along its normal."""
    for k in range(4):
        start, end = at(corners, FACES[f, k]), at(corners, FACES[f, (k + 1) % 4])
        if dot(cross(less(end, start), n), less(point, start)) > 0.0:  # to its right
            return False
    return True


@subroutine(**LEAN)
def _enters(a, b, corners, normals):
    """Return whether a segment intersects a solid, by clipping with all faces."""
    first, last = 0.0, 1.0
    for f in range(6):
        n, middle = at(normals, f), middle_of(corners, f)
        start, way = dot(n, less(a, middle)), dot(n, less(b, a))
        if way < 0.0:
            first = max(first, -start / way)
        elif way > 0.0:
            last = min(last, -start / way)
        elif start > 0.0:
            return False
    return first <= last


@subroutine(**LEAN)
def _across_edges(a, b, corners, best):
    """
    Find the least way out of a solid for an axis inside: by a face, which is given, or an edge.

    A long axis that cuts off an edge is in deep for all faces.
    """
    axis, gap, edge, normal = less(b, a), best[0] + CLEARER, EDGE, best[1]
    for e in range(12):
        way = _edge(corners, e)
        if not _are_parallel(axis, way):
            n = cross(axis, way)
            n = scaled(1.0 / length(n), n)
            for side in (n, scaled(-1.0, n)):
                found = dot(side, a) + _least_along(corners, scaled(-1.0, side))
                if found > gap:
                    gap, edge, normal = found, e, side
    if edge == EDGE:
        return best
    edge = _furthest_edge(corners, edge, normal)
    _, point = between_lines(a, b, at(corners, EDGES[edge, 0]), at(corners, EDGES[edge, 1]))
    return gap, normal, point, EDGE


@subroutine(**LEAN)
def of_axis(a, b, corners, normals):
    """
    Find the least distance of the axis of a round piece from a solid.

    :param a, b: ends of the axis.
    :returns: distance [m], negative inside; unit normal from the solid to the axis; point on
        the solid; nearest face, `EDGE` = an edge or a corner.
    """
    gap, face = -np.inf, 0
    for f in range(6):
        n = at(normals, f)
        if dot(n, n) > 0.0:
            middle = middle_of(corners, f)
            found = min(dot(n, less(a, middle)), dot(n, less(b, middle)))
            if found > gap:
                gap, face = found, f
    normal = at(normals, face)
    low = a if dot(normal, a) < dot(normal, b) else b
    best = (gap, normal, plus(low, -gap, normal), face)
    if _enters(a, b, corners, normals):
        return _across_edges(a, b, corners, best)
    least = np.inf
    for f in range(6):
        n = at(normals, f)
        for end in (a, b):
            far = dot(n, less(end, middle_of(corners, f)))
            if 0.0 < far < least and in_face(corners, f, n, end):
                least, best = far, (far, n, plus(end, -far, n), f)
    for e in range(12):
        near, point = between_lines(a, b, at(corners, EDGES[e, 0]), at(corners, EDGES[e, 1]))
        far = length(less(near, point))
        if 1e-9 < far < least - 1e-9:
            least = far
            best = (far, scaled(1.0 / far, less(near, point)), point, EDGE)
    return best
