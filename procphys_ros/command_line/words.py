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


"""Syntax of the command-line client: verbs, their arguments and their help."""

import argparse
from collections.abc import Sequence
import re

from procphys_ros.terminal.argument_parser import (
    count,
    node,
    number,
    OneLineParser,
    positive,
    whole,
)

EXIT_CODES = """\
exit codes: 0 done, 1 refused by the node (it says why), 2 invalid usage,
3 no node found"""
_NUMBER = re.compile(r'-(\d+\.?\d*|\.\d+|inf|nan)([eE][+-]?\d+)?\Z')
_REACH = {'node': '/sim', 'timeout': 5.0}
_ALONE = {'warm', 'completion'}  # verbs that need no node
_EXAMPLES = """\
examples:
  command wind 12 0 0
  command impulse oak_0/17 0 300 0
  command explode 3 2 0.5 --charge 5
  command launch --from 0 -20 2 --velocity 0 25 0 --mass 40
  command list 'oak*'
  command watch
  command --node /east explode 3 2 0.5 --ros-args -r /east/explosion:=/world/explosion
"""


def read(words: Sequence[str] | None = None) -> argparse.Namespace:
    """
    Parse the words after the command's name; print help or an error and exit if required.

    :param words: None = the process's own.
    :returns: `verb`, and its arguments; `node` and `timeout` in any case.
    :raises SystemExit: with code 0 for help, 2 for invalid usage.
    """
    parser, _ = _grown()
    said = parser.parse_args(words)
    if said.verb == 'wind' and [type(w) for w in said.velocity] not in ([float] * 3, [bool]):
        parser.error('wind takes three numbers [m/s], or "on", or "off"')
    return said


class _Parser(OneLineParser):
    """Parser that treats every number as a value, in any notation, never as an option."""

    def __init__(self, **keywords):
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter,
                         allow_abbrev=False, **keywords)
        self._negative_number_matcher = _NUMBER


def verbs() -> list[str]:
    """List the verbs in the order of the help."""
    return list(_grown()[1])


def options(verb: str) -> list[str]:
    """List the options of a verb; those of the command itself if there is no such verb."""
    parser, verb_parsers = _grown()
    return sorted(set(re.findall(r'--[a-z]+', verb_parsers.get(verb, parser).format_usage())))


def _grown() -> tuple['_Parser', dict[str, '_Parser']]:
    """Make the parser, and return it with those of its verbs."""
    parser = _Parser(prog='command', description='Talk to a running simulation.',
                     epilog=f'{_EXAMPLES}\n{EXIT_CODES}')
    parser.set_defaults(**_REACH)
    _add_reach(parser)
    group = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    _add_loads(group)
    _add_damage(group)
    _add_snow(group)
    _add_growth(group)
    _add_time(group)
    _add_looks(group)
    for verb in group.choices.keys() - _ALONE:
        _add_reach(group.choices[verb])
    return parser, group.choices


def _add_reach(parser: argparse.ArgumentParser) -> None:
    """Add the options that select the node: before the verb or after it."""
    parser.add_argument('--node', type=node, default=argparse.SUPPRESS, metavar='NAME',
                        help=f'the node to talk to (default {_REACH["node"]})')
    parser.add_argument('--timeout', type=positive, default=argparse.SUPPRESS, metavar='S',
                        help='how long to look for it, and to wait for its answers, for these two '
                        f'minutes at least [s] (default {_REACH["timeout"]})')


