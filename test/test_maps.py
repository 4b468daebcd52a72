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

"""Maps: houses, roads and trees of GeoJSON, OpenStreetMap and CityJSON in a scene."""

import json
import logging
from pathlib import Path
import random

import numpy as np
import pytest

from procphys_ros.errors import ProcPhysError, SceneError
from procphys_ros.maps import houses_of, read_map, roads_of
from procphys_ros.maps.command import main
from procphys_ros.scene import Scene
from procphys_ros.scene.map_rules import read_rules
from procphys_ros.scene.paving import _area
from procphys_ros.simulation import Simulation
from procphys_ros.wallgrammar import WallGrammar

ROOT = Path(__file__).resolve().parents[1]
HAMLET = ROOT / 'grammars' / 'hamlet.geojson'
METRE = 1.0 / np.array([111_319.49, 110_574.39])  # [degrees] on the equator (WGS 84)


def written(folder, features, name='a.geojson', **more):
    """Write GeoJSON: rings [m] at the equator, with tags, as (kind, ring, tags)."""
    shapes = {'building': ('Polygon', lambda ring: [[*ring, ring[0]]]),
              'road': ('LineString', lambda ring: ring), 'tree': ('Point', lambda ring: ring[0])}
    root = {'type': 'FeatureCollection', **more, 'features': [
        {'type': 'Feature', 'properties': tags, 'geometry': {
            'type': shapes[kind][0],
            'coordinates': shapes[kind][1]((METRE * np.array(ring, float)).tolist())}}
        for kind, ring, tags in features]}
    path = folder / name
    path.write_text(json.dumps(root), 'utf-8')
    return path


def box(x, y, width, depth):
    """Return the corners of a rectangle."""
    return [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]


def houses(path):
    """Return what becomes of each building of a map."""
    return [house for _, house in houses_of(read_map(path).in_metres())]


def scene_of(path, **more):
    """Build the scene of a map."""
    return Scene.from_parameters({
        'scene': {'objects': ['block']}, 'block': {'grammar': str(path), **more}})


OSM = """<osm version="0.6">
  <node id="1" lat="48.0" lon="9.0"/><node id="2" lat="48.0" lon="9.0002"/>
  <node id="3" lat="48.00012" lon="9.0002"/><node id="4" lat="48.00012" lon="9.0"/>
  <node id="5" lat="48.00004" lon="9.00006"/><node id="6" lat="48.00004" lon="9.00012"/>
  <node id="7" lat="48.00008" lon="9.00012"/>
  <node id="8" lat="47.9999" lon="9.0"><tag k="natural" v="tree"/></node>
  <way id="10"><nd ref="1"/><nd ref="2"/><nd ref="3"/></way>
  <way id="11"><nd ref="1"/><nd ref="4"/><nd ref="3"/></way>
  <way id="12"><nd ref="5"/><nd ref="6"/><nd ref="7"/><nd ref="5"/></way>
  <way id="13"><nd ref="1"/><nd ref="2"/><nd ref="99"/><tag k="highway" v="service"/></way>
  <way id="14"><nd ref="1"/><nd ref="2"/><tag k="waterway" v="stream"/></way>
  <relation id="20"><member type="way" ref="10" role="outer"/>
    <member type="way" ref="11" role="outer"/><member type="way" ref="12" role="inner"/>
    <tag k="type" v="multipolygon"/><tag k="building" v="yes"/></relation>
</osm>"""


SHED = """building shed
  footprint: (0, 0) (5, 0) (5, 4) (0, 4)
  facades: plain
  storey_height: 2.4
  roof: ROOF
layout english { unit: 0.215 0.1025 0.065  material: brick }
panel plain: english"""


def test_an_extract_of_openstreetmap_is_read(tmp_path):
    """Join the ways of an outline, whatever their direction, and leave out what is no feature."""
    path = tmp_path / 'a.osm'
    path.write_text(OSM, 'utf-8')
    found = read_map(path)
    features = found.in_metres()
    assert [one.kind for one in features] == ['building', 'road', 'tree']
    assert found.left_out == {'way': 1}
    outline, courtyard = features[0].rings
    # 1 arc second of latitude at 48 degrees is 30.887 m, of longitude 20.733 m (WGS 84).
    assert np.ptp(outline, axis=0) == pytest.approx([0.72 * 20.733, 0.432 * 30.887], rel=1e-3)
    assert len(outline) == 4 and len(courtyard) == 3
    assert next(houses_of(features))[1].notes == ('courtyards are left out',)


