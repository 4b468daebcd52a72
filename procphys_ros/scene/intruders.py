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


"""Settings of intruders: named bodies moved from outside the simulation."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.errors import SceneError
from procphys_ros.files.file_bounds import named_by
from procphys_ros.language.mesh_file import read_mesh
from procphys_ros.physics.world.pieces import Pieces, single
from procphys_ros.scene.intruder import FASTEST_SAW
from procphys_ros.scene.mesh import boxes_in
from procphys_ros.schema import declared, NAME, ParameterGroup, short

INTRUDER = 'intruder'  # the one that `intruder.*` describes
_LARGEST = 50.0  # [m]
_NUMBERS = {'sphere': 1, 'box': 3, 'capsule': 2}


@dataclass(frozen=True)
class IntrudersSettings(ParameterGroup, group='intruders'):
    """Collision bodies of robots, drones or vehicles of another simulator."""

    names: tuple[str, ...] = declared((), 'bodies that ~/intruders moves, in its order')
    shapes: tuple[str, ...] = declared(
        (), 'of each: "sphere 0.4", "box 1 0.5 0.3", "capsule 0.1 0.8" (diameter, length along z) '
        'or "mesh FILE [SCALE]" [m]')
    cuts: tuple[float, ...] = declared(
        (), 'how fast each saws through branches and bricks; empty = none does', 'm/s', 0.0,
        FASTEST_SAW, any_length=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.names) != len(self.shapes):
            raise SceneError(f'intruders.names has {len(self.names)} entries, intruders.shapes '
                             f'{len(self.shapes)}; each name needs one shape')
        if len(self.cuts) not in (0, len(self.names)):
            raise SceneError(f'intruders.names has {len(self.names)} entries, intruders.cuts '
                             f'{len(self.cuts)}; it needs one for each name, or none')
        for name in self.names:
            if not NAME.match(name) or name == INTRUDER:
                raise SceneError(f'intruders.names: {short(name)} cannot name an intruder; use '
                                 f'letters, digits and _, and not "{INTRUDER}"')
            if self.names.count(name) > 1:
                raise SceneError(f'intruders.names: "{name}" stands there twice')
        for text in self.shapes:
            _words(text)

    def pieces(self) -> dict[str, Pieces]:
        """
        Make the collision shapes of each intruder, by name.

        :raises SceneError: when the file of a mesh cannot be read.
        """
        with named_by('intruders.shapes', list(self.shapes)):
            return {name: _solid(text) for name, text in zip(self.names, self.shapes)}


def _words(text: str) -> tuple[str, list[float]]:
    """Read a shape: its kind, or its file if it is a mesh, and its numbers."""
    kind, *rest = text.split()
    if kind == 'mesh' and rest:
        kind, *rest = rest
        allowed = (0, 1)
    elif kind in _NUMBERS:
        allowed = (_NUMBERS[kind],) * 2
    else:
        raise SceneError(f'intruders.shapes: {short(text)} is no shape; say "sphere DIAMETER", '
                         '"box X Y Z", "capsule DIAMETER LENGTH" or "mesh FILE [SCALE]"')
    try:
        numbers = [float(word) for word in rest]
    except ValueError:
        numbers = [np.nan]
    if not allowed[0] <= len(numbers) <= allowed[1] or not all(
            0.0 < number <= _LARGEST for number in numbers):
        raise SceneError(f'intruders.shapes: {short(text)} needs {allowed[1]} numbers above 0 and '
                         f'up to {_LARGEST:g}')
    return (kind if kind in _NUMBERS else f'mesh {kind}'), numbers


def _solid(text: str) -> Pieces:
    kind, numbers = _words(text)
    if kind == 'sphere':
        return single(Shape.CAPSULE, np.full(3, numbers[0]))
    if kind == 'box':
        return single(Shape.BOX, np.array(numbers))
    if kind == 'capsule':
        diameter, length = numbers
        return single(Shape.CAPSULE, np.array([diameter, diameter, max(length, diameter)]))
    scale = numbers[0] if numbers else 1.0
    triangles = scale * read_mesh(kind.partition(' ')[2], 'intruders.shapes')
    extent = np.ptp(triangles.reshape(-1, 3), axis=0)
    if extent.max() > _LARGEST:
        raise SceneError(f'intruders.shapes: {short(text)} is {extent.round(2).tolist()} m large, '
                         f'it must not exceed {_LARGEST:g}')
    return boxes_in(triangles)
