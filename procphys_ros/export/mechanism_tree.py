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

"""Mechanism tree: parts of mechanisms as nested bodies; joints that close loops are apart."""

from collections.abc import Collection
from dataclasses import dataclass
import logging
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import GROUND, JointType
from procphys_ros.elementary import atan2
from procphys_ros.export.content import Content
from procphys_ros.geometry import rotation

_LOG = logging.getLogger(__name__)
_LISTED = 5  # names in a warning
_AXIS = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class MechanismTree:
    """
    Joints of mechanisms that hold, as a forest of their parts.

    :ivar parts: with joints, ascending, (K,).
    :ivar joint: by part, the joint to its parent, -1 = it is free, (K,).
    :ivar loops: joints that are in no tree, ropes among them, (L,).
    :ivar seats: frames of all joints in the frames of their second parts, (J, 7).
    :ivar bases: the same at rest in those of their first parts, or of the world, (J, 7).
    :ivar value: present displacements [m] or [rad], (J,).
    """

    parts: np.ndarray
    joint: np.ndarray
    loops: np.ndarray
    seats: np.ndarray
    bases: np.ndarray
    value: np.ndarray

    def axis(self, joint: int) -> np.ndarray:
        """Return the axis of a joint in the frame of its second part, (3,)."""
        return rotation.rotate(self.seats[joint, 3:], _AXIS)


def mechanism_tree(content: Content) -> MechanismTree:
    """Arrange the parts of mechanisms: the first joint of each to an earlier part is its own."""
    joints = content.blueprint.joints
    alive = np.flatnonzero(content.joints_hold)
    first, second = joints.parts.T
    parts = np.unique(np.append(first[alive], second[alive]))
    parts = parts[parts != GROUND]
    own = dict.fromkeys(parts.tolist(), -1)
    for joint in alive.tolist():
        one, other = int(first[joint]), int(second[joint])
        if own[other] < 0 and one < other and joints.kind[joint] != JointType.ROPE:
            own[other] = joint
    used = np.array([own[part] for part in parts.tolist()], np.intp)
    rest = content.blueprint.poses
    seats = rotation.relative(rest[second], joints.frame) if len(joints) else np.zeros((0, 7))
    bases = _bases(content)
    return MechanismTree(parts, used, np.setdiff1d(alive, used), seats, bases,
                         _values(content, seats, bases))


def tell_left_out(content: Content, loops: np.ndarray, path: Path,
                  kinds: Collection[int] = tuple(JointType)) -> None:
    """
    Warn of the joints that close loops and are not written.

    :param loops: joints that are in no tree.
    :param kinds: those that the format does not know in loops.
    """
    names = [content.joint_names[joint] for joint in loops.tolist()
             if content.blueprint.joints.kind[joint] in kinds]
    if names:
        more = f' and {len(names) - _LISTED} more' if len(names) > _LISTED else ''
        _LOG.warning('%s: joints that close loops are left out: %s%s', path,
                     ', '.join(names[:_LISTED]), more)


def _bases(content: Content) -> np.ndarray:
    """Return the frames of joints at rest in those of their first parts, or the world, (J, 7)."""
    joints = content.blueprint.joints
    first, rest = joints.parts[:, 0], joints.frame.copy()
    rest[:, :3] += rotation.rotate(rest[:, 3:], joints.anchor)
    held = first != GROUND
    rest[held] = rotation.relative(content.blueprint.poses[first[held]], rest[held])
    return rest


def _values(content: Content, seats: np.ndarray, bases: np.ndarray) -> np.ndarray:
    """Compute the displacements of joints from the poses of their parts, (J,)."""
    joints = content.blueprint.joints
    first, second = joints.parts.T
    there = rotation.compose(content.poses[second], seats)
    base, held = bases.copy(), first != GROUND
    base[held] = rotation.compose(content.poses[first[held]], base[held])
    moved = rotation.relative(base, there)
    angle = 2.0 * atan2(moved[:, 3], moved[:, 6])
    angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return np.where(joints.kind == JointType.SLIDER, moved[:, 0], angle)