def test_a_binary_extract_is_the_same(tmp_path):
    """Read PBF as XML."""
    osmium = pytest.importorskip('osmium')
    path, other = tmp_path / 'a.osm', tmp_path / 'b.osm.pbf'
    path.write_text(OSM, 'utf-8')
    writer = osmium.SimpleWriter(str(other))
    for element in osmium.FileProcessor(str(path)):
        writer.add(element)
    writer.close()
    one, two = (read_map(p).in_metres() for p in (path, other))
    assert [f.kind for f in one] == [f.kind for f in two]
    for first, second in zip(one, two):
        assert first.tags == second.tags
        assert all(np.abs(a - b).max() < 0.02 for a, b in zip(first.rings, second.rings))


def test_cityjson_stands_on_its_ground_surfaces(tmp_path):
    """Take footprint, height, storeys and roof of a solid of 8 by 6 by 9 m."""
    corners = [(x, y, z) for z in (0, 9000) for x, y in ((0, 0), (8000, 0), (8000, 6000),
                                                         (0, 6000))]
    walls = [[[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k]] for k in range(4)]
    faces = [[[3, 2, 1, 0]], [[4, 5, 6, 7]], *walls]
    solid = {'type': 'Solid', 'lod': '2', 'boundaries': [faces], 'semantics': {
        'surfaces': [{'type': 'GroundSurface'}, {'type': 'WallSurface'}],
        'values': [[0, 1, 1, 1, 1, 1]]}}
    root = {'type': 'CityJSON', 'version': '2.0', 'vertices': corners,
            'transform': {'scale': [0.001] * 3, 'translate': [4e5, 5e6, 0.0]},
            'CityObjects': {
                'a': {'type': 'Building', 'attributes': {'storeysAboveGround': 3,
                                                         'roofType': '1000'},
                      'children': ['b']},
                'b': {'type': 'BuildingPart', 'parents': ['a'], 'geometry': [solid]},
                'c': {'type': 'WaterBody'}}}
    path = tmp_path / 'a.city.json'
    path.write_text(json.dumps(root), 'utf-8')
    house, = houses(path)
    assert np.ptp(house.corners, axis=0).tolist() == [8.0, 6.0]
    assert (house.storeys, house.storey_height, house.roof) == (3, 3.0, 'flat')


def test_tags_become_storeys_and_roofs(tmp_path):
    """Read heights in metres and feet, levels, pitches, and whether the ridge runs across."""
    tags = [{'building': 'house', 'building:levels': '3', 'roof:shape': 'gabled'},
            {'building': 'yes', 'height': '9 m', 'roof:shape': 'flat'},
            {'building': 'yes', 'height': '30 ft', 'roof:shape': 'hipped', 'roof:angle': '45'},
            {'building': 'house', 'roof:shape': 'onion', 'roof:orientation': 'across'},
            {'name': 'a footprint alone'}]
    path = written(tmp_path, [('building', box(20 * k, 0, 10, 6), own)
                              for k, own in enumerate(tags)])
    found = houses(path)
    assert [house.storeys for house in found] == [3, 3, 2, 2, 2]
    assert [house.roof for house in found] == ['gable', 'flat', 'hip', 'hip', None]
    assert found[2].storey_height == pytest.approx(0.5 * (30 * 0.3048 - 3.0), abs=0.01)
    ways = [house.corners[1] - house.corners[0] for house in found]
    assert np.abs(np.array(ways)[:, 0]).round(1).tolist() == [10.0, 10.0, 10.0, 0.0, 10.0]
    assert found[3].notes == ('roofs "onion" are hips',)


def test_houses_know_their_neighbours_and_their_road(tmp_path):
    """Turn the front to the road, no window to a neighbour, and gables to either side."""
    path = written(tmp_path, [
        *(('building', box(6 * k, 5, 6, 9), {'building': 'house'}) for k in range(3)),
        ('building', box(18, 8, 3, 4), {'building': 'garage'}),
        ('building', box(1, 6, 3, 3), {'building': 'yes'}),
        ('road', [(-20, 0), (40, 0)], {'highway': 'residential'})])
    first, middle, last, garage, part = houses(path)
    assert part == 'those that overlap others are left out'
    for house, sides in ((first, 1), (middle, 2), (last, 2)):
        ends = np.roll(house.corners, -1, axis=0)
        low = np.argmin(house.corners[:, 1] + ends[:, 1])
        assert house.facades[low] == 0
        assert house.facades.count(2) == sides
    assert [house.room for house in (first, middle, last)] == ['ridge'] * 3
    assert garage.room == 'none'  # beside a higher one


