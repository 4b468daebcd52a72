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

"""Building: from the text of a wall grammar to a blueprint of bricks and mortar."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.geometry import rotation
from procphys_ros.language import (
    check_length,
    Expression,
    generator_of,
    GrammarFile,
    Place,
    resolve_defines,
)
from procphys_ros.wallgrammar import bodies, contacts, corners, hinged, polygons, references
from procphys_ros.wallgrammar.assembly import (
    assemble,
    corners_of,
    fastened,
    from_contacts,
    on_ground,
    without,
)
from procphys_ros.wallgrammar.bodies import Body
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.boxes import Joint, MICRO
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.interior import Interior
from procphys_ros.wallgrammar.materials import Material
from procphys_ros.wallgrammar.parser import parse
from procphys_ros.wallgrammar.spec import Call, Spec
from procphys_ros.wallgrammar.stability import check_connected
from procphys_ros.wallgrammar.tables import check_panel, read_layouts, read_materials

_JOINT_SLACK = 0.004  # [m] by which joints between cut bricks may be wider than others
_PITCHED = ('gable', 'hip', 'lean_to', 'spire')
MOST_PARTS = 200_000  # default bound on the parts of one building


@dataclass(frozen=True)
class WallGrammar(GrammarFile):
    """
    A parsed wall grammar, ready to build.

    :ivar spec: definitions of the text.
    :ivar source: name of the text, for errors.
    :ivar most_parts: bound on the parts of the building.
    """

    spec: Spec
    source: str
    materials: dict[str, Material]
    layouts: dict[str, Layout]
    most_parts: int = MOST_PARTS

    @classmethod
    def parse(cls, text: str, source: str = '<text>', most_parts: int = MOST_PARTS,
              folder: Path | None = None) -> 'WallGrammar':
        """
        Read a grammar.

        :param text: the grammar.
        :param source: name for errors.
        :param most_parts: bound on the parts of the building.
        :param folder: searched for included files before the shipped ones.
        :raises GrammarError: where the text does not fit the language.
        """
        check_length(text, source)
        spec = parse(text, source, folder)
        references.check(spec)
        materials = read_materials(spec.materials, spec.places)
        layouts = read_layouts(spec, materials)
        for panel in spec.panels.values():
            check_panel(panel, layouts, materials)
        return cls(spec, source, materials, layouts, most_parts)

    def over(self, corners: np.ndarray, facades: Sequence[int], source: str,
             storeys: int | None = None, storey_height: float | None = None,
             roof: str | None = None, pitch: float | None = None,
             bare: bool = False) -> 'WallGrammar':
        """
        Return this grammar over another footprint, such as that of a map.

        :param corners: counter-clockwise [m], (n, 2).
        :param facades: which of its facades each edge has; the last repeats.
        :param source: name of the footprint, for errors.
        :param storeys, storey_height: None = as the grammar says.
        :param roof: 'none', 'flat', 'gable' or 'hip'; None = as the grammar says.
        :param pitch: of a gable or hip [degrees]; None = that of the grammar's roof, else 35.
        :param bare: without floors and partitions.
        :raises GrammarError: when the grammar has wings, whose footprints would not fit.
        """
        building, place = self.spec.building, Place(source)
        if self.spec.wings:
            raise place.error(f'{self.source} has wings, which have no place over another '
                              'footprint; take a grammar without any')

        def number(value: float | None, own: Expression | None) -> Expression | None:
            return own if value is None else Expression.constant(value, place)

        own = building.facades
        height = number(storey_height, building.storey_height)
        return replace(self, source=source, spec=replace(self.spec, building=replace(
            building, corners=(place,) * len(corners), footprint=tuple(
                (Expression.constant(x, place), Expression.constant(y, place))
                for x, y in corners.tolist()),
            facades=tuple(own[min(k, len(own) - 1)] for k in facades),
            storeys=number(storeys, building.storeys),
            storey_height=height or building.storey_height,
            roof=_roof_of(building.roof, roof, pitch, place),
            floors=None if bare else building.floors,
            partitions=None if bare else building.partitions)))

    def build(self, /, seed: int = 0, **defines: float) -> Blueprint:
        """
        Derive the building.

        :param seed: of weighted rules and random numbers.
        :param defines: values of parameters that replace their defaults.
        :returns: parts and mortar bonds, the footprint's coordinates in x and y, the ground at 0.
        :raises GrammarError: when rules, sizes or materials do not make a building that stands.
        """
        generator = generator_of(seed, self.source)
        spec = self.spec
        values = resolve_defines(spec.building.parameters, defines, generator, self.source)
        found: list[Body] = []
        for building in (spec.building, *spec.wings):
            found.append(bodies.derive(building, spec, self.layouts, values, generator, found))
        bodies.check_apart(found)
        return _construct(self, found)


def _roof_of(own: Call | None, name: str | None, pitch: float | None, place: Place) -> Call:
    """Return a roof with a name and a pitch [degrees]; None = those of the grammar's own one."""
    if name is None and pitch is None and own is not None:
        return own
    name = own.name if name is None and own is not None else name or 'none'
    given = own.arguments if own is not None and own.name in _PITCHED else ()
    if pitch is not None or not given:
        given = (Expression.constant(35.0 if pitch is None else pitch, place),)
    return Call(name, given if name in _PITCHED else (), place)


def _construct(grammar: WallGrammar, found: Sequence[Body]) -> Blueprint:
    """Build walls, partitions, floors and roofs, and bond them."""
    site = Site(grammar.materials, grammar.most_parts, grammar.spec.building.place,
                found[0].deriver.generator)
    upright = found[-1].plan.yaws
    site.frames += [np.array([0.0, 0.0, 0.0, *rotation.from_yaw(yaw)]) for yaw in upright]
    for body in found:
        elevations = body.elevations(grammar.spec, grammar.layouts)
        Interior(site, body, elevations, bodies.neighbours(body, found)).cut_and_lay()
        corners.bond(site, elevations)
    boxes = site.boxes()
    frames = np.array(site.frames)
    patches = [on_ground(boxes, frames, len(upright)),
               from_contacts(contacts.find(boxes), boxes, frames), *site.patches]
    cut = boxes.form >= 0
    solids = corners_of(boxes, site.forms, frames) if cut.any() else np.zeros((0, 8, 3))
    if cut.any():
        reach = max(body.layout.joint for body in found) / MICRO + _JOINT_SLACK
        nailed = np.isin(boxes.joint, (Joint.FIXING, Joint.NAIL, Joint.LAP, Joint.HALVED))
        met = fastened(polygons.meet(solids, cut, reach, nailed), boxes)
        patches.append(without(met, site.patches))
        solids = solids[cut]
    check_connected(boxes, patches, frames, site)
    built = assemble(boxes, patches, frames, grammar.materials, site.kinds, solids)
    return hinged.hang(built, site.hung, frames, grammar.materials)
