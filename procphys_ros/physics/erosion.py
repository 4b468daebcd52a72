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


"""
Erosion: rain wears a height field, runs off with the soil and drops it, and steep soil slides.

Water and soil as in Davy & Lague 2009, *Fluvial erosion/transport equation of landscape evolution
models revisited*: what a stream wears is as its power, what it drops is as its load. So its load
tends to a capacity. The implicit step in the order of drainage is that of Braun & Willett 2013.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import tan

STEPS = 64  # in which rain falls; twice as many change no conclusion, see decision 100
_WATER = 9810.0  # weight of water [N/m³]
_WIDENING = 5.0  # width of a stream over the root of its discharge [√(s/m)], Leopold & Maddock
_STOP = np.radians(2.0)  # by which slides stop below the slope at which they start, Bagnold [rad]
_PATCHES = 0.5  # by how much the soil of a corner is harder or softer than the mean, at most [-]
_SLIDES = 1500  # slides per corner, at most, before the rain and in all its steps [-]
_ROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_ROOT_2 = 1.4142135623730951


class Soil(NamedTuple):
    """
    What ground is made of.

    :ivar erodibility: volume that a stream wears per energy that it spends [m³/J].
    :ivar settling: how readily a stream drops its load, "G" of Yuan and others 2019 [-].
    :ivar repose: steepest slope that stands [rad].
    """

    erodibility: float
    settling: float
    repose: float


SOILS = {
    'clay': Soil(0.1e-6, 0.2, np.radians(45.0)),
    'loam': Soil(1e-6, 1.0, np.radians(38.0)),
    'sand': Soil(10e-6, 2.0, np.radians(33.0)),
}


class Rain(NamedTuple):
    """
    What falls.

    :ivar rate: of fall [m/s].
    :ivar time: for which it falls [s].
    """

    rate: float
    time: float


class Eroded(NamedTuple):
    """
    What rain has left.

    :ivar heights: of the ground [m], (X, Y).
    :ivar carried_off: soil that streams took over the edge of the grid [m³].
    :ivar settled: whether all slides have ended.
    """

    heights: np.ndarray
    carried_off: float
    settled: bool


class Drainage(NamedTuple):
    """
    Where water runs, corner by corner, (N,), N = X·Y in the order of the heights.

    :ivar order: all corners, each behind the one that it drains to.
    :ivar receiver: corner that each drains to; itself at the edge of the grid.
    :ivar way: to the receiver, over the edge of a cell [-]; 0 at the edge of the grid.
    :ivar surface: of the water, above the ground in lakes only [m].
    """

    order: np.ndarray
    receiver: np.ndarray
    way: np.ndarray
    surface: np.ndarray


def erode(heights: np.ndarray, edge: float, rain: Rain, soil: Soil,
          rng: np.random.Generator) -> Eroded:
    """
    Let rain fall on a height field.

    The edge of the grid stays as it is, but for slides: streams leave there with their load.

    :param heights: [m], (X, Y), 2 or more each.
    :param edge: of a cell [m].
    :param rng: which corners have harder soil, and how diagonals compare there.
    """
    ground = np.array(heights, float, order='C')
    shares = corner_shares(ground.shape)
    steep, stop = (tan(float(soil.repose - less)) * edge for less in (0.0, _STOP))
    bends = 2.0 - rng.random(ground.shape)
    softness = 1.0 + rng.uniform(-_PATCHES, _PATCHES, ground.shape)
    # Streams of cells: the edge of a cell in their width and in their slope cancels out.
    wear = soil.erodibility * _WATER / _WIDENING * rain.time / STEPS * np.sqrt(rain.rate)
    gone = 0.0
    left = _slide(ground, shares, steep, stop, _SLIDES * ground.size)
    for _ in range(STEPS if wear > 0.0 else 0):
        if left < 0:
            break
        drainage = drain(ground, bends)
        area = drained(drainage, shares)
        gone += _flow(ground, drainage, area, shares, wear * softness, soil.settling)
        left = _slide(ground, shares, steep, stop, left)
    return Eroded(ground, float(gone * edge * edge), left >= 0)


def corner_shares(shape: tuple[int, ...]) -> np.ndarray:
    """
    Compute how many sixths of its triangles' cells each corner has: the volume under it.

    :param shape: of the heights.
    :returns: 1 inside, a half at edges, a third or a sixth at the four corners [-], (X, Y).
    """
    shares = np.zeros(shape)
    for part in (shares[:-1, :-1], shares[1:, 1:]):
        part += 1.0
    for part in (shares[1:, :-1], shares[:-1, 1:]):
        part += 2.0
    return shares / 6.0


def volume(heights: np.ndarray, edge: float) -> float:
    """Compute the volume between a surface of triangles and z = 0 [m³]."""
    return float((heights * corner_shares(heights.shape)).sum() * edge * edge)


@subroutine
def _before(level, cell, a, b):
    """Return whether entry a of a heap comes before b: the lower, or the first of equals."""
    return level[a] < level[b] or level[a] == level[b] and cell[a] < cell[b]


@subroutine
def _swap(level, cell, a, b):
    level[a], level[b] = level[b], level[a]
    cell[a], cell[b] = cell[b], cell[a]


@subroutine
def _push(level, cell, size, height, number):
    """Add a corner to a heap; returns its size."""
    level[size], cell[size] = height, number
    at = size
    while at > 0 and _before(level, cell, at, (at - 1) // 2):
        _swap(level, cell, at, (at - 1) // 2)
        at = (at - 1) // 2
    return size + 1


@subroutine
def _pop(level, cell, size):
    """Move the first entry of a heap behind its end; returns its size."""
    size -= 1
    _swap(level, cell, 0, size)
    at = 0
    while True:
        least = at
        for below in (2 * at + 1, 2 * at + 2):
            if below < size and _before(level, cell, below, least):
                least = below
        if least == at:
            return size
        _swap(level, cell, at, least)
        at = least


@kernel
def drain(heights, bends):
    """
    Find where water runs: down the steepest of eight ways, through lakes to their outlets.

    :param heights: [m], (X, Y).
    :param bends: random lengths of diagonal ways, over the edge of a cell, by which the slopes of
        ways are compared (Rho8, Fairfield & Leymarie 1991): streams follow slopes that lie between
        two of the eight directions [-], (X, Y).
    """
    columns, rows = heights.shape
    bend = bends.reshape(-1)
    surface, receiver = _flood(heights)
    way = np.zeros(len(receiver))
    for c in range(len(receiver)):
        if receiver[c] == c:
            continue
        i, j = c // rows, c % rows
        best, to = 0.0, receiver[c]  # on level water back to where the flood came from
        for di, dj in _ROUND:  # not at the edge of the grid, so all are there
            d = (i + di) * rows + j + dj
            slope = (surface[c] - surface[d]) / (bend[c] if di * dj else 1.0)
            if slope > best:
                best, to = slope, d
        receiver[c] = to
        way[c] = _ROOT_2 if to // rows != i and to % rows != j else 1.0
    return Drainage(_ordered(receiver), receiver, way, surface)


@subroutine
def _flood(heights):
    """
    Raise water from the edge of the grid inwards, until lakes flow over.

    Priority-flood, with a queue up slopes and through lakes, and a heap only for what may be a
    sill (Zhou, Sun & Fu 2016).

    :returns: level of the water, the ground where that is dry [m], and the corner from which it
        has come, at the edge itself; (N,).
    """
    columns, rows = heights.shape
    count = columns * rows
    ground = heights.reshape(count)
    surface, source = np.full(count, np.inf), np.arange(count)
    level, cell, size = np.empty(count), np.empty(count, np.int64), 0
    queue = np.empty(count, np.int64)
    for c in range(count):
        if c // rows in (0, columns - 1) or c % rows in (0, rows - 1):
            surface[c] = ground[c]
            size = _push(level, cell, size, ground[c], c)
    while size > 0:
        size = _pop(level, cell, size)
        queue[0] = cell[size]
        size = _spread(heights, surface, source, queue, level, cell, size)
    return surface, source


@subroutine
def _spread(heights, surface, source, queue, level, cell, size):
    """
    Raise water from the lowest of all sills: through the lake that it fills, and up slopes.

    :param queue: the sill, and room for all.
    :param level, cell, size: heap of other sills.
    :returns: size of the heap.
    """
    columns, rows = heights.shape
    ground = heights.reshape(columns * rows)
    first, last = 0, 1
    while first < last:
        c = queue[first]
        fills = first == 0 or surface[c] > ground[c]
        first += 1
        i, j = c // rows, c % rows
        is_sill = False
        for di, dj in _ROUND:
            x, y = i + di, j + dj
            if not (0 <= x < columns and 0 <= y < rows) or surface[x * rows + y] < np.inf:
                continue
            d = x * rows + y
            if ground[d] < surface[c] and not fills:
                is_sill = True  # water stands there at a level that is not known yet
                continue
            surface[d], source[d] = max(ground[d], surface[c]), c
            queue[last] = d
            last += 1
        if is_sill:
            size = _push(level, cell, size, surface[c], c)
    return size


@subroutine
def _ordered(receiver):
    """Order corners so that each is behind the one that it drains to, (N,)."""
    count = len(receiver)
    order, size = np.empty(count, np.int64), 0
    first, following = np.full(count, -1), np.full(count, -1)  # of what drains to a corner
    for c in range(count):
        r = receiver[c]
        if r == c:
            order[size] = c
            size += 1
        else:
            following[c], first[r] = first[r], c
    for n in range(count):
        c = first[order[n]]
        while c >= 0:
            order[size] = c
            size += 1
            c = following[c]
    return order


@kernel
def drained(drainage, shares):
    """Compute the area that drains through each corner, in cells [-], (N,)."""
    area = shares.reshape(-1).copy()
    for c in drainage.order[::-1]:
        if drainage.receiver[c] != c:
            area[drainage.receiver[c]] += area[c]
    return area


@kernel
def _flow(heights, drainage, area, shares, wear, settling):
    """
    Let streams wear the ground, upwards, and drop what they carry, downwards.

    :param wear: part of its height over a corner a cell below that a corner loses to the rain of
        a cell, if that is small [-], (X, Y).
    :returns: what is carried off the grid, height [m] times cells.
    """
    ground, share = heights.reshape(-1), shares.reshape(-1)
    wears, load = wear.reshape(-1), np.zeros(len(area))
    surface = drainage.surface
    lake = surface > ground
    for c in drainage.order:
        r = drainage.receiver[c]
        base = surface[r] if lake[r] else ground[r]
        if r == c or lake[c] or ground[c] <= base:
            continue
        rate = wears[c] * np.sqrt(area[c])
        loss = (ground[c] - base) * rate / (drainage.way[c] + rate)
        ground[c] -= loss
        load[c] = loss * share[c]
    gone = 0.0
    for c in drainage.order[::-1]:
        r = drainage.receiver[c]
        if r == c:
            gone += load[c]
            continue
        dropped = settling * share[c] / (area[c] + settling * share[c]) * load[c]
        if lake[c]:
            dropped = min(load[c], (surface[c] - ground[c]) * share[c])
        ground[c] += dropped / share[c]
        load[r] += load[c] - dropped
    return gone


@kernel
def _slide(heights, shares, steep, stop, most):
    """
    Let soil slide to lower corners until no slope is too steep.

    :param steep: drop over the edge of a cell at which slides start [m].
    :param stop: at which they stop, less [m].
    :param most: number of slides.
    :returns: number of slides left, negative = they have not ended.
    """
    columns, rows = heights.shape
    count = columns * rows
    ground, share = heights.reshape(count), shares.reshape(count)
    queue, waiting = np.arange(count), np.ones(count, np.bool_)
    first, size = 0, count
    while size > 0:
        c = queue[first]
        first, size = (first + 1) % count, size - 1
        waiting[c] = False
        i, j = c // rows, c % rows
        slid = False
        while True:
            worst, to, far = steep, -1, 1.0
            for di, dj in _ROUND:
                x, y = i + di, j + dj
                if 0 <= x < columns and 0 <= y < rows:
                    d, root = x * rows + y, _ROOT_2 if di * dj else 1.0
                    if (ground[c] - ground[d]) / root > worst:
                        worst, to, far = (ground[c] - ground[d]) / root, d, root
            if to < 0:
                break
            most -= 1
            if most < 0:
                return most
            moved = (ground[c] - ground[to] - stop * far) / (1.0 / share[c] + 1.0 / share[to])
            ground[c] -= moved / share[c]
            ground[to] += moved / share[to]
            slid = True
            if not waiting[to]:
                waiting[to] = True
                queue[(first + size) % count] = to
                size += 1
        if not slid:
            continue
        for di, dj in _ROUND:  # those above may follow
            x, y = i + di, j + dj
            if 0 <= x < columns and 0 <= y < rows and not waiting[x * rows + y]:
                waiting[x * rows + y] = True
                queue[(first + size) % count] = x * rows + y
                size += 1
    return most
