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


"""Paving: roads and pavements of a plan, cut at crossings, laid onto hills, shown and exported."""

import math

import numpy as np
import pytest

from procphys_ros.errors import SceneError
from procphys_ros.export.content import Content
from procphys_ros.export.surfaces import surfaces
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.scene import Scene
from procphys_ros.scene.paving import pave
from procphys_ros.scene.plan import read_plan

PLAN = """
streets:
  high: {from: [-30, 0], to: [30, 0], width: 6, surface: asphalt, pavement: 1.5}
  mill: {from: [-8, -20], to: [12, 24], width: 4, surface: cobbles, pavement: 1.2}
  path: {from: [0, 50], to: [9, 50], width: 1}
trees:
  - {street: high, side: left, grammars: [pole.lsys], spacing: 30}
"""
POLE = 'axiom: Width(0.1) Density(700) Modulus(8e9) DampingRatio(0.05) F(1)\n'
ANGLE = math.atan2(44.0, 20.0)  # between the two streets
HILLS = Terrain(np.random.default_rng(2).uniform(0.0, 2.0, (60, 50)), np.array([-41.0, -33.0]),
                1.5)


@pytest.fixture
def folder(tmp_path):
    """Make a folder with a plan and a grammar."""
    (tmp_path / 'pole.lsys').write_text(POLE)
    (tmp_path / 'cross.plan').write_text(PLAN)
    return tmp_path


def paved(folder, terrain, yaw=0.0):
    """Lay the streets of the plan."""
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    streets = read_plan(folder / 'cross.plan').streets
    return {one.texture: one for one in pave(streets, terrain, np.array([2.0, 1.0]), turn, 'x')}


def across(paving):
    """Compute the cross products of the sides of all triangles, twice their areas long."""
    a, b, c = paving.points[paving.faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


@pytest.mark.parametrize('terrain', [FLAT, HILLS], ids=['flat', 'hills'])
def test_surfaces_do_not_overlap(folder, terrain):
    """Cover what the first street leaves of the second, and what both leave of pavements."""
    found = paved(folder, terrain, yaw=0.4)
    areas = {name: 0.5 * across(one)[:, 2].sum() for name, one in found.items()}
    assert set(areas) == {'asphalt', 'cobbles', 'paving'}
    assert areas['asphalt'] == pytest.approx(60.0 * 6.0)
    length = math.hypot(20.0, 44.0)
    assert areas['cobbles'] == pytest.approx(length * 4.0 - 6.0 * 4.0 / math.sin(ANGLE))
    both = (2 * 60.0 * 1.5 + 2 * length * 1.2
            - (2 * 1.5 * (4.0 + 2 * 1.2) + 2 * 1.2 * 6.0) / math.sin(ANGLE))
    assert areas['paving'] == pytest.approx(both)


def test_surfaces_lie_on_the_terrain(folder):
    """Follow each triangle of the terrain exactly, facing upwards, a little above it."""
    for one in paved(folder, HILLS, yaw=0.4).values():
        assert (across(one)[:, 2] > 0.0).all()
        shares = np.random.default_rng(0).dirichlet((1.0, 1.0, 1.0), len(one.faces))
        inside = np.einsum('fk,fkc->fc', shares, one.points[one.faces])
        lift = inside[:, 2] - HILLS.height(inside)
        np.testing.assert_allclose(lift, lift[0], atol=1e-5)
        assert 0.005 < lift[0] < 0.05
        normals = one.vertex_normals()
        assert (normals[:, 2] > 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


@pytest.mark.parametrize('old, new, message', [
    ('surface: asphalt', 'surface: asfalt', "cross.plan:3: surface is 'asfalt', it must be a"),
    ('surface: asphalt', 'surface: asfalt', 'did you mean asphalt'),
    ('surface: asphalt', 'surface: 3', 'such as asphalt, cobbles'),
    ('pavement: 1.5', 'pavement: -1', 'pavement is -1, it must be a number from 0 to 50'),
    ('pavement: 1.2', 'pavement_surface: 1.2', 'pavement_surface is 1.2')])
def test_slips_are_told(folder, old, new, message):
    """Name file, line, key and what is allowed."""
    (folder / 'cross.plan').write_text(PLAN.replace(old, new))
    with pytest.raises(SceneError) as told:
        read_plan(folder / 'cross.plan')
    assert message in str(told.value)


def test_too_fine_a_terrain_is_refused(folder):
    """Say how much may be covered, and what to do."""
    fine = Terrain(np.zeros((900, 900)), np.array([-45.0, -45.0]), 0.1)
    with pytest.raises(SceneError, match='terrain.cell larger'):
        paved(folder, fine)


def test_exports_have_the_surfaces(folder):
    """Hand them to every format that shows surfaces; a scene without them has none."""
    for surface, count in ((', surface: asphalt', 1), ('', 0)):
        (folder / 'cross.plan').write_text(
            'streets:\n  high: {from: [0, 0], to: [9, 0]' + surface + '}\n'
            'trees:\n  - {street: high, side: left, grammars: [pole.lsys]}\n')
        (folder / 'scene.yaml').write_text('/**:\n  ros__parameters:\n    scene: {objects: [s]}\n'
                                           '    s: {grammar: cross.plan, origin: [1, 2, 0]}\n')
        scene = Scene.from_yaml(folder / 'scene.yaml')
        found = [s for s in surfaces(Content.at_rest(scene)) if s.owner == 'paving']
        assert len(found) == len(scene.paving) == count
    (folder / 'cross.plan').write_text(PLAN)
    scene = Scene.from_yaml(folder / 'scene.yaml')
    middle = 0.5 * (scene.paving[0].points.min(axis=0) + scene.paving[0].points.max(axis=0))
    np.testing.assert_allclose(middle[:2], [1.0, 2.0], atol=1e-9)
