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

"""
The engine of PyBullet.

Bodies are rigid bodies in maximal coordinates (Bullet's `btRigidBody`): a hundred times cheaper
than articulated ones and without their limits on links.
"""

from collections.abc import Callable
import os
import tempfile

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.hexahedron import inset
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.bullet_client import BulletClient, MOST_SHAPES
from procphys_ros.physics.world.engine import COLLISION_FILTERS, TERRAIN_MARGIN
from procphys_ros.physics.world.first_turn import (
    turn_as_their_shapes,
    turns_as_the_box_about_it,
)
from procphys_ros.physics.world.pieces import Pieces
from procphys_ros.physics.world.urdf import SHORTEST, write_hulls, write_urdf

# Measured on piles of 500 bricks that fall 1.2 m: with these iterations and warm starts (and ERP
# 0.3) the worst second runs twice as fast as with PyBullet's ERP 0.08, warm starting 0.1 (and 10
# iterations), everything comes to rest within 5 s instead of a tenth creeping on.
# Penetration is corrected apart from the velocities ("split impulses"): what is squeezed is moved
# out, not thrown out. 12 s after its demolition some 80 pieces of a cottage move instead of some
# 280, and with ERP 0.5 none of four of them rests deeper than 1.4 cm in the ground (0.3: 3.8 cm).
ERP = 0.5  # share of a penetration that is corrected per step
ITERATIONS = 15  # of the contact solver, at least
MOST_ITERATIONS = 100  # where few bodies move
ITERATIONS_TIMES_BODIES = 10_000  # between these two: with 15, small pieces under large ones are
#                                   squeezed into their neighbours, and rest so (decision 67)
WARM_START = 0.85  # share of the last step's contact impulses that the solver starts from
DENSE_SUBSTEPS = 4  # where contacts are dense, and with how many iterations: with fewer than 200,
DENSE_ITERATIONS = 300  # or with two substeps, a loose arch of 24 voussoirs, t/R = 0.13, falls

_MARGIN = 1e-3  # [m] by which Bullet makes every convex hull larger than its points

_GROUND_HALF = 5000.0  # [m] half of the ground's sides
_GROUND_DEPTH = 50.0   # [m] half of its thickness

_MEMORY_FOLDER = '/dev/shm'  # a folder in memory, where there is one
_ROUND = 6  # decimals of sizes and quaternions up to which plain bodies are added together
# By state: what stands still, and is created with mass, or Bullet never moves it.
_HELD = np.isin(list(BodyState), (BodyState.FIXED, BodyState.RESTING))
_UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
_FILTERS = np.array([COLLISION_FILTERS.get(state, (0, 0)) for state in BodyState], np.intc)


