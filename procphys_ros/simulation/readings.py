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


"""Readings: what can be read of a simulation at a moment, and over a stretch of steps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Blueprint, Law
from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.foliage import Flutter
from procphys_ros.physics.ground_motion import GroundMotion
from procphys_ros.physics.lidar import cast, NOTHING, Pattern, pinhole, spherical
from procphys_ros.physics.masonry import strength
from procphys_ros.physics.wind import Wind
from procphys_ros.scene import SceneObject
from procphys_ros.scene.capacity import available_memory
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.schema import short
from procphys_ros.simulation import intruder, mechanisms, particles, snow
from procphys_ros.simulation.commands import checked_count
from procphys_ros.simulation.events import EventLog
from procphys_ros.simulation.ledger import Impact, MomentumLedger
from procphys_ros.simulation.mechanisms import JointReadings
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner, PartNames
from procphys_ros.simulation.state import State

FIRST_INTRUDER = -3  # in place of a part; named ones are -4, -5, … in their order
_WIDTH = 8 * (7 + 6 + 3)  # [bytes] per part and row


@dataclass(frozen=True)
class PartLoad:
    """
    The load of the joints of a part.

    :ivar force: largest of its bonds [N]; for a branch, at its base.
    :ivar moment: largest of its bonds [N·m].
    :ivar share: of their strength, 1 = about to break.
    """

    force: float = 0.0
    moment: float = 0.0
    share: float = 0.0


def load_of(state: State, part: int) -> PartLoad:
    """
    Return the load of a part, as `loads_of`.

    :param part: its index.
    """
    return PartLoad(*loads_of(state, np.array([part]))[0].tolist())


def loads_of(state: State, parts: np.ndarray) -> np.ndarray:
    """
    Compute the loads of parts.

    :param state: between two steps.
    :param parts: indices, (K,).
    :returns: columns as in `PartLoad`, (K, 3); 0 for loose or gone parts, NaN for trees before
        their first step, which computes their joint loads.
    """
    out = np.zeros((len(parts), 3))
    owner = state.parts.owner[parts]
    for kind, compute in ((Owner.TREE, _branches), (Owner.STANDING, _bricks)):
        own = np.flatnonzero(owner == kind)
        if len(own):
            out[own] = compute(state, parts[own])
    return out


def describe_load(state: State, part: int) -> str:
    """Describe the state of a part in one line."""
    owner, name = state.parts.owner[part], state.names.name(part)
    if owner == Owner.GONE:
        return f'{name} exists no more'
    if owner == Owner.BODY:
        return f'{name} is loose, {norm(state.parts.velocities[part, :3]):.2g} m/s'
    load = load_of(state, part)
    if np.isnan(load.force):
        return f'{name} has a load from the first step on'
    return (f'{name} carries {load.force:.3g} N and {load.moment:.3g} N·m, '
            f'{100.0 * load.share:.2g} % of its strength')


def _branches(state: State, parts: np.ndarray) -> np.ndarray:
    rows, source = state.parts.row[parts], state.blueprint
    wrench, bonds = state.forest.joint_wrenches[rows], state.forest.bonds[rows]
    hinges = source.hinges.take((np.cumsum(source.bond_law == Law.HINGE) - 1)[bonds])
    force, moment = norm(wrench[:, :3], axis=1), norm(wrench[:, 3:], axis=1)
    axis = rotation.rotate(state.forest.poses[rows, 3:], np.array([0.0, 0.0, 1.0]))
    twist = np.abs((wrench[:, 3:] * axis).sum(axis=1))
    bending = np.sqrt(np.maximum(moment * moment - twist * twist, 0.0))
    stress = bending / state.forest.section[rows]
    share = np.max([force / hinges.break_force, twist / hinges.break_torque,
                    stress / hinges.strength, bending / hinges.root_moment], axis=0)
    return np.column_stack([force, moment, share])


def _bricks(state: State, parts: np.ndarray) -> np.ndarray:
    graph, out = state.solver.graph, np.zeros((len(parts), 3))
    first, count = graph.start[parts], graph.start[parts + 1] - graph.start[parts]
    owner = np.repeat(np.arange(len(parts)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    bond = graph.incident[first[owner] + within]
    owner, bond = owner[graph.alive[bond]], bond[graph.alive[bond]]
    wrench = state.solver.wrenches()
    share, _ = strength.utilisation(graph, wrench)
    np.maximum.at(out, owner, np.column_stack([
        norm(wrench[bond, :3], axis=1), norm(wrench[bond, 3:], axis=1), share[bond]]))
    return out


@dataclass(frozen=True)
class Scan:
    """
    Ranges measured at one instant.

    :ivar pose: of the sensor, world, (7,).
    :ivar ranges: [m], inf = nothing, (V, H).
    :ivar parts: hit parts, (V, H); `lidar.GROUND`, `lidar.NOTHING`, or `FIRST_INTRUDER` and less.
    :ivar directions: of the rays in the frame of the sensor, (V, H, 3).
    """

    pose: np.ndarray
    ranges: np.ndarray
    parts: np.ndarray
    directions: np.ndarray

    def points(self, in_world: bool) -> np.ndarray:
        """Return the hit points [m], (V, H, 3), in the world or the sensor's frame; NaN = none."""
        ranges = np.where(np.isfinite(self.ranges), self.ranges, np.nan)
        points = self.directions * ranges[..., None]
        if not in_world:
            return points
        return product(points, rotation.to_matrix(self.pose[3:]).T) + self.pose[:3]


