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


"""Intruders: bodies moved from outside that push branches, debris and walls, and feel them."""

from collections.abc import Iterator

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.elementary import expm1
from procphys_ros.errors import CommandError, nearest_names
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import ALIKE
from procphys_ros.physics.touch import overlap_ball, overlap_box, overlaps
from procphys_ros.physics.wind.downwash import COLUMNS, jet
from procphys_ros.physics.world import BodyState, Pieces
from procphys_ros.simulation import breaking, masonry
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import IntruderState, State

SMOOTHING = 0.1  # [s] time constant of the published wrench; contacts of rigid bodies jump
_YIELD = 0.003   # [m] deformation of a brick until its bonds exert all their strength
_THROUGH = 0.03  # [m] penetration of a wall until the bricks in the way come out, ...
_FIRST = 100.0   # [N] ... with a force that starts at this value, ...
_MORE = 1.5      # ... and is multiplied by this factor whenever the wall has withstood it
_STILL = 1e-3    # [m/s] slower intruders do not wake resting debris
_SPACING = 0.25  # [radii] between balls that approximate a capsule, to 1 % of the radius


def place(model: Model, state: State, name: str, pose: np.ndarray, time: float) -> None:
    """
    Set the target of an intruder; see `PoseInterpolator` for its motion.

    :param name: of the intruder.
    :param pose: x y z [m], unit quaternion, (7,), world.
    :param time: simulation time at which the pose is valid [s].
    :raises CommandError: if there is no such intruder.
    """
    own, world = named(state, name), state.world
    if not own.path.set_target(pose, time):
        return
    pose = own.path.pose
    if own.body < 0:
        own.body = world.add_driven(model.intruders[name], pose)
    world.set_poses(np.array([own.body]), pose[None])
    world.drive(own.body, pose)


def named(state: State, name: str) -> IntruderState:
    """
    Find an intruder.

    :raises CommandError: if none has this name.
    """
    own = state.intruders.get(name) if isinstance(name, str) else None
    if own is None:
        raise CommandError(f'there is no intruder "{name}"{nearest_names(name, state.intruders)}')
    return own


def bodies(state: State) -> dict[str, int]:
    """Return the body ids of the intruders that have been placed, by name."""
    return {name: own.body for name, own in state.intruders.items() if own.body >= 0}


def advance(model: Model, state: State, dt: float) -> None:
    """
    Move the intruders through any obstacle, and load the walls that they touch.

    Branches and loose bodies are pushed aside with their own masses. Standing bricks resist more,
    the deeper it penetrates, up to their joint strength, and then come out with the bricks ahead
    of them. Intruders pass through each other. Writes `state.intruders`, bodies, loads and the
    jets of the wind; releases.
    """
    world = state.world
    for name, own in state.intruders.items():
        own.from_wall = np.zeros(6)
        if own.body < 0:
            continue
        velocity = own.path.advance(state.time, dt)
        own.start = world.bodies.poses[own.body, :3].copy()
        world.set_velocities(np.array([own.body]), velocity[None])
        world.drive(own.body, own.path.pose)
        if np.abs(velocity).max() > _STILL:
            _wake(state, own, velocity, dt)
        saws = norm(velocity[:3]) <= model.settings.saws.get(name, -1.0)
        if saws:
            own.pressed = 0.0
            state.loads.remove_layer(f'intruder {name}')
        elif len(model.masonry.bricks):
            _press(model, state, name, velocity, dt)
    jets = [jet(own.path.pose[:3], rotation.rotate(own.path.pose[3:], own.thrust), own.disk)
            for own in state.intruders.values() if own.body >= 0 and norm(own.thrust) > 0.0]
    state.wind.jets = np.array(jets).reshape(-1, COLUMNS)


def sum_wrench(model: Model, state: State, dt: float) -> None:
    """Sum up the forces on the intruders in the engine's step; writes their wrenches."""
    world = state.world
    for own in state.intruders.values():
        if own.body < 0:
            continue
        own.wrench = own.from_wall.copy()
        table = world.bodies
        away = norm(table.poses[:, :3] - own.path.pose[:3], axis=1)
        near = away < table.radius + table.radius[own.body] + 0.1
        loose = (table.state == BodyState.AWAKE) | (table.state == BodyState.RESTING)
        if (near & loose).any():
            own.wrench += world.wrench(own.body)
        mine = state.contacts.body == own.body
        force = -state.contacts.impulse[mine] / dt
        own.wrench[:3] += force.sum(axis=0)
        own.wrench[3:] += np.cross(state.contacts.point[mine] - own.start, force).sum(axis=0)
        share = -expm1(-dt / SMOOTHING)
        own.smooth_wrench = own.smooth_wrench + share * (own.wrench - own.smooth_wrench)


def bounds(state: State, own: IntruderState, velocity: np.ndarray, dt: float) -> np.ndarray:
    """Return bounds of its bounding sphere, swept over a step, (1, 6)."""
    table = state.world.bodies
    centre, room = table.poses[own.body, :3], table.radius[own.body]
    way = velocity[:3] * dt
    return np.concatenate([centre - room + np.minimum(way, 0.0),
                           centre + room + np.maximum(way, 0.0)])[None]


