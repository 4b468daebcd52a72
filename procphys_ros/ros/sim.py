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


"""Executable `sim`: runs the node."""

from collections.abc import Callable
import gc
from importlib import import_module
import os
import signal
import sys
from typing import Any

from procphys_ros import __version__
from procphys_ros.terminal.argument_parser import split_words
from procphys_ros.terminal.interruption import raising

_USAGE = """\
usage: {name} [--help] [--version] [--ros-args ...]

Simulate a scene of trees and buildings, and show it on ROS topics{more}.

  {name:<54}  the demo
  {garden:<54}  another scene
  {name} --ros-args --params-file FILE -p wind.velocity:='[12.0, 0.0, 0.0]'
  {name} --ros-args --params-file FILE -r __node:=east --log-level debug

All topics and services are in docs/node.md, all parameters in docs/parameters.md;
a running node lists them to `ros2 node info /sim` and `ros2 param describe /sim NAME`,
or to `command`.
exit codes: 0 told to stop, 1 the scene cannot be read, 2 invalid usage
"""
_GARDEN = '--ros-args --params-file config/garden.yaml'
_MORE = {'managed_sim': ';\na managed node: it builds the scene when it is configured, and time '
                        'passes while it is active'}


def main(args: list[str] | None = None, kind: str = 'procphys_ros.ros.node:SimNode',
         name: str = 'sim') -> int:
    """
    Run the node until it is stopped.

    :param args: command line, with ROS arguments; None = the process's own.
    :param kind: module and name of the node's class.
    :param name: of the executable.
    :returns: exit code: 0 when stopped, 1 if the scene cannot be read, 2 for invalid usage.
    """
    words, _ = split_words(sys.argv[1:] if args is None else args)
    if words and words != ['--']:
        return _answer(words, name)
    # rclpy handles signals once it is started. Importing takes a second or more, and a signal
    # must end the process as cleanly in that time; so the imports come after this. Nothing is
    # open yet, and an exception might be caught by any code being imported.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    run, node = _import(kind)
    signal.signal(signal.SIGTERM, raising(SystemExit))
    signal.signal(signal.SIGINT, raising(KeyboardInterrupt))
    return run(args, node)


def _import(kind: str) -> tuple[Callable[..., int], Any]:
    """
    Import the function that runs the node, and its class.

    Module contents are excluded from garbage collection: scanning them would take a tenth of the
    time, and later some of that of steps.
    """
    gc.disable()
    from procphys_ros.ros.running import run
    module, _, name = kind.partition(':')
    node = getattr(import_module(module), name)
    gc.freeze()
    gc.enable()
    return run, node


def _answer(words: list[str], name: str) -> int:
    """Handle the options that need no node, and reject all others."""
    if words[0] in ('-h', '--help'):
        print(_USAGE.format(name=name, more=_MORE.get(name, ''), garden=f'{name} {_GARDEN}'),
              end='')
        return 0
    if words[0] == '--version':
        print(f'procphys_ros {__version__}')
        return 0
    print(f'{name}: it takes no argument "{words[0]}"; a scene is given with --ros-args '
          '--params-file FILE (--help says more)', file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
