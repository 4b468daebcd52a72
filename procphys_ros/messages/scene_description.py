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


"""Scene description: what stands in a scene, as JSON that is published once and kept."""

from collections.abc import Sequence
import json

from procphys_ros.blueprint import Blueprint, Law, Shape
from procphys_ros.messages.foliage import PlacedObject

_DIGITS = 6  # of sizes and masses; micrometres and milligrams are enough


def scene_description(blueprint: Blueprint, objects: Sequence[PlacedObject],
                      frame_id: str) -> str:
    """
    Describe objects, parts and bonds; list i of every entry of `parts` is part i.

    :param blueprint: all parts and bonds.
    :param objects: their owners, in part order.
    :param frame_id: frame of the poses that are published.
    """
    kinds = [blueprint.kinds[k] for k in blueprint.kind]
    names = [f'{o.name}/{kinds[o.first + i]}_{i}' for o in objects for i in range(o.count)]
    return json.dumps({
        'frame': frame_id,
        'objects': [{'name': o.name, 'first': o.first, 'count': o.count} for o in objects],
        'parts': {
            'name': names,
            'kind': kinds,
            'shape': [Shape(s).name.lower() for s in blueprint.shape],
            'size': blueprint.size.round(_DIGITS).tolist(),
            'mass': blueprint.mass.round(_DIGITS).tolist(),
            'material': [blueprint.materials[m] for m in blueprint.material],
        },
        'bonds': {
            'parts': blueprint.bonds.tolist(),
            'law': [Law(law).name.lower() for law in blueprint.bond_law],
        },
    }, separators=(',', ':'))
