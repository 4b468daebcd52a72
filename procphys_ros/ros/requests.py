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


"""Requests: the commands of services, with the parameters at the time of the call."""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

from procphys_ros.errors import CommandError
from procphys_ros.ros.conversions import Act, part_name, Triple
from procphys_ros.ros.file_access import state_path
from procphys_ros.ros.parameters import Parameters
from procphys_ros.ros.session import Session
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.intruder import Downwash
from procphys_ros.scene.plants import Grow
from procphys_ros.scene.settings import read_settings
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile


class Requests:
    """
    Convert a service call to an operation between two steps; in the ROS thread.

    Each method reads the parameters now and returns a function that executes them in the
    simulation thread.

    :param parameters: of the node.
    :param session: target of the operations.
    :raises ProcPhysError: from each method, if the parameters are invalid.
    """

    def __init__(self, parameters: Parameters, session: Session):
        self._parameters = parameters
        self._session = session

    def set_wind_enabled(self, enabled: bool) -> Act:
        """Switch the wind on or off."""
        return lambda: self._session.set_wind_enabled(enabled)

    def set_pause(self, paused: bool) -> Act:
        """Pause or resume the simulation."""
        return lambda: self._session.set_pause(paused)

    def gust(self) -> Act:
        """Start a gust from the `gust.*` parameters."""
        gust = read_settings(self._parameters.nested()).gust
        return lambda: self._session.gust(gust)

    def apply_impulse(self) -> Act:
        """Apply an impulse to the part `impulse.target`."""
        part = part_name(self._parameters['impulse.target'], 'the parameter impulse.target')
        linear, angular = self._parameters['impulse.linear'], self._parameters['impulse.angular']
        return lambda: self._session.strike(part, linear, angular)

    def launch_projectile(self) -> Act:
        """Launch the projectile of the `projectile.*` parameters."""
        projectile = self._group('projectile', Projectile)
        return lambda: self._session.launch(projectile)

    def explode(self) -> Act:
        """Detonate the charge of the `explosion.*` parameters."""
        return self.explode_at(self._parameters['explosion.position'])

    def explode_at(self, point: Triple) -> Act:
        """Detonate `explosion.charge` at a point [m], (3,)."""
        explosion = Explosion(point, self._parameters['explosion.charge'])
        return lambda: self._session.explode(explosion)

    def drive_rotors(self, name: str, thrust: Triple) -> Act:
        """Set the thrust on an intruder [N], of a disk of `downwash.radius`."""
        downwash = self._group('downwash', Downwash)
        return lambda: self._session.drive_rotors(name, thrust, downwash)

    def demolish(self) -> Act:
        """Arm the charges of the `demolition.*` parameters."""
        plan = self._group('demolition', Demolition)
        return lambda: self._session.demolish(plan)

    def cut(self) -> Act:
        """Make the cut of the `cut.*` parameters."""
        part_name(self._parameters['cut.target'], 'the parameter cut.target')
        cut = self._group('cut', Cut)
        return lambda: self._session.cut(cut)

    def earthquake(self) -> Act:
        """Begin the earthquake of the `earthquake.*` parameters."""
        wish = self._group('earthquake', Earthquake)
        return lambda: self._session.shake(wish)

    def grow(self) -> Act:
        """Let the plants of the `grow.*` parameters grow on."""
        wish = self._group('grow', Grow)
        return lambda: self._session.grow(wish)

    def clear_wrenches(self) -> Act:
        """Remove all lasting forces."""
        return self._session.clear_wrenches

    def step_simulation(self) -> Act:
        """Run one step while paused."""
        return self._session.step_simulation

    def reset_simulation(self) -> Act:
        """Reset everything to its start."""
        return self._session.reset_simulation

    def save_state(self) -> Act:
        """Write the whole state to the file `state.file`."""
        path = self._state_file()
        return lambda: self._session.save_state(path)

    def restore_state(self) -> Act:
        """Restore the state in the file `state.file`."""
        path = self._state_file()
        return lambda: self._session.restore_state(path)

    def remove(self) -> Act:
        """Remove the object `spawn.name` from the scene."""
        name = self._parameters['spawn.name']
        if not name:
            raise CommandError('spawn.name is empty, it must name the object to remove')
        return lambda: self._session.remove(name)

    def inspect(self) -> Act:
        """Describe the load of the part `inspect.part`."""
        part = part_name(self._parameters['inspect.part'], 'the parameter inspect.part')
        return lambda: self._session.inspect(part)

    def _state_file(self) -> Path:
        return state_path(self._parameters['state.file'], self._parameters.bounds)

    def _group(self, name: str, kind: Callable[..., Any]) -> Any:
        """Create an object from its group of parameters."""
        return kind(**{f.name: self._parameters[f'{name}.{f.name}']
                       for f in fields(kind)})  # type: ignore[arg-type]
