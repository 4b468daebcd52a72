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


"""Swept projectiles against closed forms, and against sampling the way in small steps."""

import numpy as np
from numpy.testing import assert_allclose
import pytest

from procphys_ros.geometry import rotation
from procphys_ros.physics.loads import (
    sweep_box_boxes,
    sweep_box_capsules,
    sweep_boxes,
    sweep_capsules,
)

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
BRICK = (2.0, 4.0, 6.0)
STICK = (0.4, 0.4, 3.0)  # radius 0.2, axis from -1.3 to 1.3


def _one(position=(0.0, 0.0, 0.0), attitude=UPRIGHT):
    return np.array([[*position, *attitude]])


def _random_scene(seed, count=40):
    """Scatter targets and ways through them."""
    rng = np.random.default_rng(seed)
    attitudes = rng.normal(size=(count, 4))
    attitudes /= np.linalg.norm(attitudes, axis=1, keepdims=True)
    poses = np.hstack([rng.uniform(-4, 4, (count, 3)), attitudes])
    sizes = rng.uniform(0.2, 2.0, (count, 3))
    ways = [(rng.uniform(-9, 9, 3), rng.uniform(-9, 9, 3)) for _ in range(12)]
    return poses, sizes, ways


def _distance_to_boxes(points, poses, sizes):
    """Return (points, boxes) distances by definition."""
    offset = points[:, None, :] - poses[None, :, :3]
    local = rotation.rotate(rotation.conjugate(poses[:, 3:])[None], offset)
    return np.linalg.norm(np.maximum(np.abs(local) - 0.5 * sizes, 0.0), axis=2)


def _distance_to_capsules(points, poses, sizes):
    """Return (points, capsules) distances by definition."""
    axes = rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    offset = points[:, None, :] - poses[None, :, :3]
    half = 0.5 * (sizes[:, 2] - sizes[:, 0])
    foot = np.clip(np.einsum('pni,ni->pn', offset, axes), -half, half)
    return np.linalg.norm(offset - foot[..., None] * axes, axis=2) - 0.5 * sizes[:, 0]


