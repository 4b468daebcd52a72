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


"""Session: the running simulation, and the operations on it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError, SnapshotError
from procphys_ros.physics.wind import Gust
from procphys_ros.ros.entities import Entities
from procphys_ros.ros.pacing import Pacer
from procphys_ros.ros.state_file import read_state, write_state
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.intruder import Downwash
from procphys_ros.scene.joint_drive import DriveJoint
from procphys_ros.scene.plants import Grow
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.scene.spawn import Spawn
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.simulation import readings, Simulation

REMEDY = 'time stands still until ~/reset_simulation or ~/reload_scene'


class Session:
    """
    Own the simulation and execute the commands on it; in the simulation thread.

    :param pacer: restarted after jumps of time.
    :ivar paused: whether the simulation is paused.
    :ivar failure: error that stopped the simulation, '' = none; cleared by a reset or reload.
    :ivar on_scene: called after another scene was loaded.
    :ivar on_reset: called after time has jumped back.
    :ivar on_steps: called after steps on demand, or after objects were added, moved or removed.
    :ivar mean_wind: at the reference height [m/s], (3,).
    :ivar snow: snow and ice on the scene.
    :ivar on_weather: called after a change of one of these.
    :ivar without_scene: reason for refusals while there is no scene.
    """

    def __init__(self, pacer: Pacer):
        self._pacer = pacer
        self.paused = False
        self.failure = ''
        self.on_scene: Callable[[], None] = lambda: None
        self.on_reset: Callable[[], None] = lambda: None
        self.on_steps: Callable[[], None] = lambda: None
        self.on_weather: Callable[[], None] = lambda: None
        self.mean_wind: tuple[float, ...] = (0.0, 0.0, 0.0)
        self.snow = SnowLoad()
        self.without_scene = 'the first scene is still being built'
        self._simulation: Simulation | None = None

    @property
    def has_scene(self) -> bool:
        """Return whether there is a simulation."""
        return self._simulation is not None

    @property
    def simulation(self) -> Simulation:
        """
        Return the present simulation; `adopt` replaces it.

        :raises CommandError: if there is none yet.
        """
        if self._simulation is None:
            raise CommandError(self.without_scene)
        return self._simulation

    def adopt(self, simulation: Simulation) -> str:
        """Replace the simulation, and describe its content."""
        self.close()
        self._simulation = simulation
        self._pacer.time_step = simulation.time_step
        self._blow(simulation.wind.settings.velocity)
        self._recover()
        self.on_scene()
        return self.summary()

    def close(self) -> None:
        """Free the resources of the simulation."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def set_wind(self, velocity: Sequence[float]) -> str:
        """Change the mean wind [m/s], (3,)."""
        self.simulation.set_wind(velocity)
        self._blow(velocity)
        return f'mean wind {list(velocity)} m/s'

    def change_weather(self, settings: Settings, names: set[str]) -> None:
        """Change to other settings of wind and snow; `names` are the changed parameters."""
        velocity = settings.wind.velocity if 'wind.velocity' in names else self.mean_wind
        if any(name.startswith('wind.') for name in names):
            self.simulation.wind.change(replace(settings.wind, velocity=velocity))
        if 'wind.velocity' in names:
            self.simulation.wind.set_velocity(velocity, self.simulation.time)
        if names & {'load.snow', 'load.ice'}:
            self.simulation.apply(settings.load)
        self._blow(velocity)

    def set_wind_enabled(self, enabled: bool) -> str:
        """Switch the wind on or off."""
        self.simulation.set_wind_enabled(enabled)
        return f'wind {"on" if enabled else "off"}'

    def gust(self, gust: Gust) -> str:
        """Start a gust."""
        self.simulation.gust(gust)
        return (f'{gust.kind} gust of {gust.amplitude:g} m/s for {gust.duration:g} s'
                + ('' if self.simulation.wind.enabled
                   else '; the wind is off, and the gust is not felt until it is on'))

    def shake(self, earthquake: Earthquake) -> str:
        """Begin an earthquake, and describe it."""
        self.simulation.shake(earthquake)
        motion = self.simulation.ground_motion
        return (f'earthquake of {motion.duration:.1f} s, up to '
                f'{np.abs(motion.acceleration).max():.3g} m/s²')

    def strike(self, part: str, linear: Sequence[float], angular: Sequence[float]) -> str:
        """Apply an impulse [N·s], [N·m·s] to a part, and describe the effect."""
        moves = self.simulation.apply_impulse(part, linear, angular)
        return (f'impulse {list(linear)} N·s on {part}'
                + ('' if moves else '; it holds, and its building takes the blow'))

    def push(self, part: str, force: Sequence[float], torque: Sequence[float]) -> str:
        """Apply a lasting force to a part [N], [N·m]."""
        self.simulation.apply_wrench(part, force, torque)
        return f'wrench on {part}'

    def clear_wrenches(self) -> str:
        """Remove all lasting forces."""
        return f'{self.simulation.clear_wrenches()} lasting forces ended'

    def launch(self, projectile: Projectile) -> str:
        """Launch a projectile."""
        part = self.simulation.launch(projectile)
        return f'{self.simulation.names.name(part)} flies, it is part {part}'

    def explode(self, explosion: Explosion) -> str:
        """Detonate a charge."""
        self.simulation.explode(explosion.position, explosion.charge)
        return f'{explosion.charge:g} kg TNT at {list(explosion.position)} m'

    def demolish(self, plan: Demolition) -> str:
        """Arm charges with delays."""
        return f'{self.simulation.demolish(plan)} charges armed'

    def cut(self, cut: Cut) -> str:
        """Saw through joints."""
        return f'{self.simulation.apply(cut)} joints of {cut.target} cut'

    def grow(self, wish: Grow) -> str:
        """Let plants grow on, or stop them."""
        count = self.simulation.grow(wish.target, wish.rate, wish.years)
        return (f'{count} plants grow on for {wish.years} years, {wish.rate:g} a second'
                if wish.rate else f'{count} plants stop')

    def drive_joints(self, wishes: Sequence[DriveJoint]) -> str:
        """Drive joints of mechanisms; none if one of them cannot be driven."""
        for wish in wishes:
            self.simulation.check_joint(wish)
        for wish in wishes:
            self.simulation.apply(wish)
        return f'{len(wishes)} joints driven'

    def look_from(self, position: Sequence[float], orientation: Sequence[float]) -> str:
        """Move the observer to a position [m], (3,), with a quaternion xyzw."""
        self.simulation.set_observer(position, orientation)
        return 'looks from there'

    def place_intruder(self, name: str, pose: Sequence[float]) -> str:
        """Move an intruder to a pose x y z qx qy qz qw [m], (7,)."""
        self.simulation.place_intruder(pose, name=name)
        return f'{name} to {list(pose[:3])} m'

    def drive_rotors(self, name: str, thrust: Sequence[float], downwash: Downwash) -> str:
        """Set the thrust on an intruder [N], (3,), in its frame."""
        self.simulation.set_thrust(thrust, name, downwash.radius)
        return f'{list(thrust)} N on {name}'

    def spawn(self, spawn: Spawn, blueprint: Blueprint) -> str:
        """Add a built object to the scene; after an error the scene is unchanged."""
        self._refuse_after_failure()
        name = spawn.name or self.simulation.free_name(spawn.stem)
        known = len(self.simulation.warnings)
        with self._stopping():
            joined = self.simulation.add(blueprint, spawn.position, spawn.yaw, name)
        self.on_steps()
        return '; '.join([f'{name} stands at {list(spawn.position)} m, {joined.count} parts',
                          *self.simulation.warnings[known:]])

    def remove(self, name: str) -> str:
        """Remove an object from the scene."""
        self._refuse_after_failure()
        self.simulation.remove(name)
        self.on_steps()
        return f'{name} is gone'

    def inspect(self, part: str) -> str:
        """Describe the load of a part."""
        state = self.simulation.state
        return readings.describe_load(state, state.names.index(part))

    def remove_added(self) -> str:
        """Remove all spawned objects."""
        names = self.simulation.added
        for name in names:
            self.remove(name)
        return f'{len(names)} objects are gone'

    def move(self, name: str, pose: Sequence[float] | None,
             twist: Sequence[float] | None) -> str:
        """Move a loose object or part to a pose (7,), with a twist (6,)."""
        self.simulation.set_body_state(Entities(self.simulation).movable(name), pose, twist)
        self.on_steps()
        return f'{name} moved'

    def set_pause(self, paused: bool) -> str:
        """Pause or resume the simulation; before there is a scene, that of the first one."""
        if not paused:
            self._refuse_after_failure()
        self.paused = paused
        self._pacer.restart()
        state = 'paused' if paused else 'running'
        if not self.has_scene:
            return f'{state} once there is a scene'
        return f'{state} at {self.simulation.time:.3f} s'

    def step_simulation(self) -> str:
        """Run one step while paused."""
        self._refuse_after_failure()
        if not self.paused:
            raise CommandError('the simulation is running; pause it first with ~/set_pause')
        with self._stopping():
            self.simulation.step()
        self.on_steps()
        return f'stepped to {self.simulation.time:.4f} s'

    def reset_simulation(self) -> str:
        """Reset to the start; spawned objects stay, removed ones stay removed."""
        return self._begin_anew(self.simulation.reset)

    def revert(self) -> str:
        """Reset to the scene as loaded: without spawned objects, with the removed ones."""
        return self._begin_anew(self.simulation.revert)

    def _begin_anew(self, begin: Callable[[], None]) -> str:
        with self._stopping():
            begin()
        self._blow(self.simulation.wind.settings.velocity)
        self._recover()
        self.on_reset()
        return 'back at 0 s'

    def save_state(self, path: Path) -> str:
        """Write the whole state to a file; an existing one is replaced after complete writing."""
        self._refuse_after_failure()
        data = self.simulation.save()
        write_state(path, data)
        return f'{self.simulation.time:.3f} s saved in {path}, {len(data) / 1e6:.1f} MB'

    def restore_state(self, path: Path) -> str:
        """Restore the state in a file."""
        try:
            self.simulation.restore(read_state(path))
        except SnapshotError as error:
            raise CommandError(f'state.file: {path}: {error}') from error
        self._blow(self.simulation.wind.mean_velocity(self.simulation.time))
        self._recover()
        self.on_reset()
        return f'back at {self.simulation.time:.3f} s'

    def fail(self, error: Exception) -> None:
        """
        Stop time because a step failed: its state is not reliable.

        :param error: the exception.
        """
        self.failure = f'{type(error).__name__}: {error}' if str(error) else type(error).__name__
        self._pacer.restart()

    @contextmanager
    def _stopping(self) -> Iterator[None]:
        """Stop time if a block fails, unless it refuses a command."""
        try:
            yield
        except CommandError:
            raise
        except Exception as error:
            self.fail(error)
            raise

    @property
    def stands(self) -> bool:
        """Return whether time stands still."""
        return self.paused or bool(self.failure)

    def summary(self) -> str:
        """Describe the scene in one line."""
        simulation = self.simulation
        return (f'{len(simulation.scene.objects)} objects, {len(simulation.poses)} parts, '
                f'{len(simulation.blueprint.bonds)} bonds')

    def _blow(self, velocity: Sequence[float]) -> None:
        self.mean_wind, self.snow = tuple(velocity), self.simulation.snow_load
        self.on_weather()

    def _recover(self) -> None:
        self.failure = ''
        self._pacer.restart()

    def _refuse_after_failure(self) -> None:
        if self.failure:
            raise CommandError(f'a step went wrong ({self.failure}); {REMEDY}')
