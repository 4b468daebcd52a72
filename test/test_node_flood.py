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

"""Floods of commands: each is taken or counted as rejected, also what no queue has room for."""

from threading import Event

from geometry_msgs.msg import WrenchStamped
from node_process import Client, SAPLING
import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Int32

from procphys_ros.errors import SceneError
from procphys_ros.ros.commands import CommandQueue
from procphys_ros.ros.node import SimNode
from procphys_ros.ros.receiver import Inlet, Receiver
from procphys_ros.ros.sequence_gaps import SequenceGaps

SENT, DEPTH = 1000, 10


@pytest.mark.parametrize('publishers', [1, 2, 5])
def test_what_is_missing_is_counted_whoever_sent_it(publishers):
    """Interleave publishers, and lose messages between the first and the last of each."""
    rng = np.random.default_rng(publishers)
    gaps, missing, lost = SequenceGaps(), 0, 0
    for number in range(1, 101):
        for sender in rng.permutation(publishers):
            if number > 1 and number < 100 and rng.random() < 0.2:
                lost += 1
            else:
                missing += gaps.missing(number + 1000 * int(sender), publishers)
    assert missing == lost > 0


def test_who_leaves_and_who_joins_has_lost_nothing():
    """Let a publisher go, and others begin at one or, known late, further on."""
    gaps = SequenceGaps()
    for publishers, numbers in ((1, (1, 2, 3)), (2, (1, 4, 2)), (1, (1, 2, 3))):
        assert [gaps.missing(number, publishers) for number in numbers] == [0, 0, 0]
    assert SequenceGaps().missing(7, 1) == 0


@pytest.fixture(scope='module')
def client():
    """Make a client."""
    rclpy.init()
    made = Client()
    yield made
    made.close()
    rclpy.shutdown()


@pytest.mark.parametrize(('policy', 'value', 'said'), [
    ('depth', -1, 'depth must be from 0 to 1000000, found -1'),
    ('reliability', 'foo', 'foo')])
def test_a_quality_that_makes_no_sense_is_refused_in_plain_words(client, policy, value, said):
    """Name the topic, what was found and what is allowed."""
    node = Node('odd', parameter_overrides=[
        Parameter(f'qos_overrides./flood.subscription.{policy}', value=value)])
    receiver = Receiver(node)
    with pytest.raises(SceneError, match=f'/flood cannot have .*{said}'):
        receiver.subscribe(Int32, '/flood', Inlet(print, print, print))
    assert receiver.stop(0.0)
    node.destroy_node()


def test_a_full_reader_loses_nothing_uncounted(client):
    """Send far more than fits while the receiver is held up: taken and lost are all there were."""
    node = Node('full', parameter_overrides=[
        Parameter('qos_overrides./flood.subscription.depth', value=DEPTH)])
    held, begun, taken, lost, errors = Event(), Event(), [], [], []

    def receive(message):
        begun.set()
        held.wait()
        taken.append(message.data)

    receiver = Receiver(node)
    receiver.subscribe(Int32, '/flood', Inlet(receive, errors.append, lost.append))
    receiver.start()
    try:
        publisher = client.publisher(Int32, '/flood')
        client.send_until(begun.is_set, 'the first', (publisher, Int32(data=-1)))
        for number in range(SENT):
            publisher.publish(Int32(data=number))
        held.set()
        client.spin_until(lambda: SENT - 1 in taken, 'the last')
    finally:
        held.set()
        receiver.stop(60.0)
        node.destroy_node()
    numbers = [number for number in taken if number >= 0]
    assert len(numbers) <= DEPTH + 1 and sum(lost) >= SENT - len(numbers) and not errors
    assert sum(lost) + len(numbers) - SENT <= DEPTH  # repetitions of the first


def test_what_there_is_no_room_for_is_counted_unread(client):
    """Turn every message away, then read again; the numbering shows no gap."""
    node = Node('crowded')
    full, taken, lost, errors, turned = Event(), [], [], [], []
    receiver = Receiver(node)
    receiver.subscribe(Int32, '/crowd', Inlet(taken.append, errors.append, lost.append,
                                              full.is_set, lambda: turned.append(1)))
    receiver.start()
    try:
        publisher = client.publisher(Int32, '/crowd')
        client.send_until(lambda: taken, 'the first', (publisher, Int32(data=-1)))
        full.set()
        for number in range(50):
            publisher.publish(Int32(data=number))
        client.spin_until(lambda: len(turned) >= 50, 'all of them')
        full.clear()
        publisher.publish(Int32(data=50))
        client.spin_until(lambda: taken[-1].data == 50, 'the last')
    finally:
        receiver.stop(60.0)
        node.destroy_node()
    assert not lost and not errors and len(turned) <= 51
    assert not {message.data for message in taken} & set(range(49))


def test_commands_that_are_lost_are_counted_as_rejected(client, monkeypatch):
    """Hold up the receiver of a node in a flood: taken and rejected commands add up."""
    values = {'scene.objects': ['sapling'], 'sapling.grammar_text': SAPLING,
              'qos_overrides./sim/impulse.subscription.depth': DEPTH}
    node = SimNode(parameter_overrides=[Parameter(n, value=v) for n, v in values.items()])
    client.host(node)
    held, begun = Event(), Event()
    submit = CommandQueue.submit

    def slow(self, command):
        begun.set()
        held.wait()
        submit(self, command)

    monkeypatch.setattr(CommandQueue, 'submit', slow)
    push = WrenchStamped()
    push.header.frame_id = 'sapling/1'
    try:
        client.spin_until(lambda: node.session.has_scene, 'a scene')
        publisher = client.publisher(WrenchStamped, '/sim/impulse')
        client.send_until(begun.is_set, 'the first', (publisher, push))
        for _ in range(SENT):
            publisher.publish(push)
        held.set()
        client.spin_until(lambda: sum(part.get('impulse', 0) for part in node.commands.counts())
                          > SENT, 'all commands')
    finally:
        held.set()
        while not node.destroy_node():
            pass
    taken, rejected = node.commands.counts()
    assert taken['impulse'] > 0 and rejected['impulse'] > 0
    assert 'were lost' in node.commands.last_rejection
