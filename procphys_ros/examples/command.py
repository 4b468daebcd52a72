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


"""Command `examples`: list the shipped scenes and programs, and run one."""

from collections.abc import Sequence
from importlib import import_module
import shutil
import sys
from textwrap import fill

from procphys_ros.errors import ProcPhysError
from procphys_ros.examples.catalogue import Example, examples, find
from procphys_ros.ros import view
from procphys_ros.terminal.argument_parser import OneLineParser

_FAILED = 1  # the parser itself ends with 2
_WIDEST = 99  # columns
_NARROWEST = 60


def main(words: Sequence[str] | None = None) -> int:
    """
    List the examples, or run one: a scene with its page open until Ctrl-C, a program to its end.

    :param words: after the command's name; None = the process's own.
    :returns: exit code: 0 done, 1 no such example, or no page for it, 2 invalid usage.
    """
    said, others = _parser().parse_known_args(sys.argv[1:] if words is None else list(words))
    if said.name is None:
        if others:
            _parser().error(f'unrecognized arguments: {" ".join(others)}')
        print(listing())
        return 0
    try:
        return _run(find(said.name), others)
    except ProcPhysError as error:
        print(f'examples: {error}', file=sys.stderr)
        return _FAILED


def listing() -> str:
    """Return the title and the cues of every example, as text."""
    known = examples()
    width = max(map(len, known)) + 2
    columns = min(_WIDEST, max(_NARROWEST, shutil.get_terminal_size().columns))
    lines = []
    for example in known.values():
        cues = f' ({_cues(example)})' if example.cues else ''
        lines.append(fill(example.title + cues, columns,
                          initial_indent=example.name.ljust(width), subsequent_indent=' ' * width))
    return '\n'.join([*lines, '', 'Run one:  examples NAME'])


def _cues(example: Example) -> str:
    times: dict[str, list[str]] = {}
    for cue in example.cues:
        time, command, *_ = cue.split()
        times.setdefault(command, []).append(time)
    return '; '.join(f'{command} at {", ".join(at)} s' for command, at in times.items())


def _run(example: Example, others: Sequence[str]) -> int:
    if example.is_scene:
        return view.main([str(example.path), '--open', *others])
    if others:
        _parser().error(f'{example.name} takes no arguments: {" ".join(others)}')
    import_module(f'procphys_ros.examples.{example.name}').main()
    return 0


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog='examples', allow_abbrev=False,
        description='List the scenes and programs that come with procphys_ros, or run one.',
        epilog='Options of `view` may follow the name of a scene, such as --port 9000.')
    parser.add_argument('name', nargs='?', help='which one to run; none = list all')
    return parser


if __name__ == '__main__':
    sys.exit(main())
