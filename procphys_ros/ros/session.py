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


"""Session: the simulation that runs at the moment, and what may be asked of it."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import TypeVar

from procphys_ros.errors import CommandError, ProcPhysError
from procphys_ros.physics.wind import Gust
from procphys_ros.ros.pacing import Pacer
from procphys_ros.ros.parameters import Parameters
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import read_settings
from procphys_ros.scene.strikes import Demolition, Projectile
from procphys_ros.simulation import Simulation

_Strike = TypeVar('_Strike')


class Session:
    """
    Owns the simulation and carries out what the services ask for.

    :param parameters: describe the scene.
    :param pacer: told when time does not pass as usual.
    :ivar simulation: the simulation of the moment; another one after `reload_scene`.
    :ivar paused: whether time stands still.
    :ivar on_scene: called when another scene has been loaded.
    :ivar on_reset: called when time has jumped back.
    :ivar on_steps: called when steps were run on demand.
    :raises ProcPhysError: when the first scene cannot be built.
    """

    def __init__(self, parameters: Parameters, pacer: Pacer):
        self._parameters = parameters
        self._pacer = pacer
        self.paused = False
        self.on_scene: Callable[[], None] = lambda: None
        self.on_reset: Callable[[], None] = lambda: None
        self.on_steps: Callable[[], None] = lambda: None
        self.simulation = self._build()

    def set_wind(self, velocity: Sequence[float]) -> str:
        """Change the mean wind [m/s], (3,)."""
        self.simulation.set_wind(velocity)
        self._mean_wind = tuple(velocity)
        return f'mean wind {list(velocity)} m/s'

    def change_wind(self, names: set[str]) -> None:
        """Go over to the present `wind.*` parameters, of which some have changed."""
        wind = read_settings(self._parameters.nested()).wind
        if 'wind.velocity' not in names:
            wind = replace(wind, velocity=self._mean_wind)
        self._mean_wind = tuple(wind.velocity)
        self.simulation.wind.change(wind, self.simulation.time)

    def set_wind_enabled(self, enabled: bool) -> str:
        """Switch the wind on or off."""
        self.simulation.set_wind_enabled(enabled)
        return f'wind {"on" if enabled else "off"}'

    def set_pause(self, paused: bool) -> str:
        """Stop time, or let it run again."""
        self.paused = paused
        self._pacer.restart()
        return f'{"paused" if paused else "running"} at {self.simulation.time:.3f} s'

    def gust(self) -> str:
        """Start a gust from the `gust.*` parameters."""
        gust: Gust = read_settings(self._parameters.nested()).gust
        self.simulation.gust(gust)
        return f'{gust.kind} gust of {gust.amplitude:g} m/s for {gust.duration:g} s'

    def apply_impulse(self) -> str:
        """Hit the part `impulse.target`."""
        target = self._parameters['impulse.target']
        if not target:
            raise CommandError('the parameter impulse.target is empty, it must name a part, such '
                               'as oak_0/17')
        linear = self._parameters['impulse.linear']
        return self.strike(target, linear, self._parameters['impulse.angular'])

    def strike(self, part: str, linear: Sequence[float], angular: Sequence[float]) -> str:
        """Give a part an impulse [N·s], [N·m·s], and say what it did."""
        moves = self.simulation.apply_impulse(part, linear, angular)
        return (f'impulse {list(linear)} N·s on {part}'
                + ('' if moves else '; it holds, and its building takes the blow'))

    def launch_projectile(self) -> str:
        """Throw what the `projectile.*` parameters describe."""
        part = self.simulation.launch(self._group('projectile', Projectile))
        return f'{self.simulation.names.name(part)} flies, it is part {part}'

    def explode(self) -> str:
        """Set off a charge from the `explosion.*` parameters."""
        return self.explode_at(self._parameters['explosion.position'])

    def explode_at(self, point: Sequence[float]) -> str:
        """Set off `explosion.charge` at a point [m], (3,)."""
        charge = self._parameters['explosion.charge']
        self.simulation.explode(point, charge)
        return f'{charge:g} kg TNT at {list(point)} m'

    def demolish(self) -> str:
        """Start the charges of the `demolition.*` parameters."""
        return f'{self.simulation.demolish(self._group("demolition", Demolition))} charges armed'

    def clear_wrenches(self) -> str:
        """Take away all lasting forces."""
        return f'{self.simulation.clear_wrenches()} lasting forces ended'

    def step_simulation(self) -> str:
        """Run one step while paused."""
        if not self.paused:
            raise CommandError('the simulation is running; pause it first with ~/set_pause')
        self.simulation.step()
        self.on_steps()
        return f'stepped to {self.simulation.time:.4f} s'

    def reset_simulation(self) -> str:
        """Put everything back to where it began."""
        self.simulation.reset()
        self._mean_wind = tuple(self.simulation.wind.settings.velocity)
        self._pacer.restart()
        self.on_reset()
        return 'back at 0 s'

    def reload_scene(self) -> str:
        """Build the scene anew from the present parameters; on an error the old one stays."""
        try:
            simulation = self._build()
        except ProcPhysError as error:
            raise CommandError(f'{error}; the scene stays as it was') from error
        self.simulation.close()
        self.simulation = simulation
        self._pacer.restart()
        self.on_scene()
        return self.summary()

    def summary(self) -> str:
        """Say in one line what the scene holds."""
        simulation = self.simulation
        return (f'{len(simulation.scene.objects)} objects, {len(simulation.poses)} parts, '
                f'{len(simulation.blueprint.bonds)} bonds')

    def _group(self, name: str, kind: type[_Strike]) -> _Strike:
        """Read a group of parameters as what it describes."""
        return kind(**{f.name: self._parameters[f'{name}.{f.name}']
                       for f in fields(kind)})  # type: ignore[arg-type]

    def _build(self) -> Simulation:
        scene = Scene.from_parameters(self._parameters.nested())
        simulation = Simulation(scene)
        self._pacer.time_step = simulation.time_step
        self._mean_wind = tuple(scene.settings.wind.velocity)
        return simulation
