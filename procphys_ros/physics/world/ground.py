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

"""Ground contact beyond the engine's: no sinking, and contact at the true corners of bricks."""

from typing import NamedTuple

import numpy as np

from procphys_ros import rotation
from procphys_ros.compilation import kernel
from procphys_ros.physics.terrain import FLAT, height_at, normal_at, Terrain
from procphys_ros.physics.world.body_table import BodyTable
from procphys_ros.physics.world.clearance import clearances
from procphys_ros.physics.world.ground_points import resolve_ground_contacts

OVERLAP = 1e-3  # [m] left when a body is lifted out: boxes that only touch have no contact
_DEPTH = 0.02  # [m] under the ground from which a moving body is lifted out
_SUNK = 0.01  # [m] under the ground from which a body that comes to rest is lifted out
_GROUND = 0  # id of the ground


class Correction(NamedTuple):
    """
    What the ground changes.

    :ivar ids: bodies that it moves, (K,).
    :ivar poses: new ones, (K, 7).
    :ivar velocities: new ones, (K, 6).
    :ivar contacts: rows as of `Engine.contacts`, (C, 13).
    """

    ids: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    contacts: np.ndarray


_NOTHING = Correction(np.zeros(0, np.intp), np.zeros((0, 7)), np.zeros((0, 6)), np.zeros((0, 13)))


def lift_fallen(table: BodyTable, awake: np.ndarray, before: np.ndarray, gravity: np.ndarray,
                time_step: float, terrain: Terrain = FLAT) -> Correction:
    """
    Put bodies that ran deep into the ground back to where they touched it.

    They get the speed they had there, from the energy of the fall between, and of the spin when an
    edge ran in; the contact of the next step does the rest. Without this a fast body would stay in
    the ground for a while, and what is squeezed from above for good.

    :param table: the bodies.
    :param awake: ids, (K,).
    :param before: where their centres were before the step [m], (K, 3).
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :param terrain: the surface of the ground.
    """
    chosen = awake[_sinking(terrain, awake, before, table.poses, table.velocities, table.radius,
                            time_step)]
    if not len(chosen):
        return _NOTHING
    depth = -lowest(table, chosen, terrain)
    chosen, depth = chosen[depth > _DEPTH], depth[depth > _DEPTH]
    if not len(chosen):
        return _NOTHING
    poses, velocities = table.poses[chosen], table.velocities[chosen]
    before = velocities[:, 2].copy()
    poses[:, 2] += depth - OVERLAP
    _pay(table, chosen, velocities, 2.0 * np.abs(gravity[2]) * depth)
    force = table.mass[chosen] * (velocities[:, 2] - before) / time_step
    contacts = np.zeros((len(chosen), 13))
    contacts[:, 0], contacts[:, 1] = chosen, _GROUND
    contacts[:, 2:4], contacts[:, 7] = poses[:, :2], 1.0
    contacts[:, 4] = terrain.height(poses)
    contacts[:, 11], contacts[:, 12] = force, force
    return Correction(chosen, poses, velocities, contacts)


@kernel
def _sinking(terrain, awake, before, poses, velocities, radius, time_step):
    """List the rows of bodies that may have run deep into the ground in a step, (M,)."""
    found = np.zeros(len(awake), np.bool_)
    for k in range(len(awake)):
        b = awake[k]
        x, y, z = poses[b, 0], poses[b, 1], poses[b, 2]
        v = velocities[b]
        height = z - height_at(terrain, x, y)
        spin = np.sqrt(v[3] ** 2 + v[4] ** 2 + v[5] ** 2)
        down = (before[k, 2] - height_at(terrain, before[k, 0], before[k, 1]) - height
                + spin * radius[b] * time_step)
        found[k] = height < 0.0 or (
            down > _DEPTH and height < radius[b] / normal_at(terrain, x, y)[2])
    return np.flatnonzero(found)


def _reach(terrain: Terrain, places: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Give how high over the ground the centre of a ball is that touches it [m], (K,)."""
    return radius if terrain.is_flat else radius / terrain.normal(places)[:, 2]


def _pay(table: BodyTable, ids: np.ndarray, velocities: np.ndarray, owed: np.ndarray) -> None:
    """Subtract energy [J/kg, doubled] from the fall of bodies, then from their spin, in place."""
    fall = np.square(np.minimum(velocities[:, 2], 0.0))
    velocities[:, 2] = np.where(velocities[:, 2] > 0.0, velocities[:, 2],
                                -np.sqrt(np.maximum(fall - owed, 0.0)))
    turn = rotation.rotate(rotation.conjugate(table.poses[ids, 3:]), velocities[:, 3:])
    spin = (table.inertia[ids] * (turn * turn)).sum(axis=1) / table.mass[ids]
    left = np.maximum(spin - np.maximum(owed - fall, 0.0), 0.0)
    velocities[:, 3:] *= np.sqrt(left / np.maximum(spin, 1e-12))[:, None]


def touch_with_points(table: BodyTable, awake: np.ndarray, time_step: float,
                      terrain: Terrain = FLAT) -> Correction:
    """
    Resolve ground contacts of the corners that stick out of the collision shapes of bodies.

    :param table: the bodies.
    :param awake: ids, (K,).
    :param time_step: [s].
    :param terrain: the surface of the ground.
    """
    chosen = awake[table.point_count[awake] > 0]
    place = table.poses[chosen, :3]
    chosen = chosen[place[:, 2] - terrain.height(place)
                    < _reach(terrain, place, table.radius[chosen])]
    if not len(chosen):
        return _NOTHING
    poses, velocities = table.poses[chosen], table.velocities[chosen]
    contacts = resolve_ground_contacts(table.first_point[chosen], table.point_count[chosen],
                                       table.ground_point, poses, velocities,
                                       table.mass[chosen], table.inertia[chosen],
                                       np.sqrt(table.friction[chosen] * table.friction[_GROUND]),
                                       time_step, terrain)
    if not len(contacts):
        return _NOTHING
    rows = contacts[:, 0].astype(np.intp)
    moved = np.unique(rows)
    contacts[:, 0], contacts[:, 1] = chosen[rows], _GROUND
    return Correction(chosen[moved], poses[moved], velocities[moved], contacts)


def lift_settled(table: BodyTable, ids: np.ndarray,
                 terrain: Terrain = FLAT) -> tuple[np.ndarray, np.ndarray]:
    """
    Find bodies that came to rest in the ground, and where they are out of it.

    :returns: ids, (K,), and poses, (K, 7).
    """
    low = lowest(table, ids, terrain)
    sunk = low < -_SUNK
    poses = table.poses[ids[sunk]]
    poses[:, 2] += -low[sunk] - OVERLAP
    return ids[sunk], poses


def lowest(table: BodyTable, ids: np.ndarray, terrain: Terrain = FLAT) -> np.ndarray:
    """Give the heights over the ground of the lowest points of bodies [m], (K,)."""
    return clearances(
        terrain, ids, table.poses, table.first_piece, table.piece_count, table.piece_shape,
        table.piece_size, table.piece_pose, table.first_point, table.point_count,
        table.ground_point, table.first_hexahedron, table.hexahedron_count,
        table.hexahedron_piece, table.hexahedron_corners)
