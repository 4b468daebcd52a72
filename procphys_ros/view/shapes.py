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


"""Shapes: small meshes with a texture each, as GLB files that the page draws many times over."""

from functools import cache
import io
from typing import Any

import numpy as np

from procphys_ros.appearance import mesh, texture
from procphys_ros.appearance.palette import look
from procphys_ros.appearance.unit_meshes import Kind, unit_mesh
from procphys_ros.geometry import rotation

_TONES = 4  # shades of a texture, which distinguish neighbouring bricks
_UNIFORM = 0.08  # variation of looks below which one shade is enough
TAPERS = np.array([0.4, 0.75, 1.0])  # tip diameters over base diameters
_SIDES = 9  # faces around a branch
_LAP = 0.02  # share of its length by which a segment reaches into its neighbours
_SURFACE_PIXELS, _LEAF_PIXELS = 64, 128
_CUT_OFF = 0.4  # opacity below which a leaf's image is cut out


@cache
def box(name: str, tone: int) -> bytes:
    """
    Write a cube of edge 1 around the origin.

    :param name: of the texture.
    :param tone: one of its `tones`.
    """
    cube = mesh.boxes(rotation.ORIGIN[None], np.ones((1, 3)))
    axis = np.argmax(np.abs(cube.normals), axis=1)[:, None]
    uv = 0.5 + np.take_along_axis(cube.points, np.hstack([axis + 1, axis + 2]) % 3, 1)
    return _glb(cube.points, cube.triangles, cube.normals, uv, name, tone)


def hexahedron(name: str, tone: int, corners: np.ndarray) -> bytes:
    """
    Write a solid with eight corners; see `box`.

    :param corners: as in `Hexahedra.corners` [m], (24,).
    """
    solid = mesh.hexahedra(rotation.ORIGIN[None], corners[None])
    return _glb(solid.points, solid.triangles, solid.normals, solid.uv, name, tone)


@cache
def branch(name: str, tone: int, taper: int) -> bytes:
    """
    Write a cone along z, of length 1 and base diameter 1; see `box`.

    :param taper: index into `TAPERS`.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    points = np.zeros((4, _SIDES + 1, 3))
    radius = 0.5 * np.array([0.0, 1.0, TAPERS[taper], 0.0])
    points[..., :2] = radius[:, None, None] * circle
    points[..., 2] = np.array([-0.5 - _LAP, -0.5 - _LAP, 0.5 + _LAP, 0.5 + _LAP])[:, None]
    normals = np.zeros_like(points)
    normals[1:3, :, :2] = circle
    normals[0, :, 2], normals[3, :, 2] = -1.0, 1.0
    uv = np.stack(np.broadcast_arrays(2.0 * turn / (2.0 * np.pi),
                                      np.array([0.0, 0.0, 1.0, 1.0])[:, None]), axis=-1)
    return _glb(points.reshape(-1, 3), mesh.strips(4, _SIDES + 1), normals.reshape(-1, 3),
                uv.reshape(-1, 2), name, tone)


@cache
def ball(name: str, tone: int) -> bytes:
    """Write a ball of diameter 1; see `box`."""
    import trimesh
    ico = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    normals = 2.0 * ico.vertices
    return _glb(ico.vertices, ico.faces, normals, normals[:, :2], name, tone)


@cache
def leaf(name: str, tone: int) -> bytes:
    """Write two crossed quads of length 1 that stand on the origin along z; see `box`."""
    quads = mesh.crossed_quads(rotation.ORIGIN[None], np.ones(1), look(name).aspect)
    return _glb(quads.points, quads.triangles, quads.normals, quads.uv, name, tone)


@cache
def spray(name: str) -> bytes:
    """Write the same cluster leaf by leaf, as drawn by `render` at close range."""
    from PIL import Image
    own = look(name)
    vertices, _, _, faces = unit_mesh(Kind.SPRAY, own.pattern)
    light = vertices[:, 3]
    grey = Image.fromarray(np.tile(np.arange(256, dtype=np.uint8)[:, None], (4, 1, 3)))
    colour = _linear(np.array(own.rgba[:3])) / _linear(light.mean())
    return _write(vertices[:, :3] * [own.aspect, own.aspect, 1.0], faces,
                  np.tile([0.0, 0.0, 1.0], (len(vertices), 1)),
                  np.column_stack([np.clip(light, 0.01, 0.99), np.full(len(light), 0.5)]),
                  baseColorTexture=grey, baseColorFactor=[*np.clip(colour, 0.0, 1.0), 1.0],
                  doubleSided=True)


def tones(name: str) -> int:
    """Return the number of shades of a texture."""
    return _TONES if look(name).variation >= _UNIFORM else 1


def tone_of(rows: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Assign constant shades to parts or leaves by a hash of their indices, (K,)."""
    mixed = np.asarray(rows, np.uint64) * np.uint64(0x9E3779B97F4A7C15)  # splitmix64 (Steele 2014)
    mixed = (mixed ^ mixed >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    return (mixed >> np.uint64(40)).astype(int) % count


def _glb(points: np.ndarray, faces: np.ndarray, normals: np.ndarray, uv: np.ndarray, name: str,
         tone: int) -> bytes:
    from PIL import Image
    own = look(name)
    pixels = texture.image(own.pattern)
    holes = pixels is not None and bool((pixels[..., 3] < 255).any())
    side = _LEAF_PIXELS if holes else _SURFACE_PIXELS
    picture = None if pixels is None else Image.fromarray(pixels).resize((side, side))
    shade = 1.0 + own.variation * (2.0 * (tone + 0.5) / tones(name) - 1.0)
    colour = np.clip(np.array(own.rgba[:3]) * shade / texture.mean_light(own.pattern), 0.0, 1.0)
    colour = _linear(colour)
    return _write(points, faces, normals, uv, baseColorTexture=picture,
                  baseColorFactor=[*colour, own.rgba[3]], doubleSided=holes,
                  alphaCutoff=_CUT_OFF if holes else None,
                  alphaMode='MASK' if holes else 'BLEND' if own.rgba[3] < 1.0 else 'OPAQUE')


def _write(points: np.ndarray, faces: np.ndarray, normals: np.ndarray, uv: np.ndarray,
           **looks: Any) -> bytes:
    import trimesh
    material = trimesh.visual.material.PBRMaterial(metallicFactor=0.0, roughnessFactor=1.0,
                                                   **looks)
    made = trimesh.Trimesh(points, faces, vertex_normals=normals, process=False,
                           visual=trimesh.visual.TextureVisuals(uv=uv, material=material))
    data = io.BytesIO()
    made.export(data, file_type='glb', include_normals=True)
    return data.getvalue()


def _linear(colour: np.ndarray) -> np.ndarray:
    """Convert display values to linear ones for glTF (sRGB, IEC 61966-2-1)."""
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