class BulletEngine:
    """
    One PyBullet world, see `Engine`.

    :param gravity: acceleration of awake bodies [m/s²], (3,).
    :param terrain: the surface of the ground.
    """

    name = 'bullet'
    integrations = 1

    def __init__(self, gravity: np.ndarray, terrain: Terrain = FLAT):
        self._terrain = terrain
        self._gravity = np.asarray(gravity, float).tolist()
        self._folder = _MEMORY_FOLDER if os.access(_MEMORY_FOLDER, os.W_OK) else None
        self._connect()

    def _connect(self) -> None:
        self._client = BulletClient()
        self._client.set_gravity(self._gravity)
        self._client.set_solver(ITERATIONS, ERP, WARM_START)
        self._time_step, self._iterations = 0.0, ITERATIONS
        self._made, self._free = 0, list[int]()  # numbers of bodies: given out, given back
        self._shapes: dict[tuple, int] = {}
        self._states = np.full(0, -1)  # by PyBullet's ids, as collisions know them
        self._rules: dict[int, dict[int, bool]] = {}  # whether a pair of them is excluded
        self._handles = np.full(0, -1)  # PyBullet's id of each body
        self._ids = np.full(0, -1)  # and the other way round

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._client.close()

    def clear(self) -> None:
        """Empty the world."""
        self.close()
        self._connect()

    def use_threads(self, count: int) -> None:
        """Do nothing: PyBullet's solver has one thread."""

    def refine(self, moving: int, dense: bool) -> int:
        """Iterate more where fewer bodies move, in substeps where contacts are dense."""
        iterations = DENSE_ITERATIONS if dense else _iterations(moving)
        if iterations != self._iterations:
            self._client.set_iterations(iterations)
            self._iterations = iterations
        return DENSE_SUBSTEPS if dense else 1

    def step(self, time_step: float) -> None:
        """Advance time [s]."""
        if time_step != self._time_step:
            self._client.set_time_step(time_step)
            self._time_step = time_step
        self._client.step()

    def add(self, table: BodyTable, ids: np.ndarray) -> None:
        """Add bodies, (K,) ids; plain ones of one shape, size and attitude at once."""
        plain = table.least[ids] > 0.0
        plain[plain] = turn_as_their_shapes(table, ids[plain])
        alone = ~plain | (table.hexahedron_count[ids] > 0)
        ground = table.state[ids] == BodyState.GROUND
        for place in np.flatnonzero(alone).tolist():
            body = ids[place:place + 1]
            if ground[place]:
                self._enter(body, self._create_ground())
            elif plain[place]:
                self._enter(body, self._create_plain(table, body))
            else:
                self._enter(body, self._create_compound(table, int(body[0])))
        for same in _alike(table, ids[~alone]):
            self._enter(same, self._create_plain(table, same))
        self._set_up(table, ids)

    def _enter(self, ids: np.ndarray, last: int) -> None:
        """
        Keep the numbers that PyBullet gave to new bodies, of which it tells the last.

        It gives those of removed bodies again, the last one removed first, then new ones.
        """
        again = [self._free.pop() for _ in range(min(len(ids), len(self._free)))]
        made = self._made + len(ids) - len(again)
        handles = np.array([*again, *range(self._made, made)])
        self._made = made
        if handles[-1] != last:
            raise RuntimeError(f'PyBullet called a body {last} instead of {handles[-1]}')
        self._handles = _filled(self._handles, ids, handles)
        self._ids = _filled(self._ids, handles, ids)

    def _create_ground(self) -> int:
        """
        Create the ground: a height field, or, where the top is z = 0, a huge box.

        Against a plane, Bullet finds one contact point per step only, so that what
        lands flat would strike with a corner and be turned.
        """
        if not self._terrain.is_flat:
            return self._create_terrain(self._terrain.padded(TERRAIN_MARGIN))
        slab = self._client.create_box(np.array([_GROUND_HALF, _GROUND_HALF, _GROUND_DEPTH]))
        return self._client.create_bodies(0.0, slab, np.array([[0.0, 0.0, -_GROUND_DEPTH]]),
                                          _UPRIGHT)

    def _create_terrain(self, terrain: Terrain) -> int:
        """Create a height field, which Bullet puts about the middle of its grid and heights."""
        columns, rows = terrain.heights.shape
        field = self._client.create_heights(terrain.heights.T, terrain.edge)
        middle = (*(terrain.low + 0.5 * terrain.edge * np.array([columns - 1, rows - 1])),
                  0.5 * sum(terrain.bounds()))
        return self._client.create_bodies(0.0, field, np.array([middle]), _UPRIGHT)

    def _create_plain(self, table: BodyTable, ids: np.ndarray) -> int:
        """
        Create bodies of one shape, mass and attitude, at once: 5 times faster than one by one.

        Bullet keeps the inverse inertia along world axes with which a body was created, that of
        its shape, until the end of the next step, whatever mass it is given in between: see
        `first_turn`.
        """
        return self._client.create_bodies(
            float(table.mass[ids[0]]), self._shape(table.pieces(int(ids[0]))),
            table.poses[ids, :3], table.poses[ids[0], 3:])

    def _shape(self, piece: Pieces) -> int:
        """Create the shape of a plain body once: Bullet never frees shapes."""
        if len(piece.hexahedra):
            corners = inset(piece.hexahedra.corners.reshape(1, 8, 3), _MARGIN)[0].round(_ROUND)
            return self._make(self._client.create_hull, corners)
        size = piece.sizes[0]
        if piece.shapes[0] == Shape.BOX:
            half = [round(extent, _ROUND) for extent in (0.5 * size).tolist()]
            return self._make(self._client.create_box, np.array(half))
        diameter, length = float(size[0]), float(size[2])
        return self._make(self._client.create_capsule, round(0.5 * diameter, _ROUND),
                          max(round(length - diameter, _ROUND), 0.0))

    def _make(self, create: Callable[..., int], *size: np.ndarray | float) -> int:
        key = (create.__name__, *(np.asarray(value).tobytes() for value in size))
        if key not in self._shapes:
            self._shapes[key] = create(*size)
        return self._shapes[key]

    def _create_compound(self, table: BodyTable, body: int) -> int:
        """
        Create a rigid body made of many shapes.

        PyBullet's own compounds stop at 16 shapes, a URDF link does not, but takes three times as
        long. PyBullet gives back the shapes of neither, 1 to 5 kB, before the world is closed.
        """
        pieces = table.pieces(body)
        if (len(pieces.shapes) <= MOST_SHAPES and not len(pieces.hexahedra)
                and turns_as_the_box_about_it(table, body)):
            return self._create_list(table, body, pieces)
        return self._create_from_file(table, body, pieces)

    def _create_list(self, table: BodyTable, body: int, pieces: Pieces) -> int:
        """Create a compound whose first contacts may turn it as the box about its shapes."""
        shape = self._client.create_list(pieces.shapes == Shape.BOX, pieces.sizes,
                                         pieces.local_poses, SHORTEST)
        return self._client.create_bodies(float(table.mass[body]), shape,
                                          table.poses[body:body + 1, :3], table.poses[body, 3:])

    def _create_from_file(self, table: BodyTable, body: int, pieces: Pieces) -> int:
        """Create a compound with all shapes there are, and its own inertia from the start."""
        pose = table.poses[body]
        handle, path = tempfile.mkstemp('.urdf', 'procphys_', self._folder)
        mesh = path + '.obj' if len(pieces.hexahedra) else ''
        try:
            with open(handle, 'w', encoding='ascii') as file:
                file.write(write_urdf(float(table.mass[body]), table.inertia[body], pieces, mesh))
            if mesh:
                with open(mesh, 'w', encoding='ascii') as file:
                    file.write(write_hulls(inset(
                        pieces.hexahedra.points(pieces.local_poses), _MARGIN)))
            return self._client.load_urdf(path, pose.tolist())
        finally:
            os.unlink(path)
            if mesh:
                os.unlink(mesh)

    def _set_up(self, table: BodyTable, ids: np.ndarray) -> None:
        """Give new bodies their inertia, surfaces and velocities; those that move come first."""
        state = table.state[ids]
        moves, is_ground = state >= BodyState.AWAKE, state == BodyState.GROUND
        order = np.argsort(np.where(moves, 0, np.where(is_ground, 1, 2)), kind='stable')
        ids, state = ids[order], state[order]
        # Bullet multiplies friction and restitution of a pair, so it gets the roots of them.
        surfaces = np.sqrt(np.column_stack([table.friction[ids], table.restitution[ids]]))
        self._client.set_up(self._handles[ids], moves[order], _HELD[state], surfaces,
                            table.mass[ids], table.inertia[ids], _FILTERS[state])
        self._note(self._handles[ids], state)
        self._set_in_motion(table, ids[state >= BodyState.AWAKE])

    def _set_in_motion(self, table: BodyTable, ids: np.ndarray) -> None:
        """Give bodies their velocities, and sweep those that are to be swept."""
        self.set_velocities(ids, table.velocities[ids])
        swept = ids[table.swept_radius[ids] > 0.0]
        self.set_swept(swept, table.swept_radius[swept])

    def _note(self, handles: np.ndarray, states: np.ndarray) -> None:
        """Record the states of bodies, and apply the rules of pairs: these override filters."""
        self._states = _filled(self._states, handles, states)
        for handle in handles.tolist() if self._rules else ():
            for other in self._rules.get(handle, ()):
                self._set_rule(handle, other)

    def set_excluded(self, pairs: np.ndarray, excluded: bool) -> None:
        """
        Exclude pairs of bodies from collision, or include them again, (K, 2) ids.

        PyBullet keeps a rule for a pair for ever, also for later bodies of the same numbers, and
        asks no masks where it has one.
        """
        for one, other in self._handles[pairs].tolist():
            self._rules.setdefault(one, {})[other] = excluded
            self._rules.setdefault(other, {})[one] = excluded
            self._set_rule(one, other)

    def _set_rule(self, one: int, other: int) -> None:
        (group, mask), (group_, mask_) = _FILTERS[self._states[[one, other]]].tolist()
        meet = not self._rules[one][other] and bool(group & mask_) and bool(group_ & mask)
        self._client.set_pair(one, other, meet)

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies, (K,) ids."""
        handles = self._handles[ids].tolist()
        self._client.remove(handles)
        self._free += handles

    def freeze(self, ids: np.ndarray) -> None:
        """Make bodies immovable, at no cost per step, (K,) ids."""
        states = np.full(len(ids), BodyState.FIXED)
        self._client.freeze(self._handles[ids], _FILTERS[states])
        self._note(self._handles[ids], states)

    def thaw(self, table: BodyTable, ids: np.ndarray) -> None:
        """Make immovable bodies movable, (K,) ids."""
        states = np.full(len(ids), BodyState.AWAKE)
        self._client.thaw(self._handles[ids], table.mass[ids], table.inertia[ids],
                          _FILTERS[states])
        self._note(self._handles[ids], states)

    def set_poses(self, ids: np.ndarray, poses: np.ndarray) -> None:
        """Set centres of mass and principal axes, world, (K, 7)."""
        self._client.set_poses(self._handles[ids], poses)

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set linear [m/s] and angular velocities [rad/s], world axes, (K, 6)."""
        self._client.set_velocities(self._handles[ids], velocities)

    def set_swept(self, ids: np.ndarray, radii: np.ndarray) -> None:
        """Sweep spheres of these radii [m] along the steps of plain bodies, (K,); 0 = do not."""
        for handle, radius in zip(self._handles[ids].tolist(), radii.tolist()):
            self._client.set_swept(handle, radius)

    def read(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Read poses (K, 7) and velocities (K, 6) of centres of mass, world axes."""
        return self._client.read(self._handles[ids])

    def contacts(self) -> np.ndarray:
        """Read the contact points of the last step, (C, 13); see `Engine.contacts`."""
        found = self._client.contacts()
        rubbing, ways = found['rubbing'], found['ways']
        force = (found['pressing'][:, None] * found['normal'] + rubbing[:, :1] * ways[:, 0]
                 + rubbing[:, 1:] * ways[:, 1])
        return np.column_stack([self._ids[found['bodies']], found['on_second'], found['normal'],
                                found['distance'], force, found['pressing']])

    def touched(self, body: int) -> list[int]:
        """List the ids that a body has contact points with."""
        handle = int(self._handles[body])
        bodies = self._client.contacts(handle)['bodies']
        return self._ids[np.where(bodies[:, 0] == handle, bodies[:, 1], bodies[:, 0])].tolist()


def _iterations(moving: int) -> int:
    """Choose the iterations of a step in which so many bodies move."""
    affordable = ITERATIONS_TIMES_BODIES // max(moving, 1)
    return min(max(ITERATIONS, affordable), MOST_ITERATIONS)


def _alike(table: BodyTable, ids: np.ndarray) -> list[np.ndarray]:
    """Group plain bodies alike in shape, size, mass and attitude."""
    if len(ids) < 2:
        return [ids] if len(ids) else []
    piece = table.first_piece[ids]
    keys = np.column_stack([table.piece_size[piece], table.poses[ids, 3:],
                            table.piece_shape[piece]]).round(_ROUND)
    keys = np.column_stack([keys, table.mass[ids]])
    order = np.lexsort(keys.T[::-1])
    others = (np.diff(keys[order], axis=0) != 0.0).any(axis=1)
    return np.split(ids[order], np.flatnonzero(others) + 1)


def _filled(column: np.ndarray, rows: np.ndarray, values: list[int] | np.ndarray) -> np.ndarray:
    """Write values to rows of a column, made longer where needed."""
    least = int(np.max(rows, initial=-1)) + 1
    if least > len(column):
        column = np.concatenate([column, np.full(max(least, 2 * len(column)) - len(column), -1)])
    column[rows] = values
    return column
