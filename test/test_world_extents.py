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


"""Bounds of bodies, which of them are near each other, and compounds in Bullet."""

import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.world import installed_engines, rigid_sum, World
from procphys_ros.physics.world.extents import are_near
from procphys_ros.physics.world.pieces import solid_inertia

_CUBE = np.ones(3)


def _at(x, y, z, yaw=0.0):
    return np.array([x, y, z, *rotation.from_yaw(yaw)])


def _add(world, shape, size, pose):
    return world.add_body(shape, np.asarray(size, float), 1.0, pose,
                          inertia=solid_inertia(shape, np.asarray(size, float), 1.0))


def test_bounds_are_those_of_the_turned_shapes():
    """Turn a cube by an eighth, and lay a rod of half round ends down."""
    with World() as world:
        cube = _add(world, Shape.BOX, _CUBE, _at(3.0, 0.0, 5.0, 0.25 * np.pi))
        turn = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(0.5 * np.pi))
        rod = _add(world, Shape.CAPSULE, [0.2, 0.2, 2.0], np.array([0.0, 0.0, 4.0, *turn]))
        half = 0.5 * np.sqrt(2.0)
        np.testing.assert_allclose(world.bounds([cube, rod]), [
            [3.0 - half, -half, 4.5, 3.0 + half, half, 5.5],
            [-1.0, -0.1, 3.9, 1.0, 0.1, 4.1]], atol=1e-12)


@pytest.mark.parametrize('yaw, gap', [(0.0, 0.5), (0.25 * np.pi, 1.0 - 0.5 * np.sqrt(2.0))])
def test_bodies_are_near_up_to_the_gap_between_them(yaw, gap):
    """Put a cube beside one whose face, or whose edge, looks at it."""
    with World() as world:
        pair = np.array([[_add(world, Shape.BOX, _CUBE, _at(0.0, 0.0, 5.0)),
                          _add(world, Shape.BOX, _CUBE, _at(1.5, 0.0, 5.0, yaw))]])
        for share, near in ((0.99, False), (1.01, True)):
            assert are_near(world.bodies, pair, np.array([share * gap])) == [near]


def test_any_two_pieces_make_bodies_near():
    """Look for a ball beside the far end of a row of cubes, and above the hole in it."""
    with World() as world:
        poses = np.array([_at(x, 0.0, 5.0) for x in (0.0, 1.0, 4.0)])
        total = rigid_sum(np.ones(3), box_inertia(np.ones(3), np.ones((3, 3))), poses)
        row = world.add_fragment(np.full(3, Shape.BOX), np.ones((3, 3)), total.local_poses,
                                 total.mass, total.inertia, total.pose)
        end = _add(world, Shape.CAPSULE, [0.2, 0.2, 0.2], _at(4.7, 0.0, 5.0))
        hole = _add(world, Shape.CAPSULE, [0.2, 0.2, 0.2], _at(2.5, 0.0, 5.0))
        near = are_near(world.bodies, np.array([[row, end], [row, hole]]), np.full(2, 0.2))
        assert near.tolist() == [True, False]


@pytest.mark.parametrize('engine', installed_engines())
@pytest.mark.parametrize('pieces', [2, 16, 17])
def test_compounds_of_any_size_land_flat_on_all_their_shapes(engine, pieces):
    """Let a row of cubes, apart by their width, lie: all its weight is on the ground."""
    poses = np.array([_at(0.2 * n, 0.0, 0.05) for n in range(pieces)])
    mass, size = np.full(pieces, 2.0), np.full((pieces, 3), 0.1)
    total = rigid_sum(mass, box_inertia(mass, size), poses)
    with World(engine=engine) as world:
        row = world.add_fragment(np.full(pieces, Shape.BOX), size, total.local_poses, total.mass,
                                 total.inertia, total.pose)
        for _ in range(20):
            world.step(1.0 / 60.0)
        assert world.poses([row])[0, 2] == pytest.approx(0.05, abs=2e-3)
        assert world.wrench(row)[2] == pytest.approx(total.mass * 9.81, rel=0.02)
        touched = world.contacts().point[:, 0]
        # Bullet has one point under a convex hull, as which it takes the last of 17.
        assert touched.max() - touched.min() == pytest.approx(0.2 * pieces - 0.1, abs=0.06)
