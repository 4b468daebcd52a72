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
from threading import Lock
from time import monotonic
from typing import Protocol

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from procphys_ros.ros.commands import Command, CommandQueue
from procphys_ros.ros.conversions import Act

_LOOK = 0.02  # [s] between checks of waiting commands
BUSY = 'the simulation is busy'  # prefix of the refusal of a command that timed out


Answer = Callable[[bool, str], None]


class Actions(Protocol):
    """Operations of the services; each method returns an operation, or raises ProcPhysError."""

    def set_wind_enabled(self, enabled: bool) -> Act: ...

    def set_pause(self, paused: bool) -> Act: ...

    def gust(self) -> Act: ...

    def apply_impulse(self) -> Act: ...

    def launch_projectile(self) -> Act: ...

    def explode(self) -> Act: ...

    def demolish(self) -> Act: ...

    def cut(self) -> Act: ...

    def earthquake(self) -> Act: ...

    def grow(self) -> Act: ...

    def clear_wrenches(self) -> Act: ...

    def step_simulation(self) -> Act: ...

    def reset_simulation(self) -> Act: ...

    def save_state(self) -> Act: ...

    def restore_state(self) -> Act: ...

    def remove(self) -> Act: ...

    def inspect(self) -> Act: ...


class Scenes(Protocol):
    """Loads scenes, and objects that join them; each method gets the function to answer with."""

    def reload(self, answer: Answer) -> None: ...

    def cancel(self, answer: Answer) -> None: ...

    def spawn(self, answer: Answer) -> None: ...


_TRIGGERS = ('gust', 'apply_impulse', 'launch_projectile', 'explode', 'demolish', 'cut',
             'earthquake', 'grow', 'clear_wrenches', 'step_simulation', 'reset_simulation',
             'save_state', 'restore_state', 'remove', 'inspect')
_SWITCHES = ('set_wind_enabled', 'set_pause')


class Answers:
    """
    Queue commands and wait for their results, without blocking others.

    A command whose execution has not begun before the deadline is withdrawn and refused: an answer
    is final.

    :param node: its executor runs the services.
    :param queue: executes commands, in another thread.
    :param deadline: returns the time that a command may wait [s].
    :param clock: steady clock of timers.
    :param now: returns steady real time [s].
    :ivar group: callback group for services that await `ask`.
    """

    def __init__(self, node: Node, queue: CommandQueue, deadline: Callable[[], float],
                 clock: Clock, now: Callable[[], float] = monotonic):
        self._node = node
        self._queue = queue
        self._deadline = deadline
        self._now = now
        self._lock = Lock()  # the executor may be multi-threaded
        self._waiting: list[tuple[float, Command]] = []
        self.group = ReentrantCallbackGroup()
        self._timer = node.create_timer(_LOOK, self.look, self.group, clock)
        self._timer.cancel()

    async def ask(self, name: str, prepare: Callable[[], Act]) -> tuple[bool, str]:
        """
        Execute a command.

        :param name: of the service.
        :param prepare: called now; returns the operation, or raises its refusal.
        :returns: whether it was executed, and the result or the reason.
        """
        def begin(answer: Answer) -> None:
            command = Command(name, prepare(), answer)
            due = self._now() + self._deadline()
            self._queue.call(command)  # before a check in another thread can find it missing there
            with self._lock:
                self._waiting.append((due, command))
                if self._timer.is_canceled():
                    self._timer.reset()
        return await self.wait_for(name, begin)

    async def wait_for(self, name: str, begin: Callable[[Answer], None]) -> tuple[bool, str]:
        """
        Begin an operation, and wait for its answer without a deadline.

        :param name: of the service.
        :param begin: called now with the function to answer with, from any thread; or raises.
        :returns: as `ask`.
        """
        future = Future()

        def answer(success: bool, message: str) -> None:
            future.set_result((success, message))
            executor = self._node.executor
            if executor is not None:
                executor.wake()

        try:
            begin(answer)
        except Exception as error:
            return False, self._queue.reject(name, error)
        return await future

    def look(self) -> None:
        """Refuse the commands whose deadline has passed."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
        now, still = self._now(), []
        for due, command in waiting:
            if not self._queue.is_waiting(command):
                continue
            if now < due:
                still.append((due, command))
            elif self._queue.withdraw(command):
                doing = self._queue.under_way or 'a long step'
                reason = (f'{BUSY} with {doing} and has not come to this within '
                          f'{self._deadline():g} s (service_deadline); nothing was done')
                command.answer(False, self._queue.reject(command.name, reason))
        with self._lock:
            self._waiting += still
            if not self._waiting:
                self._timer.cancel()


def create_services(node: Node, answers: Answers, actions: Actions, scenes: Scenes) -> None:
    """
    Create all services.

    :param node: the node that offers them.
    :param answers: waits for the results of commands.
    :param actions: prepares the operations.
    :param scenes: loads scenes.
    """
    for name in _TRIGGERS:
        node.create_service(Trigger, f'~/{name}', _trigger(answers, name, getattr(actions, name)),
                            callback_group=answers.group)
    for name, begin in (('reload_scene', scenes.reload), ('cancel_reload', scenes.cancel),
                        ('spawn', scenes.spawn)):
        node.create_service(Trigger, f'~/{name}', _long_trigger(answers, name, begin),
                            callback_group=answers.group)
    for name in _SWITCHES:
        node.create_service(SetBool, f'~/{name}', _switch(answers, name, getattr(actions, name)),
                            callback_group=answers.group)


def _trigger(answers: Answers, name: str, prepare: Callable[[], Act]):
    async def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = await answers.ask(name, prepare)
        return response
    return serve


def _long_trigger(answers: Answers, name: str, begin: Callable[[Answer], None]):
    async def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = await answers.wait_for(name, begin)
        return response
    return serve


def _switch(answers: Answers, name: str, prepare: Callable[[bool], Act]):
    async def serve(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success, response.message = await answers.ask(
            name, lambda: prepare(request.data))
        return response
    return serve
