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

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint
from procphys_ros.language import check_length, read_text, resolve_defines
from procphys_ros.wallgrammar import contacts, corners, footprint, polygons, references, walls
from procphys_ros.wallgrammar.assembly import assemble, corners_of, from_contacts, on_ground
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.boxes import MICRO, micro
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.derivation import Deriver, Piece
from procphys_ros.wallgrammar.interior import Interior
from procphys_ros.wallgrammar.materials import Material
from procphys_ros.wallgrammar.parser import parse
from procphys_ros.wallgrammar.spec import Spec
from procphys_ros.wallgrammar.stability import check_connected
from procphys_ros.wallgrammar.tables import check_panel, read_layouts, read_materials

_HIGHEST = 1000.0     # [m]
_JOINT_SLACK = 0.004  # [m] by which joints between cut bricks may be wider than others
MOST_PARTS = 200_000  # default bound on the parts of one building


@dataclass(frozen=True)
class WallGrammar:
    """
    A parsed wall grammar, ready to build.

    :ivar spec: what the text says.
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
        :param folder: where included files are looked for first; then among the shipped ones.
        :raises GrammarError: where the text does not fit the language.
        """
        check_length(text, source)
        spec = parse(text, source, folder)
        references.check(spec)
        materials = read_materials(spec)
        layouts = read_layouts(spec, materials)
        for panel in spec.panels.values():
            check_panel(panel, layouts, materials)
        return cls(spec, source, materials, layouts, most_parts)

    @classmethod
    def load(cls, path: str | Path, most_parts: int = MOST_PARTS) -> 'WallGrammar':
        """
        Read a grammar from a file.

        :param path: of the file, UTF-8.
        :param most_parts: bound on the parts of the building.
        :raises GrammarError: when the file cannot be read or does not fit the language.
        """
        return cls.parse(read_text(path), str(path), most_parts, Path(path).absolute().parent)

    def build(self, seed: int = 0, **defines: float) -> Blueprint:
        """
        Derive the building.

        :param seed: of weighted rules and random numbers.
        :param defines: values of parameters that replace their defaults.
        :returns: parts and mortar bonds, the footprint's coordinates in x and y, the ground at 0.
        :raises GrammarError: when rules, sizes or materials make no building that stands.
        """
        generator = np.random.default_rng(seed)
        building = self.spec.building
        values = resolve_defines(building.parameters, defines, generator, self.source)
        values['storey_height'] = building.storey_height.number(values, generator)
        values.setdefault('storeys', 1.0)
        if building.storeys is not None:
            values['storeys'] = building.storeys.number(values, generator)
        storeys, storey_height = self._storeys(values)
        deriver = Deriver(self.spec, values, generator)
        points = np.array([[c.number(values, generator) for c in corner]
                           for corner in building.footprint])
        return _Construction(self, deriver, points, storeys, storey_height).blueprint()

    def _storeys(self, values: dict[str, float]) -> tuple[int, float]:
        building = self.spec.building
        storeys, storey_height = values['storeys'], values['storey_height']
        if storeys < 1 or storeys != int(storeys) or storeys > 1000:
            place = building.storeys.place if building.storeys else building.place
            raise place.error(f'storeys must be a whole number from 1 to 1000, found {storeys:g}')
        if not 0.1 <= storey_height <= 100.0:
            raise building.storey_height.place.error(f'storey_height must be from 0.1 to 100 m, '
                                                     f'found {storey_height:g}')
        if storeys * storey_height > _HIGHEST:
            raise building.place.error(f'the building is {storeys * storey_height:g} m high, at '
                                       f'most {_HIGHEST:g} m are possible')
        return int(storeys), storey_height


class _Construction:
    """One run of the builder."""

    def __init__(self, grammar: WallGrammar, deriver: Deriver, points: np.ndarray, storeys: int,
                 storey_height: float):
        self.grammar = grammar
        self.deriver = deriver
        self.storeys = storeys
        self.storey_height = storey_height
        self.height = micro(storeys * storey_height)
        building = grammar.spec.building
        self.site = Site(grammar.materials, grammar.most_parts, building.place)
        footprint.check(points, building.corners)
        self.pieces = self._derive(points)
        self.layout = self._wall_layout()
        self.plan = footprint.read(points, self.layout.thickness, self.layout.joint,
                                   building.corners)

    def _derive(self, points: np.ndarray) -> list[list[Piece]]:
        starts = self.grammar.spec.building.facades
        edges = (np.roll(points, -1, axis=0) - points if len(points) > 2
                 else np.diff(points, axis=0))
        return [self.deriver.facade(starts[min(i, len(starts) - 1)],
                                    micro(float(np.hypot(*edge))), self.height)
                for i, edge in enumerate(edges)]

    def _wall_layout(self) -> Layout:
        """Find the one layout that sets thickness and courses, so that corners interlock."""
        grammar = self.grammar
        found: dict[tuple[int, int, int], tuple[Layout, Piece]] = {}
        for piece in (p for pieces in self.pieces for p in pieces):
            layout = grammar.layouts.get(grammar.spec.panels[piece.panel].kind)
            if layout is not None:
                found.setdefault((layout.thickness, layout.gauge, layout.joint), (layout, piece))
        if not found:
            raise grammar.spec.building.place.error('no facade has a panel with a layout, so '
                                                    'there is no wall')
        (first, one), *others = found.values()
        for layout, piece in others:
            raise piece.place.error(
                f'the panels "{one.panel}" and "{piece.panel}" cannot interlock: layouts of one '
                f'building must share wall thickness ({first.thickness / 1e6:g} and '
                f'{layout.thickness / 1e6:g} m), course height ({first.gauge / 1e6:g} and '
                f'{layout.gauge / 1e6:g} m) and joint')
        return first

    def blueprint(self) -> Blueprint:
        """Build walls, partitions, floors and roof, and bond them."""
        grammar, site = self.grammar, self.site
        site.frames += [np.array([0.0, 0.0, 0.0, *rotation.from_yaw(yaw)])
                        for yaw in self.plan.yaws]
        elevations = [walls.Elevation(
            facade, self._fit(walls.gauge_pieces(pieces, self.layout), facade.length),
            grammar.spec.panels, grammar.layouts, self.layout)
            for facade, pieces in zip(self.plan.facades, self.pieces)]
        interior = Interior(site, self.plan, elevations, grammar.spec.building, self.storeys,
                            self.storey_height, self.deriver)
        interior.cut_and_lay()
        corners.bond(site, elevations)
        boxes = site.boxes()
        frames = np.array(site.frames)
        patches = [on_ground(boxes, frames, len(self.plan.yaws)),
                   from_contacts(contacts.find(boxes), boxes, frames), *site.patches]
        cut = boxes.form >= 0
        solids = corners_of(boxes, site.forms, frames) if cut.any() else np.zeros((0, 8, 3))
        if cut.any():
            reach = self.layout.joint / MICRO + _JOINT_SLACK
            patches.append(polygons.meet(solids, cut, reach))
            solids = solids[cut]
        check_connected(boxes, patches, frames, site)
        return assemble(boxes, patches, frames, grammar.materials, site.kinds, solids)

    @staticmethod
    def _fit(pieces: list[Piece], length: int) -> list[Piece]:
        """Let panels end where the edge ends in whole micrometres of its frame."""
        return [p._replace(scope=p.scope._replace(right=length))
                if abs(p.scope.right - length) <= 5 else p for p in pieces]
