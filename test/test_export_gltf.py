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

"""GLB, read by trimesh and pygltflib: shapes where they are, textures inside."""

import io

from exported import bent_in_wind, grown, scene_of, small_wall, written
import numpy as np
from PIL import Image
import pytest

from procphys_ros.export import images
from procphys_ros.geometry import rotation

pygltflib = pytest.importorskip('pygltflib')
trimesh = pytest.importorskip('trimesh')
_COMPONENTS = {5121: np.uint8, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4}


def array(document, index: int) -> np.ndarray:
    """Read an accessor, which must lie inside its view, and the view inside the buffer."""
    accessor = document.accessors[index]
    view = document.bufferViews[accessor.bufferView]
    width, kind = _WIDTHS[accessor.type], np.dtype(_COMPONENTS[accessor.componentType])
    assert accessor.count * width * kind.itemsize == view.byteLength
    assert view.byteOffset % 4 == 0
    assert view.byteOffset + view.byteLength <= document.buffers[0].byteLength
    data = document.binary_blob()[view.byteOffset:view.byteOffset + view.byteLength]
    return np.frombuffer(data, kind).reshape(accessor.count, width)


def test_document_is_consistent(tmp_path):
    """Read every accessor; indices, normals and bounds hold what glTF asks of them."""
    simulation = bent_in_wind(scene_of(oak=grown('oak.lsys'), wall=small_wall()))
    path, content = written(simulation, tmp_path / 'scene.glb')
    document = pygltflib.GLTF2().load(str(path))
    assert [mesh.name for mesh in document.meshes] == ['oak', 'wall', 'mortar']
    for primitive in (p for mesh in document.meshes for p in mesh.primitives):
        points = array(document, primitive.attributes.POSITION)
        bounds = document.accessors[primitive.attributes.POSITION]
        assert np.array_equal(points.min(axis=0), np.float32(bounds.min))
        assert np.array_equal(points.max(axis=0), np.float32(bounds.max))
        normals = array(document, primitive.attributes.NORMAL)
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-3)
        assert np.isfinite(array(document, primitive.attributes.TEXCOORD_0)).all()
        assert array(document, primitive.indices).max() == len(points) - 1
    leaves = [m for m in document.materials if m.name == 'leaf_oak_leaf']
    assert leaves[0].alphaMode == 'MASK' and leaves[0].doubleSided


def test_bricks_have_their_volume_in_their_place(tmp_path):
    """Find closed boxes, z up turned into y up, with the volume and middle of the bricks."""
    path, content = written(scene_of(wall=small_wall()), tmp_path / 'wall.glb')
    scene = trimesh.load_scene(path)
    bricks = next(mesh for name, mesh in scene.geometry.items() if 'wall' in name)
    transform, _ = scene.graph[next(n for n in scene.graph.nodes_geometry if 'wall' in n)]
    bricks = bricks.copy()
    bricks.apply_transform(transform)
    volume = np.prod(content.blueprint.size, axis=1)
    middle = (volume[:, None] * content.poses[:, :3]).sum(axis=0) / volume.sum()
    assert bricks.volume == pytest.approx(volume.sum(), rel=1e-4)
    assert np.allclose(bricks.center_mass, middle[[0, 2, 1]] * [1, 1, -1], atol=1e-4)


def test_trees_move_with_the_simulation(tmp_path):
    """Show the stem where the wind has bent it."""
    scene = scene_of(pine=grown('pine.lsys'))
    simulation = bent_in_wind(scene)
    still, _ = written(scene, tmp_path / 'still.glb')
    bent, content = written(simulation, tmp_path / 'bent.glb')
    axis = rotation.rotate(content.poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    tips = content.poses[:, :3] + 0.5 * content.blueprint.visual_size[:, 2:] * axis
    meshes = [trimesh.load(path, force='scene').to_geometry() for path in (still, bent)]
    points = meshes[1].vertices[:, [0, 2, 1]] * [1, -1, 1]
    gap = [np.linalg.norm(points - tip, axis=1).min() for tip in tips]
    assert np.max(gap - 0.5 * content.blueprint.visual_size[:, 0]) < 1e-3
    assert np.abs(meshes[0].bounds - meshes[1].bounds).max() > 0.05


def test_images_are_png(tmp_path):
    """Read textures back with Pillow, holes in the leaves included."""
    for name in ('brick_red', 'leaf_oak', 'glass', 'nonsense'):
        expected = images.pixels(name)
        found = np.asarray(Image.open(io.BytesIO(images.png(expected))))
        assert np.array_equal(found, expected)
    assert images.has_holes('leaf_oak') and not images.has_holes('brick_red')
    assert images.pixels('glass')[0, 0, 3] < 255


def test_empty_scene_is_a_valid_file(tmp_path):
    """Write a scene without objects."""
    path, _ = written(scene_of(), tmp_path / 'empty.glb')
    document = pygltflib.GLTF2().load(str(path))
    assert document.meshes == [] and len(document.nodes) == 1
