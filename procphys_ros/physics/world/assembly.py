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

"""Rigid sums: what many parts are when they move as one body, and back."""

from dataclasses import dataclass

from numba import njit
import numpy as np

from procphys_ros import rotation


@dataclass(frozen=True)
class RigidSum:
    """
    One rigid body in its principal frame.

    :ivar mass: [kg].
    :ivar inertia: principal moments [kg·m²], (3,).
    :ivar pose: centre of mass and principal axes in world axes, (7,).
    :ivar velocity: linear [m/s] and angular [rad/s], world axes, (6,).
    :ivar local_poses: of the parts in the principal frame, (P, 7).
    """

    mass: float
    inertia: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray
    local_poses: np.ndarray


def rigid_sum(mass: np.ndarray, inertia: np.ndarray, poses: np.ndarray,
              velocities: np.ndarray | None = None) -> RigidSum:
    """
    Add parts up to one rigid body that has their momentum and angular momentum.

    Inertia by the parallel-axis theorem; the velocity is what a perfectly plastic bond between
    the parts would leave, so parts that already move as one keep their energy too.

    :param mass: of the parts [kg], (P,).
    :param inertia: principal moments in the parts' axes [kg·m²], (P, 3).
    :param poses: of the parts' centres of mass, (P, 7).
    :param velocities: of the parts in world axes, (P, 6); None = at rest.
    """
    mass = np.asarray(mass, float)
    total = float(mass.sum())
    centre = mass @ poses[:, :3] / total
    arm = poses[:, :3] - centre
    axes = rotation.to_matrix(poses[:, 3:])
    own = np.einsum('pij,pj,pkj->pik', axes, inertia, axes)
    square = (arm * arm).sum(axis=1)
    tensor = (own.sum(axis=0) + np.eye(3) * (mass @ square)
              - np.einsum('p,pi,pj->ij', mass, arm, arm))
    moments, principal = np.linalg.eigh(tensor)
    if np.linalg.det(principal) < 0.0:
        principal[:, 0] *= -1.0
    pose = np.concatenate([centre, rotation.from_matrix(principal)])
    velocity = np.zeros(6)
    if velocities is not None:
        velocity[:3] = mass @ velocities[:, :3] / total
        spin = (np.einsum('pij,pj->i', own, velocities[:, 3:])
                + (mass[:, None] * np.cross(arm, velocities[:, :3])).sum(axis=0))
        velocity[3:] = np.linalg.solve(tensor, spin)
    return RigidSum(total, moments, pose, velocity, rotation.relative(pose, poses))


@njit(cache=True)
def expand(poses, velocities, body, local, part, out_poses, out_velocities):
    """
    Carry parts along with their bodies: v = V + Ω × r, the same spin for all parts of a body.

    :param poses: of all bodies, row = id, (B, 7).
    :param velocities: of all bodies, world axes, (B, 6).
    :param body: id of each carried part's body, (K,) int.
    :param local: pose of each carried part in its body's frame, (K, 7).
    :param part: row of `out_poses` that each carried part writes, (K,) int.
    :param out_poses: of all parts, (N, 7), written in place.
    :param out_velocities: of all parts, world axes, (N, 6), written in place.
    """
    for k in range(body.shape[0]):
        b, n = body[k], part[k]
        ax, ay, az, aw = poses[b, 3], poses[b, 4], poses[b, 5], poses[b, 6]
        x, y, z = local[k, 0], local[k, 1], local[k, 2]
        tx, ty, tz = 2.0 * (ay * z - az * y), 2.0 * (az * x - ax * z), 2.0 * (ax * y - ay * x)
        rx = x + aw * tx + ay * tz - az * ty
        ry = y + aw * ty + az * tx - ax * tz
        rz = z + aw * tz + ax * ty - ay * tx
        out_poses[n, 0] = poses[b, 0] + rx
        out_poses[n, 1] = poses[b, 1] + ry
        out_poses[n, 2] = poses[b, 2] + rz
        bx, by, bz, bw = local[k, 3], local[k, 4], local[k, 5], local[k, 6]
        out_poses[n, 3] = aw * bx + ax * bw + ay * bz - az * by
        out_poses[n, 4] = aw * by - ax * bz + ay * bw + az * bx
        out_poses[n, 5] = aw * bz + ax * by - ay * bx + az * bw
        out_poses[n, 6] = aw * bw - ax * bx - ay * by - az * bz
        wx, wy, wz = velocities[b, 3], velocities[b, 4], velocities[b, 5]
        out_velocities[n, 0] = velocities[b, 0] + wy * rz - wz * ry
        out_velocities[n, 1] = velocities[b, 1] + wz * rx - wx * rz
        out_velocities[n, 2] = velocities[b, 2] + wx * ry - wy * rx
        out_velocities[n, 3] = wx
        out_velocities[n, 4] = wy
        out_velocities[n, 5] = wz
