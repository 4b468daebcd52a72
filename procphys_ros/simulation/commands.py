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

"""Commands: a dataclass each, for users, cues and nodes; how they are checked and executed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import logging
import math
import numbers
from typing import Any

import numpy as np

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.wind import Gust, MeanWind
from procphys_ros.physics.world import BodyState
from procphys_ros.scene.cues import Blow
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.intruder import Downwash
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.scene.joint_drive import DriveJoint
from procphys_ros.scene.plants import Grow
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.schema import short
from procphys_ros.simulation import (
    blasts,
    charges,
    cutting,
    earthquake,
    fragments,
    growth,
    intruder,
    masonry,
    mechanisms,
    projectiles,
    snow,
)
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State
from procphys_ros.simulation.tree_lod import Observer

_LARGEST = 1e7  # [N·s], [N] and [m]; a loaded lorry at 900 km/h, beyond it numbers diverge
_ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
_LOG = logging.getLogger(__name__)
_EARLY = 1e-9  # [s] rounding of times that are sums of steps


def checked_vector(what: str, value: Sequence[float] | np.ndarray) -> np.ndarray:
    """
    Convert a command's numbers to a vector (3,).

    :param what: their name, for the message.
    :param value: as in the command.
    :raises CommandError: if there are not three, or one is not finite or too large.
    """
    vector = _row(value)
    if vector.shape != (3,):
        raise CommandError(f'{what}: {value!r} is not three numbers [x, y, z]')
    if not np.isfinite(vector).all():
        raise CommandError(f'{what}: {vector.tolist()} is not finite')
    if np.abs(vector).max() > _LARGEST:
        raise CommandError(f'{what}: {vector.tolist()} is larger than {_LARGEST:g}')
    return vector


def checked_rotation(what: str, value: Sequence[float] | np.ndarray) -> np.ndarray:
    """
    Convert a command's numbers to a unit quaternion xyzw, (4,).

    :param what: their name, for the message.
    :param value: as in the command.
    :raises CommandError: if there are not four, one is not finite, or all are zero.
    """
    turn = _row(value)
    if turn.shape != (4,) or not np.isfinite(turn).all():
        raise CommandError(f'{what} is {value!r}, it must be a quaternion [x, y, z, w]')
    with np.errstate(over='ignore'):
        length = float(norm(turn))
    if not 1e-6 <= length < np.inf:
        raise CommandError(f'{what}: {turn.tolist()} is no rotation')
    return turn / length


def checked_pose(what: str, value: Sequence[float]) -> np.ndarray:
    """Convert a command's numbers to a pose (7,); raises as `checked_rotation`."""
    pose = _row(value)
    if pose.shape != (7,):
        raise CommandError(f'{what}: {short(value)} is not a pose of seven numbers')
    return np.concatenate([checked_vector(f'{what} position', pose[:3]),
                           checked_rotation(f'{what} orientation', pose[3:])])


def checked_twist(value: Sequence[float]) -> np.ndarray:
    """Convert a command's numbers to velocity and spin (6,); raises as `checked_vector`."""
    twist = _row(value)
    if twist.shape != (6,):
        raise CommandError(f'twist: {short(value)} is not six numbers')
    return np.concatenate([checked_vector('velocity', twist[:3]),
                           checked_vector('spin', twist[3:])])


def checked_number(what: str, value: Any) -> float:
    """Return a finite number, or raise `CommandError`."""
    if not isinstance(value, numbers.Real) or not math.isfinite(value):
        raise CommandError(f'{what} is {short(value)}, it must be a finite number')
    return float(value)


def checked_count(what: str, value: Any) -> int:
    """Return an integer of 0 or more, or raise `CommandError`."""
    if not isinstance(value, numbers.Integral) or value < 0:
        raise CommandError(f'{what} is {short(value)}, it must be a whole number, 0 or more')
    return int(value)


def checked_switch(what: str, value: Any) -> bool:
    """Return True or False, or raise `CommandError`: the text 'off' would count as true."""
    if not isinstance(value, (bool, np.bool_)):
        raise CommandError(f'{what} is {short(value)}, it must be True or False')
    return bool(value)


def _row(value: Sequence[float] | np.ndarray) -> np.ndarray:
    """Convert numbers to an array; empty if they are invalid."""
    try:
        return np.array(value, float)
    except (TypeError, ValueError):
        return np.empty(0)


@dataclass(frozen=True)
class SetWind:
    """
    Change the mean wind.

    :ivar velocity: downwind, at the reference height [m/s], (3,).
    :ivar ramp: duration of the change [s]; 0 = at once.
    """

    velocity: Sequence[float]
    ramp: float = 0.0


@dataclass(frozen=True)
class EnableWind:
    """Enable or disable the wind."""

    enabled: bool


