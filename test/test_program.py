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
"""What all programs do: signals, progress, and warnings, each in one line."""

from functools import partial
import io
from itertools import count
import logging
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from types import ModuleType
import warnings
import weakref

import numpy as np
import pytest

from procphys_ros import __version__
from procphys_ros.batch.command import main as batch
from procphys_ros.export.command import main as export
from procphys_ros.ros import sim, view
from procphys_ros.terminal import interruption, program, progress_bar
from procphys_ros.terminal.interruption import raising
from procphys_ros.terminal.progress_bar import draw_over, ProgressBar
from procphys_ros.terminal.warning_lines import told_to
from procphys_ros.warming import command as warming

ROOT = Path(__file__).resolve().parents[1]
HALF_LOADED = """
import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
except BaseException:
    pass
print('loaded')
"""
RUNNING = """
import atexit, os, signal
def main(words):
    atexit.register(print, 'taken down')
    try:
        os.kill(os.getpid(), signal.SIGINT)
    finally:
        print('closed')
"""
TALKING = """
def main(words):
    print('x')
    return 0
"""


def program_of(source, folder):
    """Write a command, and return how it is run in a process of its own, and where."""
    (folder / 'own_command.py').write_text(source, 'utf-8')
    code = ('from procphys_ros.terminal import program; program.COMMANDS["render"] = '
            '"own_command"; raise SystemExit(program.main(["render", "--help"]))')
    return [sys.executable, '-c', code], {'cwd': folder, 'env': {
        'PYTHONPATH': f'{ROOT}:{folder}'}}


@pytest.mark.parametrize('source, said', [(HALF_LOADED, ''), (RUNNING, 'closed\n')],
                         ids=['loads', 'runs'])
def test_ctrl_c_ends_a_command_at_once(source, said, tmp_path):
    """Interrupt a module that swallows exceptions, as numpy does, or a command that runs."""
    # It ends without what Python does at its exit, which takes seconds with all kernels loaded.
    words, where = program_of(source, tmp_path)
    done = subprocess.run(words, text=True, capture_output=True, **where)
    assert (done.returncode, done.stdout, done.stderr) == (130, said, 'render: interrupted\n')


@pytest.mark.parametrize('within', ['code', 'callback'])
@pytest.mark.parametrize('name', program.COMMANDS)
def test_ctrl_c_ends_a_command_that_runs(name, within, monkeypatch, capsys):
    """Interrupt it before it handles signals itself, also where Python lets no exception out."""
    module = ModuleType('running')
    raised = signal.raise_signal if within == 'code' else _signalled_in_a_callback
    module.main = lambda words: raised(signal.SIGINT)
    monkeypatch.setitem(sys.modules, program.COMMANDS[name], module)
    assert program.run(name, []) == 130
    assert capsys.readouterr().err == f'{name}: interrupted\n'


@pytest.mark.parametrize('words', [[], *([name] for name in program.COMMANDS),
                                   *([name] for name in program.NODES)])
def test_all_commands_tell_their_version(words, capsys):
    """Print the version of the package, whichever command is asked."""
    try:
        code = program.main([*words, '--version'])
    except SystemExit as ended:
        code = ended.code
    assert (code, capsys.readouterr().out) == (0, f'procphys_ros {__version__}\n')


def test_signs_that_the_output_lacks_are_printed_by_their_codes(monkeypatch):
    """Print help where the locale has no ellipsis, as ISO 8859-1 has none."""
    printed = io.BytesIO()
    monkeypatch.setattr(sys, 'stdout', io.TextIOWrapper(printed, 'latin-1'))
    with pytest.raises(SystemExit, match='0'):
        program.run('batch', ['--help'])
    sys.stdout.flush()
    assert b'name=[v, \\u2026]' in printed.getvalue()


def test_ctrl_c_ends_view_while_it_builds(monkeypatch, capsys):
    """Interrupt the growing of a scene; only a page that is served ends by itself."""
    monkeypatch.setattr(view, '_played', lambda path: signal.raise_signal(signal.SIGINT))
    assert program.run('view', ['demo']) == 130
    assert capsys.readouterr().err == 'view: interrupted\n'


