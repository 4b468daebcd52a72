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

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint, GROUND, Law

_THINNEST, _THICKEST = 0.001, 0.04  # [m] gap between two parts that mortar may fill
_CRACK = 0.01  # [m] by which parts of a broken joint have moved against each other


def standing(blueprint: Blueprint, poses: np.ndarray,
             shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Find where mortar stands; a joint whose parts have moved apart has lost it.

    :param blueprint: parts and bonds.
    :param poses: of the parts, world, (N, 7).
    :param shown: parts that exist, (N,) bool.
    :returns: poses of boxes, z across the joint, world, (J, 7), and their extents [m], (J, 3).
    """
    pair = blueprint.bonds
    bond = np.flatnonzero((blueprint.bond_law == Law.MORTAR) & (pair != GROUND).all(axis=1)
                          & shown[pair].all(axis=1))
    first, second = pair[bond].T
    frame = blueprint.bond_frame[bond]
    seat = rotation.relative(blueprint.poses[first], frame)
    now = rotation.compose(poses[first], seat)
    other = rotation.compose(poses[second], rotation.relative(blueprint.poses[second], frame))
    middles, reaches = zip(_reach(blueprint, first, frame), _reach(blueprint, second, frame))
    gap = middles[1][:, 2] - middles[0][:, 2] - reaches[0][:, 2] - reaches[1][:, 2]
    whole = ((gap > _THINNEST) & (gap < _THICKEST)
             & (np.linalg.norm(now[:, :3] - other[:, :3], axis=1) < _CRACK))
    low, high = _patch(blueprint.bond_extent[bond], gap, middles, reaches)
    centre = np.column_stack([0.5 * (low + high), np.zeros(len(bond))])
    box = now.copy()
    box[:, :3] += rotation.rotate(now[:, 3:], centre)
    return box[whole], np.column_stack([high - low, gap])[whole]


def _reach(blueprint: Blueprint, part: np.ndarray,
           frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give middle and half extents of parts along the axes of the frames of bonds [m], (J, 3)."""
    inner = rotation.relative(frame, blueprint.poses[part])
    half = np.zeros((len(part), 3))
    for axis in range(3):
        along = rotation.rotate(inner[:, 3:], np.eye(3)[axis])
        half += 0.5 * blueprint.visual_size[part, axis, None] * np.abs(along)
    return inner[:, :3], half


def _patch(extent: np.ndarray, gap: np.ndarray, middles: tuple,
           reaches: tuple) -> tuple[np.ndarray, np.ndarray]:
    """
    Give the lower and upper bounds of the mortar along the patch [m], (J, 2) each.

    Where just one of the two parts goes on, the patch ends at another joint, and the mortar meets
    that of the neighbour in its middle; where both end, it is flush with them.
    """
    bounds = []
    for side in (-1.0, 1.0):
        ends = [side * m[:, :2] + r[:, :2] for m, r in zip(middles, reaches)]
        beyond = np.clip(np.abs(ends[0] - ends[1]), 0.0, 0.5 * gap[:, None])
        bounds.append(side * (0.5 * extent + beyond))
    return bounds[0], bounds[1]