def _wake(state: State, own: IntruderState, velocity: np.ndarray, dt: float) -> None:
    """Wake resting debris within its reach, however slow it is."""
    table = state.world.bodies
    resting = np.flatnonzero(table.state == BodyState.RESTING)
    _, hit = overlaps(bounds(state, own, velocity, dt), table.bounds[resting])
    state.world.thaw(resting[hit])


def _press(model: Model, state: State, name: str, velocity: np.ndarray, dt: float) -> None:
    own = state.intruders[name]
    pose = own.path.pose
    near = model.masonry.bricks.within(bounds(state, own, velocity, dt), state.standing,
                                       state.parts.body)
    depth, normal, point = deepest(model.intruders[name], pose, near.pose, near.size)
    parts, wrenches = [np.zeros(0, np.intp)], [np.zeros((0, 6))]
    most = max(own.pressed * (_MORE if masonry.is_stable(state) else 1.0), _FIRST)
    own.pressed = 0.0
    for rows in _together(depth, normal):
        rows = rows[state.standing[near.part[rows]]]  # others may have released them
        if not len(rows):
            continue
        push = -normal[rows].mean(axis=0)
        push /= norm(push)
        arm = point[rows] - pose[:3]
        speed = np.maximum(product(velocity[:3] + np.cross(velocity[3:], arm), push), 0.0)
        plug, withstood = masonry.weakest_plug(state, near.part[rows], push, float(speed.mean()))
        force = withstood.force / len(rows) * np.minimum(depth[rows] / _YIELD, 1.0)
        waits = (float(speed.mean()) < _YIELD * masonry.WALL_RATE and depth[rows[0]] < _THROUGH
                 and force.sum() > most)
        if waits:
            force *= most / force.sum()
        own.pressed += float(force.sum())
        if depth[rows[0]] > _YIELD and not waits:
            force += _drive_out(model, state, plug, speed, push) / len(rows) / dt
        else:
            parts.append(near.part[rows])
            wrenches.append(masonry.about_centres(state, near.part[rows], point[rows],
                                                  force[:, None] * push))
        own.from_wall[:3] -= force.sum() * push
        own.from_wall[3:] -= np.cross(arm, force[:, None] * push).sum(axis=0)
    state.loads.set_layer(f'intruder {name}', np.concatenate(parts), np.concatenate(wrenches))


def _together(depth: np.ndarray, normal: np.ndarray) -> Iterator[np.ndarray]:
    """Group touched bricks by the direction of their push; those that come out now are first."""
    for rows in (np.flatnonzero(depth > _YIELD),
                 np.flatnonzero((depth > 0.0) & (depth <= _YIELD))):
        while len(rows):
            alike = product(normal[rows], normal[rows[0]]) > ALIKE
            yield rows[alike]
            rows = rows[~alike]


def _drive_out(model: Model, state: State, plug: np.ndarray, speed: np.ndarray,
               push: np.ndarray) -> float:
    """
    Release bricks and those pushed ahead; return the momentum of all of them [N·s].

    :param plug: the bricks, then those pushed ahead, (P,).
    :param speed: of each of the bricks [m/s], (K,).
    """
    pieces = breaking.pieces_of(state, plug[:len(speed)], plug)
    parts = np.concatenate(pieces)
    leaving = np.zeros((len(parts), 6))
    leaving[:, :3] = speed.mean() * push
    leaving[:len(speed), :3] = speed[:, None] * push
    breaking.release(model, state, pieces, leaving, Cause.IMPACT, 1.0)
    return float(product(state.parts.mass[parts], product(leaving[:, :3], push)))


def deepest(pieces: Pieces, pose: np.ndarray, poses: np.ndarray,
            sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the deepest penetration of an intruder into each box; see `touch`."""
    depth, normal, point = np.zeros(len(poses)), np.zeros((len(poses), 3)), np.zeros(
        (len(poses), 3))
    if not len(poses):
        return depth, normal, point
    for is_ball, local, size in _solids(pieces):
        place = rotation.compose(pose, local)
        found = (overlap_ball(place[:3], 0.5 * size[0], poses, sizes) if is_ball
                 else overlap_box(place, size, poses, sizes))
        deeper = found[0] > depth
        for best, other in zip((depth, normal, point), found):
            best[deeper] = other[deeper]
    return depth, normal, point


def _solids(pieces: Pieces) -> Iterator[tuple[bool, np.ndarray, np.ndarray]]:
    """Divide pieces into boxes and balls; a capsule becomes a close row of balls."""
    for shape, local, size in zip(pieces.shapes, pieces.local_poses, pieces.sizes):
        straight = size[2] - size[0]
        if shape == Shape.BOX or straight <= 0.0:
            yield shape != Shape.BOX, local, size
            continue
        count = int(np.ceil(straight / (_SPACING * size[0]))) + 1
        for along in np.linspace(-0.5 * straight, 0.5 * straight, count):
            middle = np.array([0.0, 0.0, along, *rotation.IDENTITY])
            yield True, rotation.compose(local, middle), np.full(3, size[0])
