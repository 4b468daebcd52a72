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

"""Processes of the package's executables, forked from one that has imported what they need."""

from collections.abc import Sequence
import ctypes
from functools import cache
import json
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
from time import monotonic, sleep

from single_thread import as_for_users

ROOT = Path(__file__).resolve().parents[1]
# Simulates a little, so that kernels are loaded. Who asked becomes the parent of what is forked.
SERVER = """
import importlib, json, os, resource, socket, sys, traceback

from procphys_ros.ros import command, node, node_recorder, replayer, running
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

Simulation(Scene.from_parameters({
    'scene': {'objects': ['post']}, 'wind': {'velocity': [8.0, 0.0, 0.0]},
    'post': {'grammar_text': 'axiom: Width(0.08) Density(700) Modulus(8e9) F(1) [ +(40) F(1) ]'}
})).step(2)
asked = socket.socket(fileno=int(sys.argv[1]))
while True:
    order, files, _, _ = socket.recv_fds(asked, 1 << 20, 2)
    if not order:
        break
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        asked.sendall(b'0')
        for file in files:
            os.close(file)
        continue
    pid = os.fork()
    if pid:
        asked.sendall(pid.to_bytes(8, 'little'))
        os._exit(0)
    asked.close()
    for number, file in enumerate(files, 1):
        os.dup2(file, number)
        os.close(file)
    module, words, environment, limit = json.loads(order)
    os.environ.clear()
    os.environ.update(environment)
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    sys.argv[:] = [module, *words]
    try:
        code = importlib.import_module(module).main()
    except SystemExit as end:
        code = end.code
    except BaseException:
        code = 1
        traceback.print_exc()
    sys.stdout.flush()
    os._exit(code or 0)  # what libraries do at the end is not for forks
"""
_SUBREAPER = 36  # prctl: whose parent ends becomes a child of this process
_LOOK = 0.02     # [s] between two looks whether a process has ended


@cache
def _server() -> socket.socket:
    """Start what processes are forked from, with as many threads as those of users have."""
    ctypes.CDLL(None, use_errno=True).prctl(_SUBREAPER, 1, 0, 0, 0)
    ours, theirs = socket.socketpair()
    subprocess.Popen([sys.executable, '-u', '-c', SERVER, str(theirs.fileno())], cwd=ROOT,
                     pass_fds=[theirs.fileno()], env=as_for_users(os.environ))
    theirs.close()
    return ours


class ForkedProcess:
    """
    An executable that starts without delay, as a `Popen` with pipes of text.

    :param module: of the package, with a `main`.
    :param words: of its command line.
    :param limit: largest file that it may write [B]; None = none.
    :param errors: whether they come in a pipe of their own, else with the output.
    """

    def __init__(self, module: str, words: Sequence[str], limit: int | None = None,
                 errors: bool = True):
        pipes = [os.pipe() for _ in range(1 + errors)]
        self.stdout, *others = [os.fdopen(mine, encoding='utf-8') for mine, _ in pipes]
        self.stderr = others[0] if errors else None
        order = json.dumps([module, list(words), as_for_users(os.environ), limit])
        socket.send_fds(_server(), [order.encode()], [pipes[0][1], pipes[-1][1]])
        for _, its in pipes:
            os.close(its)
        self.pid = int.from_bytes(_server().recv(8), 'little')
        assert self.pid, 'what processes are forked from has ended'
        _server().recv(1)  # now it is a child of this process
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code; None = it is running."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float = 3600.0) -> int:
        """Wait for the end, and return the exit code."""
        end = monotonic() + timeout
        while self.poll() is None:
            if monotonic() > end:
                raise subprocess.TimeoutExpired(f'process {self.pid}', timeout)
            sleep(_LOOK)
        return self.returncode

    def communicate(self, timeout: float = 3600.0) -> tuple[str, str]:
        """Wait for the end, and return what it printed: less than pipes hold."""
        self.wait(timeout)
        return self.stdout.read(), self.stderr.read() if self.stderr else ''

    def send_signal(self, how: signal.Signals) -> None:
        """Send a signal to a process that has not ended."""
        if self.poll() is None:
            os.kill(self.pid, how)

    def kill(self) -> None:
        """End it in any case."""
        self.send_signal(signal.SIGKILL)
        self.wait()