@dataclass(frozen=True)
class Impulse:
    """
    Apply an impulse to a part once.

    :ivar part: its name or index.
    :ivar linear: impulse [N·s], (3,), world axes.
    :ivar angular: angular impulse [N·m·s], (3,), world axes.
    :ivar point: of application of the linear impulse [m], (3,), world; None = centre of mass.
    """

    part: int | str
    linear: Sequence[float] = (0.0, 0.0, 0.0)
    angular: Sequence[float] = (0.0, 0.0, 0.0)
    point: Sequence[float] | None = None


@dataclass(frozen=True)
class Wrench:
    """
    Apply a force to a part until `ClearWrenches`; a later wrench on the same part replaces it.

    :ivar part: its name or index.
    :ivar force: at its centre of mass [N], (3,), world axes.
    :ivar torque: [N·m], (3,), world axes.
    """

    part: int | str
    force: Sequence[float]
    torque: Sequence[float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ClearWrenches:
    """End all lasting forces."""


@dataclass(frozen=True)
class SetBodyState:
    """
    Move a loose part, and the piece that it belongs to, instantly.

    :ivar part: its name or index.
    :ivar pose: x y z qx qy qz qw of the part [m], (7,), world; None = unchanged.
    :ivar twist: velocity of the part's centre and spin [m/s], [rad/s], world axes, (6,); None =
        unchanged.
    """

    part: int | str
    pose: Sequence[float] | None = None
    twist: Sequence[float] | None = None


@dataclass(frozen=True)
class PlaceIntruder:
    """
    Put an intruder into the scene, or set its next pose.

    :ivar pose: x y z qx qy qz qw [m], (7,), world.
    :ivar time: of the pose [s]; None = now.
    :ivar name: of the intruder.
    """

    pose: Sequence[float]
    time: float | None = None
    name: str = INTRUDER


@dataclass(frozen=True)
class SetThrust:
    """
    Let the rotors of an intruder drive a jet of air, until the next such command.

    :ivar thrust: on the intruder [N], (3,), in its own frame; 0 = no jet.
    :ivar name: of the intruder.
    :ivar radius: of one disk as large as all its rotors [m].
    """

    thrust: Sequence[float]
    name: str = INTRUDER
    radius: float = Downwash.radius


@dataclass(frozen=True)
class Observe:
    """
    Set the point of view for the schemes of `Settings.culling`.

    :ivar position: of the camera [m], (3,), world.
    :ivar orientation: quaternion xyzw; the camera looks along x, z is up.
    """

    position: Sequence[float]
    orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)


def apply(model: Model, state: State, command: Any) -> Any:
    """
    Execute a command; writes the state that it concerns.

    :param command: one of this module, or a `MeanWind`, `Gust`, `Blow`, `Projectile`, `Explosion`,
        `Demolition`, `Cut`, `Earthquake`, `Grow`, `DriveJoint` or `SnowLoad`.
    :returns: an `Impulse`: whether the part moves (one that stands in a wall may hold); a
        `Projectile`: its part; a `Demolition`: the number of charges; a `Cut`: the number of
        joints; `ClearWrenches`: the number of wrenches; `Grow`: the number of plants; all
        others: None.
    :raises CommandError: if it cannot be carried out; the state is unchanged then.
    """
    if type(command) not in _ACTIONS:
        raise CommandError(f'{command!r} is no command')
    try:
        return _ACTIONS[type(command)](model, state, command)
    except SceneError as error:
        raise CommandError(str(error)) from error


def apply_wrenches(model: Model, state: State, dt: float) -> None:
    """Apply lasting forces over a step; writes loads, momentum of trees and bodies."""
    if not state.wrenches and 'wrenches' not in state.loads.sources:
        return
    parts = np.fromiter(state.wrenches, np.intp, len(state.wrenches))
    wrenches = np.array([*state.wrenches.values()]).reshape(-1, 6)
    stands = state.parts.owner[parts] == Owner.STANDING
    state.loads.set_layer('wrenches', parts[stands], wrenches[stands])
    for part, wrench in zip(parts[~stands].tolist(), wrenches[~stands]):
        _push(state, part, wrench[:3] * dt, wrench[3:] * dt, state.parts.poses[part, :3])


def _push(state: State, part: int, linear: np.ndarray, angular: np.ndarray,
          point: np.ndarray) -> None:
    """Add momentum to a segment of a tree, or to the body that a part belongs to."""
    if state.parts.owner[part] == Owner.TREE:  # a far tree is ahead of its shown pose
        arm = point - state.parts.poses[part, :3]
        state.forest.apply_impulse(int(state.parts.row[part]), None, linear,
                                   angular + np.cross(arm, linear))
    elif state.parts.owner[part] == Owner.BODY:
        state.world.apply_impulse(int(state.parts.body[part]), linear, point, angular)