def scan(model: Model, state: State, settings: LidarSettings) -> Scan | None:
    """
    Take one scan of the scene at the present instant.

    Parts are seen as they collide: as boxes, capsules and hexahedra, those in walls with the
    mortar around them, so that no ray slips through a joint; leaves and dust are not seen.

    :returns: None if the sensor is attached to an intruder that has not been placed.
    :raises CommandError: if these are not settings of a lidar, or there is no such intruder.
    """
    if not isinstance(settings, LidarSettings):
        raise CommandError(f'{short(settings)} is no LidarSettings')
    pose, carrier = _pose(state, settings)
    if pose is None:
        return None
    parts = state.parts
    seen = np.flatnonzero(parts.owner != Owner.GONE)
    shapes, poses, sizes = parts.shape[seen], parts.poses[seen], parts.solid_size[seen]
    stands = parts.owner[seen] == Owner.STANDING
    sizes[stands] = model.masonry.closed_sizes[seen[stands]]
    numbers = {name: FIRST_INTRUDER - i for i, name in enumerate(state.intruders)}
    bodies = {numbers[name]: body for name, body in intruder.bodies(state).items()
              if body != carrier}
    others = [(state.world.pieces(body), state.world.bodies.poses[body])
              for body in bodies.values()]
    shapes = np.concatenate([shapes, *(pieces.shapes for pieces, _ in others)])
    poses = np.concatenate([poses, *(rotation.compose(place, pieces.local_poses)
                                     for pieces, place in others)])
    sizes = np.concatenate([sizes, *(pieces.sizes for pieces, _ in others)])
    pattern = _pattern(settings.pattern, settings.rows, settings.columns, settings.vertical_field,
                       settings.horizontal_field)
    ranges, row = cast(pattern, pose, settings.range, shapes, poses, sizes,
                       model.terrain, state.blueprint.hexahedra.among(seen))
    met = np.concatenate([seen, *(np.full(len(pieces.shapes), number)
                                  for number, (pieces, _) in zip(bodies, others)), [NOTHING]])
    return Scan(pose, ranges, np.where(row < 0, row, met[row]), pattern.directions)


def _pose(state: State, settings: LidarSettings) -> tuple[np.ndarray | None, int]:
    """Return the pose of the sensor, (7,), and the body that carries it, -1 for none."""
    own = np.concatenate([settings.position, _attitude(settings.rotation)])
    if not settings.attached_to:
        return own, -1
    intruder.named(state, settings.attached_to)
    carrier = intruder.bodies(state).get(settings.attached_to)
    if carrier is None:
        return None, -1
    return rotation.compose(state.world.bodies.poses[carrier], own), carrier


def _attitude(angles: tuple[float, ...]) -> np.ndarray:
    """Convert roll, pitch and yaw about the fixed axes x, y, z to a quaternion (4,)."""
    roll, pitch, yaw = (rotation.from_axis_angle(axis, np.asarray(angle))
                        for axis, angle in zip(np.eye(3), angles))
    return rotation.multiply(yaw, rotation.multiply(pitch, roll))


@lru_cache(maxsize=4)
def _pattern(kind: str, rows: int, columns: int, height: float, width: float) -> Pattern:
    return (spherical if kind == 'spherical' else pinhole)(rows, columns, height, width)