@pytest.mark.parametrize(('start', 'end', 'fraction', 'point', 'normal'), [
    # A face: 10 m of way, contact 1 + 0.5 m before the centre.
    ((-5.0, 1.0, 2.0), (5.0, 1.0, 2.0), 0.35, (-1.0, 1.0, 2.0), (-1.0, 0.0, 0.0)),
    # An edge, passed 0.3 m outside of it: contact 0.4 m before it.
    ((-5.0, 2.3, 0.0), (5.0, 2.3, 0.0), 0.36, (-1.0, 2.0, 0.0), (-0.8, 0.6, 0.0)),
    # A corner, along the diagonal.
    ((-4.0, -5.0, -6.0), (0.0, -1.0, -2.0), (3.0 - 0.5 / np.sqrt(3.0)) / 4.0, (-1.0, -2.0, -3.0),
     (-np.sqrt(1 / 3),) * 3),
    # From within.
    ((0.5, 0.0, 0.0), (5.0, 0.0, 0.0), 0.0, (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
])
def test_sphere_meets_a_box(start, end, fraction, point, normal):
    """Compare face, edge, corner and inside with geometry, and once more turned and moved."""
    for frame in ((0.0, 0.0, 0.0, *UPRIGHT), (7.0, -3.0, 2.0, 0.5, -0.1, 0.7, 0.5)):
        pose = np.array(frame)
        pose[3:] /= np.linalg.norm(pose[3:])
        moved = [pose[:3] + rotation.rotate(pose[3:], p) for p in (start, end, point)]
        hits = sweep_boxes(moved[0], moved[1], 0.5, pose[None], np.array([BRICK]))
        assert_allclose(hits.fraction, [fraction], atol=1e-9)
        assert_allclose(hits.point, [moved[2]], atol=1e-9)
        assert_allclose(hits.normal, [rotation.rotate(pose[3:], normal)], atol=1e-9)


@pytest.mark.parametrize(('start', 'end'), [
    ((-5.0, 2.51, 0.0), (5.0, 2.51, 0.0)),     # past an edge
    ((-5.0, 0.0, 0.0), (-1.51, 0.0, 0.0)),     # not far enough
    ((-1.6, 0.0, 0.0), (-5.0, 0.0, 0.0)),      # away
    ((-5.0, 0.0, 3.36), (5.0, 4.0, 3.36)),     # past a corner
    ((3.0, 3.0, 3.0), (3.0, 3.0, 3.0)),        # no way at all
])
def test_sphere_misses_a_box(start, end):
    """Pass the box at a little more than the radius."""
    radius = 0.35 if start[2] == 3.36 else 0.5
    assert len(sweep_boxes(start, end, radius, _one(), np.array([BRICK]))) == 0


def test_row_of_boxes_is_met_in_order():
    """Fly through a row of boxes and list them all, one left out as inactive."""
    poses = np.repeat(_one(), 6, axis=0)
    poses[:, 0] = [12.0, 2.0, 8.0, 4.0, 30.0, 6.0]
    active = np.array([True, True, False, True, True, True])
    hits = sweep_boxes((0.0, 0.0, 0.0), (20.0, 0.0, 0.0), 0.25, poses, np.ones((6, 3)), active)
    np.testing.assert_array_equal(hits.index, [1, 3, 5, 0])
    assert_allclose(hits.fraction * 20.0, [1.25, 3.25, 5.25, 11.25])


@pytest.mark.parametrize(('start', 'end', 'fraction', 'normal'), [
    ((-5.0, 0.0, 1.0), (5.0, 0.0, 1.0), 0.43, (-1.0, 0.0, 0.0)),                # the shaft
    ((-5.0, 0.42, 1.0), (5.0, 0.42, 1.0), 0.444, (-0.8, 0.6, 0.0)),             # its flank
    ((0.0, 0.0, 5.0), (0.0, 0.0, -5.0), 0.3, (0.0, 0.0, 1.0)),                  # the end
    ((-5.0, 0.0, 1.72), (5.0, 0.0, 1.72), 0.444, (-0.8, 0.0, 0.6)),             # its round
])
def test_sphere_meets_a_capsule(start, end, fraction, normal):
    """Compare shaft, flank and ends with geometry; both radii make 0.7 m."""
    hits = sweep_capsules(start, end, 0.5, _one(), np.array([STICK]))
    assert_allclose(hits.fraction, [fraction], atol=1e-9)
    assert_allclose(hits.normal, [normal], atol=1e-9)
    centre = np.array(start) + fraction * (np.array(end) - start)
    assert_allclose(hits.point, [centre - 0.5 * np.array(normal)], atol=1e-9)


def test_sphere_misses_a_capsule():
    """Pass the end at a little more than both radii."""
    for height in (2.01, -2.01):
        assert not len(sweep_capsules((-5.0, 0.0, height), (5.0, 0.0, height), 0.5, _one(),
                                      np.array([STICK])))


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_sphere_agrees_with_small_steps(seed):
    """Compare fractions and sets with distances sampled along many random ways."""
    poses, sizes, ways = _random_scene(seed)
    sticks = np.column_stack([sizes[:, 0], sizes[:, 0], sizes[:, 0] + sizes[:, 2]])
    t = np.linspace(0.0, 1.0, 4001)
    for start, end in ways:
        path = start + t[:, None] * (end - start)
        for sweep, shapes, distances in (
                (sweep_boxes, sizes, _distance_to_boxes),
                (sweep_capsules, sticks, _distance_to_capsules)):
            touching = distances(path, poses, shapes) <= 0.3
            hits = sweep(start, end, 0.3, poses, shapes)
            wanted = np.flatnonzero(touching.any(axis=0))
            np.testing.assert_array_equal(np.sort(hits.index), wanted)
            first = t[np.argmax(touching[:, hits.index], axis=0)]
            assert_allclose(hits.fraction, first, atol=2.6e-4)
            assert (np.diff(hits.fraction) >= 0.0).all()


def test_box_meets_a_box_face_to_face():
    """Compare with the gap between the faces, whichever side it comes from."""
    for axis in range(3):
        for side in (-1.0, 1.0):
            start = np.zeros(3)
            start[axis] = 10.0 * side
            hits = sweep_box_boxes(start, -start, UPRIGHT, (1.0, 1.0, 1.0), _one(),
                                   np.array([BRICK]))
            gap = 10.0 - 0.5 - 0.5 * BRICK[axis]
            assert_allclose(hits.fraction, [gap / 20.0])
            assert_allclose(hits.normal, [side * np.eye(3)[axis]], atol=1e-12)


def test_box_meets_a_box_edge_to_edge():
    """Turn two cubes by 45 degrees about crossed axes: their edges meet."""
    about_y = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.pi / 4)
    about_z = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.pi / 4)
    hits = sweep_box_boxes((-10.0, 0.0, 0.0), (10.0, 0.0, 0.0), about_z, (1.0, 1.0, 1.0),
                           _one(attitude=about_y), np.ones((1, 3)))
    assert_allclose(hits.fraction, [(10.0 - np.sqrt(2.0)) / 20.0])
    assert_allclose(hits.normal, [[-1.0, 0.0, 0.0]], atol=1e-12)
    assert_allclose(hits.point, [[-np.sqrt(0.5), 0.0, 0.0]], atol=1e-12)


