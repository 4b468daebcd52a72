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

"""The executables `record` and `replay`, with a real node."""

from pathlib import Path
import select
import signal
from types import SimpleNamespace

from forked import ForkedProcess
from geometry_msgs.msg import PoseArray, PoseStamped
from node_process import Client, PARTS, PATIENCE, SCENE, serve
import numpy as np
import pytest
import rclpy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from procphys_ros.messages import pose_array
from procphys_ros.recording.recording import Recording
from procphys_ros.recording.writer import McapWriter
from procphys_ros.ros import qos, record, replay, replayer
from procphys_ros.ros.node_recorder import NodeRecorder

pytest.importorskip('mcap')
read_ros2_messages = pytest.importorskip('mcap_ros2.reader').read_ros2_messages
_LONGEST = 600  # [s] for a process to end, on a machine however busy
_WINDY = {**SCENE, 'wind': {'velocity': [8.0, 0.0, 0.0]},
          'intruders': {'names': ['arm'], 'shapes': ['sphere 0.3']}}


@pytest.fixture(scope='module')
def node(tmp_path_factory):
    """Run a node in which trees sway."""
    yield from serve(tmp_path_factory.mktemp('node'), _WINDY)


@pytest.fixture
def client(node):
    """Talk to the node."""
    made = Client()
    yield made
    made.close()


@pytest.fixture(scope='module')
def start():
    """Return a function that starts an executable; `limit` is the largest file it writes [B]."""
    running: list[ForkedProcess] = []

    def begin(module: str, *words: str, limit: int | None = None) -> ForkedProcess:
        running.append(ForkedProcess(f'procphys_ros.ros.{module}', words, limit))
        return running[-1]
    yield begin
    for process in running:
        process.kill()


def finish(process: ForkedProcess, how: signal.Signals | None = None) -> tuple[int, str, str]:
    """Send a signal, and give exit code, output and complaints."""
    if how is not None:
        process.send_signal(how)
    out, err = process.communicate(timeout=_LONGEST)
    return process.returncode, out, err


@pytest.fixture(scope='module')
def recorded(node, start, tmp_path_factory) -> Path:
    """Record for some simulated seconds, then end it with Ctrl-C as a user does."""
    path = tmp_path_factory.mktemp('record') / 'run.mcap'
    watcher = Client()
    process = start('record', '--out', str(path))
    watcher.spin_until(lambda: watcher.node.count_subscribers('/sim/markers'), 'the recorder')
    clock = watcher.listen(Clock, '/clock')
    watcher.spin_until(lambda: clock and clock[-1].clock.sec > clock[0].clock.sec + 3, 'a run')
    watcher.close()
    code, out, err = finish(process, signal.SIGINT)
    assert (code, err) == (0, '')
    assert str(path) in out and 'messages in' in out and 'none on' not in out
    return path


def test_recording_holds_what_the_node_publishes(recorded):
    """Decode every message by the definitions inside; trees sway in the poses."""
    seen: dict[str, list] = {}
    for message in read_ros2_messages(str(recorded)):
        seen.setdefault(message.channel.topic, []).append(message.ros_msg)
    assert {'/sim/poses', '/sim/markers', '/sim/scene_description', '/sim/wind_info',
            '/clock'} <= set(seen)
    assert {len(message.poses) for message in seen['/sim/poses']} == {PARTS}
    tips = {round(message.poses[3].position.x, 9) for message in seen['/sim/poses']}
    assert len(tips) > 3
    assert '"sapling_0"' in seen['/sim/scene_description'][0].data


def test_every_moment_has_all_markers(recorded):
    """Find whole sets again and again, not the changes alone."""
    whole = [message for message in read_ros2_messages(str(recorded), topics=['/sim/markers'])
             if message.ros_msg.markers[0].action == 3]
    assert len(whole) >= 2
    for message in whole:
        names = {(m.ns, m.id) for m in message.ros_msg.markers[1:]
                 if m.ns.startswith(('sapling', 'post'))}
        assert len(names) == PARTS