def test_a_reader_that_has_had_enough_ends_a_command(tmp_path):
    """Close the pipe that a command writes to, as `head` does."""
    words, where = program_of('def main(words):\n    print(100_000 * "x")\n', tmp_path)
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          **where) as running:
        running.stdout.close()
        assert (running.stderr.read(), running.wait()) == (b'', 0)


@pytest.mark.parametrize('unbuffered', ['', '1'])
def test_an_output_that_is_full_is_told_in_one_line(tmp_path, unbuffered):
    """Print onto a device that is always full: no traceback, and no second complaint at exit."""
    words, where = program_of(TALKING, tmp_path)
    where['env']['PYTHONUNBUFFERED'] = unbuffered
    with open('/dev/full', 'w', encoding='utf-8') as full:
        done = subprocess.run(words, stdout=full, text=True, stderr=subprocess.PIPE, **where)
    assert done.returncode == 1
    assert done.stderr == 'render: [Errno 28] No space left on device\n'


def test_a_closed_output_ends_no_command(tmp_path):
    """Do what is asked for although nothing can be said, as after `>&-`."""
    (python, option, code), where = program_of(TALKING, tmp_path)
    done = subprocess.run(['sh', '-c', f'exec "$0" {option} \'{code}\' >&-', python],
                          stderr=subprocess.PIPE, **where)
    assert (done.returncode, done.stderr) == (0, b'')


def test_ctrl_c_ends_a_command_whose_output_is_closed(monkeypatch):
    """End with the code of an interrupted command where nothing can be said, as after `>&-`."""
    ended, module = [], ModuleType('running')

    def main(words):
        raise KeyboardInterrupt
    module.main = main
    monkeypatch.setitem(sys.modules, 'running', module)
    monkeypatch.setitem(program.COMMANDS, 'render', 'running')
    monkeypatch.setattr(program.os, '_exit', ended.append)
    monkeypatch.setattr(sys, 'stdout', None)
    program.start('render', [])
    assert ended == [program.INTERRUPTED]


@pytest.mark.parametrize('words, said', [
    (['record', '--out', 'run.mcap', '--node', 'a b'], 'cannot name a node'),
    (['record', '--out', 'run.mcap', '--seconds', 'nan'], 'not finite'),
    (['view', '--node', '/a!'], 'cannot name a node'), (['view', '--port', '0'], 'above 0'),
    (['view', '--port', '99999'], 'port from 1 to 65535'),
    (['replay', 'run.mcap', '--rate', '0'], 'above 0'),
    (['warm', '--jobs', '-1'], 'whole number')])
def test_values_that_make_no_sense_end_with_two(words, said, capsys):
    """Name the option and what it takes, before anything is loaded."""
    with pytest.raises(SystemExit) as end:
        program.main(words)
    error = capsys.readouterr().err
    assert end.value.code == 2 and said in error and error.count('\n') == 1


def test_every_command_is_started_so():
    """Find each in the scripts for ros2 run and in the entry points."""
    setup = (ROOT / 'setup.py').read_text('utf-8')
    for name in program.COMMANDS.keys() - {'warm'}:
        assert f"'{name} = procphys_ros.terminal.program:{name}'" in setup
        assert getattr(program, name).args == (name,)
        script = (ROOT / 'scripts' / name).read_text('utf-8')
        assert script.count(f'-P -m procphys_ros {name} "$@"') == 2


def test_an_unknown_command_is_told(capsys):
    """Name the commands there are, those of setup.py and `warm`, on stderr."""
    assert program.main(['rendr']) == 2
    listed = re.search(r'{(.*)}', capsys.readouterr().err)[1].split(',')
    setup = (ROOT / 'setup.py').read_text('utf-8')
    assert listed == sorted(['warm', *re.findall(r"'(\w+) = procphys_ros", setup)])


def answer(name, word):
    """Return the exit code of a command that is called with one word."""
    try:
        return program.main([name, word])
    except SystemExit as end:
        return end.code


@pytest.mark.parametrize('name', [*program.COMMANDS, *program.NODES])
def test_invalid_usage_ends_with_two(name, capsys):
    """Say in one line what no command knows; `warm` and the nodes alike."""
    code = answer(name, '--nothing-like-it')
    said = capsys.readouterr()
    assert (code, said.out) == (2, '')
    assert said.err.startswith(f'{name}: ') and said.err.count('\n') == 1


