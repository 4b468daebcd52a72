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

"""Cells: a piece of masonry divided into clumps of neighbours between which it breaks."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.masonry.graph import HUB

_SAME = 1e-6  # [m] distances in a bond of bricks that differ by less are the same


@kernel
def spread(points, spacing):
    """
    Choose points at least the spacing apart, greedily in their order.

    The choice is invariant to rigid motions of the points.

    :param points: [m], (P, 3).
    :returns: their rows, (S,).
    """
    chosen, count = np.empty(len(points), np.int64), 0
    for i in range(len(points)):
        free = True
        for k in range(count):
            away = points[i] - points[chosen[k]]
            free &= np.sqrt((away * away).sum()) > spacing - _SAME
        if free:
            chosen[count] = i
            count += 1
    return chosen[:count]


@kernel
def nearest(points, seeds):
    """
    Find the nearest seed of each point, the first one on ties, (P,).

    :param points: [m], (P, 3).
    :param seeds: [m], (S, 3).
    """
    out = np.zeros(len(points), np.int64)
    for i in range(len(points)):
        least = np.inf
        for k in range(len(seeds)):
            away = points[i] - seeds[k]
            distance = np.sqrt((away * away).sum())
            if distance < least - _SAME:
                least, out[i] = distance, k
    return out


@kernel
def inside(parts, start, incident, alive, first, second, place):
    """
    List the living bonds between parts of a set.

    :param parts: (P,).
    :param place: scratch filled with -1, restored on return, (N + 1,).
    :returns: rows of bonds (K,), and the indices in `parts` of their two ends, (K,) twice.
    """
    total = 0
    for k in range(len(parts)):
        place[parts[k]] = k
        total += start[parts[k] + 1] - start[parts[k]]
    rows = np.empty(total, np.int64)
    a = np.empty(total, np.int32)
    b = np.empty(total, np.int32)
    found = 0
    for k in range(len(parts)):
        i = parts[k]
        for n in range(start[i], start[i + 1]):
            m = incident[n]
            if alive[m] and first[m] == i and place[second[m]] >= 0:
                rows[found] = m
                a[found] = k
                b[found] = place[second[m]]
                found += 1
    for i in parts:
        place[i] = -1
    return rows[:found].copy(), a[:found].copy(), b[:found].copy()


@subroutine
def _adjacency(count, a, b):
    start = np.zeros(count + 1, np.int64)
    for k in range(len(a)):
        start[a[k] + 1] += 1
        start[b[k] + 1] += 1
    for i in range(count):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    other = np.empty(2 * len(a), np.int32)
    for k in range(len(a)):
        other[fill[a[k]]] = b[k]
        fill[a[k]] += 1
        other[fill[b[k]]] = a[k]
        fill[b[k]] += 1
    return start, other


@kernel
def grow(count, a, b, rank, wanted):
    """
    Divide parts into cells by breadth-first growth from seeds: Voronoi cells along the bonds.

    A part with very many bonds (a slab) is a cell by itself. Parts that no seed reaches get
    further seeds, so every cell is connected.

    :param count: number of parts.
    :param a, b: parts that each bond joins, (K,).
    :param rank: of each part; the lowest become seeds, (count,).
    :param wanted: number of cells, about.
    :returns: cell of each part, (count,) int32, and the number of cells.
    """
    start, other = _adjacency(count, a, b)
    order = np.argsort(rank)
    cell = np.full(count, -1, np.int32)
    queue = np.empty(count, np.int32)
    made, tail = 0, 0
    for i in range(count):
        if start[i + 1] - start[i] > HUB:
            cell[i] = made
            made += 1
    head = 0
    for i in order:
        if cell[i] >= 0:
            continue
        cell[i] = made
        made += 1
        queue[tail] = i
        tail += 1
        if made < wanted:
            continue
        while head < tail:
            j = queue[head]
            head += 1
            for n in range(start[j], start[j + 1]):
                k = other[n]
                if cell[k] < 0:
                    cell[k] = cell[j]
                    queue[tail] = k
                    tail += 1
    return cell, made
