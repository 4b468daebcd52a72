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

"""Objects that join a running scene and leave it, and scenes shared among processes."""

from grown_trees import bush
from masonry_walls import bonded, wall
import numpy as np
import pytest

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation


def stand(*blueprints):
    """Simulate objects beside each other."""
    scene = Scene()
    for i, blueprint in enumerate(blueprints):
        scene.add(blueprint, (6.0 * i, 0.0, 0.0), 0.0, f'thing_{i}')
    return Simulation(scene)


def test_a_wall_that_joins_stands_and_breaks_like_others():
    """Add a wall while a ball flies: its bonds carry its weight, and a second ball breaks it."""
    simulation = stand(wall(8, 10), bush(30, seed=1, damping_ratio=0.1))
    simulation.launch(Projectile('sphere', 0.3, 40.0, (0.9, -3.0, 0.4), (0.0, 25.0, 0.0)))
    simulation.step(20)
    broken, count = simulation.bonds_broken, len(simulation.poses)
    before = simulation.poses.copy()
    added = simulation.add(wall(6, 8), (10.0, 8.0, 0.0), name='later')
    assert added.first == count and len(simulation.poses) == count + added.count
    np.testing.assert_array_equal(simulation.poses[:count], before)
    solver = simulation.state.solver
    graph = solver.graph
    foot = np.where(graph.first == graph.count, graph.second, graph.first)
    feet = graph.grounded() & (foot >= added.first)
    push = np.einsum('kij,kj->ki', graph.axes[feet], solver.wrenches()[feet, :3])
    sign = np.where(graph.first[feet] == graph.count, -1.0, 1.0)
    weight = 9.81 * simulation.blueprint.mass[added.first:].sum()
    assert sign @ push[:, 2] == pytest.approx(weight, rel=0.02)
    simulation.step(60)
    own = slice(added.first, added.first + added.count)
    assert simulation.state.standing[own].all()
    simulation.launch(Projectile('sphere', 0.3, 40.0, (10.7, 6.0, 0.4), (0.0, 25.0, 0.0)))
    simulation.step(30)
    assert not simulation.state.standing[own].all() and simulation.bonds_broken > broken


def test_a_tree_that_joins_sways_with_the_others():
    """Add a tree to one like it in the wind: it takes up the wind, and the old one goes on."""
    tree = bush(30, seed=1, damping_ratio=0.1)
    simulation, alone = stand(tree), stand(tree)
    for run in (simulation, alone):
        run.set_wind((8.0, 0.0, 0.0))
        run.step(30)
    simulation.add(tree, (0.0, 20.0, 0.0), name='later')
    for run in (simulation, alone):
        run.step(60)
    np.testing.assert_array_equal(simulation.poses[:30], alone.poses)
    moved = np.linalg.norm(simulation.poses[:, :3] - simulation.blueprint.poses[:, :3], axis=1)
    assert moved[30:].max() > 0.3 * moved[:30].max() > 0.0


def test_what_joins_answers_by_its_name_and_leaves_by_it():
    """Strike an added object by name, and take it out, in pieces or not."""
    simulation = stand(wall(4, 4))
    simulation.add(bush(30, seed=2, damping_ratio=0.1), (5.0, 0.0, 0.0), name='bush')
    simulation.add(bonded([[0.0, 3.0, 1.0]], (0.2, 0.1, 0.1), ground=False), name='brick')
    simulation.apply_impulse('bush/3', (2.0, 0.0, 0.0))
    simulation.step(5)
    for name in ('bush', 'brick', 'thing_0'):
        found = next(o for o in simulation.objects if o.name == name)
        simulation.remove(name)
        parts = np.arange(found.first, found.first + found.count)
        assert not simulation.exists[parts].any()
        with pytest.raises(CommandError, match='no object'):
            simulation.remove(name)
    simulation.step(30)
    assert simulation.awake_bodies == 0 and not simulation.velocities.any()


def test_what_was_one_piece_with_a_removed_object_falls_on():
    """Drop a wall with another on it and take the lower away: the upper one lands, and blows."""
    scene = Scene()
    scene.add(wall(4, 4, tension=1e7, cohesion=1e7), (0.0, 0.0, 2.0), 0.0, 'carrier')
    scene.add(wall(4, 3, tension=1e7, cohesion=1e7), (0.0, 0.0, 0.0), 0.0, 'load', on='carrier')
    simulation = Simulation(scene)
    simulation.step(5)
    body = simulation.state.parts.body
    assert len(np.unique(body)) == 1 and body[0] >= 0  # both are one piece
    simulation.remove('carrier')
    own = simulation.exists
    low = simulation.poses[own, 2].copy()
    simulation.step(30)
    assert (simulation.poses[own, 2] < low - 0.5).all()
    simulation.explode((0.4, -2.0, 0.5), 1.0)
    simulation.step(5)
    assert (simulation.velocities[own, 1] > 0.1).all()


