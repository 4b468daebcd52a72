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


"""Intruder: a body moved from outside that pushes branches, debris and walls, and feels them."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.physics.touch import overlap, overlaps
from procphys_ros.physics.world import BodyState
from procphys_ros.simulation import fragments, masonry
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

SMOOTHING = 0.1  # [s] time constant of the wrench that is given out; contacts of rigid bodies jump
_YIELD = 0.003   # [m] that a brick gives before its bonds exert all their strength
_STILL = 1e-3    # [m/s] slower, debris at rest is left so
_LAYER = 'intruder'


def place(model: Model, state: State, pose: np.ndarray, time: float) -> None:
    """
    Say where the intruder is to be; see `PoseInterpolator` for how it gets there.

    :param pose: x y z [m], unit quaternion, (7,), world.
    :param time: of the simulation, at which the pose is valid [s].
    """
    own, world = state.intruder, state.world
    if not own.path.set_target(pose, time):
        return
    pose = own.path.pose
    if own.body < 0:
        settings = model.settings.intruder
        shape = Shape.CAPSULE if settings.shape == 'sphere' else Shape.BOX
        own.body = world.add_driven(shape, settings.edges, pose)
    world.set_poses(np.array([own.body]), pose[None])
    world.drive(own.body, pose)


def advance(model: Model, state: State, dt: float) -> None:
    """
    Move the intruder on, whatever is in its way, and press on the walls there.

    Branches and loose bodies are pushed aside with their own masses. Bricks that stand press back
    the more the deeper it gets into them, up to the strength of their bonds, and then come out.
    Writes `state.intruder`, its body and loads; releases.
    """
    own, world = state.intruder, state.world
    own.from_wall = np.zeros(6)
    if own.body < 0:
        return
    velocity = own.path.advance(state.time, dt)
    own.start = world.bodies.poses[own.body, :3].copy()
    world.set_velocities(np.array([own.body]), velocity[None])
    world.drive(own.body, own.path.pose)
    if np.abs(velocity).max() > _STILL:
        _wake(state, velocity, dt)
    if len(model.masonry.bricks):
        _press(model, state, velocity, dt)


def sum_wrench(model: Model, state: State, dt: float) -> None:
    """Sum up what acted on the intruder in the engine's step; writes its wrenches."""
    own, world = state.intruder, state.world
    if own.body < 0:
        return
    own.wrench = own.from_wall.copy()
    bodies = world.bodies
    away = np.linalg.norm(bodies.poses[:, :3] - own.path.pose[:3], axis=1)
    near = away < bodies.radius + bodies.radius[own.body] + 0.1
    if (near & (bodies.state == BodyState.AWAKE)).any():
        own.wrench += world.wrench(own.body)
    mine = state.contacts.body == own.body
    force = -state.contacts.impulse[mine] / dt
    own.wrench[:3] += force.sum(axis=0)
    own.wrench[3:] += np.cross(state.contacts.point[mine] - own.start, force).sum(axis=0)
    own.smooth_wrench = own.smooth_wrench - np.expm1(-dt / SMOOTHING) * (own.wrench
                                                                         - own.smooth_wrench)


def bodies(state: State) -> dict[str, int]:
    """Give the ids in the world of the intruders that have been placed, by name."""
    return {} if state.intruder.body < 0 else {'intruder': state.intruder.body}


def _bounds(state: State, velocity: np.ndarray, dt: float) -> np.ndarray:
    """Give bounds of its ball, before and after a step, (1, 6)."""
    bodies, body = state.world.bodies, state.intruder.body
    centre, room = bodies.poses[body, :3], bodies.radius[body]
    way = velocity[:3] * dt
    return np.concatenate([centre - room + np.minimum(way, 0.0),
                           centre + room + np.maximum(way, 0.0)])[None]


def _wake(state: State, velocity: np.ndarray, dt: float) -> None:
    """Set debris at rest free that it comes to, however slowly."""
    bodies = state.world.bodies
    resting = np.flatnonzero(bodies.state == BodyState.RESTING)
    _, hit = overlaps(_bounds(state, velocity, dt), bodies.bounds[resting])
    state.world.thaw(resting[hit])


def _press(model: Model, state: State, velocity: np.ndarray, dt: float) -> None:
    settings, pose = model.settings.intruder, state.intruder.path.pose
    near = model.masonry.bricks.within(_bounds(state, velocity, dt), state.standing,
                                       state.parts.body)
    depth, normal, point = overlap(settings.shape == 'sphere', pose, settings.edges, near.pose,
                                   near.size)
    parts, wrenches = [], []
    for i in np.flatnonzero(depth > 0.0).tolist():
        part, push = np.array([near.part[i]]), -normal[i]
        resistance = masonry.resist(state, part, push)
        force = resistance.momentum(1.0) * min(depth[i] / _YIELD, 1.0)
        arm = point[i] - pose[:3]
        if depth[i] > _YIELD:
            speed = max(0.0, float((velocity[:3] + np.cross(velocity[3:], arm)) @ push))
            leaving = np.zeros((1, 6))
            leaving[0, :3] = speed * push
            force += state.world.bodies.mass[near.body[i]] * speed / dt
            fragments.release(model, state, [part], leaving, Cause.IMPACT, 1.0)
        else:
            parts.append(part[0])
            wrenches.append(np.concatenate([force * push, np.zeros(3)]))
        state.intruder.from_wall += np.concatenate([-force * push, np.cross(arm, -force * push)])
    state.loads.set_layer(_LAYER, np.array(parts, np.intp), np.array(wrenches).reshape(-1, 6))
