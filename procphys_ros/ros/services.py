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
from time import monotonic
from typing import Protocol

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from procphys_ros.ros.commands import Command, CommandQueue

_PATIENCE = 0.1  # [s] after which a command is answered for though it has not been carried out
_LOOK = 0.04  # [s] between looks at commands that wait; both make less than 0.2 s together
LATER = ('accepted; the simulation is busy with a long step or another command, and carries it '
         'out next (if it should be refused then, /diagnostics will say so)')


class Actions(Protocol):
    """What the services ask for; each says what happened or raises CommandError."""

    def set_wind_enabled(self, enabled: bool) -> str: ...

    def set_pause(self, paused: bool) -> str: ...

    def gust(self) -> str: ...

    def apply_impulse(self) -> str: ...

    def launch_projectile(self) -> str: ...

    def explode(self) -> str: ...

    def demolish(self) -> str: ...

    def clear_wrenches(self) -> str: ...

    def step_simulation(self) -> str: ...

    def reset_simulation(self) -> str: ...

    def reload_scene(self) -> str: ...


_TRIGGERS = ('gust', 'apply_impulse', 'launch_projectile', 'explode', 'demolish',
             'clear_wrenches')
_SWITCHES = ('set_wind_enabled', 'set_pause')
# Their answer is their result, so it comes when they are done, however long that takes.
_LONG_TRIGGERS = ('step_simulation', 'reset_simulation', 'reload_scene')


class Answers:
    """
    Puts commands into the queue and waits for what becomes of them, without holding up others.

    :param node: whose executor runs the services.
    :param queue: carries commands out, in another thread.
    :param clock: steady clock of timers.
    :ivar group: callback group for services that await `ask`.
    """

    def __init__(self, node: Node, queue: CommandQueue, clock: Clock):
        self._node = node
        self._queue = queue
        self._waiting: list[tuple[float, Future]] = []
        self.group = ReentrantCallbackGroup()
        self._look = node.create_timer(_LOOK, self._hurry, self.group, clock)
        self._look.cancel()

    async def ask(self, name: str, act: Callable[[], str], is_long: bool = False
                  ) -> tuple[bool, str]:
        """
        Have a command carried out.

        :param name: of the service.
        :param act: says what happened or raises CommandError.
        :param is_long: wait for the result; else a busy simulation is not waited for.
        :returns: whether it was carried out or accepted, and what happened or why not.
        """
        future = Future()

        def answer(success: bool, message: str) -> None:
            future.set_result((success, message))
            executor = self._node.executor
            if executor is not None:
                executor.wake()

        if not is_long:
            self._waiting.append((monotonic() + _PATIENCE, future))
            if self._look.is_canceled():
                self._look.reset()
        self._queue.submit(Command(name, act, answer))
        return await future

    def _hurry(self) -> None:
        """Answer for commands that have waited too long."""
        now = monotonic()
        for due, future in self._waiting:
            if now >= due and not future.done():
                future.set_result((True, LATER))
        self._waiting = [(due, future) for due, future in self._waiting if not future.done()]
        if not self._waiting:
            self._look.cancel()


def create_services(node: Node, answers: Answers, actions: Actions) -> None:
    """
    Offer all services.

    :param node: the node that offers them.
    :param answers: waits for what becomes of a command.
    :param actions: carries them out.
    """
    for name in _TRIGGERS + _LONG_TRIGGERS:
        serve = _trigger(answers, name, getattr(actions, name), name in _LONG_TRIGGERS)
        node.create_service(Trigger, f'~/{name}', serve, callback_group=answers.group)
    for name in _SWITCHES:
        node.create_service(SetBool, f'~/{name}', _switch(answers, name, getattr(actions, name)),
                            callback_group=answers.group)


def _trigger(answers: Answers, name: str, act: Callable[[], str], is_long: bool):
    async def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = await answers.ask(name, act, is_long)
        return response
    return serve


def _switch(answers: Answers, name: str, act: Callable[[bool], str]):
    async def serve(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success, response.message = await answers.ask(name, lambda: act(request.data))
        return response
    return serve
