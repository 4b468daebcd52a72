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

"""Examples run as they are, and show what they say."""

from pathlib import Path
import signal
import socket
import webbrowser

import numpy as np
import pytest

from procphys_ros.examples import command, fly_through_crown
from procphys_ros.examples.catalogue import examples

ROOT = Path(__file__).resolve().parents[1]


def test_every_shipped_scene_and_program_is_listed(capsys):
    """Say of each what it shows, and when something happens."""
    assert command.main([]) == 0
    listed = capsys.readouterr().out
    for path in (*ROOT.glob('config/*.yaml'), ROOT / 'procphys_ros/examples/fly_through_crown.py'):
        assert f'\n{path.stem} ' in f'\n{listed}'
    assert all(len(example.title) > 20 for example in examples().values())
    assert '(demolish at 1.0 s)' in ' '.join(listed.split())


def test_a_scene_runs_with_its_page_open(monkeypatch, capsys):
    """Open the address that it prints, and end with Ctrl-C."""
    pytest.importorskip('viser')
    opened = []
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = str(free.getsockname()[1])

    def open_and_leave(address):
        opened.append(address)
        signal.raise_signal(signal.SIGINT)
    monkeypatch.setattr(webbrowser, 'open', open_and_leave)
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert command.main(['vehicle_on_wall', '--port', port]) == 0
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    address, = opened
    assert address.startswith(f'http://localhost:{port}/')  # and a secret
    assert f'{opened[0]} shows ' in capsys.readouterr().out


@pytest.mark.parametrize('words, code, says', [
    (['gardn'], 1, 'did you mean garden'),
    (['--prot'], 2, '--prot'),
    (['fly_through_crown', '--port', '9'], 2, 'takes no arguments'),
])
def test_mistakes_are_answered_with_the_remedy(words, code, says, capsys):
    """Name the nearest example, or what is not understood."""
    try:
        assert command.main(words) == code
    except SystemExit as ended:
        assert ended.code == code
    assert says in capsys.readouterr().err


def test_a_drone_feels_the_crown_that_it_flies_through(capsys, monkeypatch):
    """Be pushed back by branches, less than the tree weighs, and by nothing before its crown."""
    felt, fly = [], fly_through_crown.fly

    def watch(simulation, look):
        def look_too(simulation):
            look(simulation)
            felt.append((simulation.pose_of_intruder('drone')[0],
                         *simulation.wrench_on_intruder('drone')[:3]))
        fly(simulation, look_too)
    monkeypatch.setattr(fly_through_crown, 'fly', watch)
    fly_through_crown.main()
    said = capsys.readouterr().out
    place, force = np.array(felt)[:, 0], np.array(felt)[:, 1:]
    assert place[-1] == pytest.approx(fly_through_crown.END, abs=0.1)
    assert not force[place < -3.8].any()
    pushed = np.linalg.norm(force, axis=1).max()
    assert 10.0 < pushed < 9.81 * fly_through_crown.world().blueprint.mass.sum()
    assert force[:, 0].sum() < 0.0
    assert f'{pushed:6.1f} N' in said and 'momentum lost' in said
