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

"""Signals that come while compiled code calls Python end a program as all others do."""

from functools import partial
from pathlib import Path
import signal
import subprocess
import sys
import time
from types import ModuleType
import weakref

import numpy as np
import pytest

from procphys_ros.ros import sim
from procphys_ros.terminal import interruption, program
from procphys_ros.terminal.interruption import raising

ROOT = Path(__file__).resolve().parents[1]
IN_A_KERNEL = """
import signal, sys, time
import numpy as np
from procphys_ros.terminal.interruption import raising
from procphys_ros.physics.touch.geometry import meet_ground

def signalled(frame, event, argument):
    if event == 'call' and frame.f_code.co_name == '_numba_unpickle':
        sys.setprofile(None)
        print('in numba', flush=True)
        signal.raise_signal(signal.SIGTERM)

signal.signal(signal.SIGTERM, raising(KeyboardInterrupt))
try:
    none = np.empty((0, 7))
    meet_ground(np.empty(0, int), np.empty(0, bool), none, none[:, :3], none[:, :6], 0.01)
    sys.setprofile(signalled)
    meet_ground(np.empty(0, int), np.empty(0, bool), none, none[:, :3], none[:, :6], 0.01)
    time.sleep(60.0)
except KeyboardInterrupt:
    print('interrupted')
"""
TWICE = """
import os, signal, sys
from threading import Timer
from types import SimpleNamespace
from procphys_ros.ros import view

def signalled(frame, event, argument):
    if event == 'call' and frame.f_code.co_name == 'notify_all':
        sys.setprofile(None)
        signal.raise_signal(signal.SIGTERM)

nothing = lambda *_, **__: None
tell = Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
view.Page = lambda *_: SimpleNamespace(address='', start=tell.start, close=nothing)
view._played = lambda said: SimpleNamespace(start=nothing, close=nothing)
sys.setprofile(signalled)
sys.exit(view.main(['demo']))
"""


class _Thing:
    """Can be referred to weakly."""


def _signalled_in_a_callback(number, *_):
    """Send a signal where Python drops exceptions, and wait for it to have an effect."""
    thing = _Thing()
    weakref.finalize(thing, signal.raise_signal, number)
    del thing
    for _ in range(600):
        time.sleep(0.1)
    return 0


@pytest.fixture(autouse=True)
def signals():
    """Leave the handlers as they were."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.getsignal(number) for number in numbers]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # nohup ignores it
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for number, handler in zip(numbers, before):
        signal.signal(number, handler)


def test_a_signal_is_raised_at_once():
    """Raise in code that can bear it, before the next line of it."""
    signal.signal(signal.SIGTERM, raising(partial(SystemExit, 3)))
    later = False
    with pytest.raises(SystemExit, match='3'):
        signal.raise_signal(signal.SIGTERM)
        later = True
    assert not later


def test_a_signal_while_an_object_is_freed_is_raised_behind_that(capsys):
    """Stop while rclpy drops a future, say: Python prints what is raised in there, and goes on."""
    class Dropped:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    signal.signal(signal.SIGTERM, raising(partial(SystemExit, 3)))
    with pytest.raises(SystemExit, match='3'):
        Dropped()
        time.sleep(60.0)
    assert 'ignored' not in capsys.readouterr().err


def test_two_signals_interrupt_once(monkeypatch):
    """Leave the closing of files alone that a second signal, sent at the same time, interrupts."""
    monkeypatch.setattr(interruption, '_AGAIN', 1.0)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, raising(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        thing = _Thing()
        weakref.finalize(thing, signal.raise_signal, signal.SIGINT)
        del thing
        signal.raise_signal(signal.SIGTERM)
    try:
        time.sleep(1.5)
    except KeyboardInterrupt:
        pytest.fail('interrupted twice')


def test_a_signal_within_numba_is_raised_behind_it():
    """Let a kernel finish whose result is made into objects; raised in there it is an error."""
    done = subprocess.run([sys.executable, '-c', IN_A_KERNEL], cwd=ROOT, text=True,
                          capture_output=True)
    assert (done.returncode, done.stdout) == (0, 'in numba\ninterrupted\n'), done.stderr
    assert done.stderr == ''


@pytest.mark.parametrize('name', program.COMMANDS)
def test_commands_lose_no_signal(name, monkeypatch, capsys):
    """Interrupt a command while a callback runs that Python lets no exception out of."""
    module = ModuleType('running')
    module.main = lambda words: _signalled_in_a_callback(signal.SIGINT)
    monkeypatch.setitem(sys.modules, program.COMMANDS[name], module)
    assert program.run(name, []) == program.INTERRUPTED
    assert capsys.readouterr().err == f'{name}: interrupted\n'


@pytest.mark.parametrize('number, error', [
    (signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_the_node_loses_no_signal(number, error, monkeypatch):
    """Stop the node while a callback runs, before ROS takes signals over."""
    monkeypatch.setattr(sim, '_import', lambda kind: (
        lambda *_: _signalled_in_a_callback(number), None))
    with pytest.raises(error):
        sim.main([])


@pytest.mark.parametrize('unsafe', [1, 3])
def test_an_alarm_of_others_goes_on(monkeypatch, unsafe):
    """Borrow the alarm while a signal waits, once or again and again, and give it back."""
    answers = iter([True] * unsafe)
    monkeypatch.setattr(interruption, '_is_unsafe', lambda frame: next(answers, False))
    rang = []
    signal.signal(signal.SIGALRM, lambda *_: rang.append('theirs'))
    signal.setitimer(signal.ITIMER_REAL, 0.2, 0.2)
    signal.signal(signal.SIGTERM, raising(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
        time.sleep(60.0)
    end = time.monotonic() + 60.0
    while len(rang) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    assert rang[:2] == ['theirs', 'theirs']


def test_a_second_signal_does_not_stop_a_page_from_ending():
    """Take a signal that comes while another is handled, as where make passes Ctrl-C on."""
    done = subprocess.run([sys.executable, '-c', TWICE], cwd=ROOT, timeout=120, check=False)
    assert done.returncode == 0


def test_functions_that_numpy_calls_from_c_are_known():
    """Name the module in which any numpy keeps them: `numpy.core` before numpy 2."""
    assert type(np.zeros(1).ctypes).__module__ in interruption._UNSAFE
