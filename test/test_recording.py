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

"""Recordings, read back by mcap-ros2-support and rosbags; no ROS is needed."""

import io
import json
from pathlib import Path
import resource
import shutil
import subprocess
import sys
from types import SimpleNamespace

from exported import scene_of, small_wall
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
import numpy as np
import pytest

from procphys_ros.errors import RecordingError
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.messages import pose_array
from procphys_ros.recording import library, writer
from procphys_ros.recording.definitions import definition, KINDS
from procphys_ros.recording.marker_state import MarkerState
from procphys_ros.recording.recorder import Recorder
from procphys_ros.recording.recording import Recording
from procphys_ros.recording.writer import McapWriter, RESERVE
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

mcap_ros2 = pytest.importorskip('mcap_ros2.reader')
highlevel = pytest.importorskip('rosbags.highlevel')
typesys = pytest.importorskip('rosbags.typesys')

_STRUCK = {
    'scene': {'objects': ['wall', 'bush'],
              'cues': ['0.7 launch position=0.45,-3.0,0.3 velocity=0,25,0 mass=20 size=0.2']},
    'wind': {'velocity': [6.0, 0.0, 0.0]},
    'wall': {'grammar': 'garden_wall.wall', 'defines': ['length=0.89', 'height=0.6']},
    'bush': {'grammar': 'shrub.lsys', 'origin': [5.0, 0.0, 0.0]}}