def _impulse(model: Model, state: State, command: Impulse) -> bool:
    part = state.names.index(command.part)
    linear = checked_vector('linear impulse', command.linear)
    angular = checked_vector('angular impulse', command.angular)
    point = (state.parts.poses[part, :3] if command.point is None
             else checked_vector('point', command.point))
    _check_exists(state, part)
    if state.parts.owner[part] == Owner.STANDING:
        return masonry.strike(model, state, part, linear, angular, point)
    _push(state, part, linear, angular, point)
    return True


def _blow(model: Model, state: State, command: Blow) -> bool:
    return _impulse(model, state, Impulse(command.target, command.linear, command.angular))


def _wrench(model: Model, state: State, command: Wrench) -> None:
    part = state.names.index(command.part)
    wrench = np.concatenate([checked_vector('force', command.force),
                             checked_vector('torque', command.torque)])
    _check_exists(state, part)
    state.wrenches.pop(part, None)
    if wrench.any():
        state.wrenches[part] = wrench


def _set_body_state(model: Model, state: State, command: SetBodyState) -> None:
    part = state.names.index(command.part)
    _check_exists(state, part)
    if state.parts.owner[part] != Owner.BODY:
        raise CommandError(f'{state.names.name(part)} stands where it was built or grows there; '
                           'only what is loose can be put elsewhere')
    poses, twists = fragments.part_states(state, np.array([part]))  # with impulses since the step
    pose = poses[0] if command.pose is None else checked_pose('part', command.pose)
    twist = twists[0] if command.twist is None else checked_twist(command.twist)
    body = np.array([state.parts.body[part]])
    centre = rotation.compose(pose, rotation.relative(state.parts.local[part], _ORIGIN))
    twist = np.concatenate([twist[:3] + np.cross(twist[3:], centre[:3] - pose[:3]), twist[3:]])
    if state.world.bodies.state[body[0]] != BodyState.AWAKE:
        state.world.thaw(body)
    state.world.set_poses(body, centre[None])
    state.world.set_velocities(body, twist[None])
    parts = state.bodies.members[int(body[0])]
    state.parts.poses[parts], state.parts.velocities[parts] = fragments.part_states(state, parts)
    state.parts.moved[parts] = True


def _clear_wrenches(model: Model, state: State, command: ClearWrenches) -> int:
    count = len(state.wrenches)
    state.wrenches.clear()
    return count


def _place_intruder(model: Model, state: State, command: PlaceIntruder) -> None:
    pose = checked_pose(command.name, command.pose)
    time = state.time if command.time is None else checked_number('time', command.time)
    intruder.place(model, state, command.name, pose, time)


def _set_thrust(model: Model, state: State, command: SetThrust) -> None:
    thrust, disk = checked_vector('thrust', command.thrust), Downwash(command.radius).radius
    own = intruder.named(state, command.name)
    own.thrust, own.disk = thrust, disk


def _observe(model: Model, state: State, command: Observe) -> None:
    place = checked_vector('position of the observer', command.position)
    turn = checked_rotation('orientation of the observer', command.orientation)
    state.observer = Observer(model.settings.culling, place, turn)


def _enable_wind(model: Model, state: State, command: EnableWind) -> None:
    state.wind.enabled = checked_switch('wind', command.enabled)


def _check_exists(state: State, part: int) -> None:
    if state.parts.owner[part] == Owner.GONE:
        raise CommandError(f'{state.names.name(part)} exists no more')


_ACTIONS: dict[type, Callable[[Model, State, Any], Any]] = {
    SetWind: lambda model, state, c: state.wind.set_velocity(c.velocity, state.time, c.ramp),
    MeanWind: lambda model, state, c: state.wind.set_velocity(c.velocity, state.time, c.ramp),
    EnableWind: _enable_wind,
    Gust: lambda model, state, c: state.wind.start_gust(c, state.time),
    Impulse: _impulse, Blow: _blow, Wrench: _wrench, ClearWrenches: _clear_wrenches,
    Projectile: projectiles.launch, Explosion: blasts.explode, Demolition: charges.arm,
    Cut: cutting.cut, SetBodyState: _set_body_state, PlaceIntruder: _place_intruder,
    SetThrust: _set_thrust, Observe: _observe, Grow: growth.command, Earthquake: earthquake.begin,
    DriveJoint: mechanisms.command, SnowLoad: snow.begin,
}


def run_cues(model: Model, state: State, dt: float) -> None:
    """
    Execute the cues that are due; writes what their commands write.

    A refused cue is reported in the log, and the scene goes on.
    """
    cues = model.settings.cues
    while state.cue < len(cues) and cues[state.cue].time <= state.time + _EARLY:
        cue = cues[state.cue]
        state.cue += 1
        try:
            apply(model, state, cue.what)
        except CommandError as error:
            _LOG.warning('scene.cues: "%s" was refused: %s', cue.text, error)
