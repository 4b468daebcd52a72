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

"""`make run`: what it says before it installs, and that node and page end with it."""

import os
from pathlib import Path
import shutil
import signal
import subprocess
from time import monotonic, sleep, time

import pytest

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 60.0  # [s] far more than is ever needed
STAND_IN = '#!/bin/sh\necho $$ > {pid}.new; mv {pid}.new {pid}\n{act}\n'
pytestmark = pytest.mark.skipif(shutil.which('make') is None, reason='there is no make')


def started(folder, node='exec sleep 600', page='exec sleep 600'):
    """Run `make run` with stand-ins for node and page; return it, and their process numbers."""
    acts = {'bin/python': 'exit 0', 'bin/view': page, 'lib/procphys_ros/sim': node}
    for name, act in acts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(STAND_IN.format(pid=folder / path.name, act=act), 'utf-8')
        path.chmod(0o755)
    (folder / '.installed-run').touch()
    os.utime(folder / '.installed-run', (time() + 3600, time() + 3600))  # newer than all sources
    make = subprocess.Popen(['make', '-C', str(ROOT), 'run', f'VENV={folder}'],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                            start_new_session=True,
                            preexec_fn=as_from_a_terminal)
    pids = [folder / name for name in ('view', 'sim')]
    wait_until(lambda: all(path.exists() for path in pids))
    return make, [int(path.read_text('utf-8')) for path in pids]


def as_from_a_terminal():
    """Hear the signals that shells let what they run in the background ignore."""
    for number in (signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_DFL)


def wait_until(done):
    """Wait for something that other processes do."""
    end = monotonic() + PATIENCE
    while not done():
        assert monotonic() < end, 'waited in vain'
        sleep(0.02)


def is_there(number):
    """Return whether a process runs."""
    try:
        state = Path(f'/proc/{number}/stat').read_text('utf-8').rpartition(')')[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):  # the latter where it ends meanwhile
        return False
    return state != 'Z'


@pytest.mark.parametrize('send, number', [
    (os.kill, signal.SIGTERM), *((os.killpg, number) for number in (
        signal.SIGTERM, signal.SIGINT, signal.SIGHUP))])
def test_a_signal_ends_node_and_page(tmp_path, send, number):
    """Leave nothing behind after kill, after Ctrl-C, and after a terminal is closed."""
    make, others = started(tmp_path)
    send(make.pid, number)
    try:
        wait_until(lambda: not any(map(is_there, others)))
        assert make.wait(PATIENCE) != 0
    finally:
        for process in filter(is_there, others):
            os.kill(process, signal.SIGKILL)


def test_the_page_ends_with_the_node(tmp_path):
    """Pass on how the node ended."""
    make, others = started(tmp_path, node='exit 1')
    assert make.wait(PATIENCE) == 2  # of make: a recipe failed
    wait_until(lambda: not any(map(is_there, others)))


def test_the_node_outlives_the_page(tmp_path):
    """Go on without a page, as where its port is taken."""
    make, (_, node) = started(tmp_path, page='exit 1')
    with pytest.raises(subprocess.TimeoutExpired):
        make.wait(0.5)
    assert is_there(node)
    os.killpg(make.pid, signal.SIGTERM)
    make.wait(PATIENCE)


def test_what_is_installed_is_said_before(tmp_path):
    """Say how long it takes, how much disk, and that the system may change; compile nothing."""
    plan = subprocess.run(['make', '-C', str(ROOT), '-n', 'run', f'VENV={tmp_path / "new"}'],
                          check=True, capture_output=True, text=True).stdout
    notice, _, work = plan.partition('./.ci/system-packages')
    for word in ('minutes', 'GB', 'system packages', 'apt-get'):
        assert word in notice
    assert 'pip install' in work and 'pip install' not in notice
    assert 'procphys_ros/sim' in plan and 'procphys_ros.warm' not in plan


def test_system_packages_are_named_before_they_are_installed(tmp_path):
    """Name them, and the program that installs them."""
    for name, act in {'python': 'case "$2" in *ensurepip*) exit 1;; esac; echo 3.12',
                      'apt-get': 'echo apt-get "$@"', 'id': 'echo 0'}.items():
        (tmp_path / name).write_text(f'#!/bin/sh\n{act}\n', 'utf-8')
        (tmp_path / name).chmod(0o755)
    said = subprocess.run(
        [ROOT / '.ci' / 'system-packages', tmp_path / 'python'], check=True, capture_output=True,
        text=True, env={**os.environ, 'PATH': f'{tmp_path}:{os.environ["PATH"]}'}).stdout
    notice, _, done = said.partition('apt-get update')
    assert 'python3.12-venv' in notice and 'apt-get' in notice
    assert 'python3.12-venv' in done
