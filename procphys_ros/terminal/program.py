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


"""
Program: runs a command so that Ctrl-C ends it with one line, even while its modules load.

This module imports nothing that takes long. Exit code 130 is the shells' for SIGINT.
"""

from collections.abc import Sequence
from functools import partial
from importlib import import_module
import io
import os
import select
import signal
import sys
from typing import NoReturn

from procphys_ros import __version__
from procphys_ros.terminal.interruption import raising

INTERRUPTED = 130
COMMANDS = {
    'batch': 'procphys_ros.batch.command',
    'command': 'procphys_ros.ros.command',
    'examples': 'procphys_ros.examples.command',
    'export': 'procphys_ros.export.command',
    'map': 'procphys_ros.maps.command',
    'record': 'procphys_ros.ros.record',
    'render': 'procphys_ros.render.command',
    'replay': 'procphys_ros.ros.replay',
    'view': 'procphys_ros.ros.view',
    'warm': 'procphys_ros.warming.command',
}
NODES = {  # these end with code 0 on Ctrl-C
    'sim': 'procphys_ros.ros.sim',
    'managed_sim': 'procphys_ros.ros.managed_sim',
}


def run(name: str, words: Sequence[str] | None = None) -> int:
    """
    Run a command.

    :param name: in `COMMANDS`.
    :param words: arguments; None = the process's own.
    :returns: its exit code, 130 when Ctrl-C has ended it.
    """
    heeds = signal.getsignal(signal.SIGINT) is not signal.SIG_IGN  # nohup ignores it
    if heeds:
        # Modules that are half loaded may swallow an exception, and no files are open yet.
        signal.signal(signal.SIGINT, lambda *_: _end(name))
    _print_all_signs()
    main = import_module(COMMANDS[name]).main
    if heeds:
        signal.signal(signal.SIGINT, raising(KeyboardInterrupt))
    try:
        code = main(words)
        if sys.stdout is not None:  # as after >&-
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        if not _has_gone():
            raise  # another pipe broke, which is an error
        _discard_output()
        return 0
    except OSError as error:  # a full disk, or any other error that a command did not foresee
        print(f'{name}: {error}', file=sys.stderr)
        _discard_if_it_fails()
        return 1
    except KeyboardInterrupt:
        print(f'{name}: interrupted', file=sys.stderr)
        return INTERRUPTED


def start(name: str, words: Sequence[str] | None = None) -> int:
    """
    Run a command as the only task of this process; else as `run`.

    When Ctrl-C has ended it, all its files are closed. Finalising the interpreter as well, with
    thousands of compiled kernels, would keep the user waiting for seconds on a busy machine.
    """
    code = run(name, words)
    if code == INTERRUPTED:
        _discard_if_it_fails()
        os._exit(code)
    return code


def main(words: Sequence[str] | None = None) -> int:
    """Run the command named by the first word; return its exit code, 2 for unknown commands."""
    words = sys.argv[1:] if words is None else list(words)
    if words and words[0] in COMMANDS:
        return start(words[0], words[1:])
    if words and words[0] in NODES:
        return import_module(NODES[words[0]]).main(words[1:])
    if words == ['--version']:
        print(f'procphys_ros {__version__}')
        return 0
    names = ','.join(sorted({**COMMANDS, **NODES}))
    print(f'usage: python -m procphys_ros {{{names}}} ...; each tells more after --help',
          file=sys.stdout if words in (['-h'], ['--help']) else sys.stderr)
    return 0 if words in (['-h'], ['--help']) else 2


def _print_all_signs() -> None:
    """Escape characters that the encoding of the output lacks, as stderr does."""
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == 'strict':
        sys.stdout.reconfigure(errors='backslashreplace')


def _has_gone() -> bool:
    """Return whether the reader of the output, such as head, has gone."""
    poll = select.poll()
    poll.register(sys.stdout.fileno(), 0)  # errors are reported in any case
    return bool(poll.poll(0))


def _discard_if_it_fails() -> None:
    """Flush the output; if that fails, discard it, so that the interpreter does not try again."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        _discard_output()


def _discard_output() -> None:
    """Redirect the remaining output to the null device."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _end(name: str) -> NoReturn:
    os.write(2, f'{name}: interrupted\n'.encode())
    os._exit(INTERRUPTED)


batch, command, examples, export, map, record, render, replay, view, warm = (  # noqa: A001
    partial(start, name) for name in COMMANDS)
