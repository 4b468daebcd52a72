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


"""Contacts of rapier: its bytes tell what it tells point by point, or are left alone."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, heap
import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.physics.world import narrow_phase, rigid_states, World
from procphys_ros.physics.world.friction import friction

rapier = pytest.importorskip('procphys_ros.physics.world.rapier')


def phase_of(world):
    """Give the narrow phase behind a world."""
    return world._engine._world.narrow_phase


@pytest.fixture
def rubble():
    """Drop bricks, balls and a rod on a standing wall, until they lie on each other."""
    with World(engine='rapier') as world:
        world.add_bricks(np.array([at(0.3, 0, 0.0325), at(0.55, 0, 0.0325)]),
                         np.tile(BRICK, (2, 1)), np.full(2, BRICK_MASS))
        heap(world, 1, 3, 45)
        for x in (0.0, 0.2):
            world.add_projectile(Shape.CAPSULE, np.full(3, 0.15), 4.0, at(x, 0, 1.5), np.zeros(6))
        world.add_body(Shape.CAPSULE, [0.1, 0.1, 0.4], 3.0, at(0.1, 0.1, 2.0))
        yield world


def test_bytes_tell_the_same_contacts(rubble):
    """Read each step of a falling heap both ways: all numbers are the same to the bit."""
    most = 0
    for _ in range(90):
        rubble.step(DT)
        slow = narrow_phase.by_attributes(phase_of(rubble))
        quick = narrow_phase.by_bytes(phase_of(rubble))
        for one, other in zip(slow, quick, strict=True):
            np.testing.assert_array_equal(one, other)
        most = max(most, len(slow.owners))
    assert most > 100
    assert rapier._bytes_are_known()


@pytest.mark.parametrize(('gap', 'pairs'), [(0.015, 1), (0.045, 0)])
def test_pairs_are_those_within_millimetres_of_a_contact(gap, pairs):
    """Move two bricks side by side: they are a pair within the 2 cm of foreseen contacts only."""
    with World((0.0, 0.0, 0.0), engine='rapier') as world:
        bodies = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(x, 0, 1.0))
                  for x in (0.0, BRICK[0] + gap)]
        world.set_velocities(np.array(bodies), np.tile([0.0, 0.0, 0.3, 0.0, 0.0, 0.0], (2, 1)))
        for _ in range(3):  # bounds are padded once a body has moved
            world.step(DT)
        found = [(pair.collider1.index, pair.collider2.index)
                 for pair in phase_of(world).contact_pairs()]
        assert len([both for both in found if 0 not in both]) == pairs  # 0 is the ground


def test_the_scale_of_rapier_leaves_all_lengths_as_they_were():
    """Compare what rapier scales by its unit of length with its defaults for 1 m."""
    rapier3d = pytest.importorskip('rapier3d')
    usual = rapier3d.PhysicsWorld(gravity=(0.0, 0.0, 0.0)).integration_parameters
    with World(engine='rapier') as world:
        ours = world._engine._world.integration_parameters
        for name in ('allowed_linear_error', 'max_corrective_velocity', 'prediction_distance',
                     'contact_recycle_distance'):
            scaled = getattr(ours, f'normalized_{name}') * ours.length_unit
            assert scaled == pytest.approx(getattr(usual, f'normalized_{name}'), rel=1e-6), name
        assert ours.normalized_max_linear_velocity * ours.length_unit == pytest.approx(1e4)


def test_bytes_tell_the_same_motion(rubble):
    """Read how bodies of a falling heap lie and move both ways: all is the same to the bit."""
    for _ in range(90):
        rubble.step(DT)
        bodies = list(rubble._engine._bodies.values())
        slow = rigid_states.by_attributes(bodies)
        np.testing.assert_array_equal(slow, rigid_states.by_bytes(bodies))
    assert np.ptp(slow[1:], axis=0).min() > 0.0  # so that no number can stand for another


def test_alike_bodies_share_a_collider():
    """Add bricks alike, of other sizes and surfaces: only those alike get the same collider."""
    with World(engine='rapier') as world:
        bodies = [world.add_body(Shape.BOX, size, 1.0, at(x, 0, 1.0), friction=friction)
                  for x, (size, friction) in enumerate([
                      ([0.2, 0.1, 0.1], 0.5), ([0.2, 0.1, 0.1], 0.5), ([0.2, 0.1, 0.1], 0.9),
                      ([0.3, 0.1, 0.1], 0.5)])]
        engine = world._engine
        told = [engine._world.colliders[engine._bodies[body].colliders[0]] for body in bodies]
        found = [(collider.friction, 2.0 * collider.compute_aabb().half_extents.x)
                 for collider in told]
    assert [round(value, 3) for value, _ in found] == [0.5, 0.5, 0.9, 0.5]
    assert [round(extent, 3) for _, extent in found] == [0.2, 0.2, 0.2, 0.3]


class Snapshot:
    """A narrow phase with any bytes."""

    def __init__(self, data):
        self._data = bytes(data)

    def to_bytes(self):
        """Give them."""
        return self._data


def test_bytes_that_make_no_sense_are_left_alone(rubble):
    """Cut a snapshot short, and spoil its counts: nothing is read beyond its end."""
    for _ in range(60):
        rubble.step(DT)
    data = np.frombuffer(phase_of(rubble).to_bytes(), np.uint8)
    assert narrow_phase.by_bytes(Snapshot(data[:len(data) // 4])) is None
    assert narrow_phase.by_bytes(Snapshot(data[:20])) is None
    rng = np.random.default_rng(1)
    for _ in range(200):
        spoilt = data.copy()
        spoilt[rng.integers(8, len(data) // 2, 200)] = rng.integers(0, 256, 200)
        narrow_phase.by_bytes(Snapshot(spoilt))


def test_an_unknown_layout_changes_nothing(rubble, monkeypatch):
    """Tell contacts by a rapier whose snapshots are laid out otherwise: the table is the same."""
    for _ in range(60):
        rubble.step(DT)
    table = rubble._engine.contacts()
    monkeypatch.setattr(rapier, '_bytes_are_known', lambda: False)
    np.testing.assert_array_equal(rubble._engine.contacts(), table)
    assert len(table) > 0


def test_other_versions_are_noticed(monkeypatch):
    """Shift the layout by a byte: the trial on a small world sees it."""
    read = narrow_phase.by_bytes
    monkeypatch.setattr(rapier, 'by_bytes', lambda phase: read(Snapshot(
        phase.to_bytes()[:200] + b'\0' + phase.to_bytes()[200:])))
    rapier._bytes_are_known.cache_clear()
    assert not rapier._bytes_are_known()
    rapier._bytes_are_known.cache_clear()
    monkeypatch.undo()
    assert rapier._bytes_are_known()


def test_friction_is_the_least_that_explains_the_motion():
    """Compare with the normal equations, written out for a dozen bodies and the ground."""
    rng = np.random.default_rng(2)
    ids = np.sort(rng.integers(0, 13, (2, 60)), axis=0)
    ids = ids[:, ids[0] < ids[1]]
    normal = np.where(rng.random(ids.shape[1]) < 0.2, 0.0, rng.random(ids.shape[1]))
    impulse = rng.normal(size=(len(normal), 3))
    mass = np.concatenate([[0.0], rng.random(12) + 0.5])
    change = rng.normal(size=(13, 3))
    found = friction(ids, impulse, normal, mass, change)
    incidence = np.zeros((13, len(normal)))
    incidence[ids[0], np.arange(len(normal))] = 1.0
    incidence[ids[1], np.arange(len(normal))] = -1.0
    lacking = mass[:, None] * change - incidence @ (impulse * (normal > 0.0)[:, None])
    incidence = incidence[1:]
    matrix = incidence * normal @ incidence.T
    matrix += 1e-6 * matrix.diagonal().max() * np.eye(12)
    want = normal[:, None] * (incidence.T @ np.linalg.solve(matrix, lacking[1:]))
    np.testing.assert_allclose(found, want, atol=1e-9)
