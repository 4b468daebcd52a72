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
from procphys_ros.scene.settings import read_settings
from procphys_ros.scene.strikes import Demolition, Explosion, Projectile


class Requests:
    """
    Turns a call into what is to be done between two steps; in the thread that talks to ROS.

    Each method reads the parameters now and gives a function that does what they say, for the
    thread that simulates.

    :param parameters: of the node.
    :param session: what is done is done to it.
    :raises ProcPhysError: each method, when the parameters make no sense.
    """

    def __init__(self, parameters: Parameters, session: Session):
        self._parameters = parameters
        self._session = session

    def set_wind_enabled(self, enabled: bool) -> Act:
        """Switch the wind on or off."""
        return lambda: self._session.set_wind_enabled(enabled)

    def set_pause(self, paused: bool) -> Act:
        """Stop time, or let it run again."""
        return lambda: self._session.set_pause(paused)

    def gust(self) -> Act:
        """Start a gust from the `gust.*` parameters."""
        gust = read_settings(self._parameters.nested()).gust
        return lambda: self._session.gust(gust)

    def apply_impulse(self) -> Act:
        """Strike the part `impulse.target`."""
        part = part_name(self._parameters['impulse.target'], 'the parameter impulse.target')
        linear, angular = self._parameters['impulse.linear'], self._parameters['impulse.angular']
        return lambda: self._session.strike(part, linear, angular)

    def launch_projectile(self) -> Act:
        """Throw what the `projectile.*` parameters describe."""
        projectile = self._group('projectile', Projectile)
        return lambda: self._session.launch(projectile)

    def explode(self) -> Act:
        """Set off a charge from the `explosion.*` parameters."""
        return self.explode_at(self._parameters['explosion.position'])

    def explode_at(self, point: Triple) -> Act:
        """Set off `explosion.charge` at a point [m], (3,)."""
        explosion = Explosion(point, self._parameters['explosion.charge'])
        return lambda: self._session.explode(explosion)

    def demolish(self) -> Act:
        """Start the charges of the `demolition.*` parameters."""
        plan = self._group('demolition', Demolition)
        return lambda: self._session.demolish(plan)

    def clear_wrenches(self) -> Act:
        """Take away all lasting forces."""
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
        """Go back to the state in the file `state.file`."""
        path = self._state_file()
        return lambda: self._session.restore_state(path)

    def remove(self) -> Act:
        """Take the object `spawn.name` out of the scene."""
        name = self._parameters['spawn.name']
        if not name:
            raise CommandError('spawn.name is empty, it must name the object to remove')
        return lambda: self._session.remove(name)

    def inspect(self) -> Act:
        """Describe what the part `inspect.part` carries."""
        part = part_name(self._parameters['inspect.part'], 'the parameter inspect.part')
        return lambda: self._session.inspect(part)

    def _state_file(self) -> Path:
        return state_path(self._parameters['state.file'], self._parameters.bounds)

    def _group(self, name: str, kind: Callable[..., Any]) -> Any:
        """Read a group of parameters as what it describes."""
        return kind(**{f.name: self._parameters[f'{name}.{f.name}']
                       for f in fields(kind)})  # type: ignore[arg-type]