def test_roads_have_no_gaps_where_they_bend(tmp_path):
    """Cover the outer corner of a bend, with the width of two lanes."""
    path = written(tmp_path, [('road', [(0, 0), (20, 0), (20, 20)], {'highway': 'tertiary',
                                                                     'lanes': '2'})])
    one, two = roads_of(read_map(path).in_metres()[0], 5.0)
    assert one.width == two.width == 6.5
    assert one.end - one.start == pytest.approx([23.25, 0.0], abs=0.01)
    assert two.end - two.start == pytest.approx([0.0, 23.25], abs=0.01)
    scene = scene_of(path)
    corners = [paving.points[face][:, :2] for paving in scene.paving for face in paving.faces
               if paving.texture == 'asphalt']
    whole = 6.5 * (2 * 20.0) - 3.25 * 3.25 + 3.25 * 3.25  # without the inner, with the outer one
    assert sum(map(_area, corners)) == pytest.approx(whole, rel=2e-3)


def test_the_hamlet_stands():
    """Build what the shipped map shows, bear itself, and repeat."""
    scene, again = scene_of(HAMLET, seed=3), scene_of(HAMLET, seed=3)
    assert np.array_equal(scene.blueprint.poses, again.blueprint.poses)
    names = [one.name for one in scene.objects]
    assert [f'block_house_{k}' for k in range(10)] == names[:10] and len(names) == 15
    simulation = Simulation(scene)
    assert not simulation.warnings
    simulation.close()


def drawn(rng):
    """Draw a crooked outline that is simple: corners at random distances around a middle."""
    count = int(rng.integers(3, 9))
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    away = rng.uniform(2.5, 9.0, count)[:, None]
    return (away * np.column_stack([np.cos(angle), np.sin(angle)])).tolist()


def test_houses_that_nobody_drew_by_hand_stand(tmp_path, caplog):
    """Build crooked outlines, some hardly buildable, and tell of all that is left out."""
    rng = np.random.default_rng(5)
    path = written(tmp_path, [
        ('building', (np.array(drawn(rng)) + [25.0 * k, 0.0]).tolist(),
         {'building': 'yes', 'building:levels': str(1 + k % 2)}) for k in range(10)])
    with caplog.at_level(logging.WARNING):
        scene = scene_of(path)
    lost = sum(int(record.message.split()[0]) for record in caplog.records
               if 'houses: houses are left out' in record.message)
    assert len(scene.objects) == 10 - lost and lost < 3
    simulation = Simulation(scene)
    assert not [text for text in simulation.warnings if 'weight' in text and '; 0 of' not in text]
    simulation.close()


@pytest.mark.parametrize(('name', 'text', 'told'), [
    ('a.geojson', '{"type": ', r'a.geojson:1: this is no JSON'),
    ('a.geojson', '[' * 100_000, 'nested too deep|no JSON'),
    ('a.geojson', '{"type": "Topology"}', 'must be FeatureCollection'),
    ('a.geojson', '{"type": "FeatureCollection", "features": []}', 'no building, road or tree'),
    ('a.geojson', '{"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [[["a"]]]}}',
     'feature 0: its coordinates'),
    ('a.geojson', '{"type": "Feature", "geometry": {"type": "Polygon", "coordinates": '
     '[[[0, 0], [1, 0], [500, 1]]]}}', 'feature 0: coordinates must be longitudes'),
    ('a.geojson', '{"type": "Feature", "geometry": {"type": "Polygon", "coordinates": '
     '[[[0, 0], [1, 0], [1, 1]]]}}', 'km wide'),
    ('a.osm', '<osm><node id="1" lat="x" lon="0"/></osm>', 'a.osm:1: (lat|lon) is'),
    ('a.osm', '<!DOCTYPE a [<!ENTITY b "c">]><osm/>', 'a DOCTYPE is not allowed'),
    ('a.osm', '<osm><node', 'this is no XML'),
    ('a.osm.pbf', 'no pbf', 'this is no PBF'),
    ('a.city.json', '{"type": "CityJSON"}', 'this is no CityJSON'),
    ('a.city.json', '{"type": "CityJSON", "CityObjects": {"a": {"type": "Building", "geometry": '
     '[{"type": "Solid", "boundaries": [[["x"]]]}]}}, "vertices": []}', 'object a: its geometry')])