class Readings:
    """
    Read access to a simulation at its present time; reading changes nothing.

    Arrays are copies: later steps do not change them, and they are read-only.

    :ivar model: the compiled scene; constant.
    :ivar state: everything that changes.
    """

    model: Model
    state: State
    _flutter: Flutter | None = None

    @property
    def time_step(self) -> float:
        """Length of a step [s]."""
        return self.model.time_step

    @property
    def time(self) -> float:
        """Return the simulated time [s]."""
        return self.state.time

    @property
    def blueprint(self) -> Blueprint:
        """
        All parts and bonds, in the order of every array; parts that join are appended.

        Plants that grow are as they are now; the strengths of bonds are those of the year's end.
        """
        return self.state.shown_blueprint()

    @property
    def layouts(self) -> int:
        """Return how often plants that grow have got new parts; sizes change in between, too."""
        return self.state.growing.layouts

    @property
    def objects(self) -> list[SceneObject]:
        """Owners of the parts, in part order."""
        return list(self.state.objects)

    @property
    def names(self) -> PartNames:
        """Names of the parts."""
        return self.state.names

    @property
    def poses(self) -> np.ndarray:
        """
        Centres of mass and attitudes, world, (N, 7); NaN = the part is gone.

        They are the present ones, and read-only: `set_body_state` moves loose parts. Stages use
        `state.parts.poses`, which the next step overwrites.
        """
        return _value(self.state.shown_poses())

    @property
    def velocities(self) -> np.ndarray:
        """Linear and angular velocities [m/s], [rad/s], world, (N, 6), as `poses`."""
        return _value(self.state.parts.velocities)

    @property
    def exists(self) -> np.ndarray:
        """Parts that were neither pulverised nor broken into new ones, (N,) bool."""
        return self.state.parts.owner != Owner.GONE

    @property
    def added(self) -> tuple[str, ...]:
        """Names of the objects that were added and not removed."""
        return tuple(self.state.added)

    @property
    def removed(self) -> tuple[str, ...]:
        """Names of the objects that were removed; their parts no longer exist."""
        return tuple(self.state.removed)

    @property
    def wind(self) -> Wind:
        """Return the wind."""
        return self.state.wind

    @property
    def snow_load(self) -> SnowLoad:
        """Snow and ice on the scene, as they will be after the present change."""
        own = self.state.snow
        return SnowLoad(own.snow, own.ice, own.ramp)

    @property
    def snow_on_ground(self) -> float:
        """Snow that lies on open ground now [kg/m²]."""
        return snow.on_ground(self.state)

    @property
    def snow(self) -> np.ndarray:
        """Mass of snow and ice that each part carries now [kg], (N,)."""
        return snow.masses(self.model, self.state)

    @property
    def ground_motion(self) -> GroundMotion:
        """Motion of the ground from the beginning of its present earthquake on."""
        return self.state.shaking.motion

    @property
    def ground_acceleration(self) -> np.ndarray:
        """Present acceleration of the ground [m/s²], (3,), world."""
        own = self.state.shaking
        return own.motion.at(self.state.time - own.began)[0]

    @property
    def log(self) -> EventLog:
        """Break events not taken yet."""
        return self.state.log

    @property
    def events(self) -> np.ndarray:
        """Broken bonds not taken from `log` yet, of dtype `EVENT`, (K,)."""
        return _value(self.state.log.rows)

    @property
    def bonds_broken(self) -> int:
        """Return the number of bonds broken since the start or the last reset."""
        return self.state.log.total

    @property
    def awake_bodies(self) -> int:
        """Return the number of loose bodies that are moving."""
        return len(self.state.world.awake)

    @property
    def impacts(self) -> list[Impact]:
        """List the last blows of projectiles to standing parts, oldest first."""
        return list(self.state.ledger.recent)

    @property
    def ledger(self) -> MomentumLedger:
        """Return the momentum balance of all blows since the start or the last reset."""
        return self.state.ledger

    @property
    def dust(self) -> Puffs:
        """Return the dust in the air and on the ground."""
        cloud = self.state.dust.cloud
        return Puffs.none() if cloud is None else cloud.puffs

    @property
    def intruder_pose(self) -> np.ndarray | None:
        """Pose of the intruder, (7,), world; None before it is placed."""
        return self.pose_of_intruder(INTRUDER)

    @property
    def intruder_wrench(self) -> np.ndarray:
        """Force and moment on the intruder in the last step [N], [N·m], world, (6,)."""
        return _value(self.state.intruders[INTRUDER].wrench)

    @property
    def intruders(self) -> tuple[str, ...]:
        """Names of all externally moved bodies."""
        return tuple(self.state.intruders)

    def pose_of_intruder(self, name: str) -> np.ndarray | None:
        """Return the pose of an intruder, (7,), world; None before it is placed."""
        path = intruder.named(self.state, name).path
        return _value(path.pose) if path.placed else None

    def wrench_on_intruder(self, name: str) -> np.ndarray:
        """Return force and moment on an intruder [N], [N·m], world, smoothed, (6,)."""
        return _value(intruder.named(self.state, name).smooth_wrench)

    @property
    def joints(self) -> JointReadings:
        """Positions, velocities and efforts of the hinges, sliders and ropes of mechanisms."""
        found = mechanisms.read_joints(self.model, self.state)
        return JointReadings(found.names, *(_value(column) for column in (
            found.position, found.velocity, found.effort)))

    def load(self, part: int | str) -> PartLoad:
        """
        Return the joint load of a part, and its share of the strength.

        :param part: its name or index.
        :returns: zeros for loose or gone parts; NaN for trees before their first step.
        :raises CommandError: if there is no such part.
        """
        return load_of(self.state, self.names.index(part))

    def loads(self, parts: Sequence[int | str] | None = None) -> np.ndarray:
        """
        Return the loads of many parts, as `load` for one.

        :param parts: names or indices, (K,); None = all.
        :returns: force [N], moment [N·m] and share of the strength, (K, 3).
        :raises CommandError: if there is no such part.
        """
        return loads_of(self.state, self.names.indices(parts))

    def scan(self, lidar: LidarSettings) -> Scan | None:
        """
        Measure ranges like a lidar or a depth camera.

        :param lidar: its rays and pose.
        :returns: None if it is attached to an intruder that is not placed yet.
        """
        return scan(self.model, self.state, lidar)

    def leaf_poses(self) -> np.ndarray:
        """Compute the poses of all petioles, fluttering, flying or fallen, world, (L, 7)."""
        if self._flutter is None and self.model.settings.leaves.flutter:
            self._flutter = particles.make_flutter(self.model)
        return particles.leaf_poses(self.model, self.state, self._flutter)


