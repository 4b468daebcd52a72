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

"""Executable `view`: a page in the browser that shows a scene, or a running node."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from queue import SimpleQueue
import signal
import sys
from typing import Any
import webbrowser

from procphys_ros.errors import ProcPhysError
from procphys_ros.terminal.argument_parser import (
    add_grammar_options,
    node,
    OneLineParser,
    port,
    split_words,
)
from procphys_ros.terminal.warning_lines import print_warning, told_to
from procphys_ros.view.page import HOST, Page, PORT

_DONE, _FAILED = 0, 1  # the parser itself ends with 2


def main(words: Sequence[str] | None = None) -> int:
    """
    Serve a page until Ctrl-C.

    :param words: after the command's name; None = the process's own.
    :returns: exit code: 0 done, 1 the scene or the page is not available, 2 invalid usage.
    """
    own, for_ros = split_words(sys.argv[1:] if words is None else words)
    said = _parser().parse_args(own)
    if said.scene is None and (said.define or said.seed is not None):
        _parser().error('--seed and --define are for a grammar')
    try:
        with told_to(print_warning):
            if said.scene is None:
                with _followed(said.node, for_ros) as source:
                    _serve(source, said, f'node {source.name}')
            else:
                with closing(_played(said)) as source:
                    _serve(source, said, said.scene)
    except ProcPhysError as error:
        print(f'view: {error}', file=sys.stderr)
        return _FAILED
    return _DONE


def _serve(source: Any, said: argparse.Namespace, title: str) -> None:
    # Unlike an Event, it accepts a second signal while the first is handled.
    ended: SimpleQueue[int] = SimpleQueue()
    # Not earlier: building the scene must be interruptible.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda told, _: ended.put(told))
    # Late, like the following: scenes take a second, which help and errors need not wait for.
    from procphys_ros.scene.named import shipped_scenes

    with closing(Page(source, said.host, said.port, shipped_scenes(), said.allow_host)) as page:
        print(f'{page.address} shows {title}; Ctrl-C ends it', flush=True)
        source.start()
        page.start()
        if said.open:
            webbrowser.open(page.address)
        ended.get()


def _played(said: argparse.Namespace) -> Any:
    # Late, because kernels and engines take seconds, which help and errors need not wait for.
    from procphys_ros.scene.named import open_scene, shown_name
    from procphys_ros.simulation import Simulation
    from procphys_ros.view.player import Player

    simulation = Simulation(open_scene(said.scene, said.seed, dict(said.define)))
    return Player(simulation, shown_name(said.scene))


@contextmanager
def _followed(name: str, ros_words: Sequence[str]) -> Iterator[Any]:
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from procphys_ros.ros.followed_node import FollowedNode
    from procphys_ros.ros.starting import start_ros
    start_ros(['view', *ros_words], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with closing(FollowedNode(name)) as node:
            yield node
    finally:
        rclpy.try_shutdown()


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog='view', description='Show a scene on a page in the browser, until Ctrl-C.')
    parser.add_argument('scene', nargs='?', help='scene file (.yaml), name of a shipped scene, '
                        'grammar (.lsys, .wall, .mech, .urdf, .l, .lpy) or scanned tree (.csv, '
                        '.mtg, .ply); none = what a running node publishes')
    parser.add_argument('--node', type=node, default='/sim',
                        help='the node to follow (default /sim)')
    parser.add_argument('--host', default=HOST,
                        help=f'address to serve on (default {HOST}: this machine only; 0.0.0.0 = '
                        'all of its addresses)')
    parser.add_argument('--allow-host', action='append', default=[], metavar='NAME',
                        help='another name under which browsers may ask for the page, such as '
                        'that of a proxy; may be repeated')
    parser.add_argument('--port', type=port, default=PORT, help=f'TCP port (default {PORT})')
    parser.add_argument('--open', action='store_true', help='open the page in the browser')
    add_grammar_options(parser)
    return parser


if __name__ == '__main__':
    sys.exit(main())
