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
from functools import partial
from typing import Any

from procphys_ros.errors import CommandError
from procphys_ros.physics.wind import Gust
from procphys_ros.ros.commands import Act
from procphys_ros.ros.conversions import part_name, Triple
from procphys_ros.ros.file_access import state_path
from procphys_ros.ros.parameters import Parameters
from procphys_ros.ros.session import Session
from procphys_ros.scene.cues import Blow
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.intruder import Downwash
from procphys_ros.scene.plants import Grow
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.schema import ParameterGroup


class Requests:
    """
    Convert a service call to an operation between two steps; in the ROS thread.

    Each reads the parameters now and returns a function that executes them in the simulation
    thread, or raises ProcPhysError if the parameters are invalid.

    :param parameters: of the node.
    :param session: target of the operations.
    :ivar triggers: of services without arguments, by name.
    :ivar switches: of services that switch something on or off, by name.
    """

    def __init__(self, parameters: Parameters, session: Session):
        self._parameters = parameters
        self._session = session
        groups: dict[str, tuple[type[ParameterGroup], Callable[[Any], str]]] = {
            'gust': (Gust, session.gust), 'launch_projectile': (Projectile, session.launch),
            'explode': (Explosion, session.explode), 'demolish': (Demolition, session.demolish),
            'cut': (Cut, session.cut), 'earthquake': (Earthquake, session.shake),
            'grow': (Grow, session.grow),
            'apply_impulse': (Blow, lambda blow: session.strike(blow.target, blow.linear,
                                                                blow.angular))}
        self.triggers: dict[str, Callable[[], Act]] = {
            **{name: partial(self._of_group, *about) for name, about in groups.items()},
            'clear_wrenches': lambda: session.clear_wrenches,
            'step_simulation': lambda: session.step_simulation,
            'reset_simulation': lambda: session.reset_simulation,
            'save_state': partial(self._with_state_file, session.save_state),
            'restore_state': partial(self._with_state_file, session.restore_state),
            'remove': self._remove, 'inspect': self._inspect}
        self.switches: dict[str, Callable[[bool], str]] = {
            'set_wind_enabled': session.set_wind_enabled, 'set_pause': session.set_pause}

    def explode_at(self, point: Triple) -> Act:
        """Detonate `explosion.charge` at a point [m], (3,)."""
        explosion = Explosion(point, self._parameters['explosion.charge'])
        return lambda: self._session.explode(explosion)

    def drive_rotors(self, name: str, thrust: Triple) -> Act:
        """Set the thrust on an intruder [N], of a disk of `downwash.radius`."""
        downwash = Downwash(self._parameters['downwash.radius'])
        return lambda: self._session.drive_rotors(name, thrust, downwash)

    def _of_group(self, kind: type[ParameterGroup], act: Callable[[Any], str]) -> Act:
        """Execute a command that a group of parameters describes."""
        wish: Any = kind.read(self._parameters.nested())
        if kind in (Blow, Cut):
            part_name(wish.target, f'the parameter {kind.group}.target')
        return lambda: act(wish)

    def _with_state_file(self, act: Callable[..., str]) -> Act:
        path = state_path(self._parameters['state.file'], self._parameters.bounds)
        return lambda: act(path)

    def _remove(self) -> Act:
        """Remove the object `spawn.name` from the scene."""
        name = self._parameters['spawn.name']
        if not name:
            raise CommandError('spawn.name is empty, it must name the object to remove')
        return lambda: self._session.remove(name)

    def _inspect(self) -> Act:
        """Describe the load of the part `inspect.part`."""
        part = part_name(self._parameters['inspect.part'], 'the parameter inspect.part')
        return lambda: self._session.inspect(part)
