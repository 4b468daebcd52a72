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

"""Houses of a map: outlines that walls can stand on, storeys, roofs, and their neighbours."""

from collections.abc import Iterator, Mapping, Sequence
import math
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from procphys_ros.elementary import hypot
from procphys_ros.maps.features import Feature
from procphys_ros.maps.numbers import metres
from procphys_ros.maps.outlines import largest, library, polygon_of

if TYPE_CHECKING:
    import shapely

FRONT, SIDE, PARTY = 0, 1, 2  # facades: towards a road, elsewhere, and against a neighbour
_STRAIGHT = (0.15, 0.5, 1.5)  # [m] by which outlines may differ: maps err by more
_LEAST_AREA = 4.0  # [m²]
_BESIDE = 0.5      # [m] between a facade and a neighbour whose windows would look at each other
_EAVES = 1.2       # [m] between outlines below which eaves meet: twice the reach of wide roofs
_OVERLAP = 0.3     # of its area: who stands in others that far is their part, drawn twice
_SQUARE = math.radians(2.0)  # as `wallgrammar.footprint` squares up
_LOWEST, _USUAL, _HIGHEST = 2.2, 3.0, 6.0  # [m] storeys
_WIDEST = 12.0     # [m] spans of timber; joists of 1/20 of them are 0.6 m high
_VERGE = 0.03      # [m] by which gables stand back from a neighbour, for their boards of 25 mm
_STEP = 1.0        # [m] by which a neighbour is lower than eaves that it does not meet
_TOUCHING = 0.05   # [m²] of a strip along eaves that a neighbour may cover: maps are not exact
_STOREYS = {'house': 2, 'detached': 2, 'terrace': 2, 'semidetached_house': 2, 'residential': 3,
            'apartments': 4, 'hotel': 4, 'office': 4, 'commercial': 3, 'garage': 1, 'garages': 1,
            'shed': 1, 'hut': 1, 'cabin': 1, 'kiosk': 1, 'bungalow': 1, 'farm_auxiliary': 1,
            'greenhouse': 1, 'service': 1, 'roof': 1, 'carport': 1}
_MOST_STOREYS = 60
_SMALL = 40.0      # [m²] below it buildings of unknown kind are taken for garages
_ROOFS = {'flat': 'flat', 'gabled': 'gable', 'hipped': 'hip', 'pyramidal': 'hip'}


class House(NamedTuple):
    """
    Building of a map, as walls can stand.

    :ivar corners: of its outline, counter-clockwise [m], (n, 2).
    :ivar facades: `FRONT`, `SIDE` or `PARTY` of each edge.
    :ivar storeys: number of storeys.
    :ivar storey_height: [m]; None where the map does not tell.
    :ivar roof: 'flat', 'gable' or 'hip'; None where the map does not tell.
    :ivar pitch: [degrees]; None where the map does not tell.
    :ivar wide: whether it is too wide for joists and rafters.
    :ivar room: for eaves: 'all' around, 'ridge' = along the first edge and opposite, or 'none'.
    :ivar notes: what of the map was left out.
    :ivar plainer: the same with simpler outlines.
    """

    corners: np.ndarray
    facades: tuple[int, ...]
    storeys: int
    storey_height: float | None
    roof: str | None
    pitch: float | None
    wide: bool
    room: str
    notes: tuple[str, ...]
    plainer: 'tuple[House, ...]' = ()

    @property
    def height(self) -> float:
        """Height of its walls, where the map does not tell by storeys of 3 m [m]."""
        return self.storeys * (self.storey_height or _USUAL)

    def moved(self, way: np.ndarray) -> 'House':
        """Return the house in another place."""
        return self._replace(corners=self.corners + way,
                             plainer=tuple(plan.moved(way) for plan in self.plainer))


