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


"""Services of the node: each answers what happened, or why it did not."""

from collections.abc import Callable
from typing import Protocol

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from procphys_ros.ros.commands import Command, CommandQueue


class Actions(Protocol):
    """What the services ask for; each says what happened or raises CommandError."""

    def set_wind_enabled(self, enabled: bool) -> str: ...

    def set_pause(self, paused: bool) -> str: ...

    def gust(self) -> str: ...

    def apply_impulse(self) -> str: ...

    def clear_wrenches(self) -> str: ...

    def step_simulation(self) -> str: ...

    def reset_simulation(self) -> str: ...

    def reload_scene(self) -> str: ...


_TRIGGERS = ('gust', 'apply_impulse', 'clear_wrenches', 'step_simulation', 'reset_simulation',
             'reload_scene')
_SWITCHES = ('set_wind_enabled', 'set_pause')


def create_services(node: Node, queue: CommandQueue, actions: Actions) -> None:
    """
    Offer all services.

    A service is called between two steps, so it carries out at once what waits in the queue and
    then its own command: the order in which commands came is kept, and the answer is the truth.

    :param node: the node that offers them.
    :param queue: counts the commands, and holds those that came before.
    :param actions: carries them out.
    """
    for name in _TRIGGERS:
        node.create_service(Trigger, f'~/{name}', _trigger(queue, name, getattr(actions, name)))
    for name in _SWITCHES:
        node.create_service(SetBool, f'~/{name}', _switch(queue, name, getattr(actions, name)))


def _trigger(queue: CommandQueue, name: str, act: Callable[[], str]):
    def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = queue.run(Command(name, act))
        return response
    return serve


def _switch(queue: CommandQueue, name: str, act: Callable[[bool], str]):
    def serve(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        command = Command(name, lambda: act(request.data))
        response.success, response.message = queue.run(command)
        return response
    return serve
