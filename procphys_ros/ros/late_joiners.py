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


"""Late joiners: when new subscribers of a topic need its full state."""

from collections.abc import Callable
from time import monotonic

from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo

# [s] after the arrival. Who is known here before it knows this publisher misses what is said at
# once, on a busy machine also what is said a second later.
_TELLING = (0.0, 1.0, 5.0)


class LateJoinerTracker:
    """
    Tells when new subscribers of one topic need its full state.

    The middleware says who comes. To count subscribers would not do: one that comes while another
    goes would be missed.

    :param clock: gives steady real time [s].
    :ivar events: for `create_publisher`.
    """

    def __init__(self, clock: Callable[[], float] = monotonic):
        self.events = PublisherEventCallbacks(matched=self.note)
        self._clock = clock
        self._due: list[float] = []

    def note(self, event: QoSPublisherMatchedInfo) -> None:
        """Take up that subscribers have come or gone; in the thread that talks to ROS."""
        if event.total_count_change > 0:
            now = self._clock()
            self._due = [now + wait for wait in _TELLING]

    def are_waiting(self) -> bool:
        """Return whether it is time to tell everything; in the thread that simulates."""
        due = self._due  # the other thread replaces it as a whole
        if not _has_begun(due, self._clock()):
            return False
        del due[0]
        return True

    @property
    def would_be_told(self) -> bool:
        """Return whether `are_waiting` would say so now."""
        return _has_begun(self._due, self._clock())


def _has_begun(due: list[float], now: float) -> bool:
    return bool(due) and now >= due[0]
