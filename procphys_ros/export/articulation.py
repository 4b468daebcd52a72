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

"""Articulation: the joints of standing trees, as every exporter with joints reads them."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.export.content import Content
from procphys_ros.geometry import rotation
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.layout import (
    DAMPING,
    EXTRA_DAMPING,
    EXTRA_PRELOAD,
    EXTRA_STIFFNESS,
    EXTRA_STRIDE,
    LIMIT,
    PRELOAD_X,
    PRELOAD_Y,
    REACH,
    STIFFNESS,
)

CLAMPED, LOOSE = -1, -2  # values of `Articulation.parent`: fixed to the ground, broken off


@dataclass(frozen=True)
class Springs:
    """
    One degree of freedom of every joint: spring, damper, and coordinate.

    :ivar stiffness: [N·m/rad] or [N/m], (S,); inf = locked.
    :ivar damping: [N·m·s/rad] or [N·s/m], (S,).
    :ivar value: present coordinate [rad] or [m], (S,).
    :ivar rest: coordinate of the unloaded spring [rad] or [m], (S,).
    """

    stiffness: np.ndarray
    damping: np.ndarray
    value: np.ndarray
    rest: np.ndarray


@dataclass(frozen=True)
class Articulation:
    """
    Segments of trees, one row each, parents first.

    A joint turns about its x, then about the turned y, then twists about z and slides along it,
    z along the segment. Springs are those of the kernel, preloaded against the weight.

    :ivar part: part of each row, (S,).
    :ivar bond: bond of its joint, (S,).
    :ivar parent: parent row, `CLAMPED` to the ground, or `LOOSE`: broken off, (S,).
    :ivar reach: present distance of the centre of mass from the joint along z [m], (S,).
    :ivar limit: largest bend [rad], (S,).
    :ivar bend_x, bend_y, twist, slide: the four degrees of freedom.
    """

    part: np.ndarray
    bond: np.ndarray
    parent: np.ndarray
    reach: np.ndarray
    limit: np.ndarray
    bend_x: Springs
    bend_y: Springs
    twist: Springs
    slide: Springs

    def __len__(self) -> int:
        return len(self.part)


def articulate(content: Content) -> Articulation:
    """
    Compute the joints of all trees in a scene.

    :param content: rows of missing parts are omitted.
    """
    forest = Forest(content.blueprint, (0.0, 0.0, -content.gravity))
    model, parts = forest.model, forest.parts
    there = content.exists[parts]
    parent = np.where(content.holds[forest.bonds], forest.parents, LOOSE)
    values = _coordinates(content.poses[parts], forest.parents, model)
    place = np.append(np.cumsum(there) - 1, [LOOSE, CLAMPED])  # indexed by -2 and -1, too
    extra, second = model.extra, EXTRA_STRIDE
    springs = (
        _springs(model.swing, STIFFNESS, DAMPING, PRELOAD_X, values[0]),
        _springs(model.swing, STIFFNESS, DAMPING, PRELOAD_Y, values[1]),
        _springs(extra, EXTRA_STIFFNESS, EXTRA_DAMPING, EXTRA_PRELOAD, values[2]),
        _springs(extra, second + EXTRA_STIFFNESS, second + EXTRA_DAMPING, second + EXTRA_PRELOAD,
                 values[3]))
    kept = [Springs(*(column[there] for column in vars(s).values())) for s in springs]
    reach = model.body[:, REACH] + values[3]
    return Articulation(parts[there], forest.bonds[there], place[parent[there]], reach[there],
                        model.swing[there, LIMIT], *kept)


def _springs(table: np.ndarray, stiffness: int, damping: int, preload: int,
             value: np.ndarray) -> Springs:
    k = table[:, stiffness]
    sprung = np.isfinite(k) & (k > 0.0)
    rest = np.divide(table[:, preload], k, out=np.zeros(len(k)), where=sprung)
    return Springs(k, table[:, damping], np.where(np.isfinite(k), value, 0.0), rest)


def _coordinates(poses: np.ndarray, parent: np.ndarray,
                 model) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """
    Compute bends, twist [rad] and slide [m] of all joints from the poses of the segments.

    The values of broken joints are not used.
    """
    rooted = parent < 0
    mount = model.mount.copy()
    mount[~rooted, 2] -= model.body[parent[~rooted], REACH]  # from the parent's centre of mass
    seat = np.where(rooted[:, None], mount, rotation.compose(poses[parent], mount))
    turn = rotation.to_matrix(rotation.multiply(rotation.conjugate(seat[:, 3:]), poses[:, 3:]))
    axis = rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    slide = np.einsum('ij,ij->i', poses[:, :3] - seat[:, :3], axis) - model.body[:, REACH]
    locked = np.isinf(model.extra[:, EXTRA_STRIDE + EXTRA_STIFFNESS])
    return (np.arctan2(-turn[:, 1, 2], turn[:, 2, 2]),
            np.arcsin(np.clip(turn[:, 0, 2], -1.0, 1.0)),
            np.arctan2(-turn[:, 0, 1], turn[:, 0, 0]), np.where(locked, 0.0, slide))
