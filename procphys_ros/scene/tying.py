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

"""Tying: ropes of mechanisms that lead to branches of trees."""

from dataclasses import replace

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, JointType, Law
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm

_REACH = 0.5  # [m] between the end of a rope as written and a branch: crowns are grown, not placed


def tie(tree: Blueprint, placed: Blueprint, name: str,
        to: str) -> tuple[Blueprint, np.ndarray]:
    """
    Tie the ropes of a mechanism that lead to the ground to the nearest branches instead.

    Their ends move onto the middle line of the branch, and their lengths change as much as the
    distance between their ends does.

    :param tree: what has the branches, in the world.
    :param placed: the mechanism, in the world.
    :param name, to: of the two, for messages.
    :returns: the mechanism, and the branch of each joint, -1 = none, (J,).
    :raises SceneError: when there are no ropes, or no branches near their ends.
    """
    joints = placed.joints
    rows = np.flatnonzero((joints.kind == JointType.ROPE) & (joints.parts[:, 0] == GROUND))
    branches = np.unique(tree.bonds[tree.bond_law == Law.HINGE, 1])
    if not len(rows) or not len(branches):
        raise SceneError(f'{name}.tied_to: ' + (
            f'"{to}" has no branches' if len(rows) else
            'there is no rope to the ground in it that could be tied to a branch'))
    hosts, anchor, high = np.full(len(joints), -1), joints.anchor.copy(), joints.high.copy()
    for row in rows.tolist():
        frame = joints.frame[row]
        end = frame[:3] + rotation.rotate(frame[3:], anchor[row])
        hosts[row], place = _nearest(tree, branches, end)
        if norm(place - end) > _REACH:
            raise SceneError(f'{name}.tied_to: no branch of "{to}" is within {_REACH:g} m of the '
                             f'end of a rope at {_shown(end)} m; the nearest is at '
                             f'{_shown(place)} m')
        high[row] += norm(place - frame[:3]) - norm(end - frame[:3])
        anchor[row] = rotation.rotate(rotation.conjugate(frame[3:]), place - frame[:3])
    return replace(placed, joints=replace(joints, anchor=anchor, high=high)), hosts


def _nearest(tree: Blueprint, branches: np.ndarray,
             point: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the branch nearest to a point, and the point of its middle line nearest to it."""
    poses, half = tree.poses[branches], 0.5 * tree.visual_size[branches, 2]
    axis = rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    along = np.clip(((point - poses[:, :3]) * axis).sum(axis=1), -half, half)
    places = poses[:, :3] + along[:, None] * axis
    best = int(np.argmin(norm(places - point, axis=1)))
    return int(branches[best]), places[best]


def _shown(point: np.ndarray) -> str:
    return ', '.join(f'{x:.2f}' for x in point)
