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


"""The node as a managed node: a manager says when it builds its scene, and when time passes."""

from collections.abc import Callable
from queue import Empty, Queue

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from procphys_ros.ros.commands import Command
from procphys_ros.ros.node import SimNode
from procphys_ros.ros.pacing import RateLimiter

_LOOK = 0.05  # [s] between looks at whether ROS is still there


class ManagedSimNode(LifecycleNodeMixin, SimNode):
    """
    Simulates a scene as `SimNode` does, in the states of managed nodes.

    Unconfigured: there is no scene. Inactive: the scene is built and time stands still. Active:
    time passes. Each transition answers when it is done; `configure` fails when the scene cannot
    be built, with the reason in the log. `~/set_pause` works in any state.
    """

    def __init__(self, **options):
        SimNode.__init__(self, **options)
        LifecycleNodeMixin.__init__(self, callback_group=MutuallyExclusiveCallbackGroup())

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Build the scene of the present parameters."""
        def begin(answer: Callable[[bool, str], None]) -> None:
            self._loading.load_first(lambda error: answer(False, str(error)), answer)
        return self._wait_for(begin)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let time pass."""
        return self._have_done('activate', lambda: self.session.set_pause(False))

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let time stand still."""
        return self._have_done('deactivate', lambda: self.session.set_pause(True))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Do away with the scene."""
        return self._have_done('cleanup', self._drop_scene)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node."""
        self.loop.ended.set_result(None)
        return TransitionCallbackReturn.SUCCESS

    def _begin(self) -> None:
        """Wait to be configured."""
        self.session.paused = True

    def _drop_scene(self) -> str:
        self.session.close()
        self.session.paused = True
        self.diagnostics.latest = None
        self._output.end_scene()
        return 'no scene'

    def _have_done(self, name: str, act: Callable[[], str]) -> TransitionCallbackReturn:
        return self._wait_for(lambda answer: self.commands.call(Command(name, act, answer)))

    def _wait_for(self, begin: Callable[[Callable[[bool, str], None]], None]
                  ) -> TransitionCallbackReturn:
        """Begin with something and wait for its end; rclpy has no transitions that are awaited."""
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
            if success:
                return TransitionCallbackReturn.SUCCESS
            self.get_logger().error(message)
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.ERROR