def houses_of(features: Sequence[Feature]) -> Iterator[tuple[Feature, House | str]]:
    """
    Yield each building of a map as a house, or why there is none.

    Who overlaps an earlier building gives way to it.

    :param features: of the whole map, in metres.
    """
    buildings = [one for one in features if one.kind == 'building']
    roads = library().STRtree([library().LineString(one.rings[0]) for one in features
                               if one.kind == 'road'])
    outlines = _apart([polygon_of(one.rings) for one in buildings])
    plain = [outline if isinstance(outline, str) else _plain(one, outline)
             for one, outline in zip(buildings, outlines)]
    stand = [k for k, house in enumerate(plain) if isinstance(house, House)]
    tree = library().STRtree([outlines[k] for k in stand])
    for i, (one, house) in enumerate(zip(buildings, plain)):
        outline: Any = outlines[i]
        if isinstance(house, str):
            yield one, house
            continue
        near = [stand[k] for k in tree.query(outline.buffer(_EAVES)) if stand[k] != i]
        around = library().union_all([outlines[k] for k in near])
        beside = [(plain[k].height - house.height, outlines[k]) for k in near
                  if outlines[k].distance(outline) < _EAVES]
        turns = 'roof:orientation' not in one.tags
        first, *others = (_among(plan, around, beside, roads, turns)
                          for plan in (house, *house.plainer))
        yield one, first._replace(plainer=tuple(others))


def _apart(given: Sequence['shapely.Polygon']) -> list['shapely.Polygon | str']:
    """Cut off outlines what stands in earlier ones; return why where too little is left."""
    tree, found = library().STRtree(given), list[Any]()
    for i, whole in enumerate(given):
        left = whole
        for k in tree.query(whole).tolist():
            if k < i and not isinstance(found[k], str) and left.intersects(found[k]):
                left = largest(left.difference(found[k]))
        if whole.area < _LEAST_AREA:
            left = f'those below {_LEAST_AREA:g} m² are left out'
        elif left.area < (1.0 - _OVERLAP) * whole.area:
            left = 'those that overlap others are left out'
        found.append(left)
    return found


def _plain(feature: Feature, outline: 'shapely.Polygon') -> House:
    """Work out a house from its outline and tags, without its neighbours."""
    tags, notes = feature.tags, []
    if len(outline.interiors):
        notes.append('courtyards are left out')
    roof = _ROOFS.get(tags.get('roof:shape', ''))
    if roof is None and 'roof:shape' in tags:
        notes.append(f'roofs "{tags["roof:shape"]}" are hips')
        roof = 'hip'
    around = library().minimum_rotated_rectangle(outline)
    sides = np.diff(np.array(around.exterior.coords)[:3], axis=0)
    half = 0.5 * float(hypot(*sides.T).min())
    pitch, rise = metres(tags, 'roof:angle'), metres(tags, 'roof:height')
    if pitch is None and rise and roof != 'flat':
        pitch = math.degrees(math.atan2(rise, half))
    pitch = None if pitch is None else round(min(max(pitch, 15.0), 60.0))
    above = 0.0 if roof in (None, 'flat') else (
        rise or half * math.tan(math.radians(pitch or 35.0)))
    storeys, each = _storeys(tags, above, outline.area)
    wide = not outline.buffer(-0.5 * _WIDEST).is_empty
    found: list[House] = []
    for shape in (*(outline.simplify(most) for most in _STRAIGHT), around):
        corners = _first_along(_corners(shape), tags.get('roof:orientation') == 'across')
        if not found or len(corners) < len(found[-1].corners):
            found.append(House(corners, (), storeys, each, roof, pitch, wide, 'all', tuple(notes)))
    return found[0]._replace(plainer=tuple(found[1:]))


def _among(plan: House, around: 'shapely.Geometry',
           beside: Sequence[tuple[float, 'shapely.Polygon']], roads: 'shapely.STRtree',
           turns: bool) -> House:
    """
    Return a house among its neighbours.

    :param around, beside: see `_facades` and `_room`.
    :param turns: whether its ridge may run across, so that gables stand against neighbours.
    """
    corners, room = plan.corners, _room(plan.corners, beside)
    if turns and room == 'none' and _room(np.roll(corners, -1, axis=0), beside) == 'ridge':
        corners, room = np.roll(corners, -1, axis=0), 'ridge'
    facades = _facades(corners, around, roads)
    if room == 'ridge':
        way = (corners[1] - corners[0]) / float(hypot(*(corners[1] - corners[0])))
        corners = corners + _VERGE * np.array([1.0, -1.0, -1.0, 1.0])[:, None] * way
    return plan._replace(corners=corners, room=room, facades=facades)


