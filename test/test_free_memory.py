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

"""Memory of scenes that are gone: it is the system's again."""

import ctypes
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

import pytest

from procphys_ros.ros import loading

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
