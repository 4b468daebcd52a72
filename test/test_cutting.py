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

"""Saw cuts: branches off trees, bricks out of walls, loose pieces in two."""

import json

from grown_trees import bush
from masonry_walls import wall
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from test_arches import WALL
from visualization_msgs.msg import MarkerArray

from procphys_ros import messages
from procphys_ros.blueprint.cut_bricks import first_pieces
from procphys_ros.errors import CommandError
from procphys_ros.export.content import Content
from procphys_ros.export.surfaces import surfaces
from procphys_ros.lsystem import LSystem
from procphys_ros.messages.scene_description import SceneDescription
from procphys_ros.scene import Scene
from procphys_ros.simulation import Cause, Owner, Simulation
from procphys_ros.view.source import PageContent
from procphys_ros.wallgrammar import WallGrammar


def simulate(blueprint, name, height=0.0):
    scene = Scene()
    scene.add(blueprint, (0.0, 0.0, height), 0.0, name)
    return Simulation(scene)


def momentum(simulation):
    return simulation.blueprint.mass @ simulation.velocities[:, :3]


def joined(simulation, above):
    """Return whether an unbroken joint has one end above and the other below."""
    graph = simulation.state.loose_bonds.graph
    pairs = simulation.blueprint.bonds[graph.alive]
    inner = pairs[(pairs >= 0).all(axis=1)]
    return bool((above[inner[:, 0]] != above[inner[:, 1]]).any())


@pytest.mark.parametrize('seed', range(4))
def test_a_cut_along_a_plane_leaves_no_joint_across_it(seed):
    """Cut bushes and walls along random planes: no joint is left across, and no other is lost."""
    rng = np.random.default_rng(seed)
    for made in (bush(60, seed=seed, strength=1e12), wall(8, 8)):
        simulation = simulate(made, 'it')
        centres = simulation.blueprint.poses[:, :3]
        point = centres[rng.integers(len(centres))]
        normal = rng.normal(size=3)
        above = (simulation.poses[:, :3] - point) @ normal > 0.0
        assert joined(simulation, above)
        pairs = simulation.blueprint.bonds
        count = simulation.cut('it', point, normal)
        assert not joined(simulation, above)
        across = (pairs >= 0).all(axis=1) & (above[pairs[:, 0]] != above[pairs[:, 1]])
        grounded = count - across.sum()
        assert 0 <= grounded <= (pairs < 0).sum()
        events = simulation.events
        assert len(events) == count and (events['cause'] == Cause.CUT).all()
        assert (events['load'] == 0.0).all()


def test_a_branch_is_cut_without_a_jerk_and_falls():
    """Cut a branch off: nothing moves at once, and a second later what it bore lies lower."""
    simulation = simulate(bush(60, seed=2, strength=1e12), 'bush')
    simulation.apply_impulse('bush/20', (5.0, 0.0, 0.0))
    simulation.step(30)
    before, moving = simulation.poses.copy(), simulation.velocities.copy()
    foot = int(np.argmax(simulation.blueprint.poses[:, 2] > 0.5))
    assert simulation.cut(f'bush/{foot}') == 1
    np.testing.assert_array_equal(simulation.poses, before)
    np.testing.assert_allclose(simulation.velocities, moving, atol=1e-12)
    graph, falls = simulation.blueprint.bonds, {foot}
    for a, b in graph.tolist():  # joints are listed from the root on
        if a in falls and b != foot:
            falls.add(b)
    falling = sorted(falls)
    simulation.step(60)
    assert (before[falling, 2] - simulation.poses[falling, 2]).mean() > 0.2
    with pytest.raises(CommandError, match='nothing holds'):
        simulation.cut(f'bush/{foot}')


def test_a_felled_tree_bends_until_it_lies():
    """Cut an oak at its foot and push it: it falls as a flexible tree, and breaks as it lands."""
    made = LSystem.load('oak.lsys').build()
    simulation = simulate(made, 'oak')
    simulation.step()
    top = simulation.poses[:, 2].max()
    assert simulation.cut(0) == 1
    simulation.apply_impulse(len(made) // 3, (400.0, 0.0, 0.0))
    while simulation.poses[:, 2].max() > 0.5 * top:
        assert simulation.time < 6.0
        simulation.step()
        assert (simulation.state.parts.owner == Owner.TREE).mean() > 0.6
    simulation.step(60)
    assert simulation.poses[:, 2].max() < 0.25 * top
    assert simulation.bonds_broken > 3
    assert simulation.poses[:, 0].max() > 0.6 * top


def test_a_plant_is_cut_with_what_it_has_grown():
    """Cut a plant that grows, at half its height: no joint is left across, and it grows on."""
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['tree']}, 'tree': {'grammar': 'garden_tree.lsys', 'steps': 6}}))
    first = len(simulation.blueprint)
    simulation.grow('tree', 4.0, 4)
    simulation.step(30)
    level = 0.5 * np.nanmax(simulation.poses[:, 2])
    above = simulation.poses[:, 2] > level
    simulation.cut('tree', (0.0, 0.0, level), (0.0, 0.0, 1.0))
    assert len(simulation.blueprint) > first and not joined(simulation, above)
    simulation.step(60)
    assert np.isfinite(simulation.poses[simulation.state.parts.owner != Owner.GONE]).all()
    assert simulation.state.forest.active.any()


