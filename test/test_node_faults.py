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


"""What goes wrong inside: the node says so, lives on, and can be brought back."""

import errno
import sys
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, Vector3Stamped, WrenchStamped
from node_process import Client, PARTS, SAPLING
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message

from procphys_ros.ros.node import SimNode
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

PARAMETERS = {'scene.objects': ['sapling', 'post'], 'sapling.grammar_text': SAPLING,
              'sapling.count': 3, 'post.grammar_text': SAPLING, 'post.origin': [0.0, 6.0, 0.0],
              'service_deadline': 3600.0}


@pytest.fixture(scope='module')
def client():
    """Make a client that serves a node of this process, too."""
    rclpy.init()
    made = Client()
    node = SimNode(parameter_overrides=[Parameter(name, value=value)
                                        for name, value in PARAMETERS.items()])
    made.host(node)
    made.sim = node
    yield made
    node.destroy_node()
    made.close()
    rclpy.shutdown()


@pytest.fixture(autouse=True)
def running(client, monkeypatch):
    """Leave a node that runs."""
    yield
    monkeypatch.undo()
    assert client.trigger('reload_scene').success
    assert client.switch('set_pause', False).success


def status_where(client, fits) -> DiagnosticStatus:
    """Wait for a status that fits."""
    return client.next_message(DiagnosticArray, '/diagnostics', 10,
                               lambda array: fits(array.status[0])).status[0]


def break_steps(monkeypatch) -> None:
    """Make every step raise an error."""
    def step(self, n=1):
        raise ZeroDivisionError('division by zero')
    monkeypatch.setattr(Simulation, 'step', step)


@pytest.mark.parametrize('remedy', ['reset_simulation', 'reload_scene'])
def test_a_step_that_raises_stops_time_and_nothing_else(client, monkeypatch, remedy):
    """Say so as an error, answer on, refuse to go on, and start anew when told to."""
    break_steps(monkeypatch)
    status = status_where(client, lambda s: s.level == DiagnosticStatus.ERROR)
    assert 'ZeroDivisionError: division by zero' in status.message and remedy in status.message
    assert client.switch('set_wind_enabled', True).success
    for refused in (client.switch('set_pause', False), client.trigger('step_simulation')):
        assert not refused.success and 'ZeroDivisionError' in refused.message
        assert remedy in refused.message
    monkeypatch.undo()
    assert client.trigger(remedy).success
    status = status_where(client, lambda s: s.message in ('running', 'paused'))
    assert status.level == DiagnosticStatus.OK
    assert len(client.next_message(PoseArray, '/sim/poses').poses) == PARTS


def test_a_step_on_demand_that_raises_is_refused(client, monkeypatch):
    """Answer with the reason, and let time stand still as after any step that went wrong."""
    assert client.switch('set_pause', True).success
    break_steps(monkeypatch)
    answer = client.trigger('step_simulation')
    assert not answer.success and 'ZeroDivisionError' in answer.message
    monkeypatch.undo()
    assert 'went wrong' in client.trigger('step_simulation').message
    assert client.trigger('reset_simulation').success
    assert client.trigger('step_simulation').success


@pytest.mark.parametrize('owner, name', [(Scene, 'from_parameters'), (Simulation, '__init__')])
def test_a_reload_that_raises_leaves_the_scene(client, monkeypatch, owner, name):
    """Refuse it with the reason; the old scene goes on."""
    def fail(*_, **__):
        raise IndexError('list index out of range')
    monkeypatch.setattr(owner, name, fail)
    answer = client.trigger('reload_scene')
    assert not answer.success
    assert 'IndexError' in answer.message and 'stays as it was' in answer.message
    begin = status_where(client, lambda s: s.message == 'running')
    assert begin.level == DiagnosticStatus.OK
    assert len(client.next_message(PoseArray, '/sim/poses').poses) == PARTS


def test_a_reset_that_raises_can_be_followed_by_a_reload(client, monkeypatch):
    """Stop time, since nothing can be said of the state then, until a scene was built."""
    def fail(self):
        raise KeyError('poses')
    monkeypatch.setattr(Simulation, 'reset', fail)
    answer = client.trigger('reset_simulation')
    assert not answer.success and 'KeyError' in answer.message
    status_where(client, lambda s: s.level == DiagnosticStatus.ERROR)
    monkeypatch.undo()
    assert client.trigger('reload_scene').success


@pytest.mark.parametrize('topic, kind', [('impulse', WrenchStamped), ('wind', Vector3Stamped)])
def test_a_message_that_is_not_text_is_rejected(client, topic, kind):
    """Count a message whose name of a frame is no UTF-8, and take the next."""
    message = kind()
    message.header.frame_id = 'AAAA'
    data = serialize_message(message).replace(b'AAAA', b'\xff\xfe\x80\xc1')
    publisher = client.publisher(kind, f'/sim/{topic}')
    status = client.watch_status()
    before = int(status().get(f'rejected {topic}', 0))
    client.send_until(lambda: int(status().get(f'rejected {topic}', 0)) > before, 'a rejection',
                      (publisher, data))
    assert status()['last rejection'].startswith(f'{topic}: ')
    client.node.destroy_publisher(publisher)


def test_a_status_line_that_nobody_reads_is_given_up(client, monkeypatch):
    """Say once that the reader of the output has gone, and go on without the line."""
    node, told = client.sim, []
    client.spin_until(lambda: node.session.has_scene, 'a scene')
    logger = SimpleNamespace(warning=told.append, info=told.append)
    monkeypatch.setattr(node, '_has_status_line', True)
    monkeypatch.setattr(node, 'get_logger', lambda: logger)
    monkeypatch.setattr(sys, 'stdout', _Closed())
    for _ in range(3):
        node._report()
    assert told == ['no more status lines: Broken pipe']


class _Closed:
    """A standard output whose reader has gone."""

    def write(self, text: str) -> None:
        raise BrokenPipeError(errno.EPIPE, 'Broken pipe')

    flush = isatty = lambda self: None
