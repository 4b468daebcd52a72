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


"""Loop: the simulation thread; another thread serves ROS."""

from collections.abc import Callable
from threading import Event, Thread

from rclpy.context import Context
from rclpy.task import Future

from procphys_ros import progress
from procphys_ros.ros.activity import Activity


class Loop:
    """
    Call a function repeatedly in a separate thread.

    The function runs in one thread only, so its data need no locks. An exception in it ends the
    loop and is raised by `ended`, for the thread that spins the node.

    :param turn: function to call; returns the time until its next call [s].
    :param context: after its shutdown, errors of the turn are ignored.
    :ivar ended: future that is done after an error that ends the node; its result raises it.
    :ivar activity: long work of the loop.
    """

    def __init__(self, turn: Callable[[], float], context: Context):
        self.activity = Activity()
        self._turn = turn
        self._context = context
        self._woken = Event()
        self._stopped = False
        self._thread = Thread(target=self._run, name='simulation', daemon=True)
        self.ended = Future()

    def start(self) -> None:
        """Start the loop."""
        self._thread.start()

    def wake(self) -> None:
        """Start the next turn now."""
        self._woken.set()

    def fail(self, error: Exception) -> None:
        """End the node with an error."""
        if not self.ended.done():
            self.ended.set_exception(error)

    def stop(self, patience: float) -> bool:
        """End after the present turn, wait some time [s], and return whether it has ended."""
        self._stopped = True
        self.wake()
        if self._thread.is_alive():
            self._thread.join(patience)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            with progress.reported_to(self.activity):
                while not self._stopped:
                    self._woken.clear()
                    self._woken.wait(self._turn())
        except Exception as error:
            if self._context.ok():
                self.fail(error)
