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


"""Pieces of one cut brick are drawn in one tint: in markers, pictures, exports and on the page."""

import json

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from test_arches import WALL
from visualization_msgs.msg import MarkerArray

from procphys_ros import messages
from procphys_ros.blueprint.cut_bricks import first_pieces
from procphys_ros.export.content import Content
from procphys_ros.export.surfaces import surfaces
from procphys_ros.messages.scene_description import SceneDescription
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation
from procphys_ros.view.source import PageContent
from procphys_ros.wallgrammar import WallGrammar

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