def test_recording_ends_when_its_time_is_up(node, start, tmp_path):
    """Finish the file after a given time: exit code 0, and a file with its index."""
    path = tmp_path / 'run.mcap'
    code, _, err = finish(start('record', '--out', str(path), '--seconds', '1'))
    assert (code, err) == (0, '')
    Recording(path).close()


def test_full_disk_ends_the_recording_not_the_node(node, client, start, tmp_path):
    """Say why in one line, exit with 1; the node goes on."""
    code, _, err = finish(start('record', '--out', str(tmp_path / 'run.mcap'), '--seconds', '1',
                                limit=100))
    assert code == 1
    assert 'cannot be written any further' in err and len(err.splitlines()) == 1
    first = client.next_message(Clock, '/clock')
    later = client.next_message(Clock, '/clock', fits=lambda m: m.clock != first.clock)
    assert later.clock.sec >= first.clock.sec
    assert node.process.poll() is None


def test_forces_on_intruders_with_names_are_recorded(node, client, tmp_path):
    """Place one while recording, and find the wrench on it in the file."""
    path, topic = tmp_path / 'run.mcap', '/sim/intruders/arm/wrench'
    pose = PoseStamped()
    pose.pose.orientation.w, pose.pose.position.z = 1.0, 9.0
    written = set()

    class Noted(McapWriter):
        def write(self, name, *message):
            super().write(name, *message)
            written.add(name)

    with Noted(path) as writer:
        recorder = NodeRecorder(client.node, '/sim', writer)
        client.send_until(lambda: topic in written, 'forces',
                          (client.publisher(PoseStamped, '/sim/intruders/arm'), pose))
    assert recorder.failure is None
    assert Recording(path).topics[topic] == 'geometry_msgs/msg/WrenchStamped'
    assert list(read_ros2_messages(str(path), topics=[topic]))


def test_what_comes_in_a_burst_is_recorded(client, tmp_path):
    """Miss none of the messages that come while the recorder is busy, whatever the topic."""
    written = set()
    with McapWriter(tmp_path / 'run.mcap') as writer:
        writer.write = lambda name, kind, data, at: name == '/burst/dust' and written.add(data)
        NodeRecorder(client.node, '/burst', writer)
        publisher = client.publisher(PointCloud2, '/burst/dust')
        client.send_until(lambda: written, 'the first one', (publisher, PointCloud2()))
        for number in range(20):
            publisher.publish(PointCloud2(width=1 + number))
        client.spin_until(lambda: len(written) == 21, 'all of them')


def test_what_stands_still_is_recorded_while_the_clock_does(client, tmp_path):
    """Write whole frames each second of the wall, also where simulated time stands."""
    written = []
    node = rclpy.create_node('recorder', cli_args=[
        '--ros-args', '-p', 'use_sim_time:=true', '-r', '/clock:=/no/clock'])
    client.host(node)
    with McapWriter(tmp_path / 'run.mcap') as writer:
        writer.write = lambda name, kind, data, at: written.append(data)
        NodeRecorder(node, '/still', writer)
        client.send_until(lambda: written, 'the only message',
                          (client.publisher(PoseArray, '/still/poses'), PoseArray()))
        client.spin_until(lambda: len(written) > 2, 'whole frames')
    node.destroy_node()


def test_a_node_is_found_by_a_remapped_topic(node, start, tmp_path):
    """Look for the description of the scene where it is remapped to; say that markers are not."""
    words = [word for topic in ('scene_description', 'poses')
             for word in ('-r', f'/far/{topic}:=/sim/{topic}')]
    code, out, err = finish(start('record', '--out', str(tmp_path / 'run.mcap'), '--node', '/far',
                                  '--seconds', '1', '--ros-args', *words))
    assert code == 0 and not err and ': 0 messages' not in out
    assert '; none on /far/markers: where the node has remapped it' in out