def _value(array: np.ndarray) -> np.ndarray:
    """Return a read-only copy of an array that a later step may overwrite."""
    copied = array.copy()
    copied.flags.writeable = False
    return copied


@dataclass(frozen=True)
class Series:
    """
    The motion and loads of some parts over a number of steps, a row per recorded step.

    :ivar parts: indices, (K,).
    :ivar names: of these parts.
    :ivar times: simulated time [s], (T,).
    :ivar poses: of centres of mass, world, (T, K, 7); NaN = the part is gone.
    :ivar velocities: linear and angular [m/s], [rad/s], world, (T, K, 6).
    :ivar loads: force [N], moment [N·m] and share of the strength, (T, K, 3), see `PartLoad`.
    """

    parts: np.ndarray
    names: tuple[str, ...]
    times: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    loads: np.ndarray

    def save(self, path: Path) -> None:
        """
        Write all arrays, by their names, into a file for `numpy.load`.

        :param path: ends in .npz.
        :raises OSError: if it cannot be written.
        """
        np.savez(path, **vars(self))


def record_series(readings: Readings, step: Callable[[int], None], steps: int,
                  parts: Sequence[int | str] | None = None, every: int = 1) -> Series:
    """
    Advance time, and record parts.

    :param readings: of the simulation.
    :param step: advances it by a number of time steps.
    :param steps: number of time steps in all.
    :param parts: as in `PartNames.indices`.
    :param every: time steps per row.
    :returns: a row after each `every` steps.
    :raises CommandError: if a part is unknown, a number is invalid, or memory is too small.
    """
    steps, every = checked_count('the number of steps', steps), checked_count('every', every)
    if not every:
        raise CommandError('every is 0, it must be a whole number, 1 or more')
    chosen = readings.names.indices(parts)
    rows, rest = divmod(steps, every)
    _check_room(rows * len(chosen) * _WIDTH)
    made = Series(chosen, tuple(readings.names.name(part) for part in chosen.tolist()),
                  np.empty(rows), *(np.empty((rows, len(chosen), width)) for width in (7, 6, 3)))
    for row in range(rows):
        step(every)
        made.times[row] = readings.time
        made.poses[row] = readings.poses[chosen]
        made.velocities[row] = readings.velocities[chosen]
        made.loads[row] = loads_of(readings.state, chosen)
    step(rest)
    return made


def _check_room(size: int) -> None:
    """Raise CommandError for a series that exceeds free memory; [bytes]."""
    free = available_memory()
    if free is not None and size > free:
        raise CommandError(f'the series takes {size / 2 ** 30:.1f} GiB of memory, '
                           f'{free / 2 ** 30:.1f} are free; record fewer parts or steps')