_RATE, _STEPS = 20.0, 150  # one frame each third step


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Record two and a half seconds; return the file, and time and poses of each frame."""
    path = tmp_path_factory.mktemp('record') / 'run.mcap'
    simulation = Simulation(Scene.from_parameters(_STRUCK))
    frames = []
    with Recorder(simulation, path, rate=_RATE) as recorder:
        for step in range(_STEPS + 1):
            if step:
                simulation.step()
            if recorder.record():
                frames.append((simulation.time, simulation.poses.copy()))
    return path, frames, simulation


def decoded(path: Path, topic: str) -> list:
    """Read a topic with mcap-ros2-support, by the definitions inside the file."""
    return list(mcap_ros2.read_ros2_messages(str(path), topics=[topic]))


def rows(message) -> np.ndarray:
    """Turn a PoseArray into poses (N, 7)."""
    return np.array([[p.position.x, p.position.y, p.position.z, p.orientation.x, p.orientation.y,
                      p.orientation.z, p.orientation.w] for p in message.poses])


@pytest.mark.parametrize('kind', KINDS)
def test_definitions_are_those_of_jazzy(kind):
    """Hash the embedded definition as ROS does, and find the hash of the distribution."""
    own = typesys.get_typestore(typesys.Stores.EMPTY)
    own.register(typesys.get_types_from_msg(definition(kind), kind))
    jazzy = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    assert own.hash_rihs01(kind) == jazzy.hash_rihs01(kind)


def test_mcap_ros2_reads_the_poses(run):
    """Find each frame with its time, to the bit."""
    path, frames, _ = run
    found = decoded(path, '/sim/poses')
    assert len(found) == len(frames) == 51
    for message, (time, poses) in zip(found, frames):
        assert message.log_time_ns == round(time * 1e9)
        stamp = message.ros_msg.header.stamp
        assert stamp.sec + stamp.nanosec * 1e-9 == pytest.approx(time, abs=1e-9)
        assert np.array_equal(rows(message.ros_msg), poses, equal_nan=True)


def test_rosbags_reads_every_topic(run):
    """Deserialise all messages by the definitions in the file."""
    path, _, simulation = run
    counts: dict[str, int] = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
            if connection.topic == '/sim/breaks':
                assert message.width > 0
    assert set(counts) == {'/clock', '/sim/poses', '/sim/markers', '/sim/scene_description',
                           '/sim/breaks', '/sim/dust', '/sim/wind_info', '/sim/ground'}
    assert simulation.bonds_broken > 0
    assert counts['/sim/scene_description'] == 2  # once more when the ball came


def seen(markers, shown: dict) -> None:
    """Do to a view what a MarkerArray says."""
    for marker in markers:
        key = (marker.ns, marker.id)
        if marker.action == 3:
            shown.clear()
        elif marker.action == 2:
            shown.pop(key, None)
        else:
            place = marker.pose.position
            shown[key] = (place.x, place.y, place.z, len(marker.points))


@pytest.fixture(scope='module')
def markers(run) -> list:
    """Decode the markers of the run once."""
    return decoded(run[0], '/sim/markers')


@pytest.mark.parametrize('moment', [0.0, 1.33, 2.5])
def test_any_moment_can_be_opened(run, markers, moment):
    """Show at a moment what a viewer shows that has watched from the start."""
    path, frames, simulation = run
    types = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    watched, opened = {}, {}
    limit = round((moment + 1e-4) * 1e9)
    for message in markers:
        if message.log_time_ns < limit:
            seen(message.ros_msg.markers, watched)
    recording = Recording(path)
    state = recording.state_at(moment + 1e-4)
    for message in state:
        if message.topic == '/sim/markers':
            seen(types.deserialize_cdr(message.data, message.kind).markers, opened)
    recording.close()
    assert opened == watched and len(opened) >= len(simulation.scene.blueprint)
    assert [message.topic for message in state[:2]] == ['/sim/ground', '/sim/scene_description']
    poses = [m for m in state if m.topic == '/sim/poses'][-1]
    assert poses.at == max(round(t * 1e9) for t, _ in frames if t < moment + 1e-4)


def test_marker_state_repeats_what_was_said(run):
    """Write one array from many that shows the same."""
    path, _, _ = run
    types = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    state, watched, repeated = MarkerState(), {}, {}
    recording = Recording(path)
    for message in recording.messages():
        if message.topic == '/sim/markers':
            state.update(message.data)
            seen(types.deserialize_cdr(message.data, message.kind).markers, watched)
    recording.close()
    whole = types.deserialize_cdr(state.whole(), 'visualization_msgs/msg/MarkerArray')
    seen(whole.markers, repeated)
    assert repeated == watched and len(state) == len(watched)
    assert whole.markers[0].header.frame_id == 'world'


def test_what_stands_still_is_written_once_a_second(tmp_path):
    """Keep whole frames, and leave out those in between."""
    simulation = Simulation(scene_of(wall=small_wall()))
    with Recorder(simulation, tmp_path / 'run.mcap') as recorder:
        recorder.record()
        for _ in range(150):
            simulation.step()
            recorder.record()
    for topic in ('/sim/poses', '/sim/markers'):
        times = [m.log_time_ns * 1e-9 for m in decoded(tmp_path / 'run.mcap', topic)]
        assert times == pytest.approx([0.0, 1.0, 2.0])


def test_recording_begins_where_the_simulation_is(tmp_path):
    """Record a simulation that has run already, and refuse one that is reset."""
    simulation = Simulation(scene_of(wall=small_wall()))
    simulation.step(30)
    recorder = Recorder(simulation, tmp_path / 'run.mcap')
    recorder.record()
    simulation.step(2)
    recorder.record()
    simulation.reset()
    with pytest.raises(RecordingError, match='was reset'):
        recorder.record()
    recorder.close()
    recording = Recording(tmp_path / 'run.mcap')
    assert recording.start == 500_000_000 and recording.duration == pytest.approx(1 / 30)
    recording.close()
    with Recorder(simulation, tmp_path / 'again.mcap', rate=1.0) as recorder:
        for _ in range(20):
            recorder.record()
            simulation.step()
        recorder.record()
        simulation.reset()  # between two frames
        with pytest.raises(RecordingError, match='was reset'):
            recorder.record()
    recording.close()


def test_full_disk_ends_the_recording(tmp_path, monkeypatch):
    """Stop with a message while there is room for the index; all that was written can be read."""
    free = [10 * RESERVE]
    monkeypatch.setattr(shutil, 'disk_usage', lambda path: SimpleNamespace(free=free[0]))
    data = pose_array(np.random.default_rng(0).normal(size=(15_000, 7)), (0, 0), 'world')
    writer = McapWriter(tmp_path / 'run.mcap')
    for frame in range(10):
        writer.write('/sim/poses', 'geometry_msgs/msg/PoseArray', data, frame)
    free[0] = RESERVE // 2
    with pytest.raises(RecordingError, match='is full: 17 MB are left'):
        for frame in range(10, 30):
            writer.write('/sim/poses', 'geometry_msgs/msg/PoseArray', data, frame)
    assert len(decoded(tmp_path / 'run.mcap', '/sim/poses')) == writer.messages >= 10
    with pytest.raises(RecordingError, match='has ended'):
        writer.write('/sim/poses', 'geometry_msgs/msg/PoseArray', data, 99)
    writer.close()
    with pytest.raises(RecordingError, match='is full'):
        McapWriter(tmp_path / 'other.mcap')


def test_a_killed_recording_has_lost_seconds_only(tmp_path, monkeypatch):
    """Have on the disk what is some seconds old, though the chunk is not full."""
    now = [0.0]
    monkeypatch.setattr(writer, 'monotonic', lambda: now[0])
    open_writer = McapWriter(tmp_path / 'run.mcap')
    for number in range(12):
        now[0] += 1.0
        open_writer.write('/sim/scene_description', 'std_msgs/msg/String', bytes(16), number)
    reader = StreamReader(io.BytesIO((tmp_path / 'run.mcap').read_bytes()))
    found = []
    with pytest.raises(EndOfFile):
        for record in reader.records:
            if isinstance(record, Message):
                found.append(record.log_time)
    assert found == list(range(len(found))) and len(found) >= 6
    open_writer.close()


def test_write_error_is_one_message(tmp_path):
    """Turn the system's refusal of a write into one of ours, and stay closed."""
    code = """
import numpy as np, sys
from procphys_ros.errors import RecordingError
from procphys_ros.lsystem import LSystem
from procphys_ros.messages import pose_array
from procphys_ros.recording.writer import McapWriter
writer = McapWriter(sys.argv[1])
data = pose_array(np.random.default_rng(0).normal(size=(15_000, 7)), (0, 0), 'world')
try:
    for frame in range(40):
        writer.write('/sim/poses', 'geometry_msgs/msg/PoseArray', data, frame)
    writer.close()
except RecordingError as error:
    print(error)
writer.close()
"""
    ended = subprocess.run(
        [sys.executable, '-c', code, str(tmp_path / 'run.mcap')], capture_output=True, text=True,
        check=True, cwd=Path(__file__).resolve().parents[1],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000)))
    assert 'cannot be written any further: File too large' in ended.stdout


