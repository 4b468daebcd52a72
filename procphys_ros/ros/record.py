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

"""Executable `record`: what a running node publishes, into a file."""

from collections.abc import Sequence
from pathlib import Path
import signal
import sys

from procphys_ros.errors import ProcPhysError
from procphys_ros.terminal.argument_parser import node, OneLineParser, positive, split_words

_DONE, _FAILED, _NOT_FOUND = 0, 1, 3  # the parser itself ends with 2
_TIMEOUT = 10.0  # [s]


def main(words: Sequence[str] | None = None) -> int:
    """
    Record until Ctrl-C, until the time is up, or until the disk is full.

    :param words: after the command's name; None = the process's own.
    :returns: exit code: 0 done, 1 the file cannot be written, 2 invalid usage, 3 no node found.
    """
    own, for_ros = split_words(sys.argv[1:] if words is None else words)
    said = _parser().parse_args(own)
    ended: list[int] = []
    # Late, because it takes seconds, which help and usage errors need not wait for.
    try:
        from procphys_ros.recording.writer import check_target
        check_target(said.out)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda signum, _: ended.append(signum))
        from procphys_ros.ros import node_recorder
        print(node_recorder.record(said, for_ros, lambda: bool(ended)))
    except ProcPhysError as error:
        print(f'record: {error}', file=sys.stderr)
        return _FAILED
    except LookupError as error:
        print(f'record: {error.args[0]}', file=sys.stderr)
        return _NOT_FOUND
    return _DONE


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog='record', description='Record what a running node publishes, until Ctrl-C.')
    parser.add_argument('--out', required=True, type=Path, help='file to write (.mcap)')
    parser.add_argument('--node', type=node, default='/sim', help='the node (default /sim)')
    parser.add_argument('--seconds', type=positive, help='when to stop [s]; not given = never')
    parser.add_argument('--timeout', type=positive, default=_TIMEOUT,
                        help=f'how long to look for the node [s] (default {_TIMEOUT:g})')
    return parser


if __name__ == '__main__':
    sys.exit(main())
