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

"""Footprint: the ground polygon of a building, its edges as facades, and their corners."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procphys_ros.elementary import atan2, cos, hypot, sin, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import product
from procphys_ros.language import Place
from procphys_ros.wallgrammar.boxes import Boxes, MICRO, micro, micros

_ALIGNED = 1e-6   # [rad] edges this close to a right angle are taken as right-angled
_SQUARE = np.radians(2.0)  # [rad] edges this close to right angles can be squared up
_TOUCHING = 1e-3  # [m] between edges of two plans that touch each other
_MERGED = 3       # [µm] corners of one frame this close lie on one line
_SHORTEST = 0.1   # [m] shortest edge
_LONGEST = 10_000.0  # [m] longest edge
_FARTHEST = 100_000.0  # [m] largest coordinate; whole micrometres stay exact
_MOST_CORNERS = 500
_SHARPEST = 25.0  # [degrees] smallest angle between two facades, inside or outside


@dataclass(frozen=True)
class Corner:
    """
    End of a facade's wall, measured outwards from the end of its edge [µm].

    :ivar owned: in courses in which this facade fills the corner.
    :ivar yielded: in courses in which its neighbour does.
    :ivar joint: joint at the end where it yields.
    :ivar right: whether the neighbour stands at a right angle, in the same frame.
    :ivar turn: angle that the edges turn by, left positive [rad].
    """

    owned: int = 0
    yielded: int = 0
    joint: int = 0
    right: bool = True
    turn: float = 0.0


@dataclass(frozen=True)
class Facade:
    """
    One edge of the footprint with the wall on it.

    :ivar length: of the edge [µm].
    :ivar frame: index of the frame.
    :ivar quarter: direction of the edge in its frame, in quarter turns.
    :ivar origin: start of the edge in its frame [µm], (2,).
    :ivar start, end: ends of the wall.
    """

    length: int
    frame: int
    quarter: int
    origin: tuple[int, int]
    start: Corner = Corner()
    end: Corner = Corner()

    def place_points(self, points: np.ndarray) -> np.ndarray:
        """Move points [m] from the facade (x along, y inwards, z up) into its frame, (..., 3)."""
        turn = rotation.from_yaw(0.5 * np.pi * self.quarter)
        return rotation.rotate(turn, points) + np.array([*self.origin, 0]) / MICRO

    def place(self, boxes: Boxes) -> Boxes:
        """Move boxes from the facade (x along, y inwards, z up) into its frame."""
        low, high = boxes.low.copy(), boxes.high.copy()
        before, after = boxes.before.copy(), boxes.after.copy()
        axis = boxes.axis
        if self.quarter % 2:
            swap = [1, 0, 2]
            low, high, before, after = (c[:, swap] for c in (low, high, before, after))
            axis = np.array(swap)[axis]
        for a, mirrored in enumerate((self.quarter in (1, 2), self.quarter in (2, 3))):
            if mirrored:
                low[:, a], high[:, a] = -high[:, a], -low[:, a]
                before[:, a], after[:, a] = after[:, a].copy(), before[:, a].copy()
            low[:, a] += self.origin[a]
            high[:, a] += self.origin[a]
        return replace(boxes, low=low, high=high, before=before, after=after, axis=axis,
                       frame=np.full(len(low), self.frame))


@dataclass(frozen=True)
class Footprint:
    """
    A simple polygon, counter-clockwise; or a single edge, for a free-standing wall.

    :ivar points: corners [m], (n, 2).
    :ivar yaws: turn of each frame about the vertical [rad], (f,); frames hold right angles only.
    :ivar facades: one per edge.
    """

    points: np.ndarray
    yaws: np.ndarray
    facades: tuple[Facade, ...]

    @property
    def right_angled(self) -> bool:
        """Return whether all edges lie in the first frame."""
        return all(facade.frame == 0 for facade in self.facades)

    @property
    def least_right(self) -> int:
        """Index of the corner that is farthest from a right angle."""
        edges = np.roll(self.points, -1, axis=0) - self.points
        angles = atan2(edges[:, 1], edges[:, 0])
        return int(np.argmax(np.abs(_off_square(angles - np.roll(angles, 1))).round(9)))

    @property
    def corners(self) -> np.ndarray:
        """Corners in the first frame [µm], (n, 2); exact when the footprint is right-angled."""
        return np.array([f.origin for f in self.facades])


def read(points: np.ndarray, thickness: int, joint: int, places: Sequence[Place],
         known: Sequence[float] = ()) -> Footprint:
    """
    Make the facades of a footprint, and the ends of their walls at its corners.

    :param points: corners that have passed `check` [m], (n, 2).
    :param thickness: of the walls [µm].
    :param joint: between walls that meet [µm].
    :param places: of the corners, for errors.
    :param known: yaws of the existing frames [rad].
    :raises GrammarError: for edges too short for their walls, and corners too sharp.
    """
    closed = len(points) > 2
    edges = np.roll(points, -1, axis=0) - points if closed else points[1:] - points[:1]
    angles = atan2(edges[:, 1], edges[:, 0])
    yaws, frame, quarter = _frames(angles, known)
    lengths = hypot(*edges.T)
    facades = [Facade(micro(length), int(f), int(q), origin) for length, f, q, origin
               in zip(lengths, frame, quarter, _origins(points, yaws, frame))]
    if not closed:
        return Footprint(points, yaws, tuple(facades))
    facades = [replace(a, length=_exact_length(a, b))
               for a, b in zip(facades, facades[1:] + facades[:1])]
    turns = (angles - np.roll(angles, 1) + np.pi) % (2.0 * np.pi) - np.pi
    for i, turn in enumerate(turns):
        if np.pi - abs(turn) < np.radians(_SHARPEST):
            raise places[i].error(f'the facades meet at {180 - abs(np.degrees(turn)):.1f} degrees '
                                  f'here; at least {_SHARPEST:g} are needed')
        before, after = _corner(turn, thickness, joint)
        facades[i - 1] = replace(facades[i - 1], end=before)
        facades[i] = replace(facades[i], start=after)
    for i, facade in enumerate(facades):
        room = facade.length + min(facade.start.yielded, 0) + min(facade.end.yielded, 0)
        if room < thickness:
            raise places[i].error(f'the edge from here is {lengths[i]:.3f} m long: too short for '
                                  f'walls {thickness / 1e6:g} m thick at both its ends')
    return Footprint(points, yaws, tuple(facades))


def check(points: np.ndarray, places: Sequence[Place]) -> None:
    """
    Check that corners form a footprint.

    :param points: corners [m], (n, 2).
    :param places: of the corners, for errors.
    :raises GrammarError: for a polygon that is not simple and counter-clockwise.
    """
    if len(points) < 2:
        raise places[0].error('a footprint needs at least 2 corners (2 make a free wall), found 1')
    if len(points) > _MOST_CORNERS:
        raise places[_MOST_CORNERS].error(f'a footprint has at most {_MOST_CORNERS} corners, '
                                          f'found {len(points)}')
    for place, corner in zip(places, points):
        if not (np.abs(corner) <= _FARTHEST).all():
            raise place.error(f'coordinates must be from {-_FARTHEST:g} to {_FARTHEST:g} m, found '
                              f'({corner[0]:g}, {corner[1]:g})')
    closed = len(points) > 2
    ends = np.roll(points, -1, axis=0)
    lengths = hypot(*(ends - points).T)
    if closed and lengths[-1] == 0.0:
        raise places[-1].error('the last corner repeats the first one; leave it out, the '
                               'footprint closes by itself')
    for place, length in zip(places if closed else places[:1], lengths):
        if length == 0.0:
            raise place.error('this corner and the next one are the same; leave one out')
        if not _SHORTEST <= length <= _LONGEST:
            side = f'shorter than {_SHORTEST:g}' if length < _SHORTEST else (
                f'longer than {_LONGEST:g}')
            raise place.error(f'the edge from here is {side} m: it has {length:.4g} m')
    if not closed:
        return
    crossings = crossing(points, ends)
    if len(crossings):
        i, j = crossings[0]
        raise places[j].error(f'the footprint crosses itself: the edge from here meets '
                              f'edge {i + 1}; give the corners in order around it')
    area = 0.5 * np.sum(points[:, 0] * ends[:, 1] - ends[:, 0] * points[:, 1])
    if abs(area) < 1e-6 * np.square(lengths.max()):
        raise places[0].error('the corners of the footprint lie on one line; two corners make a '
                              'free wall')
    if area < 0.0:
        raise places[0].error('the footprint runs clockwise; give its corners counter-clockwise')


def square_up(points: np.ndarray, yaw: float | None,
              others: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> np.ndarray:
    """
    Square up a nearly right-angled plan, by turning its edges about their middles.

    Edges that touch those of an earlier plan stay with them. A plan with edges more than two
    degrees off is returned as it is.

    :param points: corners that have passed `check` [m], (n, 2).
    :param yaw: of the frame [rad]; None = the mean direction of the edges.
    :param others: earlier plans, as given and squared up.
    """
    edges = np.roll(points, -1, axis=0) - points
    angles, lengths = atan2(edges[:, 1], edges[:, 0]), hypot(*edges.T)
    off = _off_square(angles - (angles[0] if yaw is None else yaw))
    if yaw is None:
        yaw = float(angles[0] + (off * lengths).sum() / lengths.sum())
    axis = np.rint((angles - yaw) / (0.5 * np.pi)).astype(int) % 2
    begins = axis != np.roll(axis, 1)
    if len(points) < 3 or np.abs(off).max() < _ALIGNED or not begins.any() or (
            np.abs(_off_square(angles - yaw)).max() > _SQUARE):
        return points
    turn = np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])
    local = product(points, turn)
    rows = np.arange(len(points))
    line = (np.cumsum(begins) - 1) % begins.sum()  # edges in one line, one after the other
    middles = 0.5 * (local + np.roll(local, -1, axis=0))[rows, 1 - axis]
    place = np.bincount(line, middles * lengths) / np.bincount(line, lengths)
    for given, squared in others:
        for i, j in _touching(points, given):
            place[line[i]] = product(0.5 * (squared[j] + squared[(j + 1) % len(squared)]),
                                     turn)[1 - axis[i]]
    moved = local.copy()
    for ends in (rows, (rows + 1) % len(points)):
        moved[ends, 1 - axis] = place[line]
    ways = np.roll(moved, -1, axis=0) - moved
    if ((ways * (np.roll(local, -1, axis=0) - local))[rows, axis] <= 0.0).any():
        return points  # an edge shorter than its neighbours move
    return product(moved, turn.T)


def _off_square(angles: np.ndarray) -> np.ndarray:
    """Compute the deviation of angles from the nearest right angle [rad]."""
    return angles - 0.5 * np.pi * np.rint(angles / (0.5 * np.pi))


def _touching(points: np.ndarray, others: np.ndarray) -> list[tuple[int, int]]:
    """List pairs of edges of two plans that touch along a length."""
    found = []
    for i, (a, b) in enumerate(zip(points, np.roll(points, -1, axis=0))):
        for j, (c, d) in enumerate(zip(others, np.roll(others, -1, axis=0))):
            way = (d - c) / hypot(*(d - c))
            aside = product(np.array([a - c, b - c]), np.array([-way[1], way[0]]))
            along = product(np.array([a - c, b - c, d - c]), way)
            if np.abs(aside).max() < _TOUCHING and (
                    min(along[2], along[:2].max()) - max(0.0, along[:2].min()) > _TOUCHING):
                found.append((i, j))
    return found


def crossing(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Find pairs of edges that touch but are not neighbours, (k, 2), in order."""
    first, second = np.triu_indices(len(points), 2)
    apart = (second + 1) % len(points) != first
    first, second = first[apart], second[apart]
    a, b, c, d = points[first], ends[first], points[second], ends[second]

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        value = (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (
            q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])
        return np.where(np.abs(value) < 1e-9, 0.0, np.sign(value))

    near = ((np.maximum(a, b) >= np.minimum(c, d) - 1e-9)
            & (np.maximum(c, d) >= np.minimum(a, b) - 1e-9)).all(axis=1)
    touch = near & (side(a, b, c) * side(a, b, d) <= 0) & (side(c, d, a) * side(c, d, b) <= 0)
    return np.column_stack([first, second])[touch]


