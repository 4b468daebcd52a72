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

from collections.abc import Awaitable, Callable
from threading import Lock
from time import monotonic
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from procphys_ros.ros.commands import Act, Answer, Command, CommandQueue
from procphys_ros.ros.loading import Loading
from procphys_ros.ros.requests import Requests

_LOOK = 0.02  # [s] between checks of waiting commands
BUSY = 'the simulation is busy'  # prefix of the refusal of a command that timed out


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


def create_services(node: Node, answers: Answers, requests: Requests, loading: Loading) -> None:
    """
    Create all services.

    :param node: the node that offers them.
    :param answers: waits for the results of commands.
    :param requests: prepares the operations.
    :param loading: loads scenes.
    """
    def offer(kind: type, name: str, ask: Callable[[Any], Awaitable[tuple[bool, str]]]) -> None:
        async def serve(request: Any, response: Any) -> Any:
            response.success, response.message = await ask(request)
            return response
        node.create_service(kind, f'~/{name}', serve, callback_group=answers.group)

    def offer_trigger(name: str, prepare: Callable[[], Act]) -> None:
        offer(Trigger, name, lambda request: answers.ask(name, prepare))

    def offer_long(name: str, begin: Callable[[Answer], None]) -> None:
        offer(Trigger, name, lambda request: answers.wait_for(name, begin))

    def offer_switch(name: str, act: Callable[[bool], str]) -> None:
        offer(SetBool, name, lambda request: answers.ask(
            name, lambda: lambda: act(request.data)))

    for name, prepare in requests.triggers.items():
        offer_trigger(name, prepare)
    for name, begin in (('reload_scene', loading.reload), ('cancel_reload', loading.cancel),
                        ('spawn', loading.spawn)):
        offer_long(name, begin)
    for name, act in requests.switches.items():
        offer_switch(name, act)
