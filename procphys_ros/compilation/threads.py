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

"""Threads that run kernels: over ranges of rows, or concurrently with the caller."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
import os
from threading import Event
from typing import TypeVar

from numba import config
import numpy as np

_WORTH = 1000  # rows per thread at least: with less, handing work over costs more than it saves
BLOCK = 128  # rows: ranges begin at multiples, so that vectorised loops treat each row alike

Result = TypeVar('Result')
Work = Callable[[int, int, int], object]
"""Takes the place of a range among all ranges, its first row, and one past its last row."""


def most_threads(wanted: int) -> int:
    """
    Resolve a number of threads.

    :param wanted: 0 = one per core, or `NUMBA_NUM_THREADS` where that is set.
    """
    return wanted or config.NUMBA_NUM_THREADS


def even_ranges(rows: int, threads: int) -> np.ndarray:
    """
    Divide rows into ranges of about the same size.

    :param threads: ranges at most; fewer when there are few rows.
    :returns: first row of each range, and one past the last, (ranges + 1,).
    """
    count = max(1, min(threads, rows // _WORTH))
    bounds = np.arange(count + 1) * rows // count // BLOCK * BLOCK
    bounds[-1] = rows
    return bounds


def group_ranges(starts: np.ndarray, threads: int) -> np.ndarray:
    """
    Divide groups of rows, such as trees, into ranges of about as many rows.

    :param starts: first row of each group, and one past the last, (groups + 1,).
    :param threads: ranges at most.
    :returns: first group of each range, and one past the last, (ranges + 1,).
    """
    rows, groups = int(starts[-1] - starts[0]), len(starts) - 1
    count = max(1, min(threads, rows // _WORTH, groups))
    if count == 1:
        return np.array([0, groups])
    at = starts[0] + np.arange(1, count) * rows // count
    return np.concatenate([[0], np.searchsorted(starts[:-1], at), [groups]])


def run(work: Work, bounds: np.ndarray) -> None:
    """
    Run work on all ranges concurrently, and wait for all.

    Ranges run in parallel while `work` releases the interpreter lock, as kernels with the
    option `nogil` do.

    :param work: writes nothing that another range reads or writes.
    :param bounds: of the ranges, from `even_ranges` or `group_ranges`.
    """
    ranges = [(k, int(a), int(b)) for k, (a, b) in enumerate(zip(bounds[:-1], bounds[1:]))]
    if len(ranges) == 1:
        work(*ranges[0])
        return
    pool = _pool(len(ranges) - 1)
    others = [pool.submit(work, *one) for one in ranges[1:]]
    try:
        work(*ranges[0])
    finally:
        wait(others)
    for future in others:
        future.result()


def beside(name: str, work: Callable[[], Result], threads: int) -> Callable[[], Result]:
    """
    Start work on another thread, while the caller goes on.

    The work goes first until its first kernel releases the interpreter lock: a caller that holds
    it for long, as PyBullet does, would delay the start otherwise.

    :param name: of the thread; work under the same name runs in sequence.
    :param work: reads nothing that the caller writes meanwhile, nor the other way round.
    :param threads: with one only, the work is done before returning.
    :returns: function that waits for the work and returns its result, or raises its error.
    """
    if threads == 1:
        result = work()
        return lambda: result
    begun = Event()

    def announced() -> Result:
        begun.set()
        return work()
    future = _thread(name).submit(announced)
    begun.wait()

    def ended() -> Result:
        try:
            return future.result()
        finally:  # an interrupt must not let the caller go on while the work does
            wait([future])
    return ended


@cache
def _thread(name: str) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, thread_name_prefix=name)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix='kernels')


for _cached in (_thread, _pool):  # threads do not survive a fork
    os.register_at_fork(after_in_child=_cached.cache_clear)
