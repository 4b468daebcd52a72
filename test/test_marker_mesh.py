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


"""The mesh that viewers load for bricks that have moved."""

from xml.etree import ElementTree

import numpy as np

from procphys_ros.files.resources import PACKAGE, shared_folder
from procphys_ros.scene.parameter_table import GLOBAL

_SPACE = '{http://www.collada.org/2005/11/COLLADASchema}'


def _mesh():
    default = next(p.default for p in GLOBAL if p.name == 'marker_mesh')
    path = shared_folder() / default.removeprefix(f'package://{PACKAGE}/')
    return path, ElementTree.parse(path)


def _array(tree, name):
    element = next(e for e in tree.iter(f'{_SPACE}float_array') if e.get('id') == name)
    values = np.array(element.text.split(), float)
    assert len(values) == int(element.get('count'))
    return values.reshape(-1, 3)


def test_the_default_mesh_is_shipped_with_its_image():
    """Find the mesh that the parameter names, and the image that the mesh names."""
    path, tree = _mesh()
    image = tree.find(f'.//{_SPACE}image/{_SPACE}init_from').text
    assert (path.parent / image).read_bytes().startswith(b'\x89PNG')


def test_the_mesh_is_a_unit_cube_seen_from_outside():
    """Markers scale it to the brick: it spans one metre, its triangles face outwards."""
    _, tree = _mesh()
    points, normals = _array(tree, 'cube_positions_array'), _array(tree, 'cube_normals_array')
    assert np.all(points.min(axis=0) == -0.5) and np.all(points.max(axis=0) == 0.5)
    corners = np.array(tree.find(f'.//{_SPACE}triangles/{_SPACE}p').text.split(), int)
    corners = corners.reshape(12, 3, 3)
    a, b, c = np.moveaxis(points[corners[:, :, 0]], 1, 0)
    facing = np.cross(b - a, c - a)
    assert np.allclose(facing, normals[corners[:, 0, 1]])
    assert np.all(np.einsum('ij,ij->i', facing, a) > 0.0)
    assert np.isclose(0.5 * np.linalg.norm(facing, axis=1).sum(), 6.0)