def test_names_do_not_collide_and_bad_objects_change_nothing():
    """Refuse a name that is or was taken, and a place that is none."""
    simulation = stand(wall(4, 4))
    for name, place in (('thing_0', (5.0, 0.0, 0.0)), ('new', (np.nan, 0.0, 0.0))):
        with pytest.raises(CommandError):
            simulation.add(wall(3, 3), place, name=name)
    assert len(simulation.poses) == len(wall(4, 4)) and len(simulation.objects) == 1
    with pytest.raises(CommandError, match='did you mean thing_0'):
        simulation.remove('thing_1')


@pytest.mark.parametrize('name', ['a/b', 'a\nb', 3])
def test_names_that_name_no_part_are_refused(name):
    """Refuse an object whose parts could not be named, in a scene and in a running one."""
    simulation = stand(wall(3, 4))
    with pytest.raises(CommandError, match='cannot name an object'):
        simulation.add(wall(3, 4), (9.0, 0.0, 0.0), name=name)
    assert len(simulation.objects) == 1
    with pytest.raises(SceneError, match='cannot name an object'):
        Scene().add(wall(3, 4), name=name)


def test_snapshots_and_resets_know_what_joined():
    """Restore an enlarged scene in a fresh simulation; a reset puts the addition back whole."""
    simulation = stand(wall(4, 4), bush(30, seed=1, damping_ratio=0.1))
    simulation.set_wind((9.0, 0.0, 0.0))
    simulation.add(wall(5, 6), (0.0, 5.0, 0.0), 0.3, 'later')
    simulation.step(10)
    data = simulation.save()
    simulation.step(20)
    other = stand(wall(4, 4), bush(30, seed=1, damping_ratio=0.1))
    other.restore(data)
    other.step(20)
    np.testing.assert_array_equal(simulation.poses, other.poses)
    assert [o.name for o in other.objects] == ['thing_0', 'thing_1', 'later']
    other.launch(Projectile('sphere', 0.3, 40.0, (0.4, 2.0, 0.4), (0.0, 25.0, 0.0)))
    other.step(30)
    assert other.bonds_broken
    other.reset()
    assert other.time == 0.0 and other.added == ('later',) and not other.bonds_broken
    np.testing.assert_array_equal(other.poses, other.blueprint.poses)
    assert len(other.poses) == len(wall(4, 4)) + 30 + len(wall(5, 6))
    other.step(10)
    np.testing.assert_allclose(other.poses[-30:], other.blueprint.poses[-30:], atol=1e-9)


def test_resets_keep_removed_objects_away_until_all_is_undone():
    """Remove an object of the scene and one that was added: reset keeps both out, revert none."""
    simulation = stand(wall(4, 4), bush(30, seed=1, damping_ratio=0.1))
    simulation.add(wall(3, 3), (0.0, 5.0, 0.0), name='later')
    simulation.add(wall(3, 4), (0.0, 9.0, 0.0), name='last')
    for name in ('thing_0', 'later'):
        simulation.remove(name)
    assert simulation.removed == ('thing_0', 'later') and simulation.added == ('last',)
    simulation.reset()
    names = [o.name for o in simulation.objects]
    assert names == ['thing_0', 'thing_1', 'last'] and simulation.removed == ('thing_0',)
    assert not simulation.exists[:len(wall(4, 4))].any()
    assert simulation.exists[len(wall(4, 4)):].all()
    assert simulation.add(wall(3, 3), (0.0, 5.0, 0.0), name='later').count
    simulation.revert()
    assert [o.name for o in simulation.objects] == ['thing_0', 'thing_1']
    assert simulation.exists.all() and not simulation.added and not simulation.removed


def test_a_free_name_is_one_that_nothing_has_or_had():
    """Count on from what is there, what was removed and what was launched."""
    simulation = stand(wall(2, 2))
    simulation.launch(Projectile('sphere', 0.1, 1.0, (0.0, -3.0, 5.0), (0.0, 0.0, 0.0)))
    simulation.add(wall(2, 2), (0.0, 5.0, 0.0), name='thing_1')
    simulation.remove('thing_1')
    assert simulation.free_name('thing') == 'thing_2'
    assert simulation.free_name('projectile') == 'projectile_1'
    assert simulation.add(wall(2, 2), (0.0, 9.0, 0.0)).name == 'object_0'


