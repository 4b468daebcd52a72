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


"""Commands end with one line and exit code 130 on Ctrl-C, whenever it comes."""

import io
from pathlib import Path
import re
import signal
import subprocess
import sys
from types import ModuleType

import pytest

from procphys_ros import __version__
from procphys_ros.ros import view
from procphys_ros.terminal import program
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


def test_ctrl_c_ends_a_command_that_loads(tmp_path):
    """Interrupt a module that swallows exceptions, as numpy does, while it is imported."""
    (tmp_path / 'half_loaded.py').write_text(HALF_LOADED, 'utf-8')
    code = ('from procphys_ros.terminal import program; program.COMMANDS["render"] = '
            '"half_loaded"; raise SystemExit(program.main(["render", "--help"]))')
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # nohup ignores it
    try:
        done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, text=True,
                              capture_output=True, env={'PYTHONPATH': f'{ROOT}:{tmp_path}'})
    finally:
        signal.signal(signal.SIGINT, before)
    assert (done.returncode, done.stdout, done.stderr) == (130, '', 'render: interrupted\n')


@pytest.mark.parametrize('name', program.COMMANDS)
def test_ctrl_c_ends_a_command_that_runs(name, monkeypatch, capsys):
    """Interrupt each command before it handles signals itself."""
    module = ModuleType('running')
    module.main = lambda words: signal.raise_signal(signal.SIGINT)
    monkeypatch.setitem(sys.modules, program.COMMANDS[name], module)
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert program.run(name, []) == 130
    finally:
        signal.signal(signal.SIGINT, handler)
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
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert program.run('view', ['demo']) == 130
    finally:
        signal.signal(signal.SIGINT, handler)
    assert capsys.readouterr().err == 'view: interrupted\n'


def test_after_ctrl_c_nothing_holds_up_the_end(tmp_path):
    """End without what Python does at its exit, which takes seconds with all kernels loaded."""
    (tmp_path / 'running.py').write_text(RUNNING, 'utf-8')
    code = ('from procphys_ros.terminal import program; program.COMMANDS["render"] = "running"; '
            'raise SystemExit(program.main(["render", "--help"]))')
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, text=True,
                              capture_output=True, env={'PYTHONPATH': f'{ROOT}:{tmp_path}'})
    finally:
        signal.signal(signal.SIGINT, before)
    assert (done.returncode, done.stdout) == (130, 'closed\n')
    assert done.stderr == 'render: interrupted\n'


def test_a_reader_that_has_had_enough_ends_a_command(tmp_path):
    """Close the pipe that a command writes to, as `head` does."""
    (tmp_path / 'talking.py').write_text('def main(words):\n    print(100_000 * "x")\n', 'utf-8')
    code = ('from procphys_ros.terminal import program; program.COMMANDS["render"] = "talking"; '
            'raise SystemExit(program.main(["render"]))')
    with subprocess.Popen([sys.executable, '-c', code], cwd=tmp_path, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE,
                          env={'PYTHONPATH': f'{ROOT}:{tmp_path}'}) as running:
        running.stdout.close()
        assert (running.stderr.read(), running.wait()) == (b'', 0)


@pytest.mark.parametrize('unbuffered', ['', '1'])
def test_an_output_that_is_full_is_told_in_one_line(tmp_path, unbuffered):
    """Print onto a device that is always full: no traceback, and no second complaint at exit."""
    (tmp_path / 'talking.py').write_text('def main(words):\n    print("x")\n', 'utf-8')
    code = ('from procphys_ros.terminal import program; program.COMMANDS["render"] = "talking"; '
            'raise SystemExit(program.main(["render"]))')
    with open('/dev/full', 'w', encoding='utf-8') as full:
        done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, stdout=full, text=True,
                              stderr=subprocess.PIPE, env={'PYTHONPATH': f'{ROOT}:{tmp_path}',
                                                           'PYTHONUNBUFFERED': unbuffered})
    assert done.returncode == 1
    assert done.stderr == 'render: [Errno 28] No space left on device\n'


def test_a_closed_output_ends_no_command(tmp_path):
    """Do what is asked for although nothing can be said, as after `>&-`."""
    (tmp_path / 'talking.py').write_text('def main(words):\n    print("x")\n    return 0\n',
                                         'utf-8')
    code = ('from procphys_ros.terminal import program; program.COMMANDS["render"] = "talking"; '
            'raise SystemExit(program.main(["render"]))')
    done = subprocess.run(['sh', '-c', f'exec "$0" -c \'{code}\' >&-', sys.executable],
                          cwd=tmp_path, stderr=subprocess.PIPE,
                          env={'PYTHONPATH': f'{ROOT}:{tmp_path}'})
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
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert warming.main([]) == 130
    finally:
        signal.signal(signal.SIGINT, handler)
    assert capsys.readouterr().err == 'warm: interrupted\n'
