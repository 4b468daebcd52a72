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


"""Ground: the points at which a piece touches it, at its corners and on ridges and peaks."""

import numpy as np

from procphys_ros.compilation import subroutine
from procphys_ros.physics.rigid.pieces import EDGES, point_velocity, ROUND, SLOP, spin_of
from procphys_ros.physics.rigid.separation import middle_of
from procphys_ros.physics.rigid.vectors import at, cross, dot, LEAN, length, less, plus, scaled
from procphys_ros.physics.terrain import height_at, normal_at

MOST_ON_GROUND = 16  # contact points of a piece: its corners, and as many between them
_CONVEX = 1e-9  # [m] of height by which ground bends that counts as a ridge


@subroutine(**LEAN)
def touch_ground(p, pieces, poses, velocities, terrain, time_step, points, normals):
    """
    Find the points at which a piece touches the ground, and the normals of the ground there.

    Between its corners a solid touches ridges with its edges, and peaks with its faces. Only
    convex bends of the ground count, so that level ground adds none.

    :param points: written, (`MOST_ON_GROUND`, 4): half-way between the surfaces, and gap [m].
    :param normals: written, (`MOST_ON_GROUND`, 3).
    :returns: number of points.
    """
    if pieces.bounds[p, 2] > _highest(terrain, pieces.bounds[p]):
        return 0
    body = pieces.body[p]
    speed = (length(point_velocity(poses[body], velocities[body], pieces.centre[p]))
             + spin_of(velocities[body]) * pieces.reach[p])
    margin = SLOP + speed * time_step
    count = _corners(p, pieces, terrain, margin, points, normals)
    if terrain.heights.shape[0] == 0:
        return count
    corners, radius = pieces.corners[p], pieces.radius[p]
    if pieces.kind[p] == ROUND:
        count = _ridges(at(corners, 0), at(corners, 1), radius, terrain, margin, points, normals,
                        count)
    else:
        for e in range(12):
            count = _ridges(at(corners, EDGES[e, 0]), at(corners, EDGES[e, 1]), 0.0, terrain,
                            margin, points, normals, count)
    return _peaks(p, pieces, terrain, margin, points, normals, count)


@subroutine(**LEAN)
def _span(low, high, start, edge, count):
    """Return the first and the last grid line around an interval."""
    first = int(np.floor(min(max((low - start) / edge, 0.0), count - 1.0)))
    last = int(np.ceil(min(max((high - start) / edge, 0.0), count - 1.0)))
    return first, last


@subroutine(**LEAN)
def _highest(terrain, bounds):
    """Return the largest height of the ground under bounds [m]."""
    h = terrain.heights
    if h.shape[0] == 0:
        return 0.0
    i, last = _span(bounds[0], bounds[3], terrain.low[0], terrain.edge, h.shape[0])
    j, end = _span(bounds[1], bounds[4], terrain.low[1], terrain.edge, h.shape[1])
    highest = -np.inf
    for k in range(i, last + 1):
        for n in range(j, end + 1):
            highest = max(highest, h[k, n])
    return highest


@subroutine(**LEAN)
def _corners(p, pieces, terrain, margin, points, normals):
    """Find the corners of a solid, or the ends of a round piece, that touch the ground."""
    last = 2 if pieces.kind[p] == ROUND else 8
    if pieces.kind[p] == ROUND and pieces.size[p, 2] <= pieces.size[p, 0]:
        last = 1
    count = 0
    for c in range(last):
        corner = at(pieces.corners[p], c)
        n = normal_at(terrain, corner[0], corner[1])
        gap = (corner[2] - height_at(terrain, corner[0], corner[1])) * n[2] - pieces.radius[p]
        if gap < margin:
            count = _keep(plus(corner, -pieces.radius[p] - 0.5 * gap, n), gap, n, points,
                          normals, count)
    return count


@subroutine(**LEAN)
def _keep(place, gap, n, points, normals, count):
    """Append a point, or replace the shallowest when there is no room; return their number."""
    row = count
    if count == MOST_ON_GROUND:
        row = 0
        for k in range(1, count):
            if points[k, 3] > points[row, 3]:
                row = k
        if points[row, 3] <= gap:
            return count
    for i in range(3):
        points[row, i], normals[row, i] = place[i], n[i]
    points[row, 3] = gap
    return max(count, row + 1)


@subroutine(**LEAN)
def _next(place, way, done):
    """Return the parameter at which a line passes the next integer behind `done`."""
    if way == 0.0:
        return np.inf
    line = np.floor(place + done * way + 1e-9) + 1.0 if way > 0.0 else (
        np.ceil(place + done * way - 1e-9) - 1.0)
    return (line - place) / way


@subroutine(**LEAN)
def _ridges(a, b, radius, terrain, margin, points, normals, count):
    """
    Find where an edge of a solid, or the axis of a round piece, touches ridges of the ground.

    Its height over the ground is linear between grid lines and diagonals.

    :param a, b: its ends.
    """
    way, edge = less(b, a), terrain.edge
    u, v = (a[0] - terrain.low[0]) / edge, (a[1] - terrain.low[1]) / edge
    du, dv = way[0] / edge, way[1] / edge
    done, over, before = 0.0, a[2] - height_at(terrain, a[0], a[1]), np.inf
    ridge, share = (0.0, 0.0, 0.0), 0.0
    while done < 1.0:
        x, y, z = _next(u, du, done), _next(v, dv, done), _next(u + v, du + dv, done)
        t = min(x, y, z, 1.0)
        place = plus(a, t, way)
        now = place[2] - height_at(terrain, place[0], place[1])
        slope = (now - over) / (t - done)
        if done > 0.0 and slope - before > _CONVEX:
            count = _on_ridge(plus(a, done, way), way, ridge, share, over, radius, margin,
                              points, normals, count)
        ridge, share = _ridge(terrain, u + t * du, v + t * dv, 0 if t == x else 1 if t == y else 2)
        done, over, before = t, now, slope
    return count


