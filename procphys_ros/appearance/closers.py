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
Closers: cut bricks in mortar that fill corners which are not right-angled.

In every course the ends of two walls leave a wedge there, which counts as mortar.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.appearance.joints import mortar_of, Seats, unbroken
from procphys_ros.blueprint import Blueprint, GROUND, Law, Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import prisms

_UPRIGHT = 0.999    # cosine to the vertical of level bricks
_PARALLEL = 0.9999  # cosine between faces with a parallel joint
_RECESS = 0.0015    # [m] from the faces of the bricks back to the mortar


@dataclass(frozen=True)
class Closers:
    """
    Bricks and mortar that fill wedges, one row per solid.

    :ivar first, second: parts beside it, (C,).
    :ivar ends: the middle of their joint in the frames of both [m], (2, C, 3).
    :ivar corners: of the solid in the frame of the first part [m], (C, 24), as in `Hexahedra`.
    :ivar mortar: whether it is mortar, not brick, (C,) bool.
    """

    first: np.ndarray
    second: np.ndarray
    ends: np.ndarray
    corners: np.ndarray
    mortar: np.ndarray

    def take(self, rows: np.ndarray) -> 'Closers':
        """Select some rows, (K,)."""
        return Closers(self.first[rows], self.second[rows], self.ends[:, rows],
                       self.corners[rows], self.mortar[rows])

    def by_texture(self, blueprint: Blueprint) -> Iterator[tuple[str, np.ndarray]]:
        """Group the rows by the names of their textures."""
        texture = np.where(self.mortar, -1, blueprint.texture[self.first])
        for index in np.unique(texture).tolist():
            name = mortar_of(blueprint) if index < 0 else blueprint.textures[index]
            yield name, np.flatnonzero(texture == index)

    def poses(self, poses: np.ndarray, shown: np.ndarray) -> np.ndarray:
        """
        Return the poses of the solids; they are lost where the parts have moved apart.

        :param poses: of the parts, world, (N, 7).
        :param shown: parts that exist, (N,) bool.
        :returns: poses, world, (C, 7), NaN where the solid is lost.
        """
        whole = unbroken(poses, shown, self.first, self.second, self.ends)
        return np.where(whole[:, None], poses[self.first], np.nan)


def closers(blueprint: Blueprint, seats: Seats, since: int = 0) -> Closers:
    """
    Find the bricks and mortar that fill the wedges between walls.

    :param blueprint: parts and bonds.
    :param seats: of the mortar of its other joints, for the thickness.
    :param since: first bond to consider.
    """
    bond, ways = _wedges(blueprint, since)
    pair = blueprint.bonds[bond]
    joint = np.zeros(len(blueprint))
    for part in (seats.first, seats.second):
        np.maximum.at(joint, part, seats.size[:, 2])
    low, high = _levels(blueprint)
    rows, solids, mortar = [], [], []
    for row, first in enumerate(pair[:, 0].tolist()):
        corner = _Corner.between(blueprint, pair[row], ways[row])
        bed = joint[first]
        bottom, top = low[0, pair[row]].max(), high[0, pair[row]].min()
        below = max(bottom - bed, low[1, pair[row]].min())
        above = min(top + bed, high[1, pair[row]].max())
        for solid, plain in [*((one, False) for one in _prisms(corner.brick(bed), bottom, top)),
                             *((one, True) for one in _prisms(corner.mortar(), below, above))]:
            place = blueprint.poses[first]
            rows.append(row)
            solids.append(rotation.rotate(rotation.conjugate(place[3:]), solid - place[:3]))
            mortar.append(plain)
    chosen = np.array(rows, np.intp)
    ends = np.array([rotation.relative(blueprint.poses[side], blueprint.bond_frame[bond])[:, :3]
                     for side in pair.T]).reshape(2, -1, 3)
    first, second = pair[chosen].T
    return Closers(first, second, ends[:, chosen], np.array(solids).reshape(-1, 24),
                   np.array(mortar, bool))