def test_what_is_loose_can_be_put_elsewhere():
    """Set pose and twist of a ball in flight: it falls freely from there; walls stay put."""
    simulation = stand(wall(3, 3))
    simulation.launch(Projectile('sphere', 0.2, 5.0, (0.0, -9.0, 1.0), (3.0, 0.0, 0.0)))
    simulation.step(200)  # it lies still
    simulation.set_body_state('projectile_0/0', (2.0, -9.0, 30.0, 0.0, 0.0, 0.0, 2.0),
                              (1.0, 0.0, 0.0, 0.0, 0.0, 4.0))
    np.testing.assert_allclose(simulation.poses[-1], [2.0, -9.0, 30.0, 0.0, 0.0, 0.0, 1.0])
    simulation.step(30)
    fallen = 0.5 * 9.81 * 0.5 ** 2
    assert simulation.poses[-1, 0] == pytest.approx(2.5, abs=0.01)
    assert simulation.poses[-1, 2] == pytest.approx(30.0 - fallen, abs=0.1)
    for part, pose in (('thing_0/0', (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
                       ('projectile_0/0', (np.nan, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)),
                       ('projectile_0/0', (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0))):
        before = simulation.poses.copy()
        with pytest.raises(CommandError):
            simulation.set_body_state(part, pose)
        np.testing.assert_array_equal(simulation.poses, before)


def test_what_is_put_elsewhere_keeps_its_motion():
    """Move a ball that was just launched, then struck: it flies on with both, from there."""
    simulation = stand(wall(3, 3))
    ball = simulation.launch(Projectile('sphere', 0.2, 5.0, (0.0, -9.0, 1.0), (3.0, 0.0, 0.0)))
    np.testing.assert_array_equal(simulation.velocities[ball], [3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    simulation.set_body_state(ball, (2.0, -9.0, 30.0, 0.0, 0.0, 0.0, 1.0))
    simulation.apply_impulse(ball, (0.0, 10.0, 0.0))
    simulation.set_body_state(ball, (4.0, -9.0, 30.0, 0.0, 0.0, 0.0, 1.0))
    np.testing.assert_allclose(simulation.velocities[ball], [3.0, 2.0, 0.0, 0.0, 0.0, 0.0],
                               atol=1e-12)
    simulation.step(6)
    np.testing.assert_allclose(simulation.poses[ball, :2], [4.3, -8.8], atol=0.01)


def test_a_piece_moves_as_one_when_a_part_of_it_is_moved():
    """Put one brick of a loose pair elsewhere, turned: the other keeps its place beside it."""
    simulation = stand(wall(2, 2))
    simulation.add(bonded([[0.0, 0.0, 1.0], [0.2, 0.0, 1.0]], (0.2, 0.1, 0.1), ground=False,
                          tension=1e7, cohesion=1e7), name='pair')
    simulation.step(120)
    before = rotation.relative(simulation.poses[-2], simulation.poses[-1])
    turned = np.array([9.0, 9.0, 5.0, *rotation.from_yaw(1.0)])
    simulation.set_body_state('pair/0', turned, np.zeros(6))
    np.testing.assert_allclose(simulation.poses[-2], turned, atol=1e-9)
    apart = rotation.relative(simulation.poses[-2], simulation.poses[-1])
    np.testing.assert_allclose(apart, before, atol=1e-9)


POLE = 'axiom: Width(0.04) Density(800) Modulus(8e9) F(rand(1,2)) F(1) Leaf(0.4, 1)'
WHOLE = {
    'scene': {'objects': ['pole', 'mast', 'lone']}, 'seed': 3,
    'wind': {'velocity': [9.0, 2.0, 0.0], 'turbulence_intensity': 0.2},
    'pole': {'grammar_text': POLE, 'count': 7, 'layout': 'scatter'},
    'mast': {'grammar_text': POLE, 'count': 4, 'origin': [40.0, 0.0, 0.0], 'variants': 2},
    'lone': {'grammar_text': POLE, 'origin': [0.0, 40.0, 0.0]},
}


@pytest.mark.parametrize('count', [2, 12])
def test_the_shares_together_are_the_whole_scene(count):
    """Find every instance in one share, moving as it does in the whole scene."""
    whole = Simulation(Scene.from_parameters(WHOLE))
    whole.step(30)
    expected = {o.name: whole.poses[o.first:o.first + o.count] for o in whole.objects}
    found = {}
    for index in range(count):
        share = Simulation(Scene.from_parameters(
            {**WHOLE, 'shard': {'index': index, 'count': count}}))
        share.step(30)
        for o in share.objects:
            assert o.name not in found
            found[o.name] = share.poses[o.first:o.first + o.count]
    assert set(found) == set(expected)
    for name, poses in expected.items():
        assert np.array_equal(found[name], poses)


@pytest.mark.parametrize(('shard', 'word'), [
    ({'index': 2, 'count': 2}, 'shard.index'), ({'index': -1, 'count': 2}, 'shard.index'),
    ({'index': 0, 'count': 0}, 'shard.count'), ({'index': 'x', 'count': 2}, 'shard.index'),
    ({'index': 0.5, 'count': 2}, 'shard.index'), ({'share': 1}, 'shard'), (7, 'shard'),
])
def test_shares_that_cannot_be_are_named(shard, word):
    """Name the key and what is allowed."""
    with pytest.raises(SceneError, match=word):
        Scene.from_parameters({**WHOLE, 'shard': shard})


def test_what_comes_to_a_share_has_a_name_of_its_own():
    """Throw a ball in each share, and find no name twice; alone, a node calls it projectile_0."""
    def names(**shard):
        share = Simulation(Scene.from_parameters({**WHOLE, **shard}))
        share.launch(Projectile(position=(0.0, -30.0, 5.0), velocity=(0.0, 1.0, 0.0)))
        return [o.name for o in share.objects]
    shares = [name for index in range(2) for name in names(shard={'index': index, 'count': 2})]
    assert len(set(shares)) == len(shares)
    assert {n for n in shares if 'projectile' in n} == {'projectile_0_shard_0',
                                                        'projectile_0_shard_1'}
    assert names()[-1] == 'projectile_0'
