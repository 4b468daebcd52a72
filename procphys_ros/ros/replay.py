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

"""Executable `replay`: a recording, published again."""

from collections.abc import Sequence
from pathlib import Path
import signal
import sys

from procphys_ros.errors import ProcPhysError, RecordingError
from procphys_ros.terminal.argument_parser import number, OneLineParser, positive, split_words

_DONE, _FAILED = 0, 1  # the parser itself ends with 2


def main(words: Sequence[str] | None = None) -> int:
    """
    Publish a recording.

    :param words: after the command's name; None = the process's own.
    :returns: exit code: 0 done, 1 the file cannot be read, 2 invalid usage.
    """
    own, for_ros = split_words(sys.argv[1:] if words is None else words)
    said = _parser().parse_args(own)
    ended: list[int] = []
    # Late, because it takes seconds, which help and usage errors need not wait for.
    try:
        from procphys_ros.recording.recording import Recording
        recording = Recording(said.file)
        if not 0.0 <= said.start <= recording.duration:
            raise RecordingError(f'--from is {said.start:g} s, the recording lasts '
                                 f'{recording.duration:.1f} s')
        for which in (signal.SIGINT, signal.SIGTERM):
            signal.signal(which, lambda signum, _: ended.append(signum))
        from procphys_ros.ros import replayer
        replayer.replay(recording, said, for_ros, lambda: bool(ended))
    except ProcPhysError as error:
        print(f'replay: {error}', file=sys.stderr)
        return _FAILED
    return _DONE


def _parser() -> OneLineParser:
    parser = OneLineParser(prog='replay', description='Publish a recording again.')
    parser.add_argument('file', type=Path, help='recording (.mcap)')
    parser.add_argument('--from', dest='start', type=number, default=0.0, metavar='SECONDS',
                        help='where to begin [s]')
    parser.add_argument('--rate', type=positive, default=1.0, help='times the speed (default 1)')
    parser.add_argument('--loop', action='store_true', help='begin again at the end')
    return parser


if __name__ == '__main__':
    sys.exit(main())
