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
    Calls a function over and over in a thread of its own.

    The function belongs to one thread only, so what it works on needs no locks. Whatever goes
    wrong in it ends the loop and comes out of `ended`, for whoever spins the node to see.

    :param turn: what to call; gives the time until it wants to be called again [s].
    :param context: once it has been shut down, errors of the turn mean nothing any more.
    :ivar ended: is done when something went wrong that ends the node; its result raises it.
    :ivar activity: what it does that takes long.
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
        """Start taking turns."""
        self._thread.start()

    def wake(self) -> None:
        """Start the next turn now."""
        self._woken.set()

    def fail(self, error: Exception) -> None:
        """End the node with an error."""
        if not self.ended.done():
            self.ended.set_exception(error)

    def stop(self, patience: float) -> bool:
        """End after the present turn, wait some time [s] for that, and say whether it has."""
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
