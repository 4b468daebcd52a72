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

"""Scenes that memory cannot hold are refused; what is let go is returned."""

import ctypes
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

import pytest

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.ros import loading
from procphys_ros.scene import capacity, Scene
from procphys_ros.simulation import Simulation

STAND = {'scene': {'objects': ['palm']},
         'palm': {'grammar': 'palm.lsys', 'count': 40, 'variants': 1}}


def test_a_stand_beyond_memory_is_refused_with_the_number_that_fits(monkeypatch):
    """Name how many parts there are, and how many fit."""
    monkeypatch.setattr(capacity, '_PER_PART', 1000)
    capacity.check_capacity(3000, 3_000_000)
    with pytest.raises(SceneError, match='3,000 parts or more.*hold 2,999;.*shard.count'):
        capacity.check_capacity(3000, 2_999_999)


def test_scenes_ask_for_free_memory_before_they_place_trees(monkeypatch, tmp_path):
    """Pretend that little memory is free, or that it is unknown."""
    table = tmp_path / 'meminfo'
    monkeypatch.setattr(capacity, '_MEMORY', table)
    assert capacity.available_memory() is None
    Scene.from_parameters(STAND)
    table.write_text('MemTotal:  99 kB\nMemAvailable:     500 kB\n', 'ascii')
    assert capacity.available_memory() == 512000
    with pytest.raises(SceneError, match='the 0.0 GiB of memory that are free hold 25;'):
        Scene.from_parameters(STAND)


def test_plans_and_what_a_program_adds_count_too(monkeypatch, tmp_path):
    """Fill the memory with the houses of a plan, and with one tree after the other."""
    table = tmp_path / 'meminfo'
    monkeypatch.setattr(capacity, '_MEMORY', table)
    table.write_text('MemAvailable:     5000 kB\n', 'ascii')
    with pytest.raises(SceneError, match='hold 256;'):
        Scene.from_yaml(shared_folder() / 'config' / 'high_street.yaml')
    palm = LSystem.load(shared_folder() / 'grammars' / 'palm.lsys').build(seed=1)
    scene = Scene()
    for _ in range(256 // len(palm)):
        scene.add(palm)
    with pytest.raises(SceneError, match='hold 256;'):
        scene.add(palm)


def test_a_running_scene_takes_in_what_is_free_beside_it(monkeypatch, tmp_path):
    """Add trees while memory lasts, and leave the scene as it was when one is refused."""
    table = tmp_path / 'meminfo'
    monkeypatch.setattr(capacity, '_MEMORY', table)
    palm = LSystem.load(shared_folder() / 'grammars' / 'palm.lsys').build(seed=1)
    scene = Scene()
    scene.add(palm, name='first')
    simulation = Simulation(scene)
    table.write_text(f'MemAvailable: {20 * len(palm)} kB\n', 'ascii')
    simulation.add(palm, (9.0, 0.0, 0.0), name='second')
    table.write_text('MemAvailable: 500 kB\n', 'ascii')
    with pytest.raises(CommandError, match=f'third has {len(palm)} parts, .* hold 25 more'):
        simulation.add(palm, (18.0, 0.0, 0.0), name='third')
    assert [known.name for known in simulation.objects] == ['first', 'second']


def test_what_memory_cannot_hold_is_refused_before_it_is_grown(monkeypatch, tmp_path):
    """Ask for ten thousand different trees: the first few say that they do not fit."""
    table = tmp_path / 'meminfo'
    monkeypatch.setattr(capacity, '_MEMORY', table)
    table.write_text('MemAvailable:     50000 kB\n', 'ascii')
    grown = []
    build = LSystem.build
    monkeypatch.setattr(LSystem, 'build', lambda self, **values: (
        grown.append(values['seed']), build(self, **values))[1])
    with pytest.raises(SceneError, match='parts or more.*hold 2,560;'):
        Scene.from_parameters({**STAND, 'palm': {'grammar': 'palm.lsys', 'count': 10_000}})
    assert len(grown) == 1


ROOT = Path(__file__).resolve().parents[1]
# Another thread allocates 200 MB in pieces; every hundredth piece stays and pins what is around it
IN_PIECES = """
from threading import enumerate, Thread
from procphys_ros.ros.free_memory import return_free_memory

def resident():
    return int(open('/proc/self/statm').read().split()[1]) * 4096 / 1e6

kept = []
def allocate():
    pieces = [bytes(20_000) for _ in range(10_000)]
    kept.extend(pieces[::100])

before = resident()
worker = Thread(target=allocate)
worker.start()
worker.join()
held = resident() - before
return_free_memory()
for thread in enumerate():
    if thread.name == 'free memory':
        thread.join()
print(held, resident() - before)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), 'malloc_trim'),
                    reason='not the C library of GNU')
def test_what_another_thread_has_freed_goes_back_to_the_system():
    """Return most of it, although pieces in between are still used."""
    done = subprocess.run([sys.executable, '-c', IN_PIECES], cwd=ROOT, check=True,
                          capture_output=True, text=True)
    held, left = map(float, done.stdout.split())
    assert held > 40.0 and left < 0.3 * held


def test_memory_is_given_back_once_another_scene_has_been_taken_over(monkeypatch):
    """Do so after the old scene was let go, not before."""
    done, queued = [], []
    monkeypatch.setattr(loading, 'return_free_memory', lambda: done.append('given back'))
    builder = SimpleNamespace(build=lambda parameters, bounds, built, failed: built('new'))
    session = SimpleNamespace(has_scene=True, adopt=lambda scene: done.append(scene) or 'adopted')
    loads = loading.Loading(builder, SimpleNamespace(call=queued.append),
                            SimpleNamespace(nested=dict, bounds=None), session)
    loads.reload(lambda *_: None)
    assert not done
    assert queued[0].carry_out() == 'adopted' and done == ['new', 'given back']
