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

"""Cylinders of a scanned tree, and the ways up from each to the ground."""

from dataclasses import dataclass, fields

import numpy as np

from procphys_ros.geometry.linear import norm

MAX_CYLINDERS = 2_000_000  # as many as modules of the longest string of an L-system
LARGEST = 1e9  # coordinate or radius in a file; 1,000 km in mm


@dataclass(frozen=True)
class Cylinders:
    """
    Cylinders between points, in the unit of the file until they are scaled.

    :ivar parent: cylinder that this one grows from, -1 = none, (N,) int.
    :ivar start: (N, 3).
    :ivar end: (N, 3).
    :ivar radius: at the end, and of cylinders that do not taper, everywhere, (N,); NaN = the file
        has none.
    :ivar foot: radius at the start of one without a parent, (N,); others ignore it.
    :ivar tapered: True when radii are those of points, between which the wood tapers.
    """

    parent: np.ndarray
    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray
    foot: np.ndarray
    tapered: bool

    def __len__(self) -> int:
        return len(self.parent)

    @property
    def length(self) -> np.ndarray:
        """Return the lengths, (N,)."""
        return np.asarray(norm(self.end - self.start, axis=1))

    @property
    def volume(self) -> np.ndarray:
        """Return the volumes, each as of a cylinder with the radius of its end, (N,)."""
        return np.asarray(np.pi * (self.radius * self.radius) * self.length)

    def taken(self, rows: np.ndarray) -> 'Cylinders':
        """
        Take cylinders in a new order; those whose parent is not among them have none.

        :param rows: of the cylinders to take, each once, (M,) int.
        """
        place = np.full(len(self) + 1, -1)  # the last one for those without a parent
        place[rows] = np.arange(len(rows))
        columns = {field.name: getattr(self, field.name)[rows] for field in fields(self)
                   if field.name not in ('parent', 'tapered')}
        return Cylinders(parent=place[self.parent[rows]], tapered=self.tapered, **columns)


def between(points: np.ndarray, parents: np.ndarray, radii: np.ndarray) -> Cylinders:
    """
    Make the cylinders that end at points; points without a parent are the feet of trees.

    :param points: (K, 3).
    :param parents: index of each point's parent, -1 = none, (K,) int.
    :param radii: at the points, (K,); NaN = unknown.
    """
    tip = np.flatnonzero(parents >= 0)
    cylinder = np.full(len(points), -1)
    cylinder[tip] = np.arange(len(tip))
    above = parents[tip]
    return Cylinders(cylinder[above], points[above], points[tip], radii[tip], radii[above],
                     tapered=True)


def depths(parent: np.ndarray) -> np.ndarray:
    """
    Count the ancestors of each cylinder, (N,); -1 = it is, or grows from, one of its own.

    :param parent: of each cylinder, -1 = none, (N,) int.
    """
    jump, depth = parent.copy(), (parent >= 0).astype(np.intp)
    for _ in range(len(parent).bit_length() + 1):
        up = np.flatnonzero(jump >= 0)
        depth[up] += depth[jump[up]]
        jump[up] = jump[jump[up]]
    return np.where(jump >= 0, -1, depth)


def lowest_of(parent: np.ndarray, stays: np.ndarray) -> np.ndarray:
    """
    Find the first cylinder on the way from each to the ground that stays, -1 = none, (N,).

    :param parent: of each cylinder, -1 = none, without cycles, (N,) int.
    :param stays: (N,) bool.
    """
    found = np.append(np.where(stays, np.arange(len(parent)), parent), -1)
    while True:
        further = found[found]
        if np.array_equal(further, found):
            return found[:-1]
        found = further


def least_on_the_way(parent: np.ndarray, values: np.ndarray) -> np.ndarray:
    """
    Return the least value of each cylinder and all of its ancestors, (N,).

    :param parent: of each cylinder, -1 = none, without cycles, (N,) int.
    """
    jump, least = parent.copy(), values.copy()
    while len(up := np.flatnonzero(jump >= 0)):
        least[up] = np.minimum(least[up], least[jump[up]])
        jump[up] = jump[jump[up]]
    return least