def _frames(angles: np.ndarray,
            known: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Group directions that differ by right angles; the first edge sets the first frame."""
    yaws = list(known)
    frame, quarter = [], []
    for angle in angles:
        turns = [(angle - yaw) / (0.5 * np.pi) for yaw in yaws]
        fitting = [f for f, turn in enumerate(turns)
                   if abs(turn - round(turn)) * 0.5 * np.pi < _ALIGNED]
        if not fitting:
            fitting = [len(yaws)]
            yaws.append(float(angle))
            turns.append(0.0)
        frame.append(fitting[0])
        quarter.append(round(turns[fitting[0]]) % 4)
    return np.array(yaws), np.array(frame), np.array(quarter)


def _origins(points: np.ndarray, yaws: np.ndarray, frame: np.ndarray) -> list[tuple[int, int]]:
    """Express edge starts in their frames [µm]; coordinates that differ by rounding merge."""
    out = np.zeros((len(frame), 2), np.int64)
    for f, yaw in enumerate(yaws):
        c, s = cos(yaw), sin(yaw)
        local = micros(product(points, np.array([[c, -s], [s, c]])))
        for a in range(2):
            order = np.argsort(local[:, a], kind='stable')
            steps = np.diff(local[order, a]) > _MERGED
            group = np.concatenate([[0], np.cumsum(steps)])
            first = np.concatenate([[True], steps])
            local[order, a] = local[order, a][first][group]
        out[frame == f] = local[:len(frame)][frame == f]
    return [(int(x), int(y)) for x, y in out]


def _exact_length(facade: Facade, following: Facade) -> int:
    """Compute an edge's length [µm], exactly where both its ends lie in one frame."""
    if facade.frame != following.frame:
        return facade.length
    a = facade.quarter % 2
    return abs(following.origin[a] - facade.origin[a])


def _corner(turn: float, thickness: int, joint: int) -> tuple[Corner, Corner]:
    """
    Compute how the ending and the starting facade share a corner.

    At right angles they fill the square that both would cover in alternate courses. At other
    angles one runs up to the corner and the other ends clear of it; the wedge between them is
    mortar.
    """
    quarter = turn / (0.5 * np.pi)
    if abs(quarter - round(quarter)) * 0.5 * np.pi < _ALIGNED:
        if round(quarter) == 0:
            return Corner(0, 0, joint // 2), Corner(0, 0, joint - joint // 2)
        shared = (0, -thickness) if turn > 0 else (thickness, 0)
        corner = Corner(*shared, joint, True, turn)
        return corner, corner
    clear = 0.0
    owned = 0.0
    if turn > 0:
        clear = sin(turn) if turn <= 0.5 * np.pi else tan(0.5 * turn)
        owned = 0.0 if turn <= 0.5 * np.pi else 1.0 / tan(turn)
    corner = Corner(round(owned * thickness), -round(clear * thickness), joint, False, turn)
    return corner, corner
