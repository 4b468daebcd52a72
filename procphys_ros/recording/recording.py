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

"""Recording: a file of messages that can be opened at any moment."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from procphys_ros.errors import RecordingError
from procphys_ros.recording.library import load_mcap

FULL_EVERY = 1.0  # [s] between full sets of markers and poses: how far back a viewer must look
# Topics published on changes: the last message before a moment is valid then.
_LASTING = ('/scene_description', '/ground')
# Topics that only periodic full sets complete: see `FULL_EVERY`.
_REPEATED = ('/markers', '/poses')
_SLACK = 1.5  # full sets may come late by half their period


@dataclass(frozen=True)
class Message:
    """
    One recorded message.

    :ivar topic: its full name.
    :ivar kind: its type, such as geometry_msgs/msg/PoseArray.
    :ivar data: CDR with its encapsulation.
    :ivar at: time of the recording [ns].
    """

    topic: str
    kind: str
    data: bytes
    at: int


class Recording:
    """
    Read an MCAP file of ROS 2 messages.

    :param path: the file.
    :ivar topics: type of each topic by its name.
    :ivar start: time of the first message [ns].
    :ivar end: time of the last one [ns].
    :raises RecordingError: if it cannot be read, or was not finished.
    """

    def __init__(self, path: str | Path):
        self._path = Path(path)
        make_reader = load_mcap().make_reader
        try:
            self._file = self._path.open('rb')
        except OSError as error:
            raise RecordingError(f'"{path}" cannot be read: {error.strerror}') from error
        try:
            self._reader = make_reader(self._file)
            summary = self._reader.get_summary()
        except Exception as error:  # any error of the reader on a broken file
            reason = str(error) or type(error).__name__
            raise RecordingError(f'"{path}" is no complete recording ({reason}); '
                                 '"mcap recover" may help') from error
        if summary is None or summary.statistics is None:
            raise RecordingError(f'"{path}" has no index; "mcap recover" makes one')
        self.topics = {c.topic: summary.schemas[c.schema_id].name
                       for c in summary.channels.values() if c.message_encoding == 'cdr'
                       and c.schema_id in summary.schemas}
        self.start = summary.statistics.message_start_time
        self.end = summary.statistics.message_end_time

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def duration(self) -> float:
        """Return the time from the first message to the last [s]."""
        return (self.end - self.start) * 1e-9

    def messages(self, start: float = 0.0) -> Iterator[Message]:
        """
        Yield the messages from a moment on, in the order of time.

        :param start: since the beginning [s].
        :raises RecordingError: if the file is damaged.
        """
        yield from self._read(self.start + round(start * 1e9), None, list(self.topics))

    def state_at(self, start: float) -> list[Message]:
        """
        Return the messages, in order, that show a moment without earlier ones.

        :param start: time of the moment, since the beginning [s].
        """
        moment = self.start + round(start * 1e9)
        lasting = [t for t in self.topics if t.endswith(_LASTING)]
        repeated = [t for t in self.topics if t.endswith(_REPEATED)]
        newest = {m.topic: m for m in self._read(self.start, moment, lasting)}
        since = max(self.start, moment - round(_SLACK * FULL_EVERY * 1e9))
        return [*newest.values(), *self._read(since, moment, repeated)]

    def _read(self, start: int, end: int | None, topics: list[str]) -> Iterator[Message]:
        if not topics:
            return
        try:
            for schema, channel, message in self._reader.iter_messages(
                    topics, starting_at=start, ending_before=end):
                yield Message(channel.topic, schema.name, message.data, message.log_time)
        except Exception as error:  # as above
            raise RecordingError(f'"{self._path}" is damaged: '
                                 f'{str(error) or type(error).__name__}') from error
