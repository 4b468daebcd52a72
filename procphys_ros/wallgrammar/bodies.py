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

"""Bodies: a building and its wings, each with walls, floors and a roof of its own."""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import cos, hypot, sin, tan
from procphys_ros.geometry.linear import norm, product
from procphys_ros.language import Expression
from procphys_ros.wallgrammar import footprint, slopes, walls
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.boxes import MICRO, micro, micros
from procphys_ros.wallgrammar.derivation import Deriver, Piece
from procphys_ros.wallgrammar.footprint import Footprint
from procphys_ros.wallgrammar.plan import trapezia
from procphys_ros.wallgrammar.polygons import clip, moments
from procphys_ros.wallgrammar.spec import Building, Spec

_HIGHEST = 1000.0     # [m]
_MOST_EDGES = 300_000  # pairs of plan edges compared at most, some 30 s
_CLOSE = 1e-3         # [m] plans that overlap by a narrower strip touch each other


class Body(NamedTuple):
    """
    Building, or a wing of one, before it is built.

    :ivar building: its definition in the text.
    :ivar deriver: holds the values of its parameters.
    :ivar storeys: number of storeys.
    :ivar storey_height: [m].
    :ivar pieces: panels of each facade.
    :ivar layout: of its walls.
    :ivar plan: the footprint.
    :ivar given: corners of the footprint before it was squared up [m], (n, 2).
    """

    building: Building
    deriver: Deriver
    storeys: int
    storey_height: float
    pieces: list[list[Piece]]
    layout: Layout
    plan: Footprint
    given: np.ndarray

    @property
    def height(self) -> int:
        """Height of the walls [µm]."""
        return micro(self.storeys * self.storey_height)

    def elevations(self, spec: Spec, layouts: dict[str, Layout]) -> list[walls.Elevation]:
        """List the elevations of the walls, with panels fitted to courses and edges."""
        return [walls.Elevation(
            facade, _fit(walls.gauge_pieces(pieces, self.layout), facade.length), spec.panels,
            layouts, self.layout) for facade, pieces in zip(self.plan.facades, self.pieces)]


def derive(building: Building, spec: Spec, layouts: dict[str, Layout], values: dict[str, float],
           generator: np.random.Generator, earlier: Sequence[Body]) -> Body:
    """
    Derive the facades of a building or a wing.

    :param building: its definition in the text.
    :param spec: rules and panels.
    :param layouts: by name.
    :param values: of the parameters.
    :param generator: draws weighted rules and random numbers.
    :param earlier: bodies derived before; the first is the building.
    :raises GrammarError: when rules and sizes do not make a building that stands.
    """
    values = {**values, 'storey_height': building.storey_height.number(values, generator)}
    values.setdefault('storeys', 1.0)
    if building.storeys is not None:
        values['storeys'] = building.storeys.number(values, generator)
    elif building is not spec.building:
        values['storeys'] = 1.0
    storeys = _storeys(building, values)
    storey_height = values['storey_height']
    deriver = Deriver(spec, values, generator)

    def number(value: Expression) -> float:
        return value.number(values, generator)

    known = earlier[-1].plan.yaws.tolist() if earlier else []
    given = np.array([[number(c) for c in corner] for corner in building.footprint])
    footprint.check(given, building.corners)
    points = given
    if len(given) > 2 and any(map(_needs_right_angles, (spec.building, *spec.wings))):
        points = footprint.square_up(given, known[0] if known else None,
                                     [(body.given, body.plan.points) for body in earlier])
        footprint.check(points, building.corners)
    edges = (np.roll(points, -1, axis=0) - points if len(points) > 2
             else np.diff(points, axis=0))
    starts = building.facades
    pieces = [deriver.facade(starts[min(i, len(starts) - 1)], micro(float(hypot(*edge))),
                             micro(storeys * storey_height)) for i, edge in enumerate(edges)]
    layout = _wall_layout(building, spec, layouts, pieces)
    plan = footprint.read(points, layout.thickness, layout.joint, building.corners, known)
    return Body(building, deriver, storeys, storey_height, pieces, layout, plan, given)


def _needs_right_angles(building: Building) -> bool:
    """Return whether floors, partitions or a roof of timber stand in or on a body."""
    return any(call is not None and call.name not in ('none', 'spire')
               for call in (building.floors, building.roof, building.partitions))