def test_what_cannot_be_read_is_told(tmp_path, name, text, told):
    """Name file and place, and what is allowed."""
    path = tmp_path / name
    path.write_text(text, 'utf-8')
    with pytest.raises(SceneError, match=told):
        scene_of(path)


def test_broken_maps_end_in_messages(tmp_path):
    """Change the shipped map at random: a scene or a message of ours."""
    generator, text = random.Random(2), HAMLET.read_text('utf-8')
    path = tmp_path / 'a.geojson'
    for _ in range(150):
        place, size = generator.randrange(len(text)), generator.randrange(1, 30)
        path.write_text(text[:place] + generator.choice(['', '[', '}', '"', '1e9', 'null'])
                        + text[place + size:], 'utf-8')
        try:
            list(houses_of(read_map(path).in_metres()))
        except ProcPhysError as error:
            assert 'a.geojson' in str(error)


def test_rules_choose_grammars_by_tags(tmp_path):
    """Take the first rule that fits, and leave out what takes none."""
    (tmp_path / 'my.rules').write_text("""
buildings:
  - {tags: {building: [barn, shed]}, grammar: none}
  - {grammar: map_shed.wall, storey_height: 3.5}
roads:
  - {tags: {lit: []}, width: 4, surface: gravel}
""", 'utf-8')
    path = written(tmp_path, [
        ('building', box(0, 0, 6, 5), {'building': 'barn'}),
        ('building', box(20, 0, 6, 5), {'building': 'yes'}),
        ('tree', [(10, 10)], {'natural': 'tree'}),
        ('road', [(0, -9), (40, -9)], {'highway': 'track'}),
        ('road', [(0, -5), (40, -5)], {'highway': 'track', 'lit': 'no'})])
    rules = read_rules(tmp_path / 'my.rules')
    assert rules.of('tree', {}) is None and rules.of('road', {'lit': 'no'}).width == 4.0
    scene = scene_of(path, rules=str(tmp_path / 'my.rules'))
    assert [one.name for one in scene.objects] == ['block_house_0']
    assert [paving.texture for paving in scene.paving] == ['gravel']
    with pytest.raises(SceneError, match=r'block.rules: only maps'):
        Scene.from_parameters({'scene': {'objects': ['block']}, 'block': {
            'grammar': 'oak.lsys', 'rules': 'map.rules'}})


@pytest.mark.parametrize(('text', 'told'), [
    ('buildings: [{grammar: oak.lsys}]', r'rules:1: grammar is .*ends in .wall'),
    ('buildings:\n  - {tags: {a: 3}, grammar: none}', r'rules:2: tags has a'),
    ('houses: []', r'no key "houses"'),
    ('roads: [{width: wide}]', r'rules:1: width is')])
def test_wrong_rules_are_told(tmp_path, text, told):
    """Name file, line, key and what is allowed."""
    path = tmp_path / 'my.rules'
    path.write_text(text, 'utf-8')
    with pytest.raises(SceneError, match=told):
        read_rules(path)


def test_the_command_writes_a_scene(tmp_path, capsys):
    """Tell what is in a map, and write a scene that is read again; replace nothing unasked."""
    out = tmp_path / 'hamlet.yaml'
    assert main([str(HAMLET), '--out', str(out)]) == 0
    assert '10 buildings, 2 roads, 5 trees' in capsys.readouterr().out
    assert main([str(HAMLET), '--out', str(out)]) == 1
    assert '--force' in capsys.readouterr().err
    assert len(Scene.from_yaml(out).objects) == 15
    assert main([str(tmp_path / 'none.osm')]) == 1
    assert 'none.osm' in capsys.readouterr().err


def test_a_grammar_keeps_its_roof_over_another_outline():
    """Change the pitch of a lean-to over another rectangle."""
    grammar = WallGrammar.parse(SHED.replace('ROOF', 'lean_to(20)'))
    corners = np.array(box(0.0, 0.0, 4.0, 3.0))
    heights = [np.ptp(grammar.over(corners, [0] * 4, 'a map', pitch=pitch)
                      .build().poses[:, 2]) for pitch in (None, 30.0)]
    rise = 3.0 * (np.tan(np.radians(30.0)) - np.tan(np.radians(20.0)))
    assert heights[1] - heights[0] == pytest.approx(rise, abs=0.1)
