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

"""Regions: the panels of a facade as a grid, read out as runs of wall per course."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.contacts import spread
from procphys_ros.wallgrammar.footprint import Corner, Facade
from procphys_ros.wallgrammar.tiling import LEAST, Runs

EMPTY = -1
_SNAP = 25_000         # [µm] level edges this close to a bed joint move onto it, as masons gauge
_FINEST = 20_000_000   # squares of one facade's grid at most


def snap_level(height: np.ndarray | int, layout: Layout) -> np.ndarray:
    """
    Snap heights to the nearest course line when it is near.

    This avoids slivers, and gaps where a sliver would be too thin to lay.

    :param height: [µm], any shape.
    :param layout: with the courses.
    """
    height, gauge = np.asarray(height, np.int64), layout.gauge
    line = (height + gauge // 2) // gauge * gauge
    near = min(max(_SNAP, layout.joint + LEAST), gauge // 2)
    return np.where(np.abs(height - line) <= near, line, height)


@dataclass(frozen=True)
class Regions:
    """
    Grid of the panel classes that cover a facade.

    :ivar x: lines along the wall [µm], (nx + 1,).
    :ivar z: level lines [µm], (nz + 1,).
    :ivar owner: panel class of each square, `EMPTY` for none, (nz, nx).
    """

    x: np.ndarray
    z: np.ndarray
    owner: np.ndarray

    def turned(self) -> 'Regions':
        """Exchange the two directions of the grid."""
        return Regions(self.z, self.x, self.owner.T)

    def runs_of(self, owner: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find unbroken stretches of one class: row of the grid, left and right line, (n,)."""
        edge = np.zeros((self.owner.shape[0], self.owner.shape[1] + 2), np.int8)
        edge[:, 1:-1] = self.owner == owner
        change = np.diff(edge, axis=1)
        row, left = np.nonzero(change == 1)
        return row, left, np.nonzero(change == -1)[1]


def paint(rectangles: np.ndarray, owners: np.ndarray) -> Regions | None:
    """
    Paint rectangles onto a grid, later ones on top.

    :param rectangles: left, bottom, right, top [µm], (n, 4).
    :param owners: class of each, (n,).
    :returns: None when the grid would be too fine to hold.
    """
    x = np.unique(rectangles[:, [0, 2]])
    z = np.unique(rectangles[:, [1, 3]])
    if len(x) * len(z) > _FINEST:
        return None
    owner = np.full((len(z) - 1, len(x) - 1), EMPTY, np.int32)
    left, right = np.searchsorted(x, rectangles[:, 0]), np.searchsorted(x, rectangles[:, 2])
    bottom, top = np.searchsorted(z, rectangles[:, 1]), np.searchsorted(z, rectangles[:, 3])
    for i, value in enumerate(owners):
        owner[bottom[i]:top[i], left[i]:right[i]] = value
    # Lines that divide nothing are dropped, so that panels of one type are one piece of wall.
    rows = np.append(True, (owner[1:] != owner[:-1]).any(axis=1))
    columns = np.append(True, (owner[:, 1:] != owner[:, :-1]).any(axis=0))
    return Regions(x[np.append(columns, True)], z[np.append(rows, True)],
                   owner[rows][:, columns])


def courses(regions: Regions, owner: int, depth: int, layout: Layout, facade: Facade) -> Runs:
    """
    Cut the squares of one class into courses that share the facade's corners.

    :param regions: panels of the facade.
    :param owner: class of the panels.
    :param depth: outer face of the panels, inwards from the facade plane [µm].
    :param layout: of the panels.
    :param facade: where they stand.
    """
    row, left, right = regions.runs_of(owner)
    gauge = layout.gauge
    first = regions.z[row] // gauge
    run, step = spread(-(-regions.z[row + 1] // gauge) - first)
    course = first[run] + step
    left, right, row = regions.x[left[run]], regions.x[right[run]], row[run]
    half = np.full(len(run), layout.joint // 2)
    left_joint, right_joint = half, layout.joint - half
    left, left_joint, left_filled = share_corner(left, left_joint, 0, facade.start,
                                                 course % 2 == 0, -1)
    right, right_joint, right_filled = share_corner(right, right_joint, facade.length, facade.end,
                                                    course % 2 == 1, 1)
    return Runs(course, left, right, np.maximum(regions.z[row], course * gauge),
                np.minimum(regions.z[row + 1], (course + 1) * gauge), left_joint, right_joint,
                left_filled, right_filled, np.full(len(run), depth))


def share_corner(end: np.ndarray, joint: np.ndarray, edge: int, corner: Corner,
                 owning: np.ndarray, outwards: int
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Move the ends of runs that reach into a corner to the limit of their course.

    :param end: of the runs along the wall [µm], (n,).
    :param joint: inside these ends [µm], (n,).
    :param edge: end of the facade [µm].
    :param corner: of the facade.
    :param owning: whether the facade fills the corner in the course of each run, (n,).
    :param outwards: sense along the wall, 1 or -1.
    :returns: the ends, joints inside them and lengths filled of the corner [µm], (n,) each.
    """
    touching = end == edge
    limit = edge + outwards * np.where(owning, corner.owned, corner.yielded)
    beyond = touching | (outwards * (end - limit) > 0)
    flush = owning & (corner.turn != 0.0)  # walls in one line have a joint in every course
    return (np.where(beyond, limit, end),
            np.where(beyond, np.where(flush, 0, corner.joint), joint),
            np.where(touching & owning, corner.owned - corner.yielded, 0))