@pytest.mark.parametrize('name, content, complaint', [
    ('absent.mcap', None, 'cannot be read: No such file'),
    ('noise.mcap', b'no recording at all, but some text', 'is no complete recording'),
    ('empty.mcap', b'', 'is no complete recording'),
    ('begun.mcap', b'\x89MCAP0\r\n', 'is no complete recording'),
])
def test_files_that_are_none(tmp_path, name, content, complaint):
    """Say in one line why a file cannot be replayed."""
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=complaint):
        Recording(tmp_path / name)


def test_damaged_files_are_read_or_refused(tmp_path):
    """Change bytes of a recording at random: each is read, or refused as `replay` tells it."""
    # Before that was so, 444 of 2,000 such changes ended in other errors than ours.
    path = tmp_path / 'small.mcap'
    with McapWriter(path) as writer:
        for at in range(3):
            writer.write('/sim/poses', 'geometry_msgs/msg/PoseArray', bytes(64), at)
    whole, rng, refused = path.read_bytes(), np.random.default_rng(0), 0
    for _ in range(300):
        spoilt = bytearray(whole)
        spoilt[rng.integers(len(spoilt))] = rng.integers(256)
        path.write_bytes(spoilt)
        try:
            recording = Recording(path)
            assert len([*recording.messages(), *recording.state_at(0.0)]) <= 6
        except RecordingError:
            refused += 1
    assert 10 < refused < 300