def _storeys(tags: Mapping[str, str], roof: float, area: float) -> tuple[int, float | None]:
    """
    Return the number of storeys, and their height where it is told [m].

    :param roof: height of the roof, which heights of buildings include [m].
    :param area: of the outline [m²].
    """
    levels = metres(tags, 'building:levels', 'levels', 'num_floors')
    height = metres(tags, 'height', 'building:height', 'measuredHeight')
    walls = max(height - roof, _LOWEST) if height else None
    count = levels or (walls / _USUAL if walls else _STOREYS.get(
        tags.get('building', ''), 1 if area < _SMALL else 2))
    count = min(max(round(count), 1), _MOST_STOREYS)
    return count, min(max(walls / count, _LOWEST), _HIGHEST) if walls else None


def _corners(outline: 'shapely.Polygon') -> np.ndarray:
    """Return the corners of an outline, counter-clockwise, the first one only if it turns."""
    ring = library().geometry.polygon.orient(library().Polygon(outline.exterior)).exterior
    points = np.array(ring.coords)[:-1, :2]
    way, after = points[0] - points[-1], points[1] - points[0]
    aside = abs(way[0] * after[1] - way[1] * after[0]) / max(float(hypot(*(way + after))), 1e-9)
    return (points[1:] if aside < _STRAIGHT[0] and len(points) > 3 else points).round(3)


def _room(corners: np.ndarray, beside: Sequence[tuple[float, 'shapely.Polygon']]) -> str:
    """
    Return where a house has room for eaves, see `House.room`.

    :param beside: its neighbours, and how much higher their walls are [m].
    """
    as_high = [outline for higher, outline in beside if higher > -_STEP]
    if not as_high:
        return 'all'
    if not _is_rectangle(corners) or any(higher > _STEP for higher, _ in beside):
        return 'none'  # its gable would meet the eaves of a higher one
    ends = np.roll(corners, -1, axis=0)
    strips = [library().LineString([corners[k], ends[k]]).buffer(_EAVES, cap_style='flat')
              for k in (0, 2)]
    return 'ridge' if all(strip.intersection(outline).area < _TOUCHING
                          for strip in strips for outline in as_high) else 'none'


def _is_rectangle(corners: np.ndarray) -> bool:
    """Return whether an outline has four right angles."""
    way = np.roll(corners, -1, axis=0) - corners
    way = way / hypot(*way.T)[:, None]
    return len(way) == 4 and bool(
        (np.abs((way * np.roll(way, -1, axis=0)).sum(axis=1)) < math.sin(_SQUARE)).all())


def _first_along(corners: np.ndarray, across: bool) -> np.ndarray:
    """Let a ring begin with its longest edge, along which the ridge runs, or with the next one."""
    lengths = hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    return np.roll(corners, -int(np.argmax(lengths)) - across, axis=0)


def _facades(corners: np.ndarray, others: 'shapely.Geometry',
             roads: 'shapely.STRtree') -> tuple[int, ...]:
    """Tell for each edge what it looks at; the one nearest to a road is the front."""
    found, ends = [], np.roll(corners, -1, axis=0)
    for start, end in zip(corners, ends):
        way = (end - start) / float(hypot(*(end - start)))
        ahead = 0.5 * (start + end) + _BESIDE * np.array([way[1], -way[0]])
        edge = library().LineString([start, end])
        found.append(PARTY if library().LineString([0.5 * (start + end), ahead]).intersects(others)
                     and edge.distance(others) < _BESIDE else SIDE)
    free = [k for k, kind in enumerate(found) if kind == SIDE]
    middles = library().points(0.5 * (corners + ends))
    if free and len(roads):
        nearest = roads.query_nearest(middles[free], return_distance=True, all_matches=False)
        found[free[int(nearest[0][0][np.argmin(nearest[1])])]] = FRONT
    elif free:
        found[max(free, key=lambda k: float(hypot(*(ends[k] - corners[k]))))] = FRONT
    return tuple(found)