def _add_loads(group) -> None:
    """Add the verbs that load and move parts."""
    wind = group.add_parser('wind', help='set the mean wind, or switch it on and off',
                            description='Set the mean wind, the way it blows to [m/s], or say '
                                        '"on" or "off".', epilog='example: command wind 12 0 0')
    wind.add_argument('velocity', type=_wind, nargs='+', metavar='X Y Z|on|off')
    gust = group.add_parser('gust', help='send one gust through the scene')
    gust.add_argument('--amplitude', type=number, metavar='M/S', help='change at its peak')
    gust.add_argument('--duration', type=positive, metavar='S')
    _vector(gust, '--direction', 'where it blows to; along the wind if not given')
    for verb, what, unit in (('impulse', 'strike a part once', 'N·s'),
                             ('wrench', 'push a part until "clear"', 'N')):
        part = group.add_parser(verb, help=what,
                                description=f'{what.capitalize()}, at its centre of mass.',
                                epilog=f'example: command {verb} oak_0/17 0 300 0')
        part.add_argument('part', help='such as oak_0/17, oak_0/segment_17, or an index')
        for axis in 'xyz':
            part.add_argument(axis, type=number, help=f'[{unit}]')
        _vector(part, '--angular', f'about the axes [{unit[0]}·m{unit[1:]}]', (0.0, 0.0, 0.0))
    group.add_parser('clear', help='end all lasting pushes')
    rotors = group.add_parser('downwash', help="set the thrust of an intruder's rotors, which "
                              'drive air the other way', epilog='example: command downwash 0 0 20')
    for axis in 'xyz':
        rotors.add_argument(axis, type=number, help='[N], in the frame of the intruder')
    rotors.add_argument('--name', default='', help='of the intruder; that of intruder.* if not '
                        'given')
    joint = group.add_parser('joint', help='drive a joint of a mechanism', epilog=(
        'example: command joint crane/slew velocity 0.2'))
    joint.add_argument('joint', help='<object>/<joint>, as on ~/joint_states')
    joint.add_argument('mode', choices=('position', 'velocity', 'effort'))
    joint.add_argument('value', type=number, help='[m] or [rad], [m/s] or [rad/s], [N] or [N·m]')


def _add_damage(group) -> None:
    """Add the verbs that break parts."""
    explode = group.add_parser('explode', help='set off a charge',
                               epilog='example: command explode 3 2 0.5 --charge 5')
    for axis in 'xyz':
        explode.add_argument(axis, type=number, help='[m]')
    explode.add_argument('--charge', type=positive, metavar='KG', help='mass of TNT')
    launch = group.add_parser('launch', help='throw a ball or a block', epilog=(
        'What is not given is as in the last throw.\n'
        'example: command launch --from 0 -20 2 --velocity 0 25 0 --mass 40'))
    launch.add_argument('--shape', choices=('sphere', 'box'))
    launch.add_argument('--size', type=positive, nargs='+', metavar='M',
                        help='diameter of a ball, or the three edges of a block [m]')
    launch.add_argument('--mass', type=positive, metavar='KG')
    _vector(launch, '--from', 'where it starts [m]', dest='position')
    _vector(launch, '--velocity', 'how fast it starts [m/s]')
    saw = group.add_parser('cut', help='saw a branch off, a brick out, or through an object',
                           epilog='examples: command cut oak_0/17\n'
                           '          command cut pine_0 --point 0 0 1 --normal 0 0 1')
    saw.add_argument('target', metavar='part',
                     help='such as oak_0/17; or an object, which takes a plane')
    _vector(saw, '--point', 'on the plane of the cut [m]', (0.0, 0.0, 0.0))
    _vector(saw, '--normal', 'of that plane; none = all that holds the part', (0.0, 0.0, 0.0))
    saw.add_argument('--reach', type=positive, default=100.0, metavar='M',
                     help='of the blade from that point [m]')
    saw.add_argument('--hinge', type=number, default=0.0, metavar='M',
                     help='width of the wood that is left to a tree, over which it falls')
    _vector(saw, '--towards', 'where it falls', (0.0, 0.0, 0.0))
    quake = group.add_parser('earthquake', help='shake the ground', epilog=(
        'What is not given is as in the last one.\n'
        'example: command earthquake --peak 4 --duration 20'))
    quake.add_argument('--peak', type=positive, metavar='M/S2',
                       help='greatest acceleration, without ground.motion')
    quake.add_argument('--duration', type=positive, metavar='S', help='likewise')
    quake.add_argument('--scale', type=number, metavar='F', help='of ground.motion')
    quake.add_argument('--start', type=number, metavar='S', help='of it, that is left out')
    _vector(quake, '--direction', 'of the strongest shaking; level')
    group.add_parser('demolish', help='start the timed charges of demolition.*')


