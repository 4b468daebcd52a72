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

"""glTF 2.0, binary (GLB): a scene at one moment, for viewers, game engines and the web."""

from collections.abc import Sequence
import json
from pathlib import Path
import struct
from typing import Any

import numpy as np

from procphys_ros.appearance.palette import look
from procphys_ros.export import images
from procphys_ros.export.content import Content, Report
from procphys_ros.export.surfaces import Surface, surfaces
from procphys_ros.files.output_files import write_beside

_FLOAT, _UINT, _UBYTE = 5126, 5125, 5121  # component types
_VERTICES, _INDICES = 34962, 34963        # targets of buffer views
_Z_TO_Y = [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]  # glTF's y axis is up
_ROUGHNESS = 0.9
_JSON, _BIN = 0x4E4F534A, 0x004E4942      # types of chunks


class _Binary:
    """The single buffer of a GLB, with its views and accessors."""

    def __init__(self) -> None:
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self._chunks: list[bytes] = []
        self._length = 0

    def add(self, data: bytes, **view: int) -> int:
        """Append bytes as a buffer view; return its index."""
        padded = data + bytes(-len(data) % 4)
        self.views.append({'buffer': 0, 'byteOffset': self._length, 'byteLength': len(data),
                           **view})
        self._chunks.append(padded)
        self._length += len(padded)
        return len(self.views) - 1

    def accessor(self, rows: np.ndarray, component: int, kind: str, target: int,
                 **more: Any) -> int:
        """Append an array; return the index of its accessor."""
        view = self.add(rows.tobytes(), target=target)
        self.accessors.append({'bufferView': view, 'componentType': component,
                               'count': len(rows), 'type': kind, **more})
        return len(self.accessors) - 1

    def getvalue(self) -> bytes:
        return b''.join(self._chunks)


def write_gltf(content: Content, path: Path, report: Report) -> None:
    """
    Write a scene, one node per object, with embedded textures.

    :param content: to write.
    :param path: file that ends in .glb.
    :param report: called as objects are written.
    """
    binary = _Binary()
    primitives: dict[str, list[dict[str, Any]]] = {}
    materials: dict[tuple[str, bool], int] = {}
    for surface in surfaces(content):
        material = materials.setdefault((surface.texture, surface.leaf), len(materials))
        primitives.setdefault(surface.owner, []).append(_primitive(surface, material, binary))
        report(len(primitives), len(content.objects) + 1)
    document = {
        'asset': {'version': '2.0', 'generator': 'procphys_ros'},
        'scene': 0,
        'scenes': [{'name': path.stem, 'nodes': [0]}],
        'nodes': [_root(len(primitives)),
                  *({'name': name, 'mesh': i} for i, name in enumerate(primitives))],
        'meshes': [{'name': name, 'primitives': some} for name, some in primitives.items()],
        **_appearance(list(materials), binary),
        'accessors': binary.accessors, 'bufferViews': binary.views}
    data = binary.getvalue()
    if data:
        document['buffers'] = [{'byteLength': len(data)}]
    filled = {key: value for key, value in document.items() if value != []}
    file = _container(json.dumps(filled, separators=(',', ':')).encode(), data)
    write_beside(path, lambda part: part.write_bytes(file))


def _root(objects: int) -> dict[str, Any]:
    node: dict[str, Any] = {'name': 'world', 'rotation': _Z_TO_Y}
    return {**node, 'children': list(range(1, objects + 1))} if objects else node


def _primitive(surface: Surface, material: int, binary: _Binary) -> dict[str, Any]:
    mesh = surface.mesh
    points = mesh.points.astype('<f4')
    uv = np.column_stack([mesh.uv[:, 0], 1.0 - mesh.uv[:, 1]]).astype('<f4')
    grey = np.clip(np.round(255.0 * surface.tone / surface.tone.max()), 0, 255).astype(np.uint8)
    colour = np.column_stack([grey, grey, grey, np.full(len(grey), 255, np.uint8)])
    return {
        'attributes': {
            'POSITION': binary.accessor(points, _FLOAT, 'VEC3', _VERTICES,
                                        min=points.min(axis=0).tolist(),
                                        max=points.max(axis=0).tolist()),
            'NORMAL': binary.accessor(mesh.normals.astype('<f4'), _FLOAT, 'VEC3', _VERTICES),
            'TEXCOORD_0': binary.accessor(uv, _FLOAT, 'VEC2', _VERTICES),
            'COLOR_0': binary.accessor(colour, _UBYTE, 'VEC4', _VERTICES, normalized=True)},
        'indices': binary.accessor(mesh.triangles.astype('<u4').ravel(), _UINT, 'SCALAR',
                                   _INDICES),
        'material': material}


def _appearance(materials: Sequence[tuple[str, bool]], binary: _Binary) -> dict[str, list]:
    """Write the materials and their images."""
    names = list(dict.fromkeys(name for name, _ in materials))
    pictures = [{'name': name, 'mimeType': 'image/png',
                 'bufferView': binary.add(images.png(images.pixels(name)))} for name in names]
    return {
        'materials': [_material(name, leaf, names.index(name)) for name, leaf in materials],
        'textures': [{'source': i, 'sampler': 0} for i in range(len(names))],
        'images': pictures,
        'samplers': [{'magFilter': 9729, 'minFilter': 9987}] if names else []}


def _material(name: str, leaf: bool, texture: int) -> dict[str, Any]:
    material: dict[str, Any] = {
        'name': f'{name}_leaf' if leaf else name,
        'pbrMetallicRoughness': {'baseColorTexture': {'index': texture}, 'metallicFactor': 0.0,
                                 'roughnessFactor': _ROUGHNESS}}
    if leaf:
        material['doubleSided'] = True
    if images.has_holes(name):
        material['alphaMode'] = 'MASK'
    elif look(name).rgba[3] < 1.0:
        material['alphaMode'] = 'BLEND'
    return material


def _container(document: bytes, data: bytes) -> bytes:
    """Join the header of a GLB and its chunks."""
    document += b' ' * (-len(document) % 4)
    chunks = struct.pack('<II', len(document), _JSON) + document
    if data:
        chunks += struct.pack('<II', len(data), _BIN) + data
    return struct.pack('<4sII', b'glTF', 2, 12 + len(chunks)) + chunks
