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

"""Composite inertia: what a joint moves, all other joints taken as rigid (Featherstone 2008)."""

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, norm
from procphys_ros.physics.masonry.components import label
from procphys_ros.physics.world import BodyState, JointKind, World

_IMMOVABLE = (BodyState.GROUND, BodyState.FIXED, BodyState.KINEMATIC)


def accelerations(world: World, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return how sliders and hinges accelerate by a unit force or moment, and by weight alone.

    The composite body on either side of a joint is all that other joints connect; in a loop, where
    there are no two sides, its own two bodies.

    :param ids: of the joints, (K,).
    :returns: [1/kg], [1/(kg·m²)], (K,), and [m/s²], [rad/s²], (K,); 0 where both sides can fall.
    """
    rows, bodies = world.joints, world.bodies
    holding = np.flatnonzero((rows.kind != JointKind.GONE) & ~rows.broken)
    known, ends = np.unique(np.stack([rows.first[holding], rows.second[holding]]),
                            return_inverse=True)
    ends = ends.reshape(2, -1)
    # The ground and what stands hold all that is joined to them, and connect nothing.
    fixed = np.isin(bodies.state[known], _IMMOVABLE)
    inner = np.where(fixed[ends], len(known), ends)
    mobility, falling = np.zeros(len(ids)), np.zeros(len(ids))
    for k, joint in enumerate(ids.tolist()):
        others = (holding != joint) & (inner.min(axis=0) < len(known))
        labels, held = label(len(known), inner[0], inner[1], others)
        own = ends[:, np.searchsorted(holding, joint)]
        is_loop = labels[own[0]] == labels[own[1]]
        moves = ~fixed[own] & (is_loop | ~held[own])
        for side in np.flatnonzero(moves):
            end = own[side]
            moved = np.array([end]) if is_loop else np.flatnonzero(labels == labels[end])
            inertia, weight = _along(world, joint, known[moved])
            mobility[k] += 1.0 / inertia
            if not moves.all():
                falling[k] = (1.0 - 2.0 * side) * weight / inertia
    return mobility, falling


def _along(world: World, joint: int, ids: np.ndarray) -> tuple[float, float]:
    """Return mass and weight of bodies along a slider, or their moments about a hinge."""
    rows, bodies = world.joints, world.bodies
    mass = bodies.mass[ids]
    frame = rotation.compose(bodies.poses[rows.second[[joint]]], rows.other_frame[[joint]])[0]
    axis = rotation.rotate(frame[3:], np.array([1.0, 0.0, 0.0]))
    if rows.kind[joint] != JointKind.HINGE:
        return float(mass.sum()), float(mass.sum() * (axis * world.gravity).sum())
    turned = rotation.rotate(rotation.conjugate(bodies.poses[ids, 3:]),
                             np.broadcast_to(axis, (len(ids), 3)))
    lever = cross(axis, bodies.poses[ids, :3] - frame[:3])
    arms = np.square(norm(lever, axis=1))
    moment = (bodies.inertia[ids] * np.square(turned)).sum() + (mass * arms).sum()
    return float(moment), float((mass * (lever * world.gravity).sum(axis=1)).sum())