def _storeys(building: Building, values: dict[str, float]) -> int:
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
    return int(storeys)


def _wall_layout(building: Building, spec: Spec, layouts: dict[str, Layout],
                 pieces: list[list[Piece]]) -> Layout:
    """Find the thinnest layout, that of all walls; thicker panels become piers in them."""
    found: dict[str, tuple[Layout, Piece]] = {}
    for piece in (p for row in pieces for p in row):
        kind = spec.panels[piece.panel].kind
        if kind in layouts:
            found.setdefault(kind, (layouts[kind], piece))
    if not found:
        raise building.place.error('no facade has a panel with a layout, so there is no wall')
    first, one = min(found.values(), key=lambda item: item[0].thickness)
    for layout, piece in found.values():
        if (layout.gauge, layout.joint) != (first.gauge, first.joint):
            raise piece.place.error(
                f'the panels "{one.panel}" and "{piece.panel}" cannot interlock: layouts of '
                f'one building must share course height ({first.gauge / 1e6:g} and '
                f'{layout.gauge / 1e6:g} m, with the joint) and joint')
        if layout.thickness != first.thickness and max(layout.pieces, first.pieces) > 1:
            raise piece.place.error(
                f'the panels "{one.panel}" and "{piece.panel}" are of planks '
                f'{first.thickness / 1e6:g} and {layout.thickness / 1e6:g} m thick; planks of '
                f'one building must be equally thick')
    return first


def _fit(pieces: list[Piece], length: int) -> list[Piece]:
    """Snap the right ends of panels to the length of the edge, in whole micrometres."""
    return [p._replace(scope=p.scope._replace(right=length))
            if abs(p.scope.right - length) <= 5 else p for p in pieces]


class Neighbour(NamedTuple):
    """
    Body that the roofs of other bodies keep clear of.

    :ivar name: of the body.
    :ivar low, high: its bounding rectangle in the first frame [µm], (2,).
    :ivar crest: height of the vertical extension of the walls: a gable with its roof [µm].
    :ivar lean: rise over distance of a roof that leans back from the walls, a hip or a spire.
    """

    name: str
    low: np.ndarray
    high: np.ndarray
    crest: int
    lean: float


def neighbours(body: Body, bodies: Sequence[Body]) -> list[Neighbour]:
    """List the other bodies, with bounds in the first frame of one."""
    yaw = body.plan.yaws[0]
    turn = np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])
    corners = micros(product(np.concatenate([other.plan.points for other in bodies]), turn))
    starts = np.cumsum([0] + [len(other.plan.points) for other in bodies[:-1]])
    low, high = np.minimum.reduceat(corners, starts), np.maximum.reduceat(corners, starts)
    return [Neighbour(other.building.name, low[i], high[i],
                      *_over(other, float((high[i] - low[i]).min()) / MICRO))
            for i, other in enumerate(bodies) if other is not body]


def _over(body: Body, width: float) -> tuple[int, float]:
    """
    Return the height of a body with its roof: `Neighbour.crest` and `Neighbour.lean`.

    :param width: of the body, across the ridge of a gable [m].
    """
    call = body.building.roof
    if (call is None or call.name not in ('gable', 'hip', 'lean_to', 'spire')
            or len(call.arguments) != 1):
        return body.height, 0.0
    generator = deepcopy(body.deriver.generator)  # what is drawn here is drawn again
    pitch = float(np.radians(call.arguments[0].number(body.deriver.values, generator)))
    if not 0.0 < pitch < 0.5 * np.pi:
        return body.height, 0.0  # refused when it is built
    lean = float(tan(pitch))
    if call.name == 'spire':
        return body.height, lean
    leans_to = call.name == 'lean_to'
    span = body.plan.facades[-1].length / MICRO if leans_to else 0.5 * width
    eaves = body.height + body.layout.gauge  # of the plates
    cover = (slopes.rafter_depth(span, pitch, leans_to) + slopes.COVER
             + slopes.TILE[1]) / float(cos(pitch))  # and ridge tiles
    if call.name == 'hip':
        return eaves + micro(cover), lean
    return eaves + micro(span * lean + cover), 0.0


