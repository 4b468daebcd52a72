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
Ties: ropes from bodies to branches, solved for together with the contacts of trees.

A rope is a contact that only pulls. Its impulse acts along the direction in the middle of the
step, and the velocity that it leaves is across the direction at the end: so what swings on a
branch that does not give way keeps its speed. Half of the impulse acts on the body before it moves
and half after, so that it moves with the mean of its old and new velocities, as trees do.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Joints
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, norm
from procphys_ros.physics.world import JointOptions
from procphys_ros.simulation import breaking
from procphys_ros.simulation.contact_pairs import Pairs, TreeContacts
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State, TIED


class Ties(NamedTuple):
    """
    Ropes to branches in the next step, a row each.

    :ivar joint: row of `Blueprint.joints`, (K,).
    :ivar pairs: as possible contacts; normals lead from the branch to the body.
    :ivar arm: from the centre of the body to the point of the rope [m], (K, 3).
    :ivar turned: speed along the normals that the turn of the rope asks for [m/s], (K,).
    """

    joint: np.ndarray
    pairs: Pairs
    arm: np.ndarray
    turned: np.ndarray


def of_trees(state: State, parts: np.ndarray) -> np.ndarray:
    """Mark the joints, pairs of parts, (J, 2), that lead to standing or falling trees, (J,)."""
    return (parts[:, 0] >= 0) & (state.parts.owner[parts[:, 0]] == Owner.TREE)


def find(model: Model, state: State, dt: float) -> Ties:
    """List the ropes to branches; wakes what hangs on them, and their trees."""
    rows = np.flatnonzero(state.mechanisms.joint == TIED)
    joints, columns, world = model.blueprint.joints.take(rows), state.parts, state.world
    host, hung = joints.parts.T
    row, body = columns.row[host], columns.body[hung]
    high, low = _ends(model, state, joints)
    bodies = world.bodies
    if len(rows):
        world.wake(body)
        if state.trees.lod is not None:
            state.trees.lod.wake(state.trees.lod.of_rows(state.forest, row))
    moves, swings = bodies.velocities[body], state.forest.velocities[row]
    arm = low - bodies.poses[body, :3]
    slip = (moves[:, :3] + cross(moves[:, 3:], arm) + 0.5 * dt * world.gravity
            - swings[:, :3] - cross(swings[:, 3:], high - state.forest.poses[row, :3]))
    now, length = _unit(low - high), norm(low - high, axis=1)
    slip -= (slip * now).sum(axis=1)[:, None] * now  # the rope takes what is along it
    end = _unit(low - high + dt * slip)
    middle = _unit(now + end)
    leaving = (moves[:, :3] * now).sum(axis=1)
    gap = joints.high - length - 0.5 * dt * np.maximum(leaving, 0.0)
    nothing = np.full(len(rows), -1, np.intp)
    return Ties(rows, Pairs(row, nothing, body, nothing, high, middle, gap), arm,
                (slip * (end - middle)).sum(axis=1))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(norm(vectors, axis=1), np.finfo(float).tiny)[:, None]


def _ends(model: Model, state: State, joints: Joints) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of ropes on branches and on bodies [m], (K, 3) each, world."""
    columns, rest = state.parts, model.blueprint.poses
    host, hung = joints.parts.T
    far = joints.frame.copy()
    far[:, :3] += rotation.rotate(far[:, 3:], joints.anchor)
    tree = columns.owner[host] == Owner.TREE
    poses = columns.poses[host].copy()
    poses[tree] = state.forest.poses[columns.row[host[tree]]]
    pose = rotation.compose(state.world.poses(columns.body[hung]), columns.local[hung])
    return (rotation.compose(poses, rotation.relative(rest[host], far))[:, :3],
            rotation.compose(pose, rotation.relative(rest[hung], joints.frame))[:, :3])


def pull(model: Model, state: State, contacts: TreeContacts, share: float) -> None:
    """Add a share of the impulses of ropes to their bodies."""
    mine = np.flatnonzero(contacts.rope >= 0)
    hung = model.blueprint.joints.parts[contacts.rope[mine], 1]
    mine = mine[state.parts.owner[hung] == Owner.BODY]  # neither removed nor broken since
    if not len(mine):
        return
    low = _ends(model, state, model.blueprint.joints.take(contacts.rope[mine]))[1]
    bodies, body, impulse = state.world.bodies, contacts.body[mine], -contacts.impulse[mine]
    turn = bodies.poses[body, 3:]
    blow = rotation.rotate(rotation.conjugate(turn), cross(low - bodies.poses[body, :3], impulse))
    ids, place = np.unique(body, return_inverse=True)
    change = np.zeros((len(ids), 6))
    np.add.at(change, place, share * np.hstack([
        impulse / bodies.mass[body, None], rotation.rotate(turn, blow / bodies.inertia[body])]))
    state.world.push(ids, change, np.ones(len(ids), bool))


def renew(model: Model, state: State) -> None:
    """
    Forget ropes whose ends are gone, and hand over those to branches that have become bodies.

    Their momentum is that of the last step; from now on they are ropes between two bodies.
    """
    own, owner = state.mechanisms, state.parts.owner
    rows = np.flatnonzero(own.joint == TIED)
    host, hung = model.blueprint.joints.parts[rows].T
    gone = (owner[hung] != Owner.BODY) | (owner[host] == Owner.GONE)
    own.joint[rows[gone]] = -1
    _hand_over(model, state, rows[~gone & (owner[host] == Owner.BODY)])


def end_step(model: Model, state: State, dt: float) -> None:
    """Add the second half of the impulses of ropes to their bodies, and break ropes."""
    contacts = state.contacts
    mine = np.flatnonzero(contacts.rope >= 0)
    if not len(mine):
        return
    pull(model, state, contacts, 0.5)
    torn = contacts.rope[mine]
    strength = np.maximum(model.blueprint.joints.force[torn], np.finfo(float).tiny)
    load = norm(contacts.impulse[mine], axis=1) / dt / strength
    over = load > 1.0
    breaking.break_ties(model, state, torn[over], contacts.point[mine[over]], load[over])


def _hand_over(model: Model, state: State, rows: np.ndarray) -> None:
    """Make ropes between two bodies of ties whose branches have become bodies."""
    if not len(rows):
        return
    joints, columns = model.blueprint.joints.take(rows), state.parts
    host, hung = columns.body[joints.parts].T
    turn = np.tile(rotation.IDENTITY, (len(rows), 1))
    high, low = (np.hstack([ends, turn]) for ends in _ends(model, state, joints))
    state.mechanisms.joint[rows] = state.world.join(
        joints.kind.astype(np.intp), hung, host, low,
        JointOptions(low=joints.low, high=joints.high, force=joints.force,
                     collides=joints.collides), high)
