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
Compile all kernels, so that no simulation has to wait for them.

`python -m procphys_ros.warm` compiles what the cache of the user lacks, on all cores.
"""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from multiprocessing import active_children, get_context
import os
import signal
import sys
from time import monotonic
from typing import TextIO

from procphys_ros.compilation.overloads import (
    is_complete,
    mark_complete,
    Overload,
    shipped,
    StaleOverload,
)
from procphys_ros.terminal.argument_parser import OneLineParser, whole
from procphys_ros.terminal.program import INTERRUPTED
from procphys_ros.terminal.progress_bar import ProgressBar

_LOW_PRIORITY = 10  # 'nice': of a core that a simulation wants too it gets a tenth, not nothing

Done = tuple[str, bool, str]
"""Name of an overload, whether it was missing, and why it could not be compiled, or ''."""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command.

    :param arguments: words after the command's name; None = the process's own.
    :returns: exit code: 0 all are there, 1 some could not be compiled, 2 invalid usage,
        130 interrupted.
    """
    parser = OneLineParser(
        prog='warm', description='Compile all kernels, so that no simulation waits for them.')
    parser.add_argument('--jobs', type=whole, default=0, metavar='N',
                        help='processes that compile at once; 0 = one per core')
    parser.add_argument('--background', action='store_true',
                        help='help a node that is starting: one process compiles what that '
                             'needs last, then with low priority the rest')
    options = parser.parse_args(arguments)
    if is_complete():
        print('all kernels are compiled')
        return 0
    cores = len(os.sched_getaffinity(0))
    poses, markers, rest = shipped()
    if options.background:
        work = _help([*poses[::-1], *markers], rest, cores)
    else:
        work = _compile([*poses, *markers, *rest], options.jobs or cores)
    try:
        return 0 if warm(work, len(poses) + len(markers) + len(rest), sys.stdout) else 1
    except KeyboardInterrupt:
        print('warm: interrupted', file=sys.stderr)
        return INTERRUPTED


def warm(work: Iterable[Done], count: int, out: TextIO) -> bool:
    """
    Compile what the cache lacks.

    :param work: compiles one overload per step of the iteration.
    :param count: of the overloads.
    :param out: where to show the progress.
    :returns: whether every overload in the list could be compiled.
    """
    began, compiled, faults = monotonic(), 0, []
    with ProgressBar('compiling', out) as bar:
        for done, (name, was_missing, fault) in enumerate(work, 1):
            compiled += was_missing
            if fault:
                faults.append(f'{name} {fault}')
            bar.show(done, count, name)
            if not out.isatty():
                print(f'{done}/{count} {name}', file=out, flush=True)
    for fault in faults:
        print(f'warm: {fault}; it is compiled when it is first called', file=sys.stderr)
    mark_complete()
    print(f'{compiled} of {count} kernels compiled in {monotonic() - began:.0f} s, '
          'the others were there', file=out, flush=True)
    return not faults


def _help(soon: Sequence[Overload], rest: Sequence[Overload], cores: int) -> Iterator[Done]:
    """
    Compile beside a node that is starting.

    The node compiles the kernels of its first poses from the other end; the claims on files
    keep the two from compiling the same. With a single core there is nothing to share.

    :param soon: overloads that the node waits for.
    """
    if cores == 1:
        os.nice(_LOW_PRIORITY)
    yield from map(_compile_one, soon)
    if cores > 1:
        os.nice(_LOW_PRIORITY)
    yield from map(_compile_one, rest)


def _compile(overloads: Sequence[Overload], jobs: int) -> Iterator[Done]:
    """Compile overloads in no particular order."""
    if jobs <= 1:
        yield from map(_compile_one, overloads)
        return
    with ProcessPoolExecutor(jobs, get_context('spawn')) as pool:
        # Workers take over what is blocked: Ctrl-C in a terminal is for this process alone.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        futures: Iterable = [pool.submit(_compile_one, overload) for overload in overloads]
        try:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            for future in as_completed(futures):
                yield future.result()
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                worker.terminate()
            raise


def _compile_one(overload: Overload) -> Done:
    try:
        return str(overload), overload.compile(), ''
    except StaleOverload as error:
        return str(overload), False, str(error)