def _add_snow(group) -> None:
    """Add the verb for snow and ice."""
    load = group.add_parser('load', help='let snow and ice lie on trees and buildings', epilog=(
        'What is not given stays as it is.\n'
        'example: command load --snow 40 --ramp 20'))
    load.add_argument('--snow', type=number, metavar='KG/M2', help='on open ground')
    load.add_argument('--ice', type=number, metavar='M', help='thickness of the coat of twigs')
    load.add_argument('--ramp', type=number, metavar='S', help='in which the change comes about')


def _add_growth(group) -> None:
    """Add the verb for plants."""
    grow = group.add_parser('grow', help='let plants grow on, or stop them', epilog=(
        'What is not given is as in the last call.\n'
        'example: command grow oak --rate 0.5 --years 10'))
    grow.add_argument('target', nargs='?', default='', metavar='PLANT',
                      help='an object, or all called PLANT_0, PLANT_1, …; all plants if not given')
    grow.add_argument('--rate', type=number, metavar='YEARS/S',
                      help='years, steps of the grammar, in a second; 0 = they stop as they are')
    grow.add_argument('--years', type=whole, metavar='N',
                      help='after which they stop, counted from the end of the present one')


def _add_time(group) -> None:
    """Add the verbs for time and the scene."""
    group.add_parser('pause', help='let simulated time stand still')
    group.add_parser('resume', help='let it go on')
    step = group.add_parser('step', help='one or more time steps, while paused')
    step.add_argument('count', type=count, nargs='?', default=1, metavar='N')
    group.add_parser('reset', help='the same scene from the start')
    group.add_parser('reload', help='build the scene anew from the present parameters')
    spawn = group.add_parser('spawn', help='let an object join the scene', epilog=(
        'It stays until "remove"; "reset" puts it back to where it was spawned.\n'
        'example: command spawn oak.lsys 10 4 0 --seed 7 --define height=6'))
    spawn.add_argument('grammar', help='file in grammars/, or a path')
    for axis in 'xyz':
        spawn.add_argument(axis, type=number, nargs='?', default=0.0, help='[m]')
    spawn.add_argument('--name', default='', help='of the object; a free one if not given')
    spawn.add_argument('--yaw', type=number, default=0.0, metavar='RAD')
    spawn.add_argument('--seed', type=whole, default=0, metavar='N')
    spawn.add_argument('--define', action='append', default=[], metavar='NAME=NUMBER',
                       help='overrides a value of the grammar; may be given several times')
    remove = group.add_parser('remove', help='take an object out of the scene')
    remove.add_argument('name', help='such as oak_0')
    get = group.add_parser('get', help='show parameters', epilog='example: command get wind.')
    get.add_argument('name', nargs='?', default='', help='name, or how names begin; all if none')
    put = group.add_parser('set', help='change a parameter',
                           epilog='example: command set gust.duration 3')
    put.add_argument('name')
    put.add_argument('value', nargs='+',
                     help='number, word, or the numbers or texts of a list, such as [oak, pine]')


def _add_looks(group) -> None:
    """Add the verbs that only show information."""
    listing = group.add_parser('list', help='objects, or the parts of some', epilog=(
        "examples: command list    command list 'oak_*'    command list house/pane"))
    listing.add_argument('pattern', nargs='?', default='', metavar='OBJECT[/PART]',
                         help='name, with * and ? for anything; a part by kind or index')
    watch = group.add_parser('watch', help='follow time, speed, wind and breaks until Ctrl-C')
    watch.add_argument('--seconds', type=positive, metavar='S', help='stop after so long')
    group.add_parser('warm', help='compile all kernels of this installation beforehand',
                     description='Compile all kernels beforehand, so that no node of this '
                                 'installation waits for them; needs no running node.')
    completion = group.add_parser('completion', help='print what makes the TAB key work',
                                  epilog='in ~/.bashrc: eval "$(command completion bash)", with '
                                         'the path of this command')
    completion.add_argument('shell', choices=('bash', 'zsh'))


def _vector(parser: argparse.ArgumentParser, name: str, what: str, default=None,
            dest: str | None = None) -> None:
    parser.add_argument(name, type=number, nargs=3, metavar=('X', 'Y', 'Z'), help=what,
                        default=default, dest=dest)


def _wind(text: str) -> float | bool:
    return text == 'on' if text in ('on', 'off') else number(text)
