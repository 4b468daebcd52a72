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


"""The node as a managed (lifecycle) node: configure builds the scene, activate runs it."""

from collections.abc import Callable
from contextlib import suppress
from queue import Empty, Queue
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from procphys_ros.errors import CommandError
from procphys_ros.ros.commands import Answer, Command
from procphys_ros.ros.node import SimNode
from procphys_ros.ros.pacing import RateLimiter

_LOOK = 0.05  # [s] between checks whether ROS still runs
_SERVICE = 'change_state'


class ManagedSimNode(LifecycleNodeMixin, SimNode):
    """
    Simulate a scene as `SimNode`, with the states of managed nodes.

    Unconfigured: there is no scene. Inactive: the scene is built and paused. Active: time passes.
    Each transition answers when it is done, and all other services meanwhile; `configure` fails
    if the scene cannot be built, with the reason in the log, or if `~/cancel_reload` cancels it.
    `~/set_pause` works in any state.
    """

    def __init__(self, **options):
        SimNode.__init__(self, **options)
        LifecycleNodeMixin.__init__(self, callback_group=self._answers.group)
        self._works: dict[str, Callable[[Answer], None]] = {
            'configuring': self._configure,
            'activating': self._command('activate', lambda: self.session.set_pause(False)),
            'deactivating': self._command('deactivate', lambda: self.session.set_pause(True)),
            'cleaningup': self._command('cleanup', self._drop_scene),
            'shuttingdown': self._shut_down}
        # That of rclpy would block the executor until a transition is done.
        self._service_change_state.callback = self._change_state

    async def _change_state(self, request: ChangeState.Request,
                            response: ChangeState.Response) -> ChangeState.Response:
        """Make a transition, and answer when it is done."""
        machine: Any = self._state_machine
        wanted, state = request.transition, machine.current_state[1]
        response.success = False
        try:
            machine.trigger_transition_by_id(
                machine.get_transition_by_label(wanted.label) if wanted.label else wanted.id, True)
        except RuntimeError:  # RCLError
            self.commands.reject(_SERVICE, f'there is no transition "{wanted.label or wanted.id}" '
                                           f'while the node is {state}')
            return response
        work = self._works[machine.current_state[1]]
        response.success, message = await self._answers.wait_for(_SERVICE, work)
        if not response.success:
            self.get_logger().error(message)
        machine.trigger_transition_by_label(_code(response.success).to_label(), True)
        return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the scene of the present parameters."""
        return self._wait_for(self._works['configuring'])

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run the simulation."""
        return self._wait_for(self._works['activating'])

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause the simulation."""
        return self._wait_for(self._works['deactivating'])

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remove the scene."""
        return self._wait_for(self._works['cleaningup'])

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node."""
        return self._wait_for(self._works['shuttingdown'])

    def _begin(self) -> None:
        """Wait to be configured."""
        self.session.paused = True
        self.session.without_scene = 'there is no scene until the node is configured'

    def _configure(self, answer: Answer) -> None:
        self._loading.load_first(lambda error: answer(False, str(error)), answer)

    def _command(self, name: str, act: Callable[[], str]) -> Callable[[Answer], None]:
        return lambda answer: self.commands.call(Command(name, act, answer))

    def _shut_down(self, answer: Answer) -> None:
        self.loop.ended.set_result(None)
        answer(True, 'the node ends')

    def _drop_scene(self) -> str:
        with suppress(CommandError):  # no other scene is being built
            self.builder.cancel()
        self.session.close()
        self.session.paused = True
        self.diagnostics.latest = None
        self._output.end_scene()
        return 'no scene'

    def _wait_for(self, begin: Callable[[Answer], None]) -> TransitionCallbackReturn:
        """Begin a transition and wait for its end, as callers of `trigger_configure` do."""
        answers: Queue[tuple[bool, str]] = Queue()
        status = RateLimiter(1.0)
        begin(lambda success, message: answers.put((success, message)))
        while self.context.ok():
            try:
                success, message = answers.get(timeout=_LOOK)
            except Empty:
                if status.is_due():
                    self._report()
                continue
            if not success:
                self.get_logger().error(message)
            return _code(success)
        return TransitionCallbackReturn.ERROR


def _code(success: bool) -> TransitionCallbackReturn:
    return TransitionCallbackReturn.SUCCESS if success else TransitionCallbackReturn.FAILURE