def test_a_brick_is_cut_out_and_stays_in_its_hole():
    """Saw around a brick: it settles by a joint, and the wall stands over its hole."""
    simulation = simulate(wall(12, 12), 'wall')
    simulation.step(2)
    place = np.array([1.3, 0.0, 0.45])
    brick = int(np.argmin(((simulation.poses[:, :3] - place) ** 2).sum(axis=1)))
    start = simulation.poses.copy()
    assert simulation.cut(brick) == 6
    simulation.step(90)
    assert simulation.state.parts.owner[brick] == Owner.BODY
    assert 0.005 < start[brick, 2] - simulation.poses[brick, 2] < 0.012
    assert simulation.state.standing.sum() == len(start) - 1
    assert simulation.bonds_broken == 6


@pytest.mark.parametrize('along', [True, False])
def test_a_loose_piece_is_cut_in_two_with_its_momentum(along):
    """Cut a lump in flight: two bodies, with the momentum and the places of before."""
    simulation = simulate(wall(6, 6, ground=False), 'lump', 5.0)
    simulation.apply_impulse('lump/3', (20.0, 5.0, 3.0))
    simulation.step(5)
    assert simulation.awake_bodies == 1
    before, place, moving = momentum(simulation), simulation.poses.copy(), simulation.velocities
    moving = moving.copy()
    middle = place[:, :3].mean(axis=0)
    simulation.cut('lump', middle, (1.0, 0.0, 0.0) if along else (0.0, 0.0, 1.0))
    assert simulation.awake_bodies == 2
    np.testing.assert_allclose(momentum(simulation), before, rtol=1e-9)
    np.testing.assert_allclose(simulation.poses, place, atol=1e-9)
    np.testing.assert_allclose(simulation.velocities, moving, atol=1e-6)


def test_reach_limits_the_cut():
    """Cut as far as the blade reaches: fewer joints, all of them near."""
    simulation = simulate(wall(12, 12), 'wall')
    point = np.array([1.3, 0.0, 0.45])
    count = simulation.cut('wall', point, (0.0, 0.0, 1.0), 0.5)
    events = simulation.events
    assert 0 < count < 12
    assert (np.linalg.norm(events['position'] - point, axis=1) <= 0.5).all()


@pytest.mark.parametrize('target, plane, words', [
    ('wall', {}, 'is an object: a cut through it takes a plane'),
    ('wall', {'point': (0.0, 0.0, 50.0), 'normal': (0.0, 0.0, 1.0)}, 'no joint of wall'),
    ('wall/999', {}, 'there is no part'), ('walk/1', {}, 'did you mean'),
    ('wall/1', {'normal': (np.nan, 0.0, 0.0)}, 'cut.normal'),
    ('wall/1', {'reach': 0.0, 'normal': (1.0, 0.0, 0.0)}, 'cut.reach')])
def test_what_cannot_be_cut_is_refused(target, plane, words):
    """Say why, and change nothing."""
    simulation = simulate(wall(6, 6), 'wall')
    with pytest.raises(CommandError, match=words):
        simulation.cut(target, **plane)
    assert simulation.bonds_broken == 0


STRONG = 'material brick { tension: 3e6  cohesion: 4e6 }'


def built(more=''):
    """Build a wall with an arch in it."""
    text = WALL.format(below='opening', height=1.1, arch='round, 1')
    return WallGrammar.parse(text + more).build()


@pytest.mark.parametrize('more', ['', STRONG])
def test_pieces_of_a_brick_are_found(more):
    """Find pieces in one course, no longer than a brick, and leave voussoirs alone."""
    wall = built(more)
    first = first_pieces(wall)
    middle = wall.poses[:, [0, 2]]
    joined = np.flatnonzero(first != np.arange(len(wall)))
    assert len(joined) > 10 and np.isin(joined, wall.hexahedra.part).all()
    assert (np.abs(middle[joined] - middle[first[joined]]) < [1.3 * 0.215, 0.075]).all()
    stone = np.flatnonzero(np.array(wall.kinds)[wall.kind] == 'voussoir')
    assert len(stone) and (first[stone] == stone).all()
    assert (first == first_pieces(built())).all()


def test_pieces_of_a_brick_have_one_tint():
    """Find one colour per brick in markers and exports, and tell viewers which pieces belong."""
    scene = Scene()
    scene.add(built(), name='wall')
    simulation = Simulation(scene)
    blueprint = simulation.blueprint
    first = first_pieces(blueprint)
    data = messages.SceneMarkers(blueprint, simulation.objects, 'world').whole(
        blueprint.poses, (0, 0))
    markers = deserialize_message(data, MarkerArray).markers
    colour = {marker.id: marker.color.r for marker in markers if marker.ns == 'wall'}
    assert len(colour) == len(blueprint)
    assert all(colour[part] == colour[one] for part, one in enumerate(first.tolist()))
    assert len(set(colour.values())) == len(np.unique(first))
    tones = {tone for one in surfaces(Content.of(simulation)) if one.texture == 'brick_red'
             for tone in one.tone.tolist()}
    assert len(tones) == len(np.unique(first))
    described = json.loads(SceneDescription('world').write(blueprint, simulation.objects))
    solids = described['hexahedra']
    assert solids['first_piece'] == first[solids['part']].tolist()
    assert (PageContent.of(blueprint, simulation.names.name, 0).first_piece == first).all()
