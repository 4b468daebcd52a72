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


"""Scene description: what stands in a scene, as JSON that is published when it changes."""

from collections.abc import Callable, Collection, Iterable, Sequence
import json
from typing import Any

import numpy as np

from procphys_ros.appearance.paving import Paving
from procphys_ros.blueprint import Blueprint, Law, Shape
from procphys_ros.blueprint.cut_bricks import first_pieces
from procphys_ros.messages.foliage import PlacedObject
from procphys_ros.messages.ground import describe_ground
from procphys_ros.physics.terrain import FLAT, Terrain

_DIGITS = 6  # of sizes and masses; micrometres and milligrams are enough
_MORTAR_DIGITS = 4  # of boxes of mortar: tenths of a millimetre look alike


class SceneDescription:
    """
    Describe objects, parts and bonds; entry i of every list under `parts` is part i.

    Parts and bonds that join later are appended; text written once is kept.

    :param frame_id: frame of the published poses.
    :param terrain: the surface of the ground.
    :param paving: of the ground.
    :param seats: finds the mortar joints, from a bond on (`appearance.joints.seats`); None = no
        mortar is described.
    :ivar parts: number of parts described so far.
    """

    def __init__(self, frame_id: str, terrain: Terrain = FLAT, paving: Sequence[Paving] = (),
                 seats: Callable[[Blueprint, int], Any] | None = None):
        self._frame = frame_id
        ground = json.dumps(describe_ground(terrain, paving), separators=(',', ':'))[1:-1]
        self._ground = f',{ground}' if ground else ''
        self._objects = self.parts = self._bonds = 0
        self._lists: dict[str, dict[str, list[str]]] = {
            'parts': {name: [] for name in ('name', 'kind', 'shape', 'size', 'visual_size', 'mass',
                                            'material', 'texture')},
            'hexahedra': {name: [] for name in ('part', 'corners', 'first_piece')},
            'bonds': {name: [] for name in ('parts', 'law')},
            'mortar': {name: [] for name in ('bond', 'form', 'forms')}}
        self._seats = seats
        self._forms: dict[tuple[float, ...], int] = {}
        self._owners: list[dict[str, Any]] = []

    def write(self, blueprint: Blueprint, objects: Sequence[PlacedObject],
              removed: Collection[str] = ()) -> str:
        """
        Write the description.

        :param blueprint: all parts and bonds, those of the last call first.
        :param objects: their owners, in part order.
        :param removed: names of removed objects; their parts keep their rows.
        """
        new = objects[self._objects:]
        self._owners += [{'name': o.name, 'first': o.first, 'count': o.count} for o in new]
        self._add_parts(blueprint, new)
        self._add_bonds(blueprint)
        self._objects, self.parts = len(objects), len(blueprint)
        self._bonds = len(blueprint.bonds)
        groups = [f'"{group}":{{{",".join(_listed(lists))}}}'
                  for group, lists in self._lists.items()]
        owners = [o | {'removed': True} if o['name'] in removed else o for o in self._owners]
        head = json.dumps({'frame': self._frame, 'objects': owners,
                           'textures': blueprint.textures}, separators=(',', ':'))
        return f'{head[:-1]}{self._ground},{",".join(groups)}}}'

    def _add_parts(self, blueprint: Blueprint, objects: Sequence[PlacedObject]) -> None:
        new = slice(self.parts, None)
        kinds = [blueprint.kinds[k] for k in blueprint.kind[new]]
        start = self.parts
        self._add('parts', name=[f'{o.name}/{kinds[o.first - start + i]}_{i}'
                                 for o in objects for i in range(o.count)],
                  kind=kinds,
                  shape=[Shape(s).name.lower() for s in blueprint.shape[new]],
                  size=blueprint.size[new].round(_DIGITS).tolist(),
                  visual_size=blueprint.visual_size[new].round(_DIGITS).tolist(),
                  mass=blueprint.mass[new].round(_DIGITS).tolist(),
                  material=[blueprint.materials[m] for m in blueprint.material[new]],
                  texture=[_texture(blueprint, t) for t in blueprint.texture[new]])

        solids = blueprint.hexahedra
        solids = solids.take(solids.part >= start)
        self._add('hexahedra', part=solids.part.tolist(),
                  corners=solids.corners.round(_DIGITS).tolist(),
                  first_piece=first_pieces(blueprint)[solids.part].tolist())

    def _add_bonds(self, blueprint: Blueprint) -> None:
        new = slice(self._bonds, None)
        self._add('bonds', parts=blueprint.bonds[new].tolist(),
                  law=[Law(law).name.lower() for law in blueprint.bond_law[new]])
        if self._seats is not None:
            self._add_mortar(self._seats(blueprint, self._bonds))

    def _add_mortar(self, seats: Any) -> None:
        """Add mortar joints; most walls have few forms of them."""
        rows = np.column_stack([seats.box, seats.size, *seats.ends]).round(_MORTAR_DIGITS) + 0.0
        forms, place = np.unique(rows, axis=0, return_inverse=True)
        known = len(self._forms)
        number = np.array([self._forms.setdefault(tuple(form), len(self._forms))
                           for form in forms.tolist()], int)
        self._add('mortar', bond=seats.bond.tolist(), form=number[place.ravel()].tolist(),
                  forms=[list(form) for form in self._forms][known:])

    def _add(self, group: str, **lists: list) -> None:
        for name, values in lists.items():
            if values:
                self._lists[group][name].append(
                    json.dumps(values, separators=(',', ':'))[1:-1])


def _texture(blueprint: Blueprint, index: int) -> str:
    return blueprint.textures[index] if blueprint.textures else ''


def _listed(lists: dict[str, list[str]]) -> Iterable[str]:
    return (f'"{name}":[{",".join(pieces)}]' for name, pieces in lists.items())
