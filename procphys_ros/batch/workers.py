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


"""Workers: processes of this machine, or of a Dask cluster, that take runs."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
import logging
from multiprocessing import active_children, get_context
import os
import signal
from typing import Any

from procphys_ros.batch.run import record, Run
from procphys_ros.errors import ProcPhysError, SceneError
from procphys_ros.simulation.readings import Series
from procphys_ros.terminal.interruption import end_with_parent
from procphys_ros.terminal.warning_lines import told_to

Outcome = tuple[int, tuple[dict[str, float], Series | None] | None, str, list[str]]
"""Number of a run, what `record` gives of it or None, what went wrong, and warnings."""
Workers = Callable[[Iterable[Run]], Iterator[Outcome]]

_KILLED = 'the process of the run was killed, twice, perhaps for want of memory'
_ONE_THREAD = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'NUMBA_NUM_THREADS')


def attempt(what: Run) -> Outcome:
    """Execute a run; report its errors in the outcome."""
    warned: list[str] = []
    try:
        with told_to(warned.append):
            return what.number, record(what), '', warned
    except ProcPhysError as error:
        return what.number, None, str(error), warned
    except Exception as error:
        return what.number, None, f'internal error, {type(error).__name__}: {error}', warned


def _begin() -> None:
    """Leave Ctrl-C to the parent, and end when it is killed, which the pool would not notice."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with_parent()


@contextmanager
def processes(count: int) -> Iterator[Workers]:
    """
    Start processes on this machine, with a thread each.

    When one of them is killed, the interrupted runs are repeated, one after the other: only a run
    whose process is killed again fails.

    :param count: number of processes.
    """
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, '1'))

    def work(runs: Iterable[Run]) -> Iterator[Outcome]:
        waiting = deque(runs)
        while waiting:
            interrupted: list[Run] = []
            yield from _carry_out(waiting, count, interrupted)
            for one in interrupted:
                killed: list[Run] = []
                yield from _carry_out(deque([one]), 1, killed)
                if killed:
                    yield one.number, None, _KILLED, []
    try:
        yield work
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _carry_out(waiting: deque[Run], count: int, interrupted: list[Run]) -> Iterator[Outcome]:
    """
    Execute runs in parallel until a process is killed.

    :param waiting: runs; started ones are removed.
    :param count: number of processes.
    :param interrupted: receives the unfinished runs after a process was killed.
    """
    under_way: dict[Future, Run] = {}
    with _pool(count) as pool:
        try:
            while waiting or under_way:
                while waiting and len(under_way) < count:
                    future = pool.submit(attempt, waiting[0])
                    under_way[future] = waiting.popleft()
                done = wait(under_way, return_when=FIRST_COMPLETED).done
                for future in sorted(done, key=lambda one: one.exception() is not None):
                    outcome = future.result()
                    del under_way[future]
                    yield outcome
        except BrokenProcessPool:
            interrupted += under_way.values()


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    pool = ProcessPoolExecutor(count, get_context('spawn'), initializer=_begin)
    try:
        yield pool
    except (KeyboardInterrupt, GeneratorExit):  # a run may take minutes more
        for process in active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def dask_cluster(address: str, count: int) -> Iterator[Workers]:
    """
    Use a Dask cluster; its workers need this package installed.

    :param address: of its scheduler, such as tcp://host:8786; '' = start a local cluster.
    :param count: number of processes of a local cluster.
    :raises SceneError: if Dask is missing, or no scheduler answers.
    """
    try:
        from distributed import as_completed as in_turn
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise SceneError('--dask needs the package distributed, pip install it') from error
    cluster = None if address else LocalCluster(n_workers=count, threads_per_worker=1,
                                                dashboard_address=None,
                                                silence_logs=logging.ERROR)
    try:
        client = Client(cluster or address, timeout='20s')
    except (OSError, ValueError) as error:
        raise SceneError(f'--dask {address}: no scheduler answers there: {error}') from error

    def work(runs: Iterable[Run]) -> Iterator[Outcome]:
        every = list(runs)
        futures: Any = client.map(attempt, every, pure=False)
        numbers = {future.key: one.number for future, one in zip(futures, every)}
        for future in in_turn(futures):
            error = future.exception()  # for example after workers were killed
            yield (future.result() if error is None
                   else (numbers[future.key], None, f'{type(error).__name__}: {error}', []))
            future.release()
    try:
        yield work
    finally:
        client.close()
        if cluster is not None:
            cluster.close()
