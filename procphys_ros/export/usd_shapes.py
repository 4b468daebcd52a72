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

"""USD shapes: materials with textures, meshes, and prototypes of parts."""

from pathlib import Path
import shutil

import numpy as np
from pxr import Gf, Sdf

from procphys_ros.appearance import texture
from procphys_ros.appearance.mesh import Mesh
from procphys_ros.appearance.palette import look
from procphys_ros.blueprint import Shape
from procphys_ros.export import images
from procphys_ros.export.content import Content
from procphys_ros.export.surfaces import local_part
from procphys_ros.export.usd_layer import (
    Layer,
    numbers,
    place,
    put,
    refer,
    relate,
    vectors,
)
from procphys_ros.files.output_files import write_whole
from procphys_ros.geometry import rotation

_ROUGHNESS = 0.9
_HOLE = 0.5  # alpha below it is a hole


class Materials:
    """
    Preview surfaces of textures, with PNG files beside the layer.

    :param layer: to write to.
    :param root: path of the parent prim.
    :param path: of the layer's file.
    """

    def __init__(self, layer: Layer, root: str, path: Path):
        self._layer, self._root = layer, root
        self._folder = path.parent / f'{path.stem}_textures'
        self._path, self._images = path, dict[str, bytes]()
        self._known: dict[str, str] = {}
        layer.prim(root, 'Scope')

    def path(self, name: str) -> str:
        """Return the path of a texture's material, which is written on first use."""
        if name not in self._known:
            self._known[name] = f'{self._root}/{identifier(name)}'
            self._write(name, self._known[name])
        return self._known[name]

    def write(self) -> None:
        """
        Write the images, then the layer.

        :raises OSError: if one cannot be written; a new folder of images is removed then.
        """
        fresh = not self._folder.exists()
        try:
            if self._images:
                self._folder.mkdir(exist_ok=True)
            for name, image in self._images.items():
                write_whole(self._folder / name, image)
            self._layer.write(self._path)
        except OSError:
            if fresh:
                shutil.rmtree(self._folder, ignore_errors=True)
            raise

    def _write(self, name: str, path: str) -> None:
        material = self._layer.prim(path, 'Material')
        surface = self._shader(f'{path}/surface', 'UsdPreviewSurface')
        put(surface, 'float', 'inputs:roughness', _ROUGHNESS)
        put(surface, 'token', 'outputs:surface', None)
        _connect(material, 'token', 'outputs:surface', f'{path}/surface.outputs:surface')
        red, green, blue, alpha = look(name).rgba
        if texture.image(look(name).pattern) is None:
            put(surface, 'color3f', 'inputs:diffuseColor', Gf.Vec3f(red, green, blue))
            put(surface, 'float', 'inputs:opacity', alpha)
            return
        file = f'{identifier(name)}.png'
        self._images[file] = images.png(images.pixels(name))
        reader = self._shader(f'{path}/st', 'UsdPrimvarReader_float2')
        put(reader, 'string', 'inputs:varname', 'st')
        put(reader, 'float2', 'outputs:result', None)
        picture = self._shader(f'{path}/image', 'UsdUVTexture')
        put(picture, 'asset', 'inputs:file', Sdf.AssetPath(f'./{self._folder.name}/{file}'))
        for axis in ('S', 'T'):
            put(picture, 'token', f'inputs:wrap{axis}', 'repeat')
        _connect(picture, 'float2', 'inputs:st', f'{path}/st.outputs:result')
        put(picture, 'float3', 'outputs:rgb', None)
        _connect(surface, 'color3f', 'inputs:diffuseColor', f'{path}/image.outputs:rgb')
        if images.has_holes(name):
            put(picture, 'float', 'outputs:a', None)
            put(surface, 'float', 'inputs:opacityThreshold', _HOLE)
            _connect(surface, 'float', 'inputs:opacity', f'{path}/image.outputs:a')

    def _shader(self, path: str, name: str) -> Sdf.PrimSpec:
        shader = self._layer.prim(path, 'Shader')
        put(shader, 'token', 'info:id', name, uniform=True)
        return shader


def identifier(name: str) -> str:
    """Convert a name to a valid USD identifier."""
    out = ''.join(c if c.isascii() and (c.isalnum() or c == '_') else '_' for c in name)
    return out if out and not out[0].isdigit() else f'_{out}'


def add_mesh(layer: Layer, path: str, shape: Mesh, material: str, leaf: bool = False) -> None:
    """
    Write a mesh.

    :param shape: in the frame of the parent prim.
    :param material: path of its material.
    :param leaf: whether it is two-sided.
    """
    spec = layer.prim(path, 'Mesh', ['MaterialBindingAPI'])
    _put_triangles(spec, shape)
    normals = put(spec, 'normal3f[]', 'normals', vectors(shape.normals))
    normals.SetInfo('interpolation', 'vertex')
    st = put(spec, 'texCoord2f[]', 'primvars:st', vectors(shape.uv))
    st.SetInfo('interpolation', 'vertex')
    put(spec, 'token', 'subdivisionScheme', 'none', uniform=True)
    if leaf:
        put(spec, 'bool', 'doubleSided', True, uniform=True)
    relate(spec, 'material:binding', [material])


