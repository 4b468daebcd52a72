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


"""Saved states of the node: written to a file, restored from it, or refused in one line."""

import os

from node_process import Client, SAPLING
import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter

from procphys_ros.ros.node import SimNode

PARAMETERS = {'scene.objects': ['sapling'], 'sapling.grammar_text': SAPLING,
              'wind.velocity': [9.0, 0.0, 0.0], 'service_deadline': 3600.0}


@pytest.fixture(scope='module')
def client(tmp_path_factory):
    """Make a client that serves a node of this process, too; the node is paused."""
    rclpy.init()
    made = Client()
    values = {**PARAMETERS, 'files.root': [str(tmp_path_factory.getbasetemp())]}
    made.sim = SimNode(parameter_overrides=[Parameter(name, value=value)
                                            for name, value in values.items()])
    made.host(made.sim)
    made.spin_until(lambda: made.sim.session.has_scene, 'the scene')
    assert made.switch('set_pause', True).success
    yield made
    made.sim.destroy_node()
    made.close()
    rclpy.shutdown()


def _written(path, content):
    path.write_bytes(content)
    return path


def use_file(client, path):
    """Set the file of the services."""
    assert client.set_parameter('state.file', str(path)).successful


def test_a_node_goes_back_to_a_saved_state(client, tmp_path):
    """Save, go on for some steps, restore: time and poses are those of the file."""
    use_file(client, tmp_path / 'state.bin')
    assert client.trigger('step_simulation').success
    saved = client.trigger('save_state')
    assert saved.success and 'state.bin' in saved.message
    simulation = client.sim.session.simulation
    time, poses = simulation.time, simulation.poses.copy()
    for _ in range(5):
        assert client.trigger('step_simulation').success
    assert not np.array_equal(simulation.poses, poses)
    restored = client.trigger('restore_state')
    assert restored.success and f'{time:.3f} s' in restored.message
    np.testing.assert_array_equal(simulation.poses, poses)
    assert simulation.time == time


def test_a_saved_state_is_a_file_like_others_and_may_lie_at_home(client, tmp_path, monkeypatch):
    """Write it with the mode that the umask leaves, and read ~ as other parameters do."""
    monkeypatch.setenv('HOME', str(tmp_path))
    use_file(client, '~/state.bin')
    assert client.trigger('save_state').success and client.trigger('restore_state').success
    (tmp_path / 'other').write_bytes(b'')
    assert (tmp_path / 'state.bin').stat().st_mode == (tmp_path / 'other').stat().st_mode


@pytest.mark.parametrize(('prepare', 'word'), [
    (lambda folder: '', 'state.file is empty'),
    (lambda folder: folder / 'nothing.bin', 'cannot be read'),
    (lambda folder: folder, 'not a regular file'),
    (lambda folder: '/dev/zero', 'files.root allows'),
    (lambda folder: '~/.bashrc', 'files.root allows'),
    (lambda folder: _written(folder / 'other.bin', b'something else'), 'no snapshot')])
def test_what_is_no_state_is_refused_and_nothing_changes(client, tmp_path, prepare, word):
    """Answer with one line that says what is wrong, and stay where it is."""
    simulation = client.sim.session.simulation
    time, poses = simulation.time, simulation.poses.copy()
    use_file(client, prepare(tmp_path))
    answer = client.trigger('restore_state')
    assert not answer.success and word in answer.message and '\n' not in answer.message
    assert simulation.time == time
    np.testing.assert_array_equal(simulation.poses, poses)


def test_a_file_that_cannot_be_written_is_refused(client, tmp_path):
    """Name the file and the reason."""
    use_file(client, tmp_path / 'no folder' / 'state.bin')
    answer = client.trigger('save_state')
    assert not answer.success and 'cannot be written' in answer.message


@pytest.mark.parametrize('make', [os.mkfifo, os.mkdir])
def test_what_is_no_plain_file_is_not_replaced(client, tmp_path, make):
    """Leave a pipe, as a device, and a folder where they are."""
    path = tmp_path / 'state'
    make(path)
    before = path.stat()
    use_file(client, path)
    answer = client.trigger('save_state')
    assert not answer.success and 'is not a regular file' in answer.message
    assert path.stat().st_ino == before.st_ino and path.stat().st_mode == before.st_mode


def test_a_scene_file_is_not_replaced(client, tmp_path):
    """Save where a file of another kind is: it stays, and the answer says why."""
    path = _written(tmp_path / 'scene.yaml', b'/**:')
    use_file(client, path)
    answer = client.trigger('save_state')
    assert not answer.success and 'no saved state' in answer.message
    assert path.read_bytes() == b'/**:'


def test_a_reload_reads_what_the_start_gave_and_nothing_outside(client):
    """Refuse an include that came later in one line, and go on with the old scene."""
    assert client.trigger('reload_scene').success
    text = f'include: /etc/passwd\n{SAPLING}'
    assert client.set_parameter('sapling.grammar_text', text).successful
    answer = client.trigger('reload_scene')
    assert not answer.success and 'files.root allows' in answer.message
    assert 'root:' not in answer.message
    assert client.set_parameter('sapling.grammar_text', SAPLING).successful
    assert client.trigger('reload_scene').success
    assert not client.set_parameter('files.root', ['/']).successful