def test_missing_node_is_said(node, start, tmp_path):
    """Name what nobody publishes, exit with 3, and leave no file."""
    code, _, err = finish(start('record', '--out', str(tmp_path / 'x.mcap'), '--node', '/nobody',
                                '--timeout', '0.5'))
    assert code == 3 and err.startswith('record: nothing publishes /nobody/scene_description')
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_before_a_node_is_found_writes_nothing(node, client, start, tmp_path):
    """Leave the recording that was there, instead of an empty one."""
    path = tmp_path / 'x.mcap'
    path.write_bytes(b'before')
    process = start('record', '--out', str(path), '--node', '/nobody', '--timeout', '600')
    name = f'record_{process.pid}'
    client.spin_until(lambda: name in client.node.get_node_names(), 'the recorder')
    code, out, err = finish(process, signal.SIGINT)
    assert (code, out) == (3, '') and 'ended before /nobody was found' in err
    assert path.read_bytes() == b'before'


def test_bad_words_for_ros_are_said(start, tmp_path):
    """Say in one line, behind that of ROS, what cannot be read; exit with 1, leave no file."""
    code, _, err = finish(start('record', '--out', str(tmp_path / 'x.mcap'),
                                '--ros-args', '-r', 'bad'))
    assert code == 1 and 'Traceback' not in err
    assert err.splitlines()[-1].startswith("record: Couldn't parse remap rule")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('run, words, code, complaint', [
    (record.main, ['--out', 'x.bag'], 1, 'record: "x.bag": a recording must end in .mcap'),
    (record.main, ['--out', 'no/x.mcap'], 1,
     'record: "no/x.mcap" cannot be written: there is no folder "no"'),
    (record.main, [], 2, 'required: --out'),
    (record.main, ['--out', 'x.mcap', '--sconds', '3'], 2, 'unrecognized arguments: --sconds 3'),
    (record.main, ['--out', 'x.mcap', '--sconds', '3', '--ros-args'], 2, 'unrecognized'),
    (replay.main, ['--ros-args', '-r', 'a:=b'], 2, 'required: file'),
    (replay.main, ['absent.mcap'], 1, 'replay: "absent.mcap" cannot be read'),
    (replay.main, ['absent.mcap', '--rate', '0'], 2, '"0" is not above 0'),
    (replay.main, ['tape.mcap', '--from', '9'], 1,
     'replay: --from is 9 s, the recording lasts 2.0 s')])
def test_mistakes_are_said(tape, monkeypatch, capsys, run, words, code, complaint):
    """Say what is wrong before a node is looked for."""
    monkeypatch.chdir(tape.parent)
    try:
        ended = run(words)
    except SystemExit as end:
        ended = end.code
    assert ended == code and complaint in capsys.readouterr().err
    assert list(tape.parent.iterdir()) == [tape]


