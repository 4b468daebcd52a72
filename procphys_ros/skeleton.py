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

"""Skeleton: turn an explicit branch structure into bones and joints (paper, section 3.1)."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Branches:
    """
    Segments of trees before they become parts; a parent stands before its children.

    :ivar parent: segment that this one grows from, -1 for the ground, (S,) int32.
    :ivar lateral: True where a segment starts a side branch of its parent, (S,) bool.
    :ivar base: start point [m], (S, 3).
    :ivar attitude: z along the segment, x and y as the turtle's left and up, xyzw, (S, 4).
    :ivar length: [m], (S,).
    :ivar width: diameter at the base, which the physics uses throughout [m], (S,).
    :ivar tip_width: diameter drawn at the end [m], (S,).
    :ivar density: [kg/m³], (S,).
    :ivar modulus: Young's modulus along the grain [Pa], (S,).
    :ivar strength: bending strength [Pa], (S,); inf = never breaks.
    :ivar bone_ratio: bone length over segment length, (S,).
    :ivar swing_limit: [rad], (S,).
    :ivar swing_stiffness: [N·m/rad], (S,); NaN = E·I/L.
    :ivar swing_damping: [N·m·s/rad], (S,); NaN = from damping_ratio.
    :ivar damping_ratio: of the lowest bending mode of the branch, (S,).
    :ivar twist_stiffness, stretch_stiffness: [N·m/rad], [N/m], (S,); NaN = locked.
    :ivar twist_damping, stretch_damping: [N·m·s/rad], [N·s/m], (S,).
    :ivar break_force, break_torque: [N], [N·m], (S,); inf = never.
    :ivar texture: index into the texture names, (S,) int16.
    """

    parent: np.ndarray
    lateral: np.ndarray
    base: np.ndarray
    attitude: np.ndarray
    length: np.ndarray
    width: np.ndarray
    tip_width: np.ndarray
    density: np.ndarray
    modulus: np.ndarray
    strength: np.ndarray
    bone_ratio: np.ndarray
    swing_limit: np.ndarray
    swing_stiffness: np.ndarray
    swing_damping: np.ndarray
    damping_ratio: np.ndarray
    twist_stiffness: np.ndarray
    twist_damping: np.ndarray
    stretch_stiffness: np.ndarray
    stretch_damping: np.ndarray
    break_force: np.ndarray
    break_torque: np.ndarray
    texture: np.ndarray

    def __len__(self) -> int:
        return len(self.parent)