@pytest.mark.parametrize('name', [*program.COMMANDS, *program.NODES])
def test_help_calls_a_command_by_its_name(name, capsys):
    """Print the usage on standard output, the name in front and in all examples."""
    code = answer(name, '--help')
    said = capsys.readouterr()
    assert (code or 0, said.err) == (0, '') and said.out.startswith(f'usage: {name} ')
    assert not any(line.startswith('  sim ') for line in said.out.splitlines()) or name == 'sim'


def test_ctrl_c_ends_the_compiling_of_kernels(monkeypatch, capsys):
    """Interrupt it between two kernels."""
    monkeypatch.setattr(warming, 'is_complete', lambda: False)
    monkeypatch.setattr(warming, 'warm', lambda _: signal.raise_signal(signal.SIGINT))
    assert warming.main([]) == 130
    assert capsys.readouterr().err == 'warm: interrupted\n'


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self):
        return True


def test_it_draws_on_terminals_only(monkeypatch):
    """Draw share, time left and detail on a terminal and clean up; stay silent elsewhere."""
    times = count(0.0, 10.0)
    monkeypatch.setattr(progress_bar, 'monotonic', lambda: next(times))
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file, None):  # None after 2>&-
        with ProgressBar('export', stream) as bar:
            bar.show(1.0, 4.0)
            bar.show(2.0, 4.0, 'a roof')
    first, second, end = terminal.getvalue().replace('\x1b[K', '').split('\r')[1:]
    assert first.endswith(' 25 %') and second.endswith(' 50 %  0:20 left  a roof')
    assert end == ''
    assert file.getvalue() == ''


@pytest.mark.parametrize('wide, shown', [(40, 39), (0, 79), (200, 120)])
def test_lines_end_where_the_terminal_does(monkeypatch, wide, shown):
    """Draw no line that wraps: only its last row could be drawn over."""
    monkeypatch.setattr(progress_bar.os, 'get_terminal_size',
                        lambda file: os.terminal_size((wide, 24)))
    terminal = Terminal()
    monkeypatch.setattr(terminal, 'fileno', lambda: 2)
    draw_over(120 * 'x', terminal)
    assert terminal.getvalue() == '\r' + shown * 'x' + '\x1b[K'


_SLIP = 'axiom: Width(0.08) Density(700) F(1) W F(1)\n'
_SCENE = """
/**:
  ros__parameters:
    scene.objects: [sapling]
    sapling.grammar: slip.lsys
    sapling.origin: [0.0, 0.0, -0.5]
"""


@pytest.fixture
def scene(tmp_path):
    """Write a scene whose grammar has a letter that means nothing, and that stands too deep."""
    (tmp_path / 'slip.lsys').write_text(_SLIP)
    path = tmp_path / 'slip.yaml'
    path.write_text(_SCENE)
    return path


@pytest.mark.parametrize('command', [
    lambda scene: export([str(scene), '--out', str(scene.with_suffix('.urdf'))]),
    lambda scene: batch([str(scene), '--out', str(scene.with_suffix('.csv')), '--seeds', '2',
                         '--duration', '0.1', '--jobs', '1']),
], ids=['export', 'batch'])
def test_commands_warn_in_a_line_each(scene, capfd, command):
    """Name the place of a slip in one line, once, without a line of Python."""
    assert command(scene) == 0
    said = [line for line in capfd.readouterr().err.splitlines() if 'arning' in line]
    assert all(line.startswith('warning: ') for line in said)
    assert sum('slip.lsys:1:' in line and 'module W' in line for line in said) == 1
    assert len(said) == len(set(said)) <= 2


def test_other_warnings_stay_as_they_are():
    """Tell of grammars and of the library's log only, and only while it lasts."""
    lines = []
    log = logging.getLogger('procphys_ros.scene')
    with pytest.warns(UserWarning, match='another') as others:
        with told_to(lines.append):
            log.warning('%d are too deep', 2)
            warnings.warn('another', stacklevel=1)
        log.warning('later')
    assert lines == ['2 are too deep'] and len(others) == 1


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