@subroutine(**LEAN)
def _ridge(terrain, u, v, kind):
    """Return the ridge between two nodes, along y, along x or a diagonal, and a place on it."""
    h, edge = terrain.heights, terrain.edge
    columns, rows = h.shape
    i = int(np.floor(u + (0.5 if kind == 0 else 0.0)))
    j = int(np.floor(v + (0.5 if kind == 1 else 0.0)))
    i, j = min(max(i, 0), columns - 1), min(max(j, 0), rows - 1)
    right, up = min(i + 1, columns - 1), min(j + 1, rows - 1)
    if kind == 0:
        return (0.0, edge, h[i, up] - h[i, j]), v - j
    if kind == 1:
        return (edge, 0.0, h[right, j] - h[i, j]), u - i
    return (-edge, edge, h[i, up] - h[right, j]), v - j


@subroutine(**LEAN)
def _on_ridge(place, way, ridge, share, over, radius, margin, points, normals, count):
    """
    Write the point at which an edge or an axis crosses a ridge, if it touches there.

    It is nearest to the ridge a little beside the crossing, and must be so between its ends.

    :param share: of the ridge at the crossing, seen from above.
    :param over: height of the edge over the ridge there [m].
    """
    n = cross(way, ridge)
    size = length(n)
    if abs(n[2]) <= _CONVEX * size:
        return count
    along = dot(way, way) * ridge[2] - dot(way, ridge) * way[2]
    nearest = share + over * along / (size * size)
    if not -_CONVEX <= nearest <= 1.0 + _CONVEX:
        return count
    n = scaled((1.0 if n[2] > 0.0 else -1.0) / size, n)
    gap = over * n[2] - radius
    if gap >= margin:
        return count
    return _keep(plus(place, -radius - 0.5 * gap, n), gap, n, points, normals, count)


@subroutine(**LEAN)
def _peaks(p, pieces, terrain, margin, points, normals, count):
    """Find where a piece touches peaks of the ground between its corners."""
    h, bounds = terrain.heights, pieces.bounds[p]
    i, last = _span(bounds[0], bounds[3], terrain.low[0], terrain.edge, h.shape[0])
    j, end = _span(bounds[1], bounds[4], terrain.low[1], terrain.edge, h.shape[1])
    for k in range(i, last + 1):
        for m in range(j, end + 1):
            if not _is_convex(h, k, m):
                continue
            peak = (terrain.low[0] + k * terrain.edge, terrain.low[1] + m * terrain.edge, h[k, m])
            if pieces.kind[p] == ROUND:
                gap, n = _over_axis(at(pieces.corners[p], 0), at(pieces.corners[p], 1),
                                    pieces.radius[p], peak)
            else:
                gap, n = _underside(pieces.corners[p], pieces.normals[p], peak)
            if gap < margin and n[2] > 0.0:
                count = _keep(plus(peak, 0.5 * gap, n), gap, n, points, normals, count)
    return count


@subroutine(**LEAN)
def _is_convex(h, i, j):
    """Return whether the ground bends upwards at a node, along one of the lines through it."""
    left, right = max(i - 1, 0), min(i + 1, h.shape[0] - 1)
    down, up = max(j - 1, 0), min(j + 1, h.shape[1] - 1)
    least = min(h[left, j] + h[right, j], h[i, down] + h[i, up], h[left, up] + h[right, down])
    return least < 2.0 * h[i, j] - _CONVEX


@subroutine(**LEAN)
def _over_axis(a, b, radius, peak):
    """Return the gap of a round piece over a peak [m], and its normal; inf beside its axis."""
    way, off = less(b, a), less(peak, a)
    level = way[0] * way[0] + way[1] * way[1]
    share = (off[0] * way[0] + off[1] * way[1]) / level if level > 0.0 else 0.0
    away = less(plus(a, share, way), peak)
    aside = away[0] * away[0] + away[1] * away[1]
    if not 0.0 < share < 1.0 or aside > radius * radius:
        return np.inf, (0.0, 0.0, 0.0)
    if away[2] > 0.0:
        away = plus(away, -dot(away, way) / dot(way, way), way)
        far = length(away)
        if far > _CONVEX:
            return far - radius, scaled(1.0 / far, away)
    n = plus((0.0, 0.0, 1.0), -way[2] / dot(way, way), way)
    n = scaled(1.0 / length(n), n)
    return away[2] * n[2] - radius, n


@subroutine(**LEAN)
def _underside(corners, normals, peak):
    """Return the gap of a solid over a peak [m], and its normal; inf beside the solid."""
    low, high, inwards = -np.inf, np.inf, (0.0, 0.0, 0.0)
    for f in range(6):
        n = at(normals, f)
        beyond = dot(n, middle_of(corners, f)) - n[0] * peak[0] - n[1] * peak[1]
        if n[2] < -_CONVEX:
            if beyond / n[2] > low:
                low, inwards = beyond / n[2], scaled(-1.0, n)
        elif n[2] > _CONVEX:
            high = min(high, beyond / n[2])
        elif beyond < 0.0:
            return np.inf, (0.0, 0.0, 0.0)
    if low >= high:
        return np.inf, (0.0, 0.0, 0.0)
    return (low - peak[2]) * inwards[2], inwards
