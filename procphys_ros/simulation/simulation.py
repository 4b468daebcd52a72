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

"""Simulation: a scene in time, one step as a list of named stages."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter

import numpy as np

from procphys_ros.blueprint import Blueprint, chain
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.masonry import FreeBodies
from procphys_ros.physics.wind import Gust, Wind
from procphys_ros.physics.world import World
from procphys_ros.scene import Scene, SceneObject
from procphys_ros.scene.strikes import Demolition, Explosion, Projectile
from procphys_ros.simulation.bounds import checked_vector
from procphys_ros.simulation.contact.contact import Contact
from procphys_ros.simulation.contact.intruder import Intruder
from procphys_ros.simulation.contact.leaning import Leaning
from procphys_ros.simulation.cues import Cues
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import EventLog
from procphys_ros.simulation.naming import PartNames
from procphys_ros.simulation.observer import Observer
from procphys_ros.simulation.particles.dust import Dust
from procphys_ros.simulation.particles.foliage import Foliage
from procphys_ros.simulation.rubble.bearing import Bearing
from procphys_ros.simulation.rubble.impacts import Impacts
from procphys_ros.simulation.standing.buildings import Buildings, Collapse
from procphys_ros.simulation.standing.collapse import Release
from procphys_ros.simulation.strikes.arsenal import Arsenal
from procphys_ros.simulation.strikes.striking import Impact
from procphys_ros.simulation.trees.boughs import Boughs
from procphys_ros.simulation.trees.watched_grove import make_grove
from procphys_ros.simulation.wrenches import Wrenches


class Simulation:
    """
    Trees and buildings of a scene, from their rest state on.

    Same scene, seed and commands give identical poses.

    :ivar scene: what is simulated.
    :ivar blueprint: all its parts and bonds, in the order of every array here; what is launched
        or breaks into new parts is appended.
    :ivar objects: owners of the parts, in part order.
    :ivar poses: centres of mass and attitudes, world, (N, 7); row = part. Not finite = the part
        exists no more (pulverised, or broken into new parts).
    :ivar velocities: linear and angular, world, (N, 6).
    :ivar wind: the air.
    :ivar log: break events not taken yet.
    :ivar intruder: body moved from outside, with the wrench on it.
    :ivar timings: wall time of each stage of the last call of `step` [s].
    """

    def __init__(self, scene: Scene, time_step: float | None = None, seed: int | None = None):
        """
        Set a scene up at rest.

        :param scene: what to simulate.
        :param time_step: [s]; None = the scene's own, 1/60 unless its file says otherwise.
        :param seed: of the wind and all else that is random; None = the scene's own.
        """
        self.scene, settings = scene, scene.settings
        self.blueprint = scene.blueprint
        self.time_step = settings.time_step if time_step is None else float(time_step)
        self.log = EventLog()
        self.timings: dict[str, float] = {}
        seed = settings.seed if seed is None else seed
        self.wind = Wind(settings.wind, seed)
        self._cues = Cues(settings.cues)
        self._grove = make_grove(self.blueprint, settings.gravity, settings.culling)
        self._buildings = Buildings(self.blueprint, settings.gravity)
        self._foliage = Foliage(self.blueprint, self._grove, settings.leaves, settings.gravity,
                                self._buildings, seed)
        self._dust = (Dust(self.blueprint, settings.dust.capacity, settings.gravity,
                           self._buildings, seed) if settings.dust.enabled else None)
        self._arsenal = Arsenal(self.blueprint, self._grove, self._buildings, self.log, seed,
                                self._join, self._vanish)
        self.intruder = Intruder(settings.intruder, self._arsenal.blows, self._arsenal.loads)
        self._free = FreeBodies(self.blueprint)
        self._contact = Contact(self.blueprint, self._grove, self._buildings)
        self._boughs = Boughs(self.blueprint, self._grove, self._free, self.log)
        self._release = Release(self._buildings, self._free)
        self._bearing = Bearing(self.blueprint, self._arsenal.blows, self._arsenal.loads,
                                settings.gravity)
        self._impacts = Impacts(self.blueprint, self._free, settings, self._arsenal.panes)
        self._world = World()
        self.reset()

    @property
    def time(self) -> float:
        """Give the simulated time [s]."""
        return self._steps * self.time_step

    @property
    def events(self) -> np.ndarray:
        """Bonds that broke and were not taken from `log` yet, of dtype `EVENT`."""
        return self.log.rows

    @property
    def bonds_broken(self) -> int:
        """Count the bonds broken since the start or the last reset."""
        return self.log.total

    @property
    def awake_bodies(self) -> int:
        """Count the loose bodies that move at present."""
        return len(self._world.awake)

    @property
    def impacts(self) -> list[Impact]:
        """List the blows of projectiles on what stood, with the momentum that each passed on."""
        return self._arsenal.striking.impacts

    def leaf_poses(self) -> np.ndarray:
        """Work out the petioles of all leaves, fluttering, flying or fallen, world, (L, 7)."""
        return self._foliage.poses(self.wind, self.poses, self.velocities, self.time)

    @property
    def dust(self) -> Puffs:
        """Give the dust in the air and on the ground."""
        return Puffs.none() if self._dust is None else self._dust.cloud.puffs

    def reset(self) -> None:
        """Put everything back to rest and whole, the time to zero and the wind to its settings."""
        self.close()
        self._steps, self._wrenches = 0, Wrenches()
        self._cues.reset()
        self.blueprint = self.scene.blueprint
        self.objects = list(self.scene.objects)
        self.names = PartNames(self.objects, self.blueprint)
        self.poses = self.blueprint.poses.copy()
        self.velocities = np.zeros((len(self.blueprint), 6))
        self.log.clear()
        self.wind.reset()
        self._grove.reset()
        self._foliage.reset()
        self._world = World((0.0, 0.0, -self.scene.settings.gravity))
        self._debris = Debris(self.blueprint, self._world)
        self._free.reset()
        self._buildings.reset()
        self._buildings.build(self._world)
        self._arsenal.begin(self._world, self._debris, self.scene.settings.gravity)
        self._bearing.begin(self._world, self._debris)
        self._impacts.begin(self._world, self._debris, self._bearing)
        self._boughs.begin()
        leaning = Leaning(self._arsenal.blows, self._arsenal.loads, self._grove.forest)
        self._contact.begin(self._world, leaning, self.scene.settings.gravity)
        self.intruder.begin(self._world, self._contact)
        self._crumble(self._buildings.settle())
        if self._dust is not None:
            self._dust.reset(self.log)

    def close(self) -> None:
        """Free what lives outside Python; `reset` would make it anew."""
        self._world.close()

    def step(self, n: int = 1) -> None:
        """
        Let time pass.

        :param n: number of time steps.
        """
        self.timings = {}
        for _ in range(n):
            with self._stage('strikes'):
                self._cues.play(self)
                self._push()
                self.intruder.advance(self.time, self.time_step)
                self._arsenal.advance(self.wind, self.poses, self.time, self.time_step)
            with self._stage('trees'):
                self._grove.feel(self.wind, self.time)
            with self._stage('contact'):
                self._contact.act(self.time, self.time_step)
                self._grove.heed(self._contact.touches, self._world)
            with self._stage('trees'):
                self._grove.sway(self.time_step)
            with self._stage('fracture'):
                self._boughs.shed(self._debris, self.time, self.time_step)
            with self._stage('stress'):
                collapse = self._buildings.stand(self.time_step)
                self._arsenal.kick(collapse.pieces, self.velocities)
                self._crumble(collapse)
                self._arsenal.blows.judged(collapse)
            with self._stage('debris'):
                self._tumble()
                self.intruder.feel(self.time_step)
            with self._stage('poses'):
                self._grove.carry(self.poses, self.velocities)
                self._debris.carry(self.poses, self.velocities)
            with self._stage('leaves'):
                self._foliage.blow(self.wind, self.poses, self.velocities, self.time,
                                   self.time_step)
            with self._stage('impacts'):
                self._shatter()
            with self._stage('dust'):
                self._smoke()
            self._steps += 1

    def set_wind(self, velocity: Sequence[float]) -> None:
        """
        Change the mean wind from now on.

        :param velocity: of the air at the reference height, the way it blows to [m/s], (3,).
        :raises CommandError: when it is not finite or out of range.
        """
        try:
            self.wind.set_velocity(velocity, self.time)
        except SceneError as error:
            raise CommandError(str(error)) from error

    def set_wind_enabled(self, enabled: bool) -> None:
        """Let the wind blow, or still the air."""
        self.wind.enabled = bool(enabled)

    def gust(self, gust: Gust | None = None) -> None:
        """
        Send one gust through the scene.

        :param gust: its shape; None = the scene's own.
        :raises CommandError: when it has no direction.
        """
        self.wind.start_gust(gust or self.scene.settings.gust, self.time)

    def set_observer(self, position: Sequence[float],
                     orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> None:
        """
        Say from where the scene is looked at, for the schemes of `Settings.culling`.

        :param position: of the camera [m], (3,), world.
        :param orientation: quaternion xyzw; the camera looks along x, z is up.
        :raises CommandError: when a value is not finite, or the quaternion has no length.
        """
        observer = Observer(self.scene.settings.culling, position, orientation)
        self._grove.observe(observer)
        self._impacts.observe(observer)

    def apply_impulse(self, part: int | str, linear: Sequence[float] = (0.0, 0.0, 0.0),
                      angular: Sequence[float] = (0.0, 0.0, 0.0),
                      point: Sequence[float] | None = None) -> bool:
        """
        Strike a part once.

        :param part: its name or index.
        :param linear: impulse [N·s], (3,), world axes.
        :param angular: angular impulse [N·m·s], (3,), world axes.
        :param point: where the linear impulse acts [m], (3,), world; None = centre of mass.
        :returns: whether the part moves; one that stands in a wall may hold.
        :raises CommandError: when the part is unknown, gone, or a value not finite or too large.
        """
        index = self.names.index(part)
        impulse = checked_vector('linear impulse', linear)
        twist = checked_vector('angular impulse', angular)
        place = self.poses[index, :3] if point is None else checked_vector('point', point)
        if not np.isfinite(self.poses[index, 0]):
            raise CommandError(f'{self.names.name(index)} exists no more')
        if self._buildings.holds(index):
            return self._arsenal.blows.strike(index, impulse, twist, self.time)
        self._strike(index, impulse, twist, place)
        return True

    def apply_wrench(self, part: int | str, force: Sequence[float],
                     torque: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """
        Push a part until `clear_wrenches`; a later call for the same part replaces this one.

        :param part: its name or index.
        :param force: at its centre of mass [N], (3,), world axes.
        :param torque: [N·m], (3,), world axes.
        :raises CommandError: when the part is unknown or a value not finite or too large.
        """
        self._wrenches.put(self.names.index(part), force, torque)

    def launch(self, projectile: Projectile) -> int:
        """
        Let a ball or a block fly.

        :param projectile: its shape, size, mass, position and velocity.
        :returns: index of the part that it becomes, behind all others.
        :raises CommandError: when there are too many, or it would start inside of something.
        """
        return self._arsenal.launch(projectile)

    def explode(self, point: Sequence[float], charge: float) -> None:
        """
        Set off a charge in the open; its wave arrives in the next steps.

        :param point: where [m], (3,), world.
        :param charge: mass of TNT of the same effect [kg], at most 10,000.
        :raises CommandError: when a value is out of its range.
        """
        self._arsenal.explode(Explosion(point, charge), self.blueprint, self.poses, self.time)

    def demolish(self, plan: Demolition | None = None) -> int:
        """
        Start the clocks of timed charges.

        :param plan: where and when; None = along the ground-floor walls, from the middle out.
        :returns: number of charges.
        :raises CommandError: when no building stands.
        """
        return self._arsenal.demolish(plan or Demolition(), self.time)

    def place_intruder(self, pose: Sequence[float], time: float | None = None) -> None:
        """
        Put the body of `Settings.intruder` into the scene, or move it on; see `Course`.

        :param pose: x y z qx qy qz qw [m], (7,), world.
        :param time: when it is there [s]; None = now.
        :raises CommandError: when the pose is none.
        """
        self.intruder.place(pose, self.time if time is None else time)

    def clear_wrenches(self) -> int:
        """End all lasting forces, and say how many there were."""
        return self._wrenches.clear()

    def _strike(self, index: int, linear: np.ndarray, angular: np.ndarray,
                point: np.ndarray) -> None:
        if self._grove.holds(index):
            row = int(self._grove.row_of_part[index])
            self._grove.forest.apply_impulse(row, point, linear, angular)
        elif self._debris.carrier[index] >= 0:
            body = int(self._debris.carrier[index])
            self._world.apply_impulse(body, linear, point, angular)

    def _push(self) -> None:
        self._arsenal.loads.put('wrenches', *self._wrenches.on(self._buildings.holds))
        for index, impulse in self._wrenches.impulses(self.time_step):
            self._strike(index, impulse[:3], impulse[3:], self.poses[index, :3])

    def _crumble(self, collapse: Collapse) -> None:
        if len(collapse.bond):
            self.log.record(self.time, self.blueprint.bond_frame[collapse.bond, :3],
                            collapse.bond, self.blueprint.bonds[collapse.bond], collapse.cause,
                            collapse.load)
        self._release.let_go(collapse, self._world, self._debris, self.poses, self.velocities)

    def _tumble(self) -> None:
        awake = self._world.awake
        if len(awake):
            points = self._world.poses(awake)[:, :3]
            self._debris.drag(self.wind.velocity(points, self.time), self.time_step)
        self._impacts.watch()
        if self._dust is not None:
            self._dust.batter(self._world, self._debris.carrier, self.impacts)
            self._dust.watch(self._world, self._debris.carrier, self.time_step)
        self._world.step(self.time_step)

    def _shatter(self) -> None:
        self._bearing.press(self.time_step)
        if self._impacts.judge(self.time, self.time_step):
            self._debris.carry(self.poses, self.velocities)

    def _smoke(self) -> None:
        if self._dust is not None:
            self._dust.rise(self._world, self.log, self.time_step)
            self._dust.drift(self.wind, self.time, self.time_step)

    def _join(self, parts: Blueprint, name: str) -> int:
        """Append parts that come into being now as an object, and give the index of the first."""
        taken = {known.name for known in self.objects}
        number = self.scene.shard.own(name)
        while number in taken:
            number += '_'
        first = len(self.blueprint)
        self.blueprint = chain([self.blueprint, parts])
        self.objects.append(SceneObject(number, first, len(parts)))
        self.names = PartNames(self.objects, self.blueprint)
        self.poses = np.concatenate([self.poses, parts.poses])
        self.velocities = np.concatenate([self.velocities, np.zeros((len(parts), 6))])
        self._debris.grow(self.blueprint)
        self._grove.grow(len(self.blueprint))
        return first

    def _vanish(self, parts: np.ndarray) -> None:
        self.poses[parts], self.velocities[parts] = np.nan, 0.0

    @contextmanager
    def _stage(self, name: str) -> Iterator[None]:
        start = perf_counter()
        yield
        self.timings[name] = self.timings.get(name, 0.0) + perf_counter() - start