def _wedges(blueprint: Blueprint, since: int) -> tuple[np.ndarray, np.ndarray]:
    """Find the mortar joints between upright, non-parallel faces of boxes."""
    box = blueprint.shape == Shape.BOX
    box[blueprint.hexahedra.part] = False
    upright = rotation.rotate(blueprint.poses[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]
    box &= upright > _UPRIGHT
    bonds = blueprint.bonds[since:]
    bond = since + np.flatnonzero((blueprint.bond_law[since:] == Law.MORTAR)
                                  & (bonds != GROUND).all(axis=1))
    bond = bond[box[blueprint.bonds[bond]].all(axis=1)]
    normal = rotation.rotate(blueprint.bond_frame[bond, 3:], np.array([0.0, 0.0, 1.0]))
    bond = bond[np.abs(normal[:, 2]) < 1.0 - _UPRIGHT]
    ways = _ways(blueprint, bond)
    wedge = (ways[:, 0] * ways[:, 1]).sum(axis=1) < _PARALLEL
    return bond[wedge], ways[wedge]


def _ways(blueprint: Blueprint, bond: np.ndarray) -> np.ndarray:
    """
    Find the faces of upright joints: the frame is midway, and bisects their angle.

    :returns: outward of the face of the first part, inward of that of the second, unit, (J, 2, 2).
    """
    middles, normals = [], []
    for part in blueprint.bonds[bond].T:
        axes = np.stack([rotation.rotate(blueprint.poses[part, 3:], side * axis)[:, :2]
                         for axis in np.eye(3)[:2] for side in (-1.0, 1.0)], axis=1)
        half = 0.5 * np.repeat(blueprint.visual_size[part, :2], 2, axis=1)
        normals.append(axes)
        middles.append(blueprint.poses[part, None, :2] + half[..., None] * axes)
    frame = blueprint.bond_frame[bond]
    along = rotation.rotate(frame[:, 3:], np.array([0.0, 0.0, 1.0]))[:, None, None, :2]
    middle = 0.5 * (middles[0][:, :, None] + middles[1][:, None])
    between = normals[0][:, :, None] - normals[1][:, None]
    between = between / np.maximum(np.linalg.norm(between, axis=3, keepdims=True), 1e-9)
    error = (np.linalg.norm(middle - frame[:, None, None, :2], axis=3)
             + np.linalg.norm(between - along, axis=3)).reshape(len(bond), 16)
    one, other = np.divmod(np.argmin(error, axis=1), 4)
    rows = np.arange(len(bond))
    return np.stack([normals[0][rows, one], -normals[1][rows, other]], axis=1)


def _levels(blueprint: Blueprint) -> tuple[np.ndarray, np.ndarray]:
    """Return bottoms and tops of parts, and of them with their neighbours [m], (2, N) each."""
    half = 0.5 * blueprint.visual_size[:, 2]
    middle = blueprint.poses[:, 2]
    low, high = (np.stack([side, side]) for side in (middle - half, middle + half))
    first, second = blueprint.bonds[(blueprint.bonds != GROUND).all(axis=1)].T
    for one, other in ((first, second), (second, first)):
        np.minimum.at(low[1], one, low[0, other])
        np.maximum.at(high[1], one, high[0, other])
    return low, high


@dataclass(frozen=True)
class _Corner:
    """
    The ends of two walls in plan.

    :ivar ends: left and right edge of the end of the first, and of the start of the second, in
        walking direction [m], (2, 2, 2).
    :ivar ways: out of the end, and into the start, unit, (2, 2).
    """

    ends: np.ndarray
    ways: np.ndarray

    @classmethod
    def between(cls, blueprint: Blueprint, pair: np.ndarray, ways: np.ndarray) -> '_Corner':
        ends = []
        for part, way, side in zip(pair, ways, (1.0, -1.0)):
            pose, half = blueprint.poses[part], 0.5 * blueprint.visual_size[part, :2]
            turned = abs(rotation.rotate(pose[3:], np.eye(3)[0])[:2] @ way) < 0.5
            depth, width = half[::-1] if turned else half
            left = np.array([-way[1], way[0]])
            middle = pose[:2] + side * depth * way
            ends.append([middle + width * left, middle - width * left])
        return cls(np.array(ends), ways)

    def tips(self) -> np.ndarray:
        """Return the intersections of the left faces, and of the right ones, (2, 2)."""
        first, second = self.ways
        turn = first[0] * second[1] - first[1] * second[0]
        gap = self.ends[1] - self.ends[0]
        reach = (gap[:, 0] * second[1] - gap[:, 1] * second[0]) / turn
        return self.ends[0] + reach[:, None] * first

    def brick(self, joint: float) -> np.ndarray:
        """Return the outline of a brick at the distance of a joint from the ends, (C, 2)."""
        tips = self.tips()
        room = np.linalg.norm(tips - self.ends, axis=2)[..., None]
        if room[:, :].max() < 2.0 * joint:
            return tips[:0]
        share = np.minimum(1.0, joint / np.maximum(room, 1e-9))
        return np.concatenate([*(self.ends + share * (tips - self.ends)), tips])

    def mortar(self) -> np.ndarray:
        """Return the outline of the space between the ends, slightly recessed, (C, 2)."""
        left = np.column_stack([-self.ways[:, 1], self.ways[:, 0]])
        inwards = np.stack([-left, left], axis=1)  # of both edges of both ends
        corner = inwards.sum(axis=0) / (1.0 + left[0] @ left[1])
        return np.concatenate([*(self.ends + _RECESS * inwards), self.tips() + _RECESS * corner])


def _prisms(outline: np.ndarray, low: float, high: float) -> Iterator[np.ndarray]:
    """Build prisms over the convex hull of points, (8, 3) each."""
    if not len(outline) or high <= low:
        return
    hull = outline[scipy.spatial.ConvexHull(outline).vertices]
    for k in range(1, len(hull) - 1, 2):
        yield prisms(hull[None, [0, k, min(k + 2, len(hull) - 1), k + 1]], low, high)[0]
