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

"""Interior: floors, partitions and roof of a building, by the keywords of its grammar."""

from collections.abc import Sequence
from dataclasses import dataclass

from procphys_ros.errors import nearest_names
from procphys_ros.wallgrammar import spires
from procphys_ros.wallgrammar.bodies import Body, Neighbour
from procphys_ros.wallgrammar.boxes import micro
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.floors import joist_height, slab_floor, timber_floor
from procphys_ros.wallgrammar.partitions import elevations, half_brick, halve, rooms_of, trim
from procphys_ros.wallgrammar.plan import bays, Rectangle, span_axis
from procphys_ros.wallgrammar.regions import snap_level
from procphys_ros.wallgrammar.roofs import Roof
from procphys_ros.wallgrammar.spec import Call
from procphys_ros.wallgrammar.walls import Elevation

_FLOORS = {'none': (), 'timber': (), 'slab': ((0.05, 1.0),)}
_ROOFS = {'none': (), 'flat': (), 'gable': ((10.0, 70.0),), 'hip': ((10.0, 70.0),),
          'lean_to': ((5.0, 60.0),), 'spire': ((50.0, 85.0),)}
_ON_RAFTERS = ('gable', 'hip', 'lean_to')
_PARTITIONS = {'none': (), 'halves': ((1.0, 100.0),)}


@dataclass
class Interior:
    """
    Builds everything behind the facades, then the facades with room for it.

    :ivar site: takes the parts.
    :ivar body: the building, or a wing of it.
    :ivar walls: of its facades.
    :ivar neighbours: other bodies of the building.
    """

    site: Site
    body: Body
    walls: Sequence[Elevation]
    neighbours: Sequence[Neighbour]

    def cut_and_lay(self) -> None:
        """
        Build all parts.

        :raises GrammarError: for unknown keywords, and for parts that do not fit the footprint.
        """
        floors, depth = self._read(self.body.building.floors, 'floors', _FLOORS)
        roof, pitch = self._read(self.body.building.roof, 'roof', _ROOFS)
        partitions, least = self._read(self.body.building.partitions, 'partitions', _PARTITIONS)
        only_top = roof == 'flat' and floors == 'none'
        if only_top:
            floors = 'timber'
        layout = self.walls[0].layout
        for wall in self.walls if (floors, partitions) != ('none', 'none') else ():
            wall.check_inside()
        levels = [int(snap_level(micro(s * self.body.storey_height), layout))
                  for s in range(self.body.storeys + 1)]
        rooms, inner = self._rooms(partitions, least, levels,
                                   self._floor_depth(floors, micro(depth)))
        trim(inner, self.walls)
        rooms = [room.within(self._set_back()) for room in rooms]
        for level in levels[-1:] if only_top else levels[1:]:
            # Ties lie on the uppermost joists, or the stones of a spire lean in over them.
            bare = level == levels[-1] and roof in ('gable', 'hip', 'spire')
            self._lay_floor(floors, micro(depth), level, inner, [] if bare else rooms)
        for wall in (*self.walls, *inner):
            wall.build(self.site)
        call = self.body.building.roof
        if call is not None and roof == 'spire':
            spires.build(self.site, self.body.plan, layout, levels[-1], pitch, call.place)
        elif call is not None and roof in _ON_RAFTERS:
            Roof(self.site, self.body.plan, self.walls, levels[-1], roof, pitch, call.place,
                 self.neighbours).build()

    def _lay_floor(self, floors: str, depth: int, level: int, inner: Sequence[Elevation],
                   rooms: Sequence[Rectangle]) -> None:
        """Lay the floor below a level [µm], on the walls and partitions; boards go into rooms."""
        if floors == 'slab':
            slab_floor(self.site, self.body.plan, level, depth, [*self.walls, *inner])
        elif floors == 'timber':
            call = self.body.building.floors
            if call is None or call.name == 'none':
                call = self.body.building.roof
            place = self.body.building.place if call is None else call.place
            timber_floor(self.site, self.body.plan, level, self.walls, inner, rooms, place)

    def _floor_depth(self, floors: str, depth: int) -> int:
        """Compute the depth of floors below their level [µm], of joists along the shorter side."""
        layout = self.walls[0].layout
        if floors != 'timber':
            return -int(snap_level(-depth, layout)) if floors == 'slab' else 0
        axis = span_axis(self.body.plan)
        return max(joist_height(bay, axis, layout.gauge)
                   for bay in bays(self.body.plan, axis, layout.thickness))

    def _read(self, call: Call | None, key: str,
              table: dict[str, tuple[tuple[float, float], ...]]) -> tuple[str, float]:
        """Read a keyword with its number; the table holds keywords and bounds of their numbers."""
        if call is None or call.name == 'none':
            return 'none', 0.0
        if call.name not in table:
            allowed = ', '.join(f'{n}(number)' if b else n for n, b in table.items())
            raise call.place.error(f'unknown {key} "{call.name}"'
                                   f'{nearest_names(call.name, table)} (allowed: {allowed})')
        bounds = table[call.name]
        if len(call.arguments) != len(bounds):
            raise call.place.error(f'"{call.name}" takes {len(bounds)} numbers, '
                                   f'found {len(call.arguments)}')
        value = 0.0
        for (low, high), argument in zip(bounds, call.arguments):
            deriver = self.body.deriver
            value = argument.number(deriver.values, deriver.generator)
            if not low <= value <= high:
                raise argument.place.error(f'the number of "{call.name}" must be from {low:g} to '
                                           f'{high:g}, found {value:g}')
        if call.name != 'spire':
            floors = self.body.building.floors  # flat roofs are floors once more
            slab = call.name == 'flat' and floors is not None and floors.name == 'slab'
            self._check_plan(call, key, not slab and call.name not in (*_ON_RAFTERS, 'slab'))
        return call.name, value

    def _check_plan(self, call: Call, key: str, square: bool) -> None:
        """Check that timber fits the plan: closed, and of right angles where these are needed."""
        if len(self.body.plan.facades) < 3:
            raise call.place.error(f'{key}: {call.name} needs a closed footprint, found a free '
                                   f'wall; use none here')
        if square and not self.body.plan.right_angled:
            x, y = self.body.plan.points[self.body.plan.least_right]
            raise call.place.error(
                f'{key}: {call.name} needs a footprint with right angles only, to within 2 '
                f'degrees and along the first edge of the building; look at the corner ({x:g}, '
                f'{y:g}), or use none here')

    def _rooms(self, partitions: str, least: float, levels: list[int], depth: int) -> tuple:
        if not self.body.plan.right_angled or len(self.body.plan.facades) < 3:
            return [], []
        layout = half_brick(self.walls[0].layout)
        rooms = rooms_of(self.body.plan, self.walls[0].layout.thickness)
        if partitions == 'none':
            return rooms, []
        # No room with its walls stays larger than this, and each but the first adds a wall,
        # of which doors take less than half.
        widest = 2 * (micro(least) + layout.thickness)
        bricks = 0.5 * levels[-1] / layout.gauge / layout.pitch  # per length of wall
        area = sum(float(r.size[0]) * r.size[1] for r in rooms)
        self.site.expect((area / (widest * widest) - 1.0) * micro(least) * bricks)
        rooms, between = halve(rooms, micro(least), layout.thickness)
        self.site.expect(sum(r.size[axis] for r, axis in between) * bricks)
        return rooms, elevations(between, layout, levels, depth, self.body.building.place)

    def _set_back(self) -> int:
        """Return the largest projection of facade panels into rooms [µm]."""
        return max((scope.depth for wall in self.walls for scope in wall.set_back()), default=0)