@pytest.fixture
def tape(tmp_path) -> Path:
    """Write a recording of another node: one pose that moves by a metre each quarter second."""
    path = tmp_path / 'tape.mcap'
    with McapWriter(path) as writer:
        for number in range(9):
            pose = np.array([[float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
            writer.write('/tape/poses', 'geometry_msgs/msg/PoseArray',
                         pose_array(pose, (number, 0), 'world'), number * 250_000_000)
            if number == 0:
                text = b'described\0'
                data = b'\0\1\0\0' + len(text).to_bytes(4, 'little') + text
                writer.write('/tape/scene_description', 'std_msgs/msg/String', data, 0)
    return path


def places(poses: list) -> str:
    """List where the pose of the tape was, a digit each."""
    return ''.join(f'{m.poses[0].position.x:.0f}' for m in poses)


def test_replay_publishes_again_in_order(client, start, tape):
    """Hear every pose of a loop, and the latched description however late."""
    poses = client.listen(PoseArray, '/tape/poses', qos.changes())
    process = start('replay', str(tape), '--loop', '--rate', '2')
    client.spin_until(lambda: '8012345678' in places(poses), 'a whole loop')
    described = client.next_message(String, '/tape/scene_description', qos.latched())
    assert described.data == 'described'
    assert poses[0].header.frame_id == 'world'
    assert all(m.header.stamp.sec == m.poses[0].position.x for m in poses)
    code, out, err = finish(process, signal.SIGINT)
    assert (code, err) == (0, '') and '2.0 s, from 0 s at 2 times' in out


def test_replay_begins_in_the_middle(client, start, tape):
    """Show what holds at the moment first; nothing older than a whole frame's time."""
    poses = client.listen(PoseArray, '/tape/poses', qos.changes())
    process = start('replay', str(tape), '--from', '1.9', '--loop')
    client.spin_until(lambda: '82345678' in places(poses), 'two loops')
    assert not set('01') & set(places(poses))
    assert finish(process, signal.SIGTERM)[0] == 0


@pytest.fixture
def now(monkeypatch):
    """Return the time of a clock that only sleeping moves [s]."""
    now = [0.0]

    def sleep(duration):
        now[0] += duration
    monkeypatch.setattr(replayer, 'monotonic', lambda: now[0])
    monkeypatch.setattr(replayer, 'sleep', sleep)
    return now


@pytest.mark.parametrize('found, begin', [(0.0, 0.5), (2.5, 3.0), (1e9, 3.0)])
def test_replay_begins_when_it_is_heard(now, monkeypatch, found, begin):
    """Wait for who is found late, as subscribers on a busy machine are, but not for ever."""
    publisher = SimpleNamespace(get_subscription_count=lambda: int(now[0] >= found),
                                wait_for_all_acked=lambda patience: None)
    begun = []
    monkeypatch.setattr(replayer, '_publishers', lambda *_: {'/tape/poses': publisher})
    monkeypatch.setattr(replayer, '_play', lambda *_: begun.append(now[0]))
    monkeypatch.setattr(replayer, 'start_ros', lambda *_, **options: None)
    monkeypatch.setattr(replayer.rclpy, 'create_node', lambda *_, **options: None)
    monkeypatch.setattr(replayer.rclpy, 'try_shutdown', lambda: None)
    tape = SimpleNamespace(duration=2.0, close=lambda: None)
    replayer.replay(tape, SimpleNamespace(file='tape', start=0.0, rate=1.0), [], lambda: False)
    np.testing.assert_allclose(begun, [begin], atol=0.06)


def test_a_loop_over_nothing_does_not_flood(now):
    """Begin again once a second, where nothing comes behind the place to begin at."""
    begun = []
    tape = SimpleNamespace(start=0, messages=lambda start: iter(()),
                           state_at=lambda start: begun.append(now[0]) or [])
    replayer._play(tape, SimpleNamespace(start=2.0, rate=1.0, loop=True), {},
                   lambda: now[0] > 4.5 or len(begun) > 99, lambda: None)
    np.testing.assert_allclose(begun, [0.0, 1.0, 2.0, 3.0, 4.0])


def test_replay_of_a_node_is_its_run(client, start, recorded):
    """Publish the markers of a recorded node on its topics, and say that it is there itself."""
    process = start('replay', str(recorded), '--loop')
    assert select.select([process.stderr], [], [], PATIENCE)[0]
    assert process.stderr.readline() == 'replay: somebody else publishes /clock, too\n'
    client.spin_until(lambda: client.node.count_publishers('/sim/markers') > 1, 'the second one')
    markers = client.listen(MarkerArray, '/sim/markers', qos.changes())
    client.spin_until(lambda: sum(m.markers[0].action == 3 for m in markers) > 3, 'whole sets')
    assert finish(process, signal.SIGINT)[0] == 0