def test_overlapping_boxes_part_on_the_shortest_way():
    """Start inside: touch at once, with the normal of the least overlap."""
    hits = sweep_box_boxes((0.9, 0.0, 0.0), (3.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), _one(),
                           np.array([BRICK]))
    assert_allclose(hits.fraction, [0.0])
    assert_allclose(hits.normal, [[1.0, 0.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize('seed', [3, 4])
def test_box_agrees_with_small_steps(seed):
    """Compare with distances of the points of a fine lattice in the moving box."""
    poses, sizes, ways = _random_scene(seed, count=15)
    sticks = np.column_stack([sizes[:, 0], sizes[:, 0], sizes[:, 0] + sizes[:, 2]])
    attitude = poses[0, 3:]
    extent = np.array([0.8, 0.5, 1.1])
    steps = [np.linspace(-0.5, 0.5, 9) * edge for edge in extent]
    lattice = np.stack(np.meshgrid(*steps, indexing='ij'), axis=-1).reshape(-1, 3)
    lattice = rotation.rotate(attitude, lattice)
    for start, end in ways[:5]:
        for sweep, shapes, distances in (
                (sweep_box_boxes, sizes, _distance_to_boxes),
                (sweep_box_capsules, sticks, _distance_to_capsules)):
            hits = sweep(start, end, attitude, extent, poses, shapes)
            for row, fraction in zip(hits.index, hits.fraction):
                one = poses[row:row + 1], shapes[row:row + 1]
                length = np.linalg.norm(end - start)
                for t, least, most in ((fraction, -1.0, 0.13), (fraction - 0.2 / length, 1e-9, 9)):
                    if t > 0.0:
                        near = distances(start + t * (end - start) + lattice, *one).min()
                        assert least < near < most
            missed = np.setdiff1d(np.arange(len(poses)), hits.index)
            for t in np.linspace(0.0, 1.0, 60):
                centre = start + t * (end - start)
                assert (distances(centre + lattice, poses[missed], shapes[missed]) > 0).all()


def test_box_meets_a_capsule():
    """Compare shaft, end and corner-on with geometry."""
    sizes = np.array([STICK])
    hits = sweep_box_capsules((-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), _one(),
                              sizes)
    assert_allclose(hits.fraction, [0.43], atol=1e-8)
    assert_allclose(hits.normal, [[-1.0, 0.0, 0.0]], atol=1e-6)
    hits = sweep_box_capsules((0.0, 0.0, 5.0), (0.0, 0.0, -5.0), UPRIGHT, (1.0, 1.0, 1.0), _one(),
                              sizes)
    assert_allclose(hits.fraction, [0.3], atol=1e-8)
    turned = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.pi / 4)
    hits = sweep_box_capsules((-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), turned, (1.0, 1.0, 1.0), _one(),
                              sizes)
    assert_allclose(hits.fraction, [(5.0 - 0.2 - np.sqrt(0.5)) / 10.0], atol=1e-8)
    assert not len(sweep_box_capsules((-5.0, 0.71, 0.0), (5.0, 0.71, 0.0), UPRIGHT,
                                      (1.0, 1.0, 1.0), _one(), sizes))


def test_no_targets_no_hits():
    """Sweep through nothing."""
    for sweep in (sweep_boxes, sweep_capsules):
        assert len(sweep((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5, np.empty((0, 7)),
                         np.empty((0, 3)))) == 0
