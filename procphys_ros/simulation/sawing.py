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
Sawing: intruders that cut what they are moved into, and wedges in felling cuts.

A kerf deepens by the way that a saw goes across a segment or a brick, as fast as the saw cuts at
most; moved faster, it pushes as any intruder does. What is left of a joint bends and breaks as the
segment of a circle that it is.
"""

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.trees.sections import kerfed
from procphys_ros.simulation import cutting, intruder
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import IntruderState, State

_HOME = 3.0  # [s] in which blows of an axe drive a wedge home


def step(model: Model, state: State, dt: float) -> None:
    """Deepen the kerfs of saws, and drive wedges; writes the forest, bonds and bodies."""
    if state.wedges:
        _drive_wedges(model, state, dt)
    for name, rate in model.settings.saws.items():
        own = state.intruders[name]
        own.sawn = own.sawn[:0]
        if own.body >= 0:
            velocity = state.world.bodies.velocities[own.body]
            _saw_trees(model, state, name, velocity, rate, dt)
            if norm(velocity[:3]) <= rate and len(model.masonry.bricks):
                _saw_bricks(model, state, name, velocity, dt)


def blades(state: State) -> np.ndarray:
    """Pair saws with the segments that they do not push, as `contact_exclusions.colliders`."""
    return np.concatenate([np.zeros((0, 2), np.intp), *(
        np.column_stack([own.sawn, np.full(len(own.sawn), ~own.body)])
        for own in state.intruders.values() if len(own.sawn))])


def _drive_wedges(model: Model, state: State, dt: float) -> None:
    part = np.fromiter(state.wedges, np.intp, len(state.wedges))
    left = np.array([*state.wedges.values()])
    rows = state.parts.row[part]
    holds = (state.parts.owner[part] == Owner.TREE) & ~state.forest.is_free(rows)
    width = model.blueprint.bond_extent[state.forest.bonds[rows], 0]
    now = np.minimum(left, cutting.WEDGE / width * dt / _HOME)
    state.forest.wedge(rows[holds], now[holds])
    left -= now
    goes_on = holds & (left > 0.0)
    state.wedges = dict(zip(part[goes_on].tolist(), left[goes_on].tolist()))


def _saw_trees(model: Model, state: State, name: str, velocity: np.ndarray, rate: float,
               dt: float) -> None:
    """Deepen the kerfs in the joints nearest to where a saw touches segments."""
    own, forest = state.intruders[name], state.forest
    reach = state.world.bodies.radius[own.body] + norm(velocity[:3]) * dt
    away = norm(forest.poses[:, :3] - own.path.pose[:3], axis=1) - forest.half_lengths
    near = np.flatnonzero(forest.active & (away < reach + state.trees.sizes[:, 0]))
    if not len(near):
        return
    if norm(velocity[:3]) <= rate:
        own.sawn = forest.parts[near]
    depth, _, point = intruder.deepest(model.intruders[name], own.path.pose, forest.poses[near],
                                       state.trees.sizes[near])
    near, point = near[depth > 0.0], point[depth > 0.0]
    axis = rotation.rotate(forest.poses[near, 3:], np.array([0.0, 0.0, 1.0]))
    arm = point - own.path.pose[:3]
    feed = velocity[:3] + np.cross(velocity[3:], arm) - forest.velocities[near, :3]
    feed -= (feed * axis).sum(axis=1)[:, None] * axis
    along = ((point - forest.poses[near, :3]) * axis).sum(axis=1)
    speed = norm(feed, axis=1)
    joints = np.array([_nearest_joint(model, state, row, side) for row, side in
                       zip(near.tolist(), along.tolist())], np.intp)
    moves = speed > 0.0
    _deepen(model, state, joints[moves], feed[moves] / speed[moves, None],
            np.minimum(speed[moves], rate) * dt)


def _nearest_joint(model: Model, state: State, row: int, along: float) -> int:
    """Return the row whose foot is the joint next to a place on a segment."""
    forest = state.forest
    if along > 0.0:
        carried = row + 1 + np.flatnonzero(forest.parents[row + 1:forest.ends[row]] == row)
        carried = carried[forest.active[carried]]
        if len(carried):
            width = model.blueprint.bond_extent[forest.bonds[carried], 0]
            return int(carried[np.argmax(width)])
    return row


def _deepen(model: Model, state: State, joints: np.ndarray, ways: np.ndarray,
            more: np.ndarray) -> None:
    """Deepen kerfs [m], (K,), and part what they have gone through."""
    forest = state.forest
    joints, first = np.unique(joints, return_index=True)
    held = ~forest.is_free(joints)
    joints, ways, more = joints[held], ways[first[held]], more[first[held]]
    parts = forest.parts[joints]
    deep = np.array([state.kerfs.get(part, 0.0) for part in parts.tolist()]) + more
    state.kerfs.update(zip(parts.tolist(), deep.tolist()))
    share = deep / model.blueprint.bond_extent[forest.bonds[joints], 0]
    through = share >= 1.0
    if not through.all():
        fresh = ~through & ~forest.is_cut(joints)
        forest.begin_cuts(joints[fresh], ways[fresh])
        forest.saw(joints[~through], kerfed(share[~through]))
    if through.any():
        cutting.part(model, state, np.sort(forest.bonds[joints[through]]))
    if state.trees.lod is not None:
        state.trees.lod.wake(state.trees.lod.of_rows(forest, joints))


def _saw_bricks(model: Model, state: State, name: str, velocity: np.ndarray, dt: float) -> None:
    """Deepen the kerfs in standing bricks; those that are sawn through lose their bonds."""
    own: IntruderState = state.intruders[name]
    speed = float(norm(velocity[:3]))
    near = model.masonry.bricks.within(intruder.bounds(state, own, velocity, dt), state.standing,
                                       state.parts.body)
    depth, _, _ = intruder.deepest(model.intruders[name], own.path.pose, near.pose, near.size)
    touched = depth > 0.0
    if speed == 0.0 or not touched.any():
        return
    way = rotation.to_matrix(near.pose[touched, 3:])
    extent = (np.abs(product(np.swapaxes(way, 1, 2), velocity[:3] / speed))
              * near.size[touched]).sum(axis=1)
    parts = near.part[touched]
    deep = np.array([state.kerfs.get(part, 0.0) for part in parts.tolist()]) + speed * dt
    state.kerfs.update(zip(parts.tolist(), deep.tolist()))
    through = parts[deep >= extent]
    if len(through):
        cutting.part(model, state, cutting.bonds_of(model, state, through))