def check_apart(bodies: Sequence[Body]) -> None:
    """
    Check that no wings overlap each other or the building.

    :raises GrammarError: naming both, or when there are too many to compare.
    """
    meets = _near(bodies)
    for i, body in enumerate(bodies):
        for k in np.flatnonzero(meets[i, :i]).tolist():
            if _overlap(_ground_of(body), _ground_of(bodies[k])):
                raise body.building.place.error(
                    f'the plans of "{body.building.name}" and "{bodies[k].building.name}" '
                    'overlap; wings may touch the building, not stand in it')
    for body, near in zip(bodies, meets):
        others = [bodies[k] for k in np.flatnonzero(near).tolist()]
        for piece, ground in _standing_out(body) if others else ():
            for other in others:
                if _stands_in(piece, ground, other):
                    raise piece.place.error(
                        f'the panel "{piece.panel}" stands {-piece.scope.depth / MICRO:g} m out '
                        f'of "{body.building.name}", into "{other.building.name}"')


def _near(bodies: Sequence[Body]) -> np.ndarray:
    """Mark pairs of bodies whose bounding rectangles, with projections, overlap, (N, N) bool."""
    grounds = [np.concatenate([_ground_of(body), *(covered for _, covered in _standing_out(body))])
               for body in bodies]
    low = np.array([ground.min(axis=0) for ground in grounds])
    high = np.array([ground.max(axis=0) for ground in grounds])
    meets = np.all((low[:, None] < high) & (low < high[:, None]), axis=2)
    np.fill_diagonal(meets, False)
    edges = np.array([len(ground) for ground in grounds])
    work = np.cumsum((np.outer(edges, edges) * meets).sum(axis=1))
    if work[-1] > _MOST_EDGES:
        body = bodies[int(np.searchsorted(work, _MOST_EDGES, 'right'))]
        raise body.building.place.error(
            f'{meets.sum() // 2} pairs of plans are so near to each other that they must be '
            f'compared edge by edge, {work[-1]:,} times in all; at most {_MOST_EDGES:,} are done')
    return meets


def _stands_in(piece: Piece, ground: np.ndarray, other: Body) -> bool:
    """Return whether a projecting panel meets another body, or a panel that projects from it."""
    if piece.scope.bottom < other.height and _overlap(ground, _ground_of(other)):
        return True
    return any(max(piece.scope.bottom, of.scope.bottom) < min(piece.scope.top, of.scope.top)
               and _overlap(ground, covered) for of, covered in _standing_out(other))


def _standing_out(body: Body) -> Iterator[tuple[Piece, np.ndarray]]:
    """Yield the panels that project from facades, and the rectangles that they cover [m]."""
    points = body.plan.points
    for pieces, start, end in zip(body.pieces, points, np.roll(points, -1, axis=0)):
        along = (end - start) / norm(end - start)
        out = np.array([along[1], -along[0]])
        for piece in pieces:
            left, right, depth = (value / MICRO for value in (
                piece.scope.left, piece.scope.right, piece.scope.depth))
            if depth < 0.0:
                yield piece, start + np.array([left * along, right * along, right * along
                                               - depth * out, left * along - depth * out])


def _ground_of(body: Body) -> np.ndarray:
    """Return the ground polygon of a body [m], (n, 2); a free wall's has its thickness."""
    points = body.plan.points
    if len(points) > 2:
        return points
    way = (points[1] - points[0]) / norm(points[1] - points[0])
    return np.concatenate([points, points[::-1] + body.layout.thickness * 1e-6
                           * np.array([-way[1], way[0]])])


def _overlap(points: np.ndarray, others: np.ndarray) -> bool:
    """Return whether two polygons overlap by more than a strip along their edges."""
    return any(len(piece := clip(one, other)) > 2
               and moments(piece)[0] > _CLOSE * np.ptp(piece, axis=0).max()
               for one in _pieces(points) for other in _pieces(others))


def _pieces(polygon: np.ndarray) -> list[np.ndarray]:
    """Cut a polygon into trapezia, counter-clockwise, (4, 2) each."""
    found = trapezia(polygon)
    for piece in found:  # the ends of one that ends in a point may have changed places
        piece[:, 0] = np.sort(piece[:, 0].reshape(2, 2), axis=1).ravel()
    return [piece[[0, 1, 3, 2]] for piece in found]
