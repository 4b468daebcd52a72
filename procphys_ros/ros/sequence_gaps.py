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

"""Sequence gaps: how many messages of a topic were lost before they could be taken."""


class SequenceGaps:
    """
    Counts the messages that are missing in what publishers numbered.

    A reader that is full drops its oldest messages and tells nobody, and so does a publisher whose
    own depth is full. Messages do not say which publisher they are from. That of two streams one
    is taken for the other does not change the sum of what is missing in both, since it depends on
    the first and the last number of each only.
    """

    def __init__(self) -> None:
        self._last: list[int] = []  # number of each stream, that was heard last at the end

    def missing(self, number: int, publishers: int) -> int:
        """
        Take up a message, and give how many of its publisher are missing before it.

        :param number: that its publisher gave to it, counted from 1.
        :param publishers: how many there are now; what comes first of each has nothing before it.
        """
        last = self._last
        if number - 1 in last:
            last.remove(number - 1)
        else:
            del last[:max(len(last) - publishers, 0)]  # they have gone
            before = max((known for known in last if known < number), default=0)
            if before and len(last) >= publishers:
                last.remove(before)
                last.append(number)
                return number - before - 1
        last.append(number)
        return 0
