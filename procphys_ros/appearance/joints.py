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

"""Joints: the mortar between the bricks that still hang together."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Law
from procphys_ros.geometry import rotation

_THINNEST, _THICKEST = 0.001, 0.04  # [m] gap between two parts that mortar may fill
_CRACK = 0.01  # [m] displacement between the parts of a joint that breaks its mortar


@dataclass(frozen=True)
class Seats:
    """
    Mortar of joints, one row per joint with a gap for it.

    :ivar bond: the joint's row among the bonds, (J,).
    :ivar first, second: parts on its sides, (J,).
    :ivar box: pose of the box of mortar in the frame of the first part, z across, (J, 7).
    :ivar ends: the joint's middle in the frames of both parts [m], (2, J, 3).
    :ivar size: extents of the box [m], (J, 3).
    """

    bond: np.ndarray
    first: np.ndarray
    second: np.ndarray
    box: np.ndarray
    ends: np.ndarray
    size: np.ndarray

    def boxes(self, poses: np.ndarray, shown: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """
        Return the boxes of mortar; a joint whose parts have moved apart has lost it.

        :param poses: of the parts, world, (N, 7).
        :param shown: parts that exist, (N,) bool.
        :param rows: joints, (K,).
        :returns: poses, world, (K, 7), NaN where the mortar is lost.
        """
        first, second = self.first[rows], self.second[rows]
        whole = unbroken(poses, shown, first, second, self.ends[:, rows])
        box = rotation.compose(poses[first], self.box[rows])
        box[~whole] = np.nan
        return box


def unbroken(poses: np.ndarray, shown: np.ndarray, first: np.ndarray, second: np.ndarray,
             ends: np.ndarray) -> np.ndarray:
    """
    Mark the joints that have not opened, (J,) bool.

    :param poses: of the parts, world, (N, 7).
    :param shown: parts that exist, (N,) bool.
    :param first, second: parts on their sides, (J,).
    :param ends: their middles in the frames of both parts [m], (2, J, 3).
    """
    place = [poses[part, :3] + rotation.rotate(poses[part, 3:], end)
             for part, end in zip((first, second), ends)]
    return (np.linalg.norm(place[0] - place[1], axis=1) < _CRACK) & shown[first] & shown[second]


def seats(blueprint: Blueprint, since: int = 0) -> Seats:
    """
    Find the joints with mortar.

    :param blueprint: parts and bonds.
    :param since: first bond to consider.
    """
    bond = since + np.flatnonzero(
        (blueprint.bond_law[since:] == Law.MORTAR)
        & (blueprint.bonds[since:] != GROUND).all(axis=1))
    first, second = blueprint.bonds[bond].T
    frame = blueprint.bond_frame[bond]
    middles, reaches = zip(_reach(blueprint, first, frame), _reach(blueprint, second, frame))
    gap = middles[1][:, 2] - middles[0][:, 2] - reaches[0][:, 2] - reaches[1][:, 2]
    low, high = _patch(blueprint.bond_extent[bond], gap, middles, reaches)
    ends = [rotation.relative(blueprint.poses[part], frame) for part in (first, second)]
    box = ends[0].copy()
    box[:, :3] += rotation.rotate(ends[0][:, 3:],
                                  np.column_stack([0.5 * (low + high), np.zeros(len(bond))]))
    has = (gap > _THINNEST) & (gap < _THICKEST)
    return Seats(bond[has], first[has], second[has], box[has],
                 np.stack([end[has, :3] for end in ends]), np.column_stack([high - low, gap])[has])


def mortar_of(blueprint: Blueprint) -> str:
    """Return the name of the texture of mortar."""
    return next((name for name in blueprint.textures if 'mortar' in name), 'mortar')


def standing(blueprint: Blueprint, poses: np.ndarray,
             shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Find the mortar that is still in place.

    :param blueprint: parts and bonds.
    :param poses: of the parts, world, (N, 7).
    :param shown: parts that exist, (N,) bool.
    :returns: poses of boxes, z across the joint, world, (J, 7), and their extents [m], (J, 3).
    """
    places = seats(blueprint)
    box = places.boxes(poses, shown, np.arange(len(places.bond)))
    whole = np.isfinite(box[:, 0])
    return box[whole], places.size[whole]


def _reach(blueprint: Blueprint, part: np.ndarray,
           frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return middle and half extents of parts along the axes of bond frames [m], (J, 3)."""
    inner = rotation.relative(frame, blueprint.poses[part])
    half = np.zeros((len(part), 3))
    for axis in range(3):
        along = rotation.rotate(inner[:, 3:], np.eye(3)[axis])
        half += 0.5 * blueprint.visual_size[part, axis, None] * np.abs(along)
    middle, solids = inner[:, :3].copy(), blueprint.hexahedra
    place = np.full(len(blueprint), -1)
    place[solids.part] = np.arange(len(solids))
    cut = np.flatnonzero(place[part] >= 0)
    corners = solids.corners[place[part[cut]]].reshape(-1, 8, 3)
    points = inner[cut, None, :3] + rotation.rotate(inner[cut, None, 3:], corners)
    low, high = points.min(axis=1), points.max(axis=1)
    middle[cut], half[cut] = 0.5 * (low + high), 0.5 * (high - low)
    return middle, half


def _patch(extent: np.ndarray, gap: np.ndarray, middles: tuple,
           reaches: tuple) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the lower and upper bounds of the mortar along the patch [m], (J, 2) each.

    Where only one of the two parts continues, the patch ends at another joint, and the mortar
    meets that of the neighbour in the middle; where both end, it is flush with them.
    """
    bounds = []
    for side in (-1.0, 1.0):
        ends = [side * m[:, :2] + r[:, :2] for m, r in zip(middles, reaches)]
        beyond = np.clip(np.abs(ends[0] - ends[1]), 0.0, 0.5 * gap[:, None])
        bounds.append(side * (0.5 * extent + beyond))
    return bounds[0], bounds[1]