def add_collider(layer: Layer, path: str, content: Content, part: int) -> None:
    """Write the collision shape of a part, in its own frame."""
    if len(content.blueprint.hexahedra.among(np.array([part]))):
        _add_hull(layer, path, local_part(content, part))
        return
    x, y, z = content.blueprint.solid_size(np.array([part]))[0]
    box = content.blueprint.shape[part] == Shape.BOX
    kind = 'Cube' if box else 'Capsule' if z > x else 'Sphere'
    spec = layer.prim(path, kind, ['PhysicsCollisionAPI'])
    put(spec, 'token', 'purpose', 'guide', uniform=True)
    if box:
        put(spec, 'double', 'size', 1.0)
        place(spec, rotation.ORIGIN, np.array([x, y, z]))
        half = np.full(3, 0.5)
    else:
        put(spec, 'double', 'radius', 0.5 * float(x))
        half = np.array([0.5 * x, 0.5 * x, 0.5 * max(z, x)])
    if kind == 'Capsule':
        put(spec, 'double', 'height', float(z - x))
        put(spec, 'token', 'axis', 'Z', uniform=True)
    put(spec, 'float3[]', 'extent', vectors(np.array([-half, half])))


def _add_hull(layer: Layer, path: str, shape: Mesh) -> None:
    """Write a convex hull for collision."""
    spec = layer.prim(path, 'Mesh', ['PhysicsCollisionAPI', 'PhysicsMeshCollisionAPI'])
    put(spec, 'token', 'purpose', 'guide', uniform=True)
    put(spec, 'token', 'physics:approximation', 'convexHull', uniform=True)
    _put_triangles(spec, shape)
    put(spec, 'token', 'subdivisionScheme', 'none', uniform=True)


def _put_triangles(spec: Sdf.PrimSpec, shape: Mesh) -> None:
    put(spec, 'point3f[]', 'points', vectors(shape.points))
    put(spec, 'int[]', 'faceVertexCounts', numbers(np.full(len(shape.triangles), 3)))
    put(spec, 'int[]', 'faceVertexIndices', numbers(shape.triangles.ravel()))
    put(spec, 'float3[]', 'extent', vectors(np.array([shape.points.min(axis=0),
                                                      shape.points.max(axis=0)])))


class Prototypes:
    """
    Shapes shared by many parts, as classes for instances.

    :param layer: to write to.
    :param root: path of the parent class.
    :param content: with the parts.
    :param materials: of the scene.
    """

    def __init__(self, layer: Layer, root: str, content: Content, materials: Materials):
        self._layer, self._root, self._content = layer, root, content
        self._materials, blueprint = materials, content.blueprint
        self._keys = np.round(np.column_stack([
            blueprint.visual_size, blueprint.mass, blueprint.shape, blueprint.texture]), 9)
        self._corners = {part: tuple(corners) for part, corners in zip(
            blueprint.hexahedra.part.tolist(), blueprint.hexahedra.corners.round(6).tolist())}
        self._known: dict[tuple, str] = {}
        layer.prim(root, specifier=Sdf.SpecifierClass)

    def path(self, part: int) -> str:
        """Return the path of a part's prototype, which is written on first use."""
        key = (*self._keys[part].tolist(), self._corners.get(part))
        if key not in self._known:
            path = f'{self._root}/shape_{len(self._known)}'
            self._known[key] = path
            spec = self._layer.prim(path, 'Xform', ['PhysicsRigidBodyAPI', 'PhysicsMassAPI'])
            weigh(spec, self._content, part)
            # Materials must be below the instance, or importers do not find them.
            name = self._content.textures[self._content.blueprint.texture[part]]
            refer(self._layer.prim(f'{path}/material', 'Material'), self._materials.path(name))
            add_mesh(self._layer, f'{path}/visual', local_part(self._content, part),
                     f'{path}/material')
            add_collider(self._layer, f'{path}/collider', self._content, part)
        return self._known[key]


def weigh(spec: Sdf.PrimSpec, content: Content, part: int) -> None:
    """Write mass and inertia of a part; its frame is at its centre of mass."""
    put(spec, 'float', 'physics:mass', float(content.blueprint.mass[part]))
    put(spec, 'float3', 'physics:diagonalInertia',
        Gf.Vec3f(*content.blueprint.inertia[part].tolist()))
    put(spec, 'point3f', 'physics:centerOfMass', Gf.Vec3f(0.0, 0.0, 0.0))
    put(spec, 'quatf', 'physics:principalAxes', Gf.Quatf(1.0, 0.0, 0.0, 0.0))


def _connect(spec: Sdf.PrimSpec, kind: str, name: str, source: str) -> None:
    put(spec, kind, name, None).connectionPathList.explicitItems.append(source)
