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


"""Wind pressure on buildings and drag on debris against closed forms."""

from masonry_walls import wall
import numpy as np
from numpy.testing import assert_allclose
import pytest

from procphys_ros import rotation
from procphys_ros.physics.loads import (
    exposed_faces,
    outer_faces,
    Skin,
    wall_forces,
    wind_pressure,
    with_joints,
)

DENSITY = 1.225  # [kg/m³]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def _room():
    """Set up four walls of 4 x 3 m without a roof: -x, +x, -y, +y, 1 m above the ground."""
    poses = np.array([[-2.1, 0, 2.5, *UPRIGHT], [2.1, 0, 2.5, *UPRIGHT],
                      [0, -2.1, 2.5, *UPRIGHT], [0, 2.1, 2.5, *UPRIGHT]])
    return poses, np.array([[0.2, 4.4, 3.0]] * 2 + [[4.0, 0.2, 3.0]] * 2)


def test_wind_reaches_the_outside_only():
    """Find the outer faces and the tops exposed, neither rooms nor undersides."""
    exposed = exposed_faces(*_room())
    wanted = np.zeros((4, 6), bool)
    wanted[:, 5] = True
    wanted[[0, 1, 2, 3], [0, 1, 2, 3]] = True
    wanted[:2, 2:4] = True  # the ends of the longer walls
    np.testing.assert_array_equal(exposed, wanted)


def test_distant_wall_does_not_count():
    """Ask for a free way of 3 m only: the room's inner faces, 4 m apart, are exposed too."""
    near = exposed_faces(*_room(), reach=3.0)
    assert near[0, 1] and near[1, 0] and near[2, 3] and near[3, 2]


def test_free_wall_takes_pressure_and_suction():
    """Compare with 0.85 · (0.8 + 0.5) · q · A, whichever way the wall stands."""
    for yaw in (0.0, 0.9):
        pose = np.array([[0.0, 0.0, 5.0, *rotation.from_yaw(yaw)]])
        sizes = np.array([[0.2, 6.0, 3.0]])
        wind = rotation.rotate(pose[:, 3:], np.array([[12.0, 0.0, 0.0]]))
        exposed = np.array([[True, True, False, False, False, False]])
        force, moment = wall_forces(pose, sizes, exposed, wind)
        wanted = 0.85 * 1.3 * 0.5 * DENSITY * 144.0 * 18.0 * wind / 12.0
        assert_allclose(force, wanted, rtol=1e-12)
        assert_allclose(moment, 0.0, atol=1e-9)


def test_room_takes_what_a_free_wall_takes_and_its_sides_are_sucked_out():
    """Sum up a room in a wind along x: 1.1 q A along, the side walls pulled outward alike."""
    poses, sizes = _room()
    wind = np.tile([10.0, 0.0, 0.0], (4, 1))
    force, _ = wall_forces(poses, sizes, exposed_faces(poses, sizes), wind)
    q = 0.5 * DENSITY * 100.0
    assert force[:, 0].sum() == pytest.approx(0.85 * 1.3 * q * 4.4 * 3.0)
    assert force[0, 0] == pytest.approx(0.85 * 0.8 * q * 4.4 * 3.0)
    assert force[3, 1] == pytest.approx(0.5 * q * 4.0 * 3.0)
    assert force[2, 1] == pytest.approx(-force[3, 1])


def _house():
    """Set up a closed box of plates, 8 x 8 m and 4 m high."""
    poses = np.array([[-4, 0, 2, *UPRIGHT], [4, 0, 2, *UPRIGHT], [0, -4, 2, *UPRIGHT],
                      [0, 4, 2, *UPRIGHT], [0, 0, 4, *UPRIGHT]], float)
    sizes = np.array([[0.2, 8.2, 4.0]] * 2 + [[8.2, 0.2, 4.0]] * 2 + [[8.2, 8.2, 0.2]])
    return poses, sizes


