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

"""The ground on topics: what a viewer is told of terrain and paving is what is simulated."""

import json

from node_process import Client, NodeProcess, SAPLING, wait_until
import numpy as np
import pytest
import rclpy
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker, MarkerArray

from procphys_ros import messages
from procphys_ros.appearance.paving import Paving
from procphys_ros.messages import SceneDescription
from procphys_ros.messages.ground import ground_of, MOST_HEIGHTS, thinned
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.recording.recorder import Recorder
from procphys_ros.recording.recording import Recording
from procphys_ros.ros import qos
from procphys_ros.ros.followed_node import FollowedNode
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

HILLS = Terrain(np.random.default_rng(1).uniform(0.0, 3.0, (9, 6)), np.array([-4.0, 2.0]), 0.5)
ROAD = Paving('asphalt', np.array([[0.0, 0.0, 0.1], [1.0, 0.0, 0.1], [0.0, 1.0, 0.1]]),
              np.array([[0, 1, 2]]))
SCENE = {'scene': {'objects': ['sapling']}, 'sapling': {'grammar_text': SAPLING},
         'terrain': {'noise': 4.0, 'extent': 30.0, 'wavelength': 15.0, 'seed': 3}}


@pytest.fixture(scope='module')
def simulation():
    """Make a simulation of a tree on a hill."""
    return Simulation(Scene.from_parameters(SCENE))


def described(simulation, terrain, paving=()):
    """Write and read a description."""
    return json.loads(SceneDescription('world', terrain, paving).write(
        simulation.blueprint, simulation.objects))


def test_the_description_carries_the_ground(simulation):
    """Read heights to the millimetre, place and paving back; say nothing of flat ground."""
    terrain, paving = ground_of(described(simulation, HILLS, [ROAD]))
    np.testing.assert_allclose(terrain.heights, HILLS.heights, atol=5.1e-4)
    assert terrain.low.tolist() == [-4.0, 2.0] and terrain.edge == 0.5
    assert paving[0].texture == 'asphalt'
    np.testing.assert_allclose(paving[0].points, ROAD.points)
    assert paving[0].faces.tolist() == [[0, 1, 2]]
    plain = described(simulation, FLAT)
    assert 'terrain' not in plain and 'paving' not in plain
    assert ground_of(plain)[0].is_flat


@pytest.mark.parametrize('shape', [(700, 500), (20_000, 3), (1201, 2)])
def test_messages_of_large_terrains_stay_small(shape):
    """Thin out to corners that lie on the simulated surface, over all of its extent."""
    heights = np.random.default_rng(0).uniform(0.0, 9.0, shape)
    large = Terrain(heights, np.array([1.0, 2.0]), 2.0)
    small = thinned(large, 2000)
    assert small.heights.size <= 2000
    points, _ = small.mesh()
    np.testing.assert_allclose(large.height(points), points[:, 2], atol=1e-9)
    reach = small.low + small.edge * (np.array(small.heights.shape) - 1)
    assert (reach >= large.low + 2.0 * (np.array(shape) - 1)).all()
    assert thinned(HILLS) is HILLS


def test_markers_of_the_ground_are_its_triangles():
    """Clear, then list the triangles of terrain and paving, in bytes that ROS reads."""
    data = messages.ground_markers(HILLS, [ROAD], (3, 4), 'world')
    clear, hills, road = deserialize_message(data, MarkerArray).markers
    assert clear.action == Marker.DELETEALL
    assert (hills.ns, road.ns) == ('terrain', 'paving')
    assert hills.type == road.type == Marker.TRIANGLE_LIST
    points = np.array([[p.x, p.y, p.z] for p in hills.points]).reshape(-1, 3, 3)
    assert len(points) == 2 * 8 * 5
    np.testing.assert_allclose(HILLS.height(points.reshape(-1, 3)), points[..., 2].ravel())
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    assert (normals[:, 2] > 0.0).all()
    assert [p.x for p in road.points] == [0.0, 1.0, 0.0]
    assert road.header.frame_id == 'world' and road.header.stamp.sec == 3
    alone = deserialize_message(messages.ground_markers(FLAT, [], (0, 0), 'map'), MarkerArray)
    assert [m.action for m in alone.markers] == [Marker.DELETEALL]


def test_a_recording_shows_the_ground_from_any_moment_on(tmp_path, simulation):
    """Write it once, and give it to whoever opens the file later."""
    path = tmp_path / 'run.mcap'
    with Recorder(simulation, path) as recorder:
        for _ in range(90):
            recorder.record()
            simulation.step()
    recording = Recording(path)
    kinds = [m.topic for m in recording.messages()]
    assert kinds.count('/sim/ground') == 1
    later = {m.topic: m for m in recording.state_at(1.2)}
    ground = deserialize_message(later['/sim/ground'].data, MarkerArray).markers[1]
    assert ground.ns == 'terrain'
    assert len(ground.points) == 6 * np.prod(np.array(simulation.model.terrain.heights.shape) - 1)
    recording.close()


def test_a_node_tells_late_joiners_of_its_ground(tmp_path, simulation):
    """Send marker and description to late joiners, and the simulated surface to the page."""
    process = NodeProcess(tmp_path, SCENE)
    rclpy.init()
    try:
        process.wait_for_banner()
        client = Client()
        ground = client.next_message(MarkerArray, '/sim/ground', qos.latched()).markers
        assert [m.ns for m in ground] == ['', 'terrain']
        followed = FollowedNode('sim')
        followed.start()
        wait_until(lambda: followed.frame() is not None, 'the scene')
        shown, own = followed.frame().content.terrain, simulation.model.terrain
        np.testing.assert_allclose(shown.heights, own.heights, atol=5.1e-4)
        assert shown.edge == own.edge
        followed.close()
        client.close()
    finally:
        rclpy.try_shutdown()
        process.kill()


def test_a_large_height_file_is_within_the_default_limit():
    """Keep what most scenes have as it is, and a file of a million heights below the limit."""
    assert thinned(Terrain(np.zeros((161, 161)), np.zeros(2), 1.0)).edge == 1.0
    million = thinned(Terrain(np.zeros((1000, 1000)), np.zeros(2), 1.0))
    assert million.heights.size <= MOST_HEIGHTS and million.edge == 6.0