def test_cut_file_is_recognised(run, tmp_path):
    """Refuse a recording without its end, and name the remedy."""
    (tmp_path / 'cut.mcap').write_bytes(run[0].read_bytes()[:-5000])
    with pytest.raises(RecordingError, match='mcap recover'):
        Recording(tmp_path / 'cut.mcap')


@pytest.mark.parametrize('path, complaint', [
    ('run.bag', 'must end in .mcap'), ('nowhere/run.mcap', 'there is no folder'),
    ('folder.mcap', 'it is a folder')])
def test_places_that_cannot_be_written(tmp_path, path, complaint):
    """Refuse before anything is simulated."""
    (tmp_path / 'folder.mcap').mkdir()
    with pytest.raises(RecordingError, match=complaint):
        McapWriter(tmp_path / path)


def test_a_file_takes_one_recording_at_a_time(tmp_path):
    """Refuse a second one, which would make neither readable, until the first has ended."""
    path, data = tmp_path / 'run.mcap', pose_array(np.zeros((1, 7)), (0, 0), 'world')
    with McapWriter(path) as writer:
        writer.write('/sim/poses', 'geometry_msgs/msg/PoseArray', data, 7)
        with pytest.raises(RecordingError, match='another recording goes into it'):
            McapWriter(path)
    assert [message.at for message in Recording(path).messages()] == [7]
    McapWriter(path).close()
    assert not Recording(path).topics


def test_missing_package_is_named(tmp_path, monkeypatch):
    """Say how to install it."""
    def gone(name):
        raise ImportError(name)
    monkeypatch.setattr(library, 'import_module', gone)
    with pytest.raises(RecordingError, match='pip install mcap'):
        McapWriter(tmp_path / 'run.mcap')


def test_what_acts_on_intruders_is_recorded(tmp_path):
    """Press a body against a wall, one beside it, and find forces once they are placed."""
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['wall']}, 'wall': _STRUCK['wall'],
        'intruders': {'names': ['arm', 'leg'], 'shapes': ['sphere 0.2', 'sphere 0.2']}}))
    with Recorder(simulation, tmp_path / 'run.mcap') as recorder:
        recorder.record()
        for step in range(30):
            simulation.place_intruder((0.2, -0.3 + 0.01 * step, 0.2, 0.0, 0.0, 0.0, 1.0))
            simulation.place_intruder((5.0, -0.3, 0.2, 0.0, 0.0, 0.0, 1.0), name='leg')
            simulation.step()
            recorder.record()
    pressed = decoded(tmp_path / 'run.mcap', '/sim/intruder_wrench')
    free = decoded(tmp_path / 'run.mcap', '/sim/intruders/leg/wrench')
    assert max(abs(m.ros_msg.wrench.force.y) for m in pressed) > 1.0
    assert pressed[-1].ros_msg.wrench.force.y == simulation.wrench_on_intruder('intruder')[1]
    assert len(free) == len(pressed) > 10
    assert not any(m.ros_msg.wrench.force.y for m in free)
    assert not decoded(tmp_path / 'run.mcap', '/sim/intruders/arm/wrench')


def test_what_joins_and_leaves_is_recorded(tmp_path):
    """Add a bush with leaves and take the wall out while recording: viewers see just that."""
    simulation = Simulation(scene_of(wall=small_wall()))
    with Recorder(simulation, tmp_path / 'run.mcap') as recorder:
        recorder.record()
        simulation.add(LSystem.load(shared_folder() / 'grammars' / 'shrub.lsys').build(),
                       (5.0, 0.0, 0.0), name='bush')
        for step in range(70):
            if step == 20:
                simulation.remove('wall')
            simulation.step()
            recorder.record()
    shown: dict = {}
    for message in decoded(tmp_path / 'run.mcap', '/sim/markers'):
        seen(message.ros_msg.markers, shown)
    assert {namespace for namespace, _ in shown} == {'bush', 'bush/leaves'}
    text = decoded(tmp_path / 'run.mcap', '/sim/scene_description')[-1].ros_msg.data
    owners = {o['name']: o for o in json.loads(text)['objects']}
    assert owners['wall']['removed'] and 'removed' not in owners['bush']