@pytest.mark.parametrize(('lost', 'inner'), [(None, -0.226), (0, 0.35), (1, -0.3)])
def test_air_in_a_house_takes_the_pressure_of_its_openings(lost, inner):
    """Compare walls of a house with c_pe - c_pi: closed, open to windward, open to the lee."""
    poses, sizes = _house()
    faces, gone = outer_faces(poses, sizes), np.zeros(5, bool)
    np.testing.assert_array_equal(faces.sum(axis=1), 1)
    if lost is not None:
        gone[lost] = True
    wind = np.tile([20.0, 0.0, 0.0], (5, 1))
    force, _ = wall_forces(poses, sizes, faces, wind, skin=Skin(faces, np.zeros(5, int), gone))
    q, front, rear = 0.5 * DENSITY * 400.0, 0.7, -0.3  # low, for the middles of its faces count
    if lost != 0:
        assert force[0, 0] == pytest.approx(q * 32.8 * (0.85 * front - inner), abs=80.0)
    if lost != 1:
        assert force[1, 0] == pytest.approx(-q * 32.8 * (0.85 * rear - inner), abs=80.0)
    assert lost is None or not force[lost].any()


@pytest.mark.parametrize(('pitch', 'facing', 'wanted'), [
    (30.0, 1.0, 0.1), (45.0, 1.0, 0.3), (30.0, -1.0, -0.4), (45.0, -1.0, -0.2),
    (30.0, 0.0, -0.5), (0.0, 0.0, -0.2), (60.0, 1.0, 0.7)])
def test_roofs_follow_the_tables(pitch, facing, wanted):
    """Compare slopes before, behind and along the ridge with EN 1991-1-4, tables 7.2 and 7.4."""
    tilt, turn = np.radians(pitch), np.arccos(facing)
    normal = np.array([[-np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]])
    place = wind_pressure.Outline(*(np.array([v]) for v in (9.0, 8.0, 12.0, 16.0, 6.0)))
    found = wind_pressure.external(normal, np.array([[1.0, 0.0]]), place)
    assert found[0] == pytest.approx(wanted)


def test_joints_belong_to_the_face_of_a_wall():
    """Compare the wind on bonded bricks with that on a slab of the same outline."""
    plan = wall(12, 16)
    poses, sizes = with_joints(plan)
    low, high = poses[:, :3] - sizes / 2, poses[:, :3] + sizes / 2
    outline = np.prod((high.max(axis=0) - low.min(axis=0))[[0, 2]])
    assert (sizes[:, 0] * sizes[:, 2]).sum() == pytest.approx(outline, rel=1e-9)
    assert_allclose(sizes[:, 1], plan.size[:, 1])
    exposed = np.tile([False, False, True, True, False, False], (len(plan), 1))
    wind = np.tile([0.0, 20.0, 0.0], (len(plan), 1))
    force, moment = wall_forces(poses, sizes, exposed, wind, plan.poses[:, :3])
    assert force[:, 1].sum() == pytest.approx(0.85 * 1.3 * 0.5 * DENSITY * 400.0 * outline)
    assert np.abs(moment).max() < 0.01 * force[:, 1].max()  # less than 5 mm off the middle


def test_pressure_follows_the_angle():
    """Compare a windward face at 60 degrees with (-0.5 + 1.3 cos²)(1 - 0.15 cos²)."""
    wind = 20.0 * np.array([[np.cos(np.pi / 3), np.sin(np.pi / 3), 0.0]])
    force, _ = wall_forces(np.array([[0, 0, 5.0, *UPRIGHT]]), np.array([[0.2, 1.0, 1.0]]),
                           np.array([[True, False, False, False, False, False]]), wind)
    assert force[0, 0] == pytest.approx(0.5 * DENSITY * 400.0 * (-0.5 + 1.3 * 0.25)
                                        * (1.0 - 0.15 * 0.25))


def test_still_air_does_not_push():
    """Find no force without wind."""
    poses, sizes = _room()
    force, moment = wall_forces(poses, sizes, np.ones((4, 6), bool), np.zeros((4, 3)))
    assert not force.any() and not moment.any()
