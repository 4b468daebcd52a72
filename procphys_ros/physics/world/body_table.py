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

"""Body table: the state and shapes of all bodies of a world as columns, a row per id."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import box_inertia, Hexahedra, Shape
from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, norm
from procphys_ros.physics.world.loose_bodies import LooseBody, radii
from procphys_ros.physics.world.pieces import Pieces


class BodyState(ArrayEnum):
    """State of motion of a body."""

    GONE = 0       # unused row
    GROUND = 1     # the ground, z <= 0
    FIXED = 2      # immovable until it is thawed: a standing brick
    RESTING = 3    # debris at rest: immovable until it is hit or loses its support
    AWAKE = 4      # moves freely
    KINEMATIC = 5  # follows prescribed poses and pushes awake bodies


_COLUMNS: dict[str, tuple[type, int]] = {  # type and width; 0 = a single value per body
    'state': (np.uint8, 0), 'mass': (float, 0), 'inertia': (float, 3), 'friction': (float, 0),
    'restitution': (float, 0), 'radius': (float, 0), 'least': (float, 0),
    'poses': (float, 7), 'velocities': (float, 6), 'target': (float, 7), 'quiet': (float, 0),
    'mark': (float, 7), 'bounds': (float, 6),
    'first_piece': (np.int64, 0), 'piece_count': (np.int64, 0), 'first_point': (np.int64, 0),
    'point_count': (np.int64, 0), 'first_hexahedron': (np.int64, 0),
    'hexahedron_count': (np.int64, 0)}
_PIECES: dict[str, tuple[type, int]] = {
    'piece_shape': (np.int64, 0), 'piece_size': (float, 3), 'piece_pose': (float, 7)}
_POINTS: dict[str, tuple[type, int]] = {'ground_point': (float, 3)}
_HEXAHEDRA: dict[str, tuple[type, int]] = {
    'hexahedron_piece': (np.int32, 0), 'hexahedron_corners': (float, 24)}
_ROWS = (('piece', _PIECES), ('point', _POINTS), ('hexahedron', _HEXAHEDRA))  # many per body


class BodyTable:
    """
    Columns of bodies, of their collision shapes and of their ground contact points.

    Rows of removed bodies are reused by later ones, the last one removed first. The columns have
    spare rows; those are `GONE`. The table can be saved and restored as arrays; it holds no
    handles of an engine.

    :ivar state: `BodyState`, (B,) uint8.
    :ivar mass: [kg], also while immovable, (B,).
    :ivar inertia: principal moments in the body's axes [kg·m²], (B, 3).
    :ivar friction: Coulomb coefficient between two bodies that have this value, (B,).
    :ivar restitution: coefficient of restitution between two such bodies, (B,).
    :ivar radius: of the bounding sphere about the centre of mass [m], (B,).
    :ivar least: least extent of a plain body [m], 0 for compounds, (B,).
    :ivar poses: centre of mass and principal axes, world, (B, 7).
    :ivar velocities: linear and angular, world axes, (B, 6).
    :ivar target: pose of a kinematic body at the end of the next step, (B, 7).
    :ivar quiet: time that the body has stayed near `mark` [s], (B,).
    :ivar mark: reference pose of the sleep test, (B, 7).
    :ivar bounds: axis-aligned bounds of immovable bodies [m], (B, 6).
    :ivar first_piece: row of its first collision shape, (B,).
    :ivar piece_count: number of its collision shapes, (B,).
    :ivar first_point: row of its first ground contact point, (B,).
    :ivar point_count: number of its ground contact points, (B,).
    :ivar first_hexahedron: row of its first hexahedron, (B,).
    :ivar hexahedron_count: number of its collision shapes that are hexahedra, (B,).
    :ivar piece_shape: `Shape`, (P,).
    :ivar piece_size: as in `Blueprint.size` [m], (P, 3).
    :ivar piece_pose: in the body's frame, (P, 7).
    :ivar ground_point: in the body's frame [m], (Q, 3).
    :ivar hexahedron_piece: its index among the body's collision shapes, (H,).
    :ivar hexahedron_corners: as in `Hexahedra.corners` [m], (H, 24).
    """

    state: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    friction: np.ndarray
    restitution: np.ndarray
    radius: np.ndarray
    least: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    target: np.ndarray
    quiet: np.ndarray
    mark: np.ndarray
    bounds: np.ndarray
    first_piece: np.ndarray
    piece_count: np.ndarray
    first_point: np.ndarray
    point_count: np.ndarray
    piece_shape: np.ndarray
    piece_size: np.ndarray
    piece_pose: np.ndarray
    ground_point: np.ndarray
    first_hexahedron: np.ndarray
    hexahedron_count: np.ndarray
    hexahedron_piece: np.ndarray
    hexahedron_corners: np.ndarray

    def __init__(self) -> None:
        for name, (kind, width) in (_COLUMNS | _PIECES | _POINTS | _HEXAHEDRA).items():
            setattr(self, name, np.zeros((0, width) if width else 0, kind))
        self._free: list[int] = []
        self._used, self._used_rows = 0, {name: 0 for name, _ in _ROWS}
        self._views: dict[int, Pieces] = {}
        self._awake: np.ndarray | None = None  # see `awake`, until a state changes

    @property
    def ids(self) -> np.ndarray:
        """Ids of all bodies, ascending, (K,)."""
        return np.flatnonzero(self.state)

    @property
    def awake(self) -> np.ndarray:
        """Ids of the bodies that move freely, ascending, (K,), read-only."""
        if self._awake is None:
            self._awake = np.flatnonzero(self.state[:self._used] == BodyState.AWAKE)
        return self._awake

    def set_state(self, ids: np.ndarray, state: BodyState) -> None:
        """Set the state of bodies."""
        self.state[ids] = state
        self._awake = None

    def add_ground(self, friction: float) -> np.ndarray:
        """Add the ground, which must be the first body; return its id, (1,)."""
        ids = self._add_rows(1, BodyState.GROUND)
        self.mass[ids] = self.inertia[ids] = np.inf
        self.friction[ids], self.restitution[ids] = friction, 1.0
        self.poses[ids, 6] = 1.0
        return ids

    def add_bodies(self, state: BodyState, bodies: Sequence[LooseBody]) -> np.ndarray:
        """Add bodies with the values of the columns of the same names; return their ids."""
        ids = self._add_rows(len(bodies), state)
        pieces = [body.pieces for body in bodies]
        solids = [own.hexahedra for own in pieces]
        self._append_all('piece', ids, [own.shapes for own in pieces],
                         [own.sizes for own in pieces], [own.local_poses for own in pieces])
        self._append_all('point', ids, [own.ground_points for own in pieces])
        self._append_all('hexahedron', ids, [own.part for own in solids],
                         [own.corners for own in solids])
        self.radius[ids] = radii(pieces)
        for name in ('least', 'mass', 'inertia', 'friction', 'restitution'):
            getattr(self, name)[ids] = [getattr(body, name) for body in bodies]
        self.poses[ids] = self.target[ids] = [body.pose for body in bodies]
        self.velocities[ids] = [np.zeros(6) if body.velocity is None else body.velocity
                                for body in bodies]
        return ids

    def _append_all(self, kind: str, ids: np.ndarray, *rows: Sequence[np.ndarray]) -> None:
        """Append rows of several bodies, one list per column, and record their places."""
        count = np.array([len(own) for own in rows[0]])
        if count.any():
            first = self._append(kind, *map(np.concatenate, rows))
        else:
            first = self._used_rows[kind]
        getattr(self, f'first_{kind}')[ids] = first + np.cumsum(count) - count
        getattr(self, f'{kind}_count')[ids] = count

    def add_boxes(self, state: BodyState, poses: np.ndarray, sizes: np.ndarray,
                  mass: np.ndarray | float, friction: float, restitution: float,
                  hexahedra: Hexahedra, inertia: np.ndarray | None = None) -> np.ndarray:
        """
        Add plain boxes; equal boxes get adjacent ids, as engines add those faster.

        :param poses: (K, 7).
        :param sizes: full extents [m], (K, 3).
        :param mass: [kg], (K,).
        :param friction: Coulomb coefficient.
        :param restitution: coefficient of restitution.
        :param hexahedra: corners of the boxes that are not rectangular.
        :param inertia: principal moments [kg·m²], (K, 3); None = of solid rectangular boxes.
        :returns: ids, (K,).
        """
        keys = np.round(np.column_stack([sizes, poses[:, 3:]]), 6)
        ids = np.empty(len(poses), np.intp)
        ids[np.lexsort(keys.T[::-1])] = self._add_rows(len(poses), state)
        first = self._append('piece', np.full(len(ids), Shape.BOX), sizes,
                             np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(ids), 1)))
        self.first_piece[ids], self.piece_count[ids] = first + np.arange(len(ids)), 1
        cut = ids[hexahedra.part]
        first = self._append('hexahedron', np.zeros(len(cut), np.int32), hexahedra.corners)
        self.first_hexahedron[cut], self.hexahedron_count[cut] = first + np.arange(len(cut)), 1
        self.radius[ids] = 0.5 * norm(sizes, axis=1)
        self.least[ids] = sizes.min(axis=1)
        self.mass[ids] = mass
        self.inertia[ids] = box_inertia(self.mass[ids], sizes) if inertia is None else inertia
        self.friction[ids], self.restitution[ids] = friction, restitution
        self.poses[ids] = poses
        return ids

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies; their ids may be reused."""
        self.set_state(ids, BodyState.GONE)
        for body in ids.tolist():
            self._free.append(body)
            self._views.pop(body, None)

    def pieces(self, body: int) -> Pieces:
        """Return the collision shapes of a body, the same object until the body is removed."""
        if body not in self._views:
            first, point = self.first_piece[body], self.first_point[body]
            own = slice(first, first + self.piece_count[body])
            solid = self.first_hexahedron[body]
            cut = slice(solid, solid + self.hexahedron_count[body])
            self._views[body] = Pieces(
                self.piece_shape[own], self.piece_size[own], self.piece_pose[own],
                self.ground_point[point:point + self.point_count[body]],
                Hexahedra(self.hexahedron_piece[cut], self.hexahedron_corners[cut]))
        return self._views[body]

    def velocity_change(self, body: int, impulse: np.ndarray, point: np.ndarray | None,
                        angular: np.ndarray | None) -> np.ndarray:
        """
        Compute the velocity change of a free body by an impulse, (6,).

        :param impulse: [N·s], world, (3,).
        :param point: point of application, world [m], (3,); None = at the centre of mass.
        :param angular: further angular impulse [N·m·s], world, (3,).
        """
        turn = np.zeros(3) if angular is None else np.array(angular, float)
        if point is not None:
            arm = np.asarray(point) - self.poses[body, :3]
            turn = turn + cross(arm, impulse)
        attitude = self.poses[body, 3:]
        spin = rotation.rotate(rotation.conjugate(attitude), turn) / self.inertia[body]
        return np.concatenate([np.asarray(impulse) / self.mass[body],
                               rotation.rotate(attitude, spin)])

    def copied(self, name: str, kept: np.ndarray) -> np.ndarray:
        """
        Copy a column into an earlier copy of it, as allocation takes longer than copying.

        :param name: of the column.
        :param kept: the earlier copy, or one of its first few values per body; a new copy is made
            when the number of rows differs.
        """
        column = getattr(self, name)[:, :kept.shape[1]]
        if len(kept) != len(column):
            return column.copy()
        kept[:self._used] = column[:self._used]
        return kept

    def save(self) -> dict[str, np.ndarray]:
        """Return copies of the columns, without shapes of removed bodies."""
        self._compact()
        saved = {name: getattr(self, name)[:self._used].copy() for name in _COLUMNS}
        for kind, columns in _ROWS:
            saved |= {name: getattr(self, name)[:self._used_rows[kind]].copy()
                      for name in columns}
        return saved | {'free': np.array(self._free, np.int64),
                        'capacity': np.array(len(self.state))}

    @classmethod
    def restore(cls, saved: dict[str, np.ndarray]) -> 'BodyTable':
        """Build a table from the result of `save`."""
        table = cls()
        for name, (kind, _) in (_COLUMNS | _PIECES | _POINTS | _HEXAHEDRA).items():
            setattr(table, name, np.array(saved[name], kind))
        table._free = saved['free'].tolist()
        table._used = len(table.state)
        table._used_rows = {kind: len(getattr(table, next(iter(columns))))
                            for kind, columns in _ROWS}
        for name in _COLUMNS:  # the same capacity as before: sorts may depend on it
            column = getattr(table, name)
            room = np.zeros((int(saved['capacity']) - len(column), *column.shape[1:]))
            setattr(table, name, np.concatenate([column, room.astype(column.dtype)]))
        return table

    def _add_rows(self, count: int, state: BodyState) -> np.ndarray:
        """Allocate rows for new bodies; all their values but the state are zero."""
        old = [self._free.pop() for _ in range(min(count, len(self._free)))]
        end = self._used + count - len(old)
        ids = np.array([*old, *range(self._used, end)], np.intp)
        self._reserve(_COLUMNS, end)
        self._used = end
        for name in _COLUMNS:
            getattr(self, name)[ids] = 0
        self.set_state(ids, state)
        return ids

    def _append(self, kind: str, *rows: np.ndarray) -> int:
        """Append rows behind those in use; return the index of the first."""
        columns = dict(_ROWS)[kind]
        if self._used_rows[kind] + len(rows[0]) > len(getattr(self, next(iter(columns)))):
            self._compact()
            self._reserve(columns, 2 * (self._used_rows[kind] + len(rows[0])))
        first = self._used_rows[kind]
        for name, values in zip(columns, rows):
            getattr(self, name)[first:first + len(values)] = values
        self._used_rows[kind] = first + len(rows[0])
        return first

    def _reserve(self, columns: dict[str, tuple[type, int]], count: int) -> None:
        for name in columns:
            column = getattr(self, name)
            if count > len(column):
                more = max(count, 2 * len(column)) - len(column)
                room = np.zeros((more, *column.shape[1:]), column.dtype)
                setattr(self, name, np.concatenate([column, room]))

    def _compact(self) -> None:
        """Close the gaps that removed bodies left among shapes and points."""
        ids = self.ids
        for kind, columns in _ROWS:
            starts, counts = getattr(self, f'first_{kind}'), getattr(self, f'{kind}_count')
            ends = np.cumsum(counts[ids])
            rows = np.arange(ends[-1] if len(ids) else 0) + np.repeat(
                starts[ids] - (ends - counts[ids]), counts[ids])
            for name in columns:
                column = getattr(self, name)
                column = column.copy()  # views from `pieces` stay valid
                column[:len(rows)] = column[rows]
                setattr(self, name, column)
            starts[ids] = ends - counts[ids]
            self._used_rows[kind] = len(rows)
        gone = self.state == BodyState.GONE
        for kind, _ in _ROWS:
            getattr(self, f'first_{kind}')[gone] = getattr(self, f'{kind}_count')[gone] = 0
