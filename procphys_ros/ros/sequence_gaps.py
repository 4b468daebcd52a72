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
    Count the missing messages in the sequence numbers of publishers.

    A full reader drops its oldest messages silently, and so does a publisher whose depth is
    exceeded. Messages do not identify their publisher. If two streams are confused, the total
    number of missing messages stays the same, since it depends only on the first and the last
    number of each.
    """

    def __init__(self) -> None:
        self._last: list[int] = []  # last number of each stream, the most recent at the end

    def missing(self, number: int, publishers: int) -> int:
        """
        Record a message, and return the number of missing messages of its publisher before it.

        :param number: its sequence number, counted from 1.
        :param publishers: their present number; the first message of each has none before it.
        """
        last = self._last
        if number - 1 in last:
            last.remove(number - 1)
        else:
            del last[:max(len(last) - publishers, 0)]  # their publishers have gone
            before = max((known for known in last if known < number), default=0)
            if before and len(last) >= publishers:
                last.remove(before)
                last.append(number)
                return number - before - 1
        last.append(number)
        return 0
