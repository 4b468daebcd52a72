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

"""Linking: which cylinder each one grows from, by where they start and end."""

from heapq import heappop, heappush

import numpy as np
import scipy.spatial

from procphys_ros.geometry.linear import norm

_NEAREST = 8  # ends that are looked at for each start


def gaps_to(parent: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """
    Return the distances between starts and the ends of parents, 0 without a parent, (N,).

    :param parent: of each cylinder, -1 = none, (N,) int.
    :param start: (N, 3).
    :param end: (N, 3).
    """
    return np.where(parent >= 0, norm(start - end[parent], axis=1), 0.0)


def link_by_ends(start: np.ndarray, end: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """
    Link cylinders whose file names no parents: each to the nearest end within its own radius.

    Cylinders without an end near their start are roots, from which the others are reached, the
    smallest distances first; so no cylinder comes to itself.

    :param start: (N, 3).
    :param end: (N, 3).
    :param radius: (N,); of the two cylinders the larger one counts.
    :returns: parents, -1 = none, (N,) int.
    """
    count, places = len(start), _at_places(start, end, radius)
    nearest = min(_NEAREST + 1, len(places))  # its own end may be among them
    apart, found = scipy.spatial.cKDTree(end[places]).query(start, k=nearest)
    apart, found = apart.reshape(count, nearest), places[found.reshape(count, nearest)]
    near = found != np.arange(count)[:, None]
    near &= apart <= np.maximum(radius[:, None], radius[found])
    children: list[list[tuple[float, int]]] = [[] for _ in range(count)]
    for row, column in np.argwhere(near).tolist():
        children[found[row, column]].append((float(apart[row, column]), row))
    alone = ~near.any(axis=1)
    order = np.lexsort((start[:, 2], ~alone))  # roots, then what only circles could reach
    return _reached(children, order)


def _at_places(start: np.ndarray, end: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Of the cylinders that end at one place take the thickest, if one has a length of these."""
    point = (start == end).all(axis=1)
    order = np.lexsort((-radius, point, end[:, 2], end[:, 1], end[:, 0]))
    ends = end[order]
    return order[np.append(True, (ends[1:] != ends[:-1]).any(axis=1))]


def _reached(children: list[list[tuple[float, int]]], order: np.ndarray) -> np.ndarray:
    """Grow trees from cylinders in an order, each as far as it reaches."""
    parent = np.full(len(children), -1)
    done = np.zeros(len(children), bool)
    for root in order.tolist():
        if done[root]:
            continue
        ready = [(0.0, root, -1)]
        while ready:
            _, row, above = heappop(ready)
            if not done[row]:
                done[row], parent[row] = True, above
                for apart, child in children[row]:
                    heappush(ready, (apart, child, row))
    return parent
