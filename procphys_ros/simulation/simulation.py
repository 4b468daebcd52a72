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


"""Simulation: a scene in time."""

from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any, Self

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import SceneError
from procphys_ros.physics.wind import Gust
from procphys_ros.scene import Scene, SceneObject
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.intruder import Downwash
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.scene.joint_drive import DriveJoint
from procphys_ros.scene.plants import Grow
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.schema import short
from procphys_ros.simulation import (
    additions,
    commands,
    growth,
    load_checks,
    mechanisms,
    readings,
    snapshot,
)
from procphys_ros.simulation.at_rest import at_rest
from procphys_ros.simulation.commands import checked_count
from procphys_ros.simulation.model import compile_model, Model
from procphys_ros.simulation.readings import Readings, Series
from procphys_ros.simulation.stages import STAGES


class Simulation(Readings):
    """
    Trees and buildings of a scene in time, starting at rest.

    The same scene, seed and commands give identical poses.

    :ivar scene: the simulated scene.
    :ivar model: the compiled scene; constant.
    :ivar state: everything that changes.
    :ivar stages: of each step, in order; see `Stage` to add one.
    :ivar warnings: about objects that crack under their weight, overlap, or are below the ground,
        a line each, also of those that joined later; they are logged, too.
    :ivar timings: wall time of each stage of the last call of `step` [s].
    """

    def __init__(self, scene: Scene, time_step: float | None = None, seed: int | None = None,
                 engine: str | None = None):
        """
        Set up a scene at rest.

        :param scene: to be simulated.
        :param time_step: [s]; None = that of the scene, 1/60 by default.
        :param seed: of the wind and all other random numbers; None = the scene's own.
        :param engine: of rigid bodies, 'auto', 'bullet' or 'native'; None = the scene's own.
        :raises SceneError: if it is not a scene, or one of these values is invalid in scene files.
        """
        if not isinstance(scene, Scene):
            raise SceneError(f'{short(scene)} is no scene; Scene.from_yaml reads one, '
                             'and Scene.add places what a grammar builds')
        given: dict[str, Any] = {'time_step': time_step, 'seed': seed, 'engine': engine}
        settings = mechanisms.settings_for(replace(scene.settings, **{
            k: v for k, v in given.items() if v is not None}), scene.blueprint)
        self.scene, self._load = scene, settings.load
        self.timings: dict[str, float] = {}
        self.stages = STAGES
        self.model = compile_model(
            settings, scene.shard, scene.blueprint, scene.objects, settings.time_step,
            settings.seed, plants=scene.plants)
        self._scene_model = self.model  # without objects added while it runs
        self.state, cracked = at_rest(self.model)
        self.warnings = load_checks.log([*load_checks.check_places(
            scene.blueprint, scene.objects, scene.settings.terrain), *load_checks.check_trees(
                self.state, scene.objects, self.model.trees.climbers.anchors),
            *load_checks.check_cues(self.state, settings.cues), *cracked])

    def reset(self) -> None:
        """
        Reset all objects to rest and undamaged, and the time to zero.

        Added objects stay where they were placed; removed ones stay removed; `revert` undoes
        both. The wind returns to its last settings, snow and ice to what was last asked for, cues
        apart; the observer stays.
        """
        wind, observer = self.state.wind, self.state.observer
        added, removed = self.state.added, self.state.removed
        self.close()
        self.model, self._flutter = additions.with_added(self._scene_model, added), None
        self.state, _ = at_rest(self.model, wind.settings, self._load)
        self.state.added = added
        known = {placed.name for placed in self.state.objects}
        for name in removed:
            if name in known:
                additions.remove(self.model, self.state, name)
        self.state.observer = observer

    def revert(self) -> None:
        """Reset to the scene as loaded: without added objects, with the removed ones."""
        self.state.added, self.state.removed = {}, []
        self.reset()

    def close(self) -> None:
        """Free the resources outside Python; `reset` would recreate them."""
        self.state.world.close()

    def save(self) -> bytes:
        """
        Serialise the whole state.

        A run continued from here and one from the snapshot are identical to the bit. With
        `native` so is a run without a save; `bullet`, whose caches cannot be saved, is rebuilt.
        """
        data = snapshot.dump(self._scene_model, self.model, self.state)
        self.state.world.rebuild()
        return data

    def restore(self, data: bytes) -> None:
        """
        Restore a saved state of the same scene.

        :param data: from `save`, of this or another simulation of the scene, in any process.
        :raises SnapshotError: if it is not a snapshot, damaged, or of another scene or version;
            the present state is kept.
        """
        model, state = snapshot.load(self._scene_model, data)
        self.close()
        self.model, self.state, self._flutter = model, state, None

    def fork(self) -> Self:
        """Return a second simulation in the same state; equal commands give equal results."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, timings={},
                              state=snapshot.clone(self.model, self.state))
        self.state.world.rebuild()
        return other

    def __copy__(self) -> Self:
        return self.fork()

    def __deepcopy__(self, memo: dict) -> Self:
        return self.fork()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, 'model': None, 'state': self.save(), '_flutter': None}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__dict__.update(saved)
        self.model, self.state = snapshot.load(self._scene_model, saved['state'])

    def add(self, blueprint: Blueprint, position: Sequence[float] = (0.0, 0.0, 0.0),
            yaw: float = 0.0, name: str = '') -> SceneObject:
        """
        Place an object into the running scene; it stays until `remove` or `revert`.

        It is at rest, trees bent by the present mean wind.

        :param blueprint: of the object; it is not changed.
        :param position: of its origin [m], (3,), world; z counts from the ground.
        :param yaw: turn about the vertical [rad].
        :param name: must be new, among the objects there are and were; default `object_<n>`.
        :returns: its name and parts, which follow all others.
        :raises CommandError: if the name is or was taken, the position is not finite, or free
            memory cannot hold the object.
        """
        name = name or self.free_name('object')
        self.model, lines = additions.add(self.model, self.state, blueprint, position, yaw, name)
        self._flutter = None
        self.warnings += load_checks.log(
            [*load_checks.check_added(self.state, self.model.terrain), *lines,
             *load_checks.check_trees(self.state, self.objects[-1:],
                                      self.model.trees.climbers.anchors)])
        return self.state.objects[-1]

    def remove(self, name: str) -> None:
        """
        Remove an object from the running scene, wherever its parts are by now.

        Its parts keep their numbers, and its name is not available before `reset`.

        :raises CommandError: if there is no such object.
        """
        additions.remove(self.model, self.state, name)

    def free_name(self, stem: str) -> str:
        """Return the first unused object name among `<stem>_0`, `<stem>_1`, …."""
        return additions.free_name(self.state, stem)

    def step(self, n: int = 1) -> None:
        """
        Advance time.

        :param n: number of time steps.
        :raises CommandError: if it is negative, or not an integer.
        """
        n = checked_count('the number of steps', n)
        state, dt = self.state, self.model.time_step
        self.timings = {stage.name: 0.0 for stage in self.stages}
        for _ in range(n):
            model = self._begin_years()
            for stage in self.stages:
                start = perf_counter()
                stage.step(model, state, dt)
                self.timings[stage.name] += perf_counter() - start
            state.steps += 1
            state.time = state.steps * dt

    def _begin_years(self) -> Model:
        """Extend the model by what plants grow in the years that begin now, and return it."""
        start, model = perf_counter(), growth.enlarge(self.model, self.state)
        if model is not self.model:
            self.model, self._flutter = model, None
            self.timings[growth.STAGE] += perf_counter() - start
        return model

    def series(self, steps: int, parts: Sequence[int | str] | None = None,
               every: int = 1) -> Series:
        """
        Advance time, and record the poses, velocities and loads of parts.

        :param steps: number of time steps.
        :param parts: names or indices, (K,), the name of an object for all of its parts; None =
            all present parts.
        :param every: time steps per row.
        :returns: a row after each `every` steps.
        :raises CommandError: if a part is unknown, a number is invalid, or memory is too small.
        """
        return readings.record_series(self, self.step, steps, parts, every)

    def apply(self, command: Any) -> Any:
        """
        Execute a command now, before the next step.

        :param command: one of `simulation.commands`, or a `Gust`, `Projectile`, `Explosion`,
            `Demolition`, `Earthquake`, `Grow` or `SnowLoad`.
        :returns: see `commands.apply`.
        :raises CommandError: if it cannot be carried out; nothing is changed then.
        """
        answer = commands.apply(self.model, self.state, command)
        if isinstance(command, SnowLoad):
            self._load = command
        return answer

    def set_wind(self, velocity: Sequence[float], ramp: float = 0.0) -> None:
        """
        Change the mean wind from now on.

        :param velocity: of the air, downwind, at the reference height [m/s], (3,).
        :param ramp: duration of the change [s]; 0 = at once.
        :raises CommandError: if it is not finite or out of range.
        """
        self.apply(commands.SetWind(velocity, ramp))

    def set_wind_enabled(self, enabled: bool) -> None:
        """Enable or disable the wind."""
        self.apply(commands.EnableWind(enabled))

    def gust(self, gust: Gust | None = None) -> None:
        """
        Send one gust through the scene.

        :param gust: its shape; None = the scene's own.
        :raises CommandError: if it has no direction.
        """
        self.apply(gust or self.model.settings.gust)

    def set_snow(self, load: float, ice: float = 0.0, ramp: float = 0.0) -> None:
        """
        Change the snow and ice that lie on trees and buildings.

        :param load: snow on open ground [kg/m²].
        :param ice: thickness of the coat around twigs [m].
        :param ramp: duration of the change [s]; 0 = at once.
        :raises CommandError: if a value is out of its range.
        """
        self.apply(SnowLoad(load, ice, ramp))

    def set_observer(self, position: Sequence[float],
                     orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> None:
        """
        Set the point of view for the schemes of `Settings.culling`.

        :param position: of the camera [m], (3,), world.
        :param orientation: quaternion xyzw; the camera looks along x, z is up.
        :raises CommandError: if a value is not finite, or the quaternion has no length.
        """
        self.apply(commands.Observe(position, orientation))

    def apply_impulse(self, part: int | str, linear: Sequence[float] = (0.0, 0.0, 0.0),
                      angular: Sequence[float] = (0.0, 0.0, 0.0),
                      point: Sequence[float] | None = None) -> bool:
        """
        Apply an impulse to a part once.

        :param part: its name or index.
        :param linear: impulse [N·s], (3,), world axes.
        :param angular: angular impulse [N·m·s], (3,), world axes.
        :param point: of application of the linear impulse [m], (3,), world; None = centre of mass.
        :returns: whether the part moves; one that stands in a wall may hold.
        :raises CommandError: if the part is unknown or gone, or a value is not finite or too
            large.
        """
        return self.apply(commands.Impulse(part, linear, angular, point))

    def apply_wrench(self, part: int | str, force: Sequence[float],
                     torque: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """
        Apply a force to a part until `clear_wrenches`; a later call for the part replaces it.

        :param part: its name or index.
        :param force: at its centre of mass [N], (3,), world axes.
        :param torque: [N·m], (3,), world axes.
        :raises CommandError: if the part is unknown or gone, or a value is not finite or too
            large.
        """
        self.apply(commands.Wrench(part, force, torque))

    def clear_wrenches(self) -> int:
        """End all lasting forces, and return their number."""
        return self.apply(commands.ClearWrenches())

    def launch(self, projectile: Projectile) -> int:
        """
        Launch a ball or a block.

        :param projectile: its shape, size, mass, position and velocity.
        :returns: index of its part, after all others.
        :raises CommandError: if there are too many, or it would start inside an obstacle.
        """
        return self.apply(projectile)

    def explode(self, point: Sequence[float], charge: float) -> None:
        """
        Detonate a charge in the open; its wave arrives in the next steps.

        :param point: of the charge [m], (3,), world.
        :param charge: equivalent mass of TNT [kg], at most 10,000.
        :raises CommandError: if a value is out of its range.
        """
        self.apply(Explosion(point, charge))

    def demolish(self, plan: Demolition | None = None) -> int:
        """
        Schedule charges in walls, from now on.

        :param plan: positions and delays; None = along the ground-floor walls, from the middle
            out.
        :returns: number of charges.
        :raises CommandError: if no building stands.
        """
        return self.apply(plan or Demolition())

    def cut(self, part: int | str, point: Sequence[float] = Cut.point,
            normal: Sequence[float] = Cut.normal, reach: float = Cut.reach,
            hinge: float = Cut.hinge, towards: Sequence[float] = Cut.towards) -> int:
        """
        Saw through what holds a part, or along a plane through a part or an object.

        :param part: name or index of a part, or name of an object, which takes a plane.
        :param point, normal: of the plane [m], world, (3,); a normal of zeros = no plane: a
            segment of a tree is cut off at its foot, any other part out of what it is bonded to.
        :param reach: of the blade from the point [m].
        :param hinge: width of the strip of wood that is left to a tree [m]; 0 = none.
        :param towards: where it falls over it, (3,), world; level.
        :returns: number of joints cut.
        :raises CommandError: if the part is unknown or gone, or there is no joint to cut.
        """
        return self.apply(Cut(str(part), point, normal, reach, hinge, towards))

    def shake(self, earthquake: Earthquake | None = None) -> None:
        """
        Begin an earthquake, in the place of one that is under way.

        Positions and velocities are relative to the ground.

        :param earthquake: None = the scene's own.
        :raises CommandError: if it begins behind the end of its record.
        """
        self.apply(earthquake or self.model.settings.earthquake)

    def grow(self, target: str = '', rate: float = Grow.rate, years: int = Grow.years) -> int:
        """
        Let plants grow on, a derivation step of their grammars per year.

        What the next year brings is derived when it begins, with the random numbers and in the
        habitat that a scene with as many steps would have; so that it also ends in the same plant.

        :param target: object, or those called <target>_0, <target>_1, …; '' = all plants.
        :param rate: [years/s]; 0 = they stop as they are.
        :param years: after which they stop, whole ones from the end of the present one on.
        :returns: number of the plants.
        :raises CommandError: if a value is out of range, or there is no such plant that can grow:
            one of an L-system of the scene, that neither climbs nor is climbed on.
        """
        return self.apply(Grow(target, rate, years))

    def set_body_state(self, part: int | str, pose: Sequence[float] | None = None,
                       twist: Sequence[float] | None = None) -> None:
        """
        Move a loose part, and the piece that it belongs to, instantly.

        :param part: its name or index.
        :param pose: of the part [m], (7,), world; None = unchanged.
        :param twist: velocity of its centre and spin [m/s], [rad/s], world axes, (6,); None =
            unchanged.
        :raises CommandError: if the part is unknown, gone, or not loose, or a value is not finite.
        """
        self.apply(commands.SetBodyState(part, pose, twist))

    def place_intruder(self, pose: Sequence[float], time: float | None = None,
                       name: str = INTRUDER) -> None:
        """
        Place a body of `Settings.intruder` or `Settings.intruders`, or set its next pose.

        :param pose: x y z qx qy qz qw [m], (7,), world.
        :param time: of the pose [s]; None = now.
        :param name: of the intruder.
        :raises CommandError: if the pose is invalid, or there is no such intruder.
        """
        self.apply(commands.PlaceIntruder(pose, time, name))

    def set_thrust(self, thrust: Sequence[float], name: str = INTRUDER,
                   radius: float = Downwash.radius) -> None:
        """
        Let the rotors of an intruder drive a jet of air, until this is called again.

        :param thrust: on the intruder [N], (3,), in its own frame; 0 = no jet.
        :param name: of the intruder.
        :param radius: of one disk as large as all its rotors [m].
        :raises CommandError: if a value is out of range, or there is no such intruder.
        """
        self.apply(commands.SetThrust(thrust, name, radius))

    def drive_joint(self, joint: str, mode: str, value: float) -> None:
        """
        Drive a joint of a mechanism from now on, by its motor.

        :param joint: its name, `<object>/<joint>`.
        :param mode: 'position', 'velocity' or 'effort'.
        :param value: [m] or [rad], [m/s] or [rad/s], [N] or [N·m]; an effort of 0 = motor off.
        :raises CommandError: if there is no such joint, it has broken or has no motor, or a value
            is out of range.
        """
        self.apply(DriveJoint(joint, mode, value))

    def check_joint(self, wish: DriveJoint) -> None:
        """Raise CommandError if a joint cannot be driven."""
        mechanisms.find(self.model, self.state, wish)
