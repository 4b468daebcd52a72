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

# [s] after the arrival. A subscriber that is discovered before it has discovered this publisher
# misses the first message, on a busy machine also one a second later.
_TELLING = (0.0, 1.0, 5.0)


class LateJoinerTracker:
    """
    Detect when new subscribers of one topic need its full state.

    The middleware reports new subscribers. Counting them would miss one that comes while another
    leaves.

    :param clock: returns steady real time [s].
    :ivar events: for `create_publisher`.
    """

    def __init__(self, clock: Callable[[], float] = monotonic):
        self.events = PublisherEventCallbacks(matched=self.note)
        self._clock = clock
        self._due: list[float] = []

    def note(self, event: QoSPublisherMatchedInfo) -> None:
        """Record a change of subscribers; in the ROS thread."""
        if event.total_count_change > 0:
            now = self._clock()
            self._due = [now + wait for wait in _TELLING]

    def are_waiting(self) -> bool:
        """Return whether the full state is due, and clear that; in the simulation thread."""
        due = self._due  # the other thread replaces it as a whole
        if not _has_begun(due, self._clock()):
            return False
        del due[0]
        return True

    @property
    def would_be_told(self) -> bool:
        """Return whether `are_waiting` would return True now."""
        return _has_begun(self._due, self._clock())


def _has_begun(due: list[float], now: float) -> bool:
    return bool(due) and now >= due[0]
