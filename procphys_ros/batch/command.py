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


"""Executable `batch`: run a scene many times unattended, and write a table row per run."""

import argparse
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cache
import os
from pathlib import Path
import signal
import sys
from typing import Any

from procphys_ros.batch.sweep import Sweep
from procphys_ros.batch.table import check_format, Table
from procphys_ros.batch.workers import dask_cluster, processes, Workers
from procphys_ros.errors import ProcPhysError
from procphys_ros.scene.named import scene_file
from procphys_ros.schema import short
from procphys_ros.terminal.argument_parser import count, OneLineParser, positive
from procphys_ros.terminal.interruption import raising
from procphys_ros.terminal.progress_bar import ProgressBar
from procphys_ros.terminal.warning_lines import print_warning, told_to

_MOST_TOLD = 20  # failed runs listed for each reason
_EXAMPLES = """\
values: name=[v, …] in YAML, name=v,v,…, or name=first..last/number; of a vector such as
wind.velocity a range of numbers varies the length, and keeps the direction of the scene
examples:
  batch config/palms_in_a_gust.yaml --vary gust.amplitude=10..40/4 --seeds 20 --out palms.csv
  batch config/demo.yaml --vary wind.velocity=10..40/4 --series oak_0/0 --out wind.parquet
  batch config/demo.yaml --vary 'wind.velocity=[[8, 0, 0], [0, 16, 0]]' --out wind.csv
A run that was killed goes on when it is said again: finished rows stay.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command.

    :param arguments: words after the command's name; default the process's own.
    :returns: exit code: 0 all rows exist, 1 it cannot be done or runs failed, 2 invalid usage,
        130 interrupted.
    """
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, raising(KeyboardInterrupt))
    warn = cache(print_warning)  # equal warnings of many runs are printed once
    try:
        check_format(options.out)
        with told_to(warn):
            sweep = Sweep.read(scene_file(options.scene), options.vary, options.seeds,
                               options.duration, options.series, options.every)
        table = Table(options.out, sweep.columns, sweep.digest)
    except ProcPhysError as error:
        print(f'batch: {error}', file=sys.stderr)
        return 1
    workers: AbstractContextManager[Workers] = (
        processes(options.jobs) if options.dask is None
        else dask_cluster(options.dask, options.jobs))
    failed: dict[str, list[str]] = {}
    code = 0
    try:
        with workers as work, ProgressBar(f'batch {options.out.name}', sys.stderr) as bar:
            _work(sweep, table, work, bar, warn, failed)
    except ProcPhysError as error:
        failed[str(error)] = []
    except KeyboardInterrupt:
        code = 130
    whole = len(table.done) == len(sweep)
    try:
        table.close(whole)
    except ProcPhysError as error:
        failed[str(error)] = []
    for reason, runs in sorted(failed.items()):
        _tell_failure(reason, runs)
    print(f'{options.out}: {len(table.done)} of {len(sweep)} runs'
          + ('' if whole else '; say it again to go on'))
    return code or int(bool(failed))


def _work(sweep: Sweep, table: Table, work: Workers, bar: ProgressBar,
          warn: Callable[[str], None], failed: dict[str, list[str]]) -> None:
    """
    Execute the missing runs.

    :param failed: receives the reasons of failures, each with its runs.
    """
    missing = {run.number: (values, run) for values, run in sweep.runs()
               if run.number not in table.done}
    bar.show(len(table.done), len(sweep))
    for number, done, reason, warned in work([run for _, run in missing.values()]):
        for line in warned:
            warn(line)
        if done is None:
            failed.setdefault(reason, []).append(
                f'run {number}: {_shown(sweep.columns, missing[number][0])}')
        else:
            table.add(number, missing[number][0], *done)
        bar.show(len(table.done), len(sweep))


def _shown(names: Sequence[str], values: Sequence[Any]) -> str:
    """Format the varied values of a run, long strings and lists shortened."""
    return ', '.join(f'{name}={short(value)}'
                     for name, value in zip(names, values))


def _tell_failure(reason: str, runs: Sequence[str]) -> None:
    """Print a reason, and the runs that failed for it."""
    number = f' ({len(runs)} runs)' if len(runs) > 1 else ''
    lines = [f'batch: {reason}{number}', *(f'  {run}' for run in runs[:_MOST_TOLD])]
    if len(runs) > _MOST_TOLD:
        lines.append(f'  … and {len(runs) - _MOST_TOLD} more')
    print(*lines, sep='\n', file=sys.stderr)


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog='batch', epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Simulate a scene many times with varied parameters, without anyone '
                    'watching, and write a row of a table for each run.')
    parser.add_argument('scene', help='scene file (.yaml), or name of a shipped scene')
    parser.add_argument('--vary', action='append', default=[], metavar='NAME=VALUES',
                        help='values of a parameter; several are combined with each other')
    parser.add_argument('--seeds', type=count, default=1, metavar='N',
                        help='runs of each combination, with seeds that follow that of the scene')
    parser.add_argument('--duration', type=positive, default=10.0, metavar='S',
                        help='simulated time of each run [s] (default %(default)g)')
    parser.add_argument('--series', action='append', default=[], metavar='PART',
                        help='record poses, velocities and loads of a part, or of all parts of an '
                             'object, into OUT.series/RUN.npz; may be repeated')
    parser.add_argument('--every', type=count, default=1, metavar='N',
                        help='time steps from row to row of the series (default %(default)s)')
    parser.add_argument('--out', required=True, type=Path, help='table: .csv or .parquet')
    parser.add_argument('--jobs', type=count, default=len(os.sched_getaffinity(0)), metavar='N',
                        help='processes (default: one for each core, %(default)s)')
    parser.add_argument('--dask', nargs='?', const='', default=None, metavar='ADDRESS',
                        help='use a Dask cluster, of that scheduler or a local one')
    return parser
