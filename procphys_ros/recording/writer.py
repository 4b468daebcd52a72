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

"""Writer: write messages into an MCAP file until the disk is full."""

from pathlib import Path
import shutil
from time import monotonic
from typing import Self

from procphys_ros.errors import RecordingError
from procphys_ros.files.output_files import lock, obstacle
from procphys_ros.recording.definitions import definition
from procphys_ros.recording.library import load_mcap

# Several frames of a large scene: resting parts in it cost nothing.
_CHUNK = 4 * 1024 * 1024   # [bytes] before compression
RESERVE = 32 * 1024 * 1024  # [bytes] of free disk at which a recording ends, to fit its index
_LONGEST = 5.0  # [s] of a chunk: the loss of a killed process
_CHECK_EVERY = _CHUNK       # [bytes] written between two checks of the disk


class McapWriter:
    """
    Write messages with their definitions, compressed with zstd.

    :param path: file to write; an existing one is replaced.
    :ivar messages: number of written messages.
    :raises RecordingError: if it cannot be written, or the package mcap is missing.
    """

    def __init__(self, path: str | Path):
        self.path, self.messages = Path(path), 0
        check_target(self.path)
        mcap = load_mcap()
        try:
            self._file = self.path.open('ab')
            if not lock(self._file):
                self._file.close()
                raise RecordingError(f'"{path}" cannot be written: another recording goes '
                                     'into it')
            self._file.seek(0)
            self._file.truncate()
        except OSError as error:
            raise RecordingError(f'"{path}" cannot be written: {error.strerror}') from error
        self._open, self._unchecked, self._saved = True, 0, monotonic()
        self._writer = mcap.Writer(self._file, chunk_size=_CHUNK,
                                   compression=mcap.CompressionType.ZSTD)
        self._writer.start(profile='ros2', library='procphys_ros')
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequence: dict[str, int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def write(self, topic: str, kind: str, data: bytes, at: int, published: int | None = None,
              ) -> None:
        """
        Write a message.

        :param topic: its full name.
        :param kind: its type, one of `definitions.KINDS`.
        :param data: CDR with its encapsulation.
        :param at: time in the index [ns].
        :param published: time of publication [ns]; None = the same.
        :raises RecordingError: if the disk is full; the recording ends then, and earlier messages
            can be read.
        """
        if not self._open:
            raise RecordingError(f'"{self.path}" has ended')
        try:
            if self._unchecked >= _CHECK_EVERY:
                self._unchecked = 0
                _check_room(self.path)
            self._sequence[topic] = self._sequence.get(topic, -1) + 1
            self._writer.add_message(self._channel(topic, kind), at, data,
                                     at if published is None else published,
                                     self._sequence[topic])
            self._save()
        except RecordingError:
            self.close()
            raise
        except OSError as error:
            self._abandon(error)
        self._unchecked += len(data)
        self.messages += 1

    def close(self) -> None:
        """
        Write the index and close the file; may be called again.

        :raises RecordingError: if the disk has no space for the index.
        """
        if not self._open:
            return
        try:
            self._writer.finish()
            self._open = False
            self._file.close()
        except OSError as error:
            self._abandon(error)

    def _save(self) -> None:
        """Flush a chunk to the disk regularly, even if it fills slowly."""
        if monotonic() - self._saved > _LONGEST:
            self._saved = monotonic()
            self._writer.flush()

    def _channel(self, topic: str, kind: str) -> int:
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, 'ros2msg',
                                                               definition(kind).encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, 'cdr',
                                                                  self._schemas[kind])
        return self._channels[topic]

    def _abandon(self, error: OSError) -> None:
        """End immediately, without an index."""
        self._open = False
        try:
            self._file.close()
        except OSError:
            pass  # the same error again: the data still buffered by Python are lost
        raise RecordingError(f'"{self.path}" cannot be written any further: {error.strerror}; '
                             '"mcap recover" makes it readable') from error


def check_target(path: Path) -> None:
    """
    Validate the path of a recording, before any work for it.

    :raises RecordingError: if its suffix is wrong, its folder missing, or its disk full.
    """
    if path.suffix != '.mcap':
        raise RecordingError(f'"{path}": a recording must end in .mcap')
    if reason := obstacle(path, beside=False):
        raise RecordingError(f'"{path}" cannot be written: {reason}')
    _check_room(path)


def _check_room(path: Path) -> None:
    free = shutil.disk_usage(path.parent).free
    if free < RESERVE:
        raise RecordingError(f'the disk of "{path}" is full: {free / 1e6:.0f} MB are left, and a '
                             f'recording leaves {RESERVE / 1e6:.0f} MB')
