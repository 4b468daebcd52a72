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

"""Mechanisms: joints between loose parts, their motors, and the wind on plates."""

from dataclasses import dataclass, fields, replace

import numpy as np

from procphys_ros.blueprint import Blueprint, FASTEST, GROUND, Joints, JointType
from procphys_ros.errors import CommandError, nearest_names, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, norm
from procphys_ros.physics.air import AIR_DENSITY, PLATE_DRAG
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry.components import groups, label
from procphys_ros.physics.world import BodyState, DEFAULT_ENGINE, JointOptions, World
from procphys_ros.scene import Settings
from procphys_ros.scene.joint_drive import DriveJoint
from procphys_ros.simulation import breaking, contact_exclusions, ties
from procphys_ros.simulation.composite_inertia import accelerations
from procphys_ros.simulation.fragments import NEGLIGIBLE
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import MechanismState, State, TIED

ENGINE = 'native'  # that has joints
_LAYER = 'hinges'
_ALONG = (JointType.HINGE, JointType.SLIDER, JointType.ROPE)  # kinds with one displacement
_DRIVEN = (JointType.HINGE, JointType.SLIDER)
# Middles of the 3 by 3 equal patches of a plate, over its extents.
_PATCHES = np.stack(np.meshgrid(*2 * (np.array([-1.0, 0.0, 1.0]) / 3.0,)), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class JointReadings:
    """
    Displacements of joints, and what moves them, a row per hinge, slider and rope.

    :ivar names: `<object>/<joint>`.
    :ivar position: displacement, of a rope its length [m], [rad], (K,).
    :ivar velocity: [m/s], [rad/s], (K,).
    :ivar effort: force along or moment about the axis in the last step, of motor, friction,
        spring and limits together [N], [N·m], (K,).
    """

    names: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


def settings_for(settings: Settings, blueprint: Blueprint) -> Settings:
    """
    Choose the engine with joints for a scene with mechanisms that leaves the choice.

    :raises SceneError: when it names an engine without joints.
    """
    if not len(blueprint.joints) or settings.engine == ENGINE:
        return settings
    if settings.engine != DEFAULT_ENGINE:
        raise SceneError(f'engine is "{settings.engine}", which has no joints, and the scene has '
                         f'mechanisms: take "{ENGINE}" or "{DEFAULT_ENGINE}"')
    return replace(settings, engine=ENGINE)


def check_engine(name: str, placed: Blueprint, world: World) -> None:
    """Raise SceneError for a mechanism that joins a world without joints."""
    if len(placed.joints) and not world.has_joints:
        raise SceneError(f'{name} has joints, and engine is "{world.engine}", which has none: '
                         f'take "{ENGINE}"')


def rigid_groups(model: Model, parts: np.ndarray) -> list[np.ndarray]:
    """
    Group loose parts into bodies: those with welds that never break between them are one.

    :param parts: ascending, (K,).
    """
    joints = model.blueprint.joints
    firm = joints.parts[_is_firm(joints) & (joints.parts != GROUND).all(axis=1)].T.copy()
    member = np.zeros(len(model.blueprint), bool)
    member[parts] = True
    labels = label(len(member), firm[0], firm[1], np.ones(firm.shape[1], bool))[0]
    return groups(labels, member)


def _is_firm(joints: Joints) -> np.ndarray:
    return (joints.kind == JointType.WELD) & np.isinf(joints.force) & np.isinf(joints.moment)


def connect(model: Model, state: State, first: int = 0) -> None:
    """
    Join the bodies of mechanisms that are at rest; writes joints, exclusions and the world.

    :param first: row of the first joint that is new.
    """
    joints = model.blueprint.joints
    own, rows = state.mechanisms, np.arange(first, len(joints))
    if not len(rows):
        return
    more = MechanismState.initial(joints.take(rows))
    for column in fields(MechanismState):
        known = getattr(own, column.name)[:first]
        setattr(own, column.name, np.concatenate([known, getattr(more, column.name)]))
    _exclude(model, state, first)
    ends, tied = _bodies(state, joints.parts[rows]), ties.of_trees(state, joints.parts[rows])
    own.joint[rows[tied]] = TIED
    rows = rows[~tied & (ends[:, 0] != ends[:, 1])]
    new = joints.take(rows)
    far = new.frame.copy()
    far[:, :3] += rotation.rotate(new.frame[:, 3:], new.anchor)
    speed, drive = _motors(new, new.speed, new.effort)
    own.joint[rows] = state.world.join(
        new.kind.astype(np.intp), state.parts.body[new.parts[:, 1]],
        _bodies(state, new.parts[:, 0]), new.frame,
        JointOptions(new.low, new.high, new.stiffness, new.damping, new.rest, speed, drive,
                     new.force, new.moment, new.collides), far)


def _exclude(model: Model, state: State, first: int) -> None:
    """
    Exclude the overlaps of jointed parts of one object from contact, and of what welds hold.

    Nothing that is welded to the ground can give way to what is welded there, too.

    :param first: row of the first joint that is new.
    """
    pairs = model.blueprint.joints.parts[first:]
    jointed = np.unique(pairs[pairs != GROUND])
    owners = np.array([thing.first for thing in model.objects])
    starts = np.searchsorted(owners, jointed, side='right')
    ends = np.flatnonzero(np.diff(starts)) + 1
    contact_exclusions.add_mechanisms(state, [*np.split(jointed, ends),
                                              _welded_to_ground(model, state, first)])
    contact_exclusions.update(model, state)


def _welded_to_ground(model: Model, state: State, first: int) -> np.ndarray:
    """List the loose parts that welds, old or new, hold on the ground, ascending, (K,)."""
    joints = model.blueprint.joints
    holds = joints.kind == JointType.WELD
    broken = torn(model, state)
    holds[broken[broken < first]] = False
    count = len(model.blueprint)
    ends = np.where(joints.parts == GROUND, count, joints.parts).T.copy()
    held = label(count, ends[0], ends[1], holds)[1]
    return np.flatnonzero(held & (state.parts.owner == Owner.BODY))


def _bodies(state: State, parts: np.ndarray) -> np.ndarray:
    """Return the bodies of parts, or that of the ground, of the same shape."""
    return np.where(parts == GROUND, World.ground, state.parts.body[parts])


def _motors(joints: Joints, speed: np.ndarray,
            effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and force of the engine's motors: those without power are brakes, friction."""
    runs = effort > 0.0
    return np.where(runs, speed, 0.0), np.where(runs, np.maximum(effort, joints.friction),
                                                joints.friction)


def drive_motors(model: Model, state: State, dt: float) -> None:
    """Set the motors of joints for a step, and apply constant efforts; writes bodies."""
    own, world = state.mechanisms, state.world
    alive = np.flatnonzero(own.joint >= 0)
    if not len(alive):
        return
    joints, ids = model.blueprint.joints.take(alive), own.joint[alive]
    speed, target, applied = own.speed[alive], own.target[alive], own.applied[alive]
    aimed, pushed, most = ~np.isnan(target), applied != 0.0, _top_speed(joints.kind)
    fastest = np.minimum(joints.fastest, most)[aimed]
    gap = target[aimed] - world.joints.way[ids[aimed]]
    mobility, falling = accelerations(world, ids[aimed])
    wanted = _approach(gap, own.effort[alive][aimed] * mobility - np.sign(gap) * falling, dt)
    speed[aimed] = np.clip(wanted, -fastest, fastest)
    # An effort is a motor of that force which never gets to its speed.
    speed = np.where(pushed, np.sign(applied) * most, np.clip(speed, -most, most))
    speed, drive = _motors(joints, speed, np.where(pushed, np.abs(applied), own.effort[alive]))
    world.set_motors(ids, speed, np.where(pushed, np.abs(applied), drive))


def _approach(gap: np.ndarray, braking: np.ndarray, dt: float) -> np.ndarray:
    """
    Return the highest speed from which a motor still stops at its target.

    Time-optimal in steps of dt (Han 2009, "From PID to active disturbance rejection control",
    eq. 13); within the last step, all of the gap.

    :param gap: way that is left [m], [rad], (K,).
    :param braking: greatest deceleration [m/s²], [rad/s²], (K,).
    """
    half = 0.5 * dt * np.maximum(braking, 0.0)  # half of the change of speed in a step
    at_once = np.abs(gap) / dt
    return np.sign(gap) * np.minimum(at_once, np.sqrt(half * (half + 4.0 * at_once)) - half)


def _top_speed(kind: np.ndarray) -> np.ndarray:
    """Return the highest speed of the motors of joints [m/s], [rad/s], (K,)."""
    return np.where(kind == JointType.HINGE, np.radians(FASTEST), FASTEST)


def _placed(world: World, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the present place of joints.

    :returns: frames on the second bodies, (K, 7), their axes, which of ropes lead from the second
        point to the first, (K, 3), and the points on the first bodies [m], (K, 3); world.
    """
    rows = world.joints.of(ids)
    point = rotation.compose(world.poses(rows.first), rows.frame)[:, :3]
    frame = rotation.compose(world.poses(rows.second), rows.other_frame)
    axis = rotation.rotate(frame[:, 3:], np.array([1.0, 0.0, 0.0]))
    rope = np.flatnonzero(rows.kind == JointType.ROPE)
    way = point[rope] - frame[rope, :3]
    axis[rope] = way / np.maximum(norm(way, axis=1), np.finfo(float).tiny)[:, None]
    return frame, axis, point


def press_plates(model: Model, state: State, dt: float) -> None:
    """
    Apply the force of the wind on flat parts, normal to them; writes their velocities.

    On each of nine patches it is ½ ρ Cd A |v·n| v·n, with the velocity v of the air relative to
    the patch. Resting plates wake in a wind that moves them.
    """
    plates = model.blueprint.plates
    loose = np.flatnonzero(state.parts.owner[plates.part] == Owner.BODY)
    bodies = state.world.bodies
    rests = bodies.state[state.parts.body[plates.part[loose]]] == BodyState.RESTING
    if state.wind.is_still(state.time) and not len(state.wind.jets):
        loose, rests = loose[~rests], rests[~rests]
    if not len(loose):
        return
    parts = plates.part[loose]
    place, force, moment, rate = _plate_forces(state, parts, plates.normal[loose],
                                               plates.area[loose])
    body, mass = state.parts.body[parts], state.parts.mass[parts]
    # Explicit, so no more than stops the plate in the air.
    share = (dt / np.maximum(1.0, rate * dt / mass))[:, None]
    felt = norm(force, axis=1) > NEGLIGIBLE * mass
    state.world.wake(body[felt & rests])
    used = np.flatnonzero(felt | ~rests)
    ids, owner = np.unique(body[used], return_inverse=True)
    wrench, stirs = np.zeros((len(ids), 6)), np.zeros(len(ids), bool)
    arm = place[used] - bodies.poses[body[used], :3]
    np.add.at(wrench, owner, share[used] * np.hstack([
        force[used], moment[used] + cross(arm, force[used])]))
    np.logical_or.at(stirs, owner, felt[used])
    turn = bodies.poses[ids, 3:]
    spin = rotation.rotate(rotation.conjugate(turn), wrench[:, 3:]) / bodies.inertia[ids]
    state.world.push(ids, np.hstack([wrench[:, :3] / bodies.mass[ids, None],
                                     rotation.rotate(turn, spin)]), stirs)


def _mean_velocities(state: State, bodies: np.ndarray) -> np.ndarray:
    """
    Return the mean velocities of bodies over the last step, (P, 6).

    Forces act as impulses between steps, so the velocity then is that of a half of their effect.
    """
    now, before = state.world.velocities(bodies), state.rubble.velocities
    known = np.flatnonzero(bodies < len(before))
    now[known] = 0.5 * (now[known] + before[bodies[known]])
    return now


def _plate_forces(state: State, parts: np.ndarray, normal: np.ndarray,
                  area: np.ndarray) -> tuple[np.ndarray, ...]:
    """
    Compute the force of the air on plates and its moment about their centres, world, (P, 3) each.

    :returns: these centres [m], force and moment [N], [N·m], and force over speed [N·s/m], (P,).
    """
    columns, world, rows = state.parts, state.world, np.arange(len(parts))
    pose = rotation.compose(world.poses(columns.body[parts]), columns.local[parts])
    velocity = _mean_velocities(state, columns.body[parts])
    velocity[:, :3] += cross(velocity[:, 3:],
                             pose[:, :3] - world.poses(columns.body[parts])[:, :3])
    local = np.zeros((len(parts), len(_PATCHES), 3))
    for k in (1, 2):
        axis = (normal + k) % 3
        local[rows, :, axis] = _PATCHES[None, :, k - 1] * columns.size[parts, axis][:, None]
    arm = rotation.rotate(pose[:, None, 3:], local)
    across = rotation.rotate(pose[:, 3:], np.eye(3)[normal])[:, None]
    points = pose[:, None, :3] + arm
    air = state.wind.velocity(points.reshape(-1, 3), state.time).reshape(points.shape)
    slip = air - velocity[:, None, :3] - cross(velocity[:, None, 3:], arm)
    speed = (slip * across).sum(axis=2)
    factor = 0.5 * AIR_DENSITY * PLATE_DRAG * area / len(_PATCHES)
    force = (factor[:, None] * np.abs(speed) * speed)[..., None] * across
    return (pose[:, :3], force.sum(axis=1), cross(arm, force).sum(axis=1),
            factor * np.abs(speed).sum(axis=1))


def break_overloaded(model: Model, state: State, dt: float) -> None:
    """Record the joints that the engine has broken, and forget those of parts that are gone."""
    own, rows = state.mechanisms, state.world.joints
    alive = np.flatnonzero(own.joint >= 0)
    if not len(alive):
        return
    joints, ids = model.blueprint.joints.take(alive), own.joint[alive]
    there = ((rows.kind[ids] == joints.kind)
             & (rows.first[ids] == state.parts.body[joints.parts[:, 1]])
             & (rows.second[ids] == _bodies(state, joints.parts[:, 0])))
    own.joint[alive[~there]] = -1
    broken = np.flatnonzero(there & rows.broken[ids])
    if not len(broken):
        return
    least = np.finfo(float).tiny  # a strength of 0 bears nothing
    share = np.column_stack([
        norm(rows.force[ids[broken]], axis=1) / np.maximum(joints.force[broken], least),
        norm(rows.moment[ids[broken]], axis=1) / np.maximum(joints.moment[broken], least)])
    causes = np.where(share[:, 1] > share[:, 0], Cause.TWIST, Cause.FORCE)
    breaking.break_joints(model, state, alive[broken], causes)
    contact_exclusions.update(model, state)


def press_hosts(model: Model, state: State, dt: float) -> None:
    """Load the standing parts that mechanisms hang on with the forces of the joints."""
    joints, own = model.blueprint.joints, state.mechanisms
    host = joints.parts[:, 0]
    rows = np.flatnonzero((host != GROUND) & (own.joint >= 0))
    rows = rows[state.parts.owner[host[rows]] == Owner.STANDING]
    if not len(rows) and _LAYER not in state.loads.sources:
        return
    host, hung, ids = host[rows], state.parts.body[joints.parts[rows, 1]], own.joint[rows]
    bodies, place = state.world.bodies, joints.frame[rows, :3]  # hosts stand where they were built
    force, moment = -state.world.joints.force[ids], -state.world.joints.moment[ids]
    rests = bodies.state[hung] == BodyState.RESTING  # its joints are not solved
    force[rests] = bodies.mass[hung[rests], None] * [0.0, 0.0, -model.gravity]
    moment[rests] = cross(bodies.poses[hung[rests], :3] - place[rests], force[rests])
    axis = rotation.rotate(joints.frame[rows, 3:], np.array([1.0, 0.0, 0.0]))
    turns = joints.kind[rows] == JointType.HINGE  # whose motors are latches: they hold elsewhere
    moment[turns] -= (moment[turns] * axis[turns]).sum(axis=1)[:, None] * axis[turns]
    moment += cross(place - state.parts.poses[host, :3], force)
    state.loads.follow(_LAYER, host, np.hstack([force, moment]))


def torn(model: Model, state: State) -> np.ndarray:
    """Return the joints that have broken, or whose parts are gone, (K,) rows."""
    ends = _bodies(state, model.blueprint.joints.parts)
    return np.flatnonzero((state.mechanisms.joint == -1) & (ends[:, 0] != ends[:, 1]))


def names(model: Model, state: State) -> list[str]:
    """Return the names of all joints, `<object>/<joint>`, by row."""
    source = model.blueprint
    owners = np.array([thing.first for thing in state.objects])
    place = np.searchsorted(owners, source.joints.parts[:, 1], side='right') - 1
    return [f'{state.objects[i].name}/{source.joint_names[k]}'
            for i, k in zip(place.tolist(), source.joints.name.tolist())]


def read_joints(model: Model, state: State) -> JointReadings:
    """Return the displacements of all joints with an axis that hold."""
    own, joints = state.mechanisms, model.blueprint.joints
    there = state.parts.owner[joints.parts[:, 1]] == Owner.BODY  # not removed since the last step
    rows = np.flatnonzero((own.joint >= 0) & there & np.isin(joints.kind, _ALONG))
    ids, world = own.joint[rows], state.world
    known = names(model, state)
    engine = world.joints.of(ids)
    frame, axis, point = _placed(world, ids)
    one, other = world.velocities(engine.first), world.velocities(engine.second)
    turns = engine.kind == JointType.HINGE
    at = frame[:, :3]
    slip = (one[:, :3] + cross(one[:, 3:], point - world.poses(engine.first)[:, :3])
            - other[:, :3] - cross(other[:, 3:], point - world.poses(engine.second)[:, :3]))
    slip[turns] = one[turns, 3:] - other[turns, 3:]
    position = engine.way + joints.zero[rows]
    rope = engine.kind == JointType.ROPE
    position[rope] = norm(point[rope] - at[rope], axis=1)
    effort = np.where(turns[:, None], engine.moment, engine.force)
    return JointReadings(tuple(known[row] for row in rows.tolist()), position,
                         (slip * axis).sum(axis=1), (effort * axis).sum(axis=1))


def find(model: Model, state: State, wish: DriveJoint) -> int:
    """
    Return the row of a joint that can be driven.

    :raises CommandError: if there is no such joint, it has broken, or has no motor.
    """
    known, own, joints = names(model, state), state.mechanisms, model.blueprint.joints
    if wish.target not in known:
        listed = ', '.join(known[:10]) or 'none'
        raise CommandError(f'there is no joint "{wish.target}"'
                           f'{nearest_names(wish.target, known)} (joints: {listed})')
    row = known.index(wish.target)
    if own.joint[row] == -1 or state.parts.owner[joints.parts[row, 1]] != Owner.BODY:
        raise CommandError(f'{wish.target} has broken, or is gone')
    if joints.kind[row] not in _DRIVEN or joints.effort[row] == 0.0:
        raise CommandError(f'{wish.target} has no motor; a hinge or a slider with "motor:" has')
    most = float(_top_speed(joints.kind[row]))
    if wish.mode == 'velocity' and abs(wish.value) > most:
        raise CommandError(f'the velocity of {wish.target} is {wish.value:g}, it must be from '
                           f'{-most:g} to {most:g}')
    return row


def command(model: Model, state: State, wish: DriveJoint) -> None:
    """
    Drive a joint from now on; writes `state.mechanisms`, and wakes its bodies.

    :raises CommandError: see `find`.
    """
    row, own = find(model, state, wish), state.mechanisms
    joints = model.blueprint.joints
    most = joints.effort[row]
    own.speed[row] = own.applied[row] = 0.0
    own.target[row], own.effort[row] = np.nan, most
    if wish.mode == 'position':
        own.target[row] = wish.value - joints.zero[row]
    elif wish.mode == 'velocity':
        own.speed[row] = wish.value
    else:
        own.applied[row] = np.clip(wish.value, -most, most)
        own.effort[row] = 0.0
    ends = state.world.joints.of(own.joint[[row]])
    state.world.wake(np.concatenate([ends.first, ends.second]))
