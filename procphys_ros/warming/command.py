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

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
import gc
from multiprocessing import active_children, get_context
import os
import signal
import sys
from time import monotonic

from procphys_ros.compilation.folder import is_complete, mark_complete
from procphys_ros.terminal.argument_parser import OneLineParser, whole
from procphys_ros.terminal.interruption import end_with_parent
from procphys_ros.terminal.program import INTERRUPTED
from procphys_ros.terminal.progress_bar import ProgressBar
from procphys_ros.terminal.warning_lines import told_to

_LOW_PRIORITY = 10  # 'nice': of a core that a simulation wants too it gets a tenth, not nothing


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command.

    :param arguments: words after the command's name; None = the process's own.
    :returns: exit code: 0 all are there, 2 invalid usage, 130 interrupted.
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
    try:
        warm(_beside_a_node(cores) if options.background else _at_once(options.jobs or cores))
    except KeyboardInterrupt:
        print('warm: interrupted', file=sys.stderr)
        return INTERRUPTED
    return 0


def warm(work: Iterator[str]) -> None:
    """
    Run all scenes, and show the progress.

    :param work: runs one scene per step of the iteration; yields its name.
    """
    count, began, out = len(_scenes()), monotonic(), sys.stdout
    with ProgressBar('compiling', out) as bar:
        for done, name in enumerate(work, 1):
            bar.show(done, count, name)
            if not out.isatty():
                print(f'{done}/{count} {name}', file=out, flush=True)
    mark_complete()
    print(f'all kernels compiled in {monotonic() - began:.0f} s', file=out, flush=True)


def _beside_a_node(cores: int) -> Iterator[str]:
    """
    Run all scenes beside a node that is starting.

    The first one compiles what the node comes to last; the two share the work by the locks of
    `compilation.cache`. With a single core there is nothing to share.
    """
    for place, name in enumerate(_scenes()):
        if place == (0 if cores == 1 else 1):
            os.nice(_LOW_PRIORITY)
        yield _run(name)


def _at_once(jobs: int) -> Iterator[str]:
    """Run all scenes in several processes."""
    if jobs <= 1:
        yield from map(_run, _scenes())
        return
    with ProcessPoolExecutor(jobs, get_context('spawn'), end_with_parent) as pool:
        # Workers take over what is blocked: Ctrl-C in a terminal is for this process alone.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        futures = [pool.submit(_run, name) for name in _scenes()]
        try:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            for future in as_completed(futures):
                yield future.result()
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                worker.terminate()
            raise


def _run(name: str) -> str:
    scene = _scenes()[name]
    gc.freeze()  # what is there stays: to look through it again and again costs a tenth
    with told_to(lambda _: None):  # that a wall falls is intended
        scene()
    return name


def _scenes() -> dict[str, Callable[[], None]]:
    """Import the scenes, and with them most of the package, when they are needed."""
    from procphys_ros.warming.scenes import SCENES
    return SCENES
