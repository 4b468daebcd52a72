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
PyBullet engine, by its public API.

Bodies are rigid bodies in maximal coordinates (Bullet's `btRigidBody`): a hundred times cheaper
than articulated ones and without their limits on links.
"""

from collections.abc import Iterable
from functools import cache
from itertools import chain
import logging
from operator import itemgetter
import os
import tempfile
from types import ModuleType
from typing import Any
import weakref

import numpy as np

from procphys_ros.blueprint import Hexahedra, Shape
from procphys_ros.geometry.hexahedron import box_corners, inset, write_hulls
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.contacts import hand_on
from procphys_ros.physics.world.engine import COLLISION_FILTERS, Looked, TERRAIN_MARGIN
from procphys_ros.physics.world.joint_table import JointTable
from procphys_ros.physics.world.pieces import Pieces
from procphys_ros.physics.world.rolling import resist_rolling

_LOG = logging.getLogger(__name__)
MANY = 300  # moving bodies beyond which `native` is clearly faster


def _import_quietly() -> ModuleType:
    """Import PyBullet and suppress the banner that it writes to stderr."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        import pybullet
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)
    return pybullet


pybullet = _import_quietly()

LONGEST = 1.0 / 240.0  # [s] of a substep; PyBullet's own step
ERP = 0.5  # share of a penetration that is corrected per substep, apart from the velocities
WARM_START = 0.85  # share of the last contact impulses in the initial guess of the solver
REACH = 5e-3  # gap below which bodies touch, as a share of their radius: bodies that are stopped
#               before they touch do not bounce
SWEEP = 0.45  # radius of a plain body's swept sphere as a share of its least extent

_MARGIN = 1e-3  # [m] collision margin that Bullet adds to every convex hull
_MOST_SHAPES = 16  # in the list of shapes of a PyBullet compound
_MOMENT = 1e-9  # [s] of a dummy step
_CONTACT = 1e-6  # [-], change of speed by a contact as a share of gravity's
_GROUND_HALF = (1e7, 1e7, 50.0)  # [m] half extents of level ground
_BASE = -1  # the only link of a rigid body
_NOWHERE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
_AWAKE = {'activationState': pybullet.ACTIVATION_STATE_DISABLE_SLEEPING}
_ASLEEP = {'activationState': pybullet.ACTIVATION_STATE_SLEEP}
# Of a contact point: bodies; distance and forces; point, normal and two tangents.
_BODIES, _SIZES, _WAYS = itemgetter(1, 2), itemgetter(8, 9, 10, 12), itemgetter(6, 7, 11, 13)
_FOLDER = '/dev/shm' if os.access('/dev/shm', os.W_OK) else None  # in memory, if possible


class BulletEngine:
    """
    One PyBullet world, see `Engine`; `step` writes poses and velocities of its table.

    :param gravity: acceleration of awake bodies [m/s²], (3,).
    :param terrain: the surface of the ground.
    """

    name, has_joints, threads = 'bullet', False, 1

    def __init__(self, gravity: np.ndarray, terrain: Terrain = FLAT):
        self._gravity, self._terrain = np.array(gravity, float), terrain
        self._connect()

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Set the acceleration of awake bodies [m/s²], (3,)."""
        self._gravity = np.array(gravity, float)
        pybullet.setGravity(*self._gravity.tolist(), **self._to)

    def _connect(self) -> None:
        self._table = BodyTable()
        client = pybullet.connect(pybullet.DIRECT)
        if client < 0:
            raise RuntimeError('PyBullet gave no world: too many are open')
        self._close = weakref.finalize(self, pybullet.disconnect, client)
        self._to = {'physicsClientId': client}
        pybullet.setGravity(*self._gravity.tolist(), **self._to)
        pybullet.setPhysicsEngineParameter(
            contactERP=ERP, erp=ERP, warmStartingFactor=WARM_START, useSplitImpulse=1,
            splitImpulsePenetrationThreshold=0.0, contactBreakingThreshold=REACH,
            deterministicOverlappingPairs=1, enableFileCaching=0, **self._to)
        # Without a visual shape PyBullet triangulates every collision shape for its renderer.
        self._visual = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=[0.01] * 3, **self._to)
        self._shapes: dict[tuple, int] = {}
        self._rules: dict[int, dict[int, bool]] = {}  # by handle: whether a pair is excluded
        self._handles = np.full(0, -1)  # PyBullet's id of each body
        self._ids = np.full(0, -1)  # and the other way round
        self._points: list[tuple] = []  # contact points by substep
        self._way = np.zeros((0, 3))  # displacement of each body in the step [m]
        self._weight = np.zeros(0)  # mass of moving bodies [kg]
        self._told = np.zeros((0, 13))

    def close(self) -> None:
        """Free the world; a second call has no effect."""
        self._close()

    def clear(self) -> None:
        """Remove all bodies from the world."""
        self.close()
        self._connect()

    def add(self, table: BodyTable, ids: np.ndarray) -> None:
        """Add bodies, (K,) ids; see `Engine.add`."""
        self.contacts()  # while handles still belong to the touching bodies
        self._table = table
        new = ids[table.state[ids] != BodyState.GROUND]
        for body in ids[table.state[ids] == BodyState.GROUND].tolist():
            self._create(body, 0.0, *self._ground())
        turn_unlike = [self._create_piece(body) for body in new.tolist()]
        if any(turn_unlike):
            self._take_over_inertia(new)
        for body in ids.tolist():
            self._set_state(body)
        self.set_velocities(new, table.velocities[new])

    def _create(self, body: int, mass: float, shape: int, pose: list[float]) -> int:
        """Create a body; Bullet multiplies friction and restitution, so it gets their roots."""
        table = self._table
        handle = pybullet.createMultiBody(
            mass, shape, self._visual, pose[:3], pose[3:], useMaximalCoordinates=1,
            flags=pybullet.URDF_ENABLE_SLEEPING, **self._to)
        pybullet.changeDynamics(
            handle, _BASE, lateralFriction=float(np.sqrt(table.friction[body])),
            restitution=float(np.sqrt(table.restitution[body])), linearDamping=0.0,
            angularDamping=0.0, ccdSweptSphereRadius=SWEEP * float(table.least[body]), **self._to)
        self._handles = _filled(self._handles, body, handle)
        self._ids = _filled(self._ids, handle, body)
        return handle

    def _create_piece(self, body: int) -> bool:
        """Create a body with mass; return whether Bullet's inertia of its shape is wrong."""
        table, pieces = self._table, self._table.pieces(body)
        mass, inertia = float(table.mass[body]), table.inertia[body]
        shape = self._plain(pieces) if table.least[body] > 0.0 else self._compound(pieces)
        handle = self._create(body, mass, shape, table.poses[body].tolist())
        own = np.array(pybullet.getDynamicsInfo(handle, _BASE, **self._to)[2])
        return bool((np.abs(own - inertia) > 1e-3 * inertia).any())

    def _take_over_inertia(self, new: np.ndarray) -> None:
        """
        Step new bodies for a moment without collisions while all others sleep.

        Bullet uses the given inertia only after the first step of a body, until then that of the
        bounding box of its shape.
        """
        others = np.flatnonzero(self._table.state[:len(self._handles)] >= BodyState.AWAKE)
        others = np.setdiff1d(others[self._handles[others] >= 0], new)
        for handle in self._handles[others].tolist():
            pybullet.changeDynamics(handle, _BASE, **_ASLEEP, **self._to)
        for body, handle in zip(new.tolist(), self._handles[new].tolist()):
            self._set_free(body)
            pybullet.setCollisionFilterGroupMask(handle, _BASE, 0, 0, **self._to)
        pybullet.setTimeStep(_MOMENT, **self._to)
        pybullet.stepSimulation(**self._to)
        for handle in self._handles[others].tolist():
            pybullet.changeDynamics(handle, _BASE, **_AWAKE, **self._to)
        self.set_velocities(others, self._table.velocities[others])  # sleep has set them to zero

    def _ground(self) -> tuple[int, list[float]]:
        """
        Create the shape of the ground: a height field, or a huge box where it is level.

        Against a plane Bullet finds only one point per step, which turns bodies that land flat.
        """
        if self._terrain.is_flat:
            box = self._shape(pybullet.GEOM_BOX, halfExtents=_GROUND_HALF)
            return box, [0.0, 0.0, -_GROUND_HALF[2], *_NOWHERE[3:].tolist()]
        terrain = self._terrain.padded(TERRAIN_MARGIN)
        columns, rows = terrain.heights.shape
        field = self._shape(
            pybullet.GEOM_HEIGHTFIELD, meshScale=(terrain.edge, terrain.edge, 1.0),
            heightfieldData=tuple(terrain.heights.T.ravel().tolist()),
            numHeightfieldRows=columns, numHeightfieldColumns=rows)
        # Bullet centres it at the middle of its grid and heights.
        middle = terrain.low + 0.5 * terrain.edge * np.array([columns - 1, rows - 1])
        return field, [*middle.tolist(), 0.5 * sum(terrain.bounds()), *_NOWHERE[3:].tolist()]

    def _plain(self, pieces: Pieces) -> int:
        """Create the shape of a body of one piece."""
        size = pieces.sizes[0].round(6).tolist()
        if len(pieces.hexahedra):
            corners = inset(pieces.hexahedra.corners.reshape(1, 8, 3), _MARGIN)[0]
            return self._shape(pybullet.GEOM_MESH,
                               vertices=tuple(map(tuple, corners.round(6).tolist())))
        if pieces.shapes[0] == Shape.BOX:
            return self._shape(pybullet.GEOM_BOX, halfExtents=tuple(0.5 * e for e in size))
        radius, straight = 0.5 * size[0], size[2] - size[0]
        if straight > 0.0:
            return self._shape(pybullet.GEOM_CAPSULE, radius=radius, height=straight)
        return self._shape(pybullet.GEOM_SPHERE, radius=radius)

    def _shape(self, kind: int, **size: Any) -> int:
        """Create a shape, or return the cached one."""
        key = (kind, *size.values())
        if key not in self._shapes:
            self._shapes[key] = pybullet.createCollisionShape(kind, **size, **self._to)
        return self._shapes[key]

    def _compound(self, pieces: Pieces) -> int:
        """
        Create the shape of a body of many pieces; PyBullet's list of shapes takes only few.

        Further pieces go, as boxes, into a file of convex hulls with the hexahedra.
        """
        hulls = pieces.are_hexahedra
        if hulls.any() or len(hulls) > _MOST_SHAPES:
            hulls[np.flatnonzero(~hulls)[_MOST_SHAPES - 1:]] = True
        sizes, poses = pieces.sizes[~hulls], pieces.local_poses[~hulls]
        kinds = np.where(sizes[:, 2] > sizes[:, 0], pybullet.GEOM_CAPSULE, pybullet.GEOM_SPHERE)
        kinds = np.where(pieces.shapes[~hulls] == Shape.BOX, pybullet.GEOM_BOX, kinds)
        with tempfile.NamedTemporaryFile('w', suffix='.obj', dir=_FOLDER) as file:
            if hulls.any():
                corners = _corners(pieces, np.flatnonzero(hulls))
                file.write(write_hulls(inset(corners, _MARGIN)))
                file.flush()
                kinds = np.append(kinds, pybullet.GEOM_MESH)
                sizes, poses = np.vstack([sizes, np.zeros(3)]), np.vstack([poses, _NOWHERE])
            return pybullet.createCollisionShapeArray(
                shapeTypes=kinds.tolist(), halfExtents=(0.5 * sizes).tolist(),
                radii=(0.5 * sizes[:, 0]).tolist(), lengths=(sizes[:, 2] - sizes[:, 0]).tolist(),
                fileNames=[file.name] * len(kinds), meshScales=[[1.0] * 3] * len(kinds),
                collisionFramePositions=poses[:, :3].tolist(),
                collisionFrameOrientations=poses[:, 3:].tolist(), **self._to)

    def _set_free(self, body: int) -> None:
        pybullet.changeDynamics(
            int(self._handles[body]), _BASE, mass=float(self._table.mass[body]),
            localInertiaDiagonal=self._table.inertia[body].tolist(), **_AWAKE, **self._to)

    def _set_state(self, body: int) -> None:
        """Set whether a body moves, and its collision filter, by its state in the table."""
        handle, state = int(self._handles[body]), self._table.state[body]
        if state >= BodyState.AWAKE:
            self._set_free(body)
        elif state != BodyState.GROUND:
            pybullet.resetBaseVelocity(handle, [0.0] * 3, [0.0] * 3, **self._to)
            pybullet.changeDynamics(handle, _BASE, mass=0.0, **_ASLEEP, **self._to)
        pybullet.setCollisionFilterGroupMask(handle, _BASE, *self._filter(handle), **self._to)
        for other in self._rules.get(handle, ()):
            self._set_rule(handle, other)

    def _filter(self, handle: int) -> tuple[int, int]:
        state = BodyState(self._table.state[self._ids[handle]])
        return COLLISION_FILTERS.get(state, (0, 0))

    def set_excluded(self, pairs: np.ndarray, excluded: bool) -> None:
        """
        Exclude pairs of bodies from collision, or include them again, (K, 2) ids.

        PyBullet keeps the rule for a pair permanently, also for later bodies of the same handles,
        and the rule overrides the masks.
        """
        for one, other in self._handles[pairs].tolist():
            self._rules.setdefault(one, {})[other] = excluded
            self._rules.setdefault(other, {})[one] = excluded
            self._set_rule(one, other)

    def _set_rule(self, one: int, other: int) -> None:
        (group, mask), (group_, mask_) = self._filter(one), self._filter(other)
        meet = not self._rules[one][other] and bool(group & mask_) and bool(group_ & mask)
        pybullet.setCollisionFilterPair(one, other, _BASE, _BASE, int(meet), **self._to)

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies, (K,) ids."""
        for handle in self._handles[ids].tolist():
            pybullet.removeBody(handle, **self._to)
        self._handles[ids] = -1
        self._told = self._told[~np.isin(self._told[:, :2], ids).any(axis=1)]

    def hand_on(self, former: np.ndarray, heirs: np.ndarray, bounds: np.ndarray) -> None:
        """Hand contacts of the last step on to bodies in the place of others; see `hand_on`."""
        hand_on(self._told, former, heirs, bounds)

    def freeze(self, ids: np.ndarray) -> None:
        """Make bodies immovable, at no cost per step, (K,) ids."""
        for body in ids.tolist():
            self._set_state(body)

    def thaw(self, table: BodyTable, ids: np.ndarray) -> None:
        """Make immovable bodies movable, (K,) ids."""
        self.freeze(ids)

    def set_poses(self, ids: np.ndarray, poses: np.ndarray) -> None:
        """Set centres of mass and principal axes, world, (K, 7)."""
        for handle, pose in zip(self._handles[ids].tolist(), poses.tolist()):
            pybullet.resetBasePositionAndOrientation(handle, pose[:3], pose[3:], **self._to)

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set linear [m/s] and angular velocities [rad/s], world axes, (K, 6)."""
        for handle, velocity in zip(self._handles[ids].tolist(), velocities.tolist()):
            pybullet.resetBaseVelocity(handle, velocity[:3], velocity[3:], **self._to)

    def respond(self, change: np.ndarray) -> np.ndarray:
        """Return changes of velocity, by id, (B, 6); there are no joints."""
        return change

    def set_joints(self, joints: JointTable) -> None:
        """Ignore joints, which this engine does not support."""

    def step(self, time_step: float, looked: Looked | None = None) -> None:
        """Advance time [s], in substeps of at most `LONGEST`; see `Engine.step`."""
        table, count = self._table, max(int(np.ceil(time_step / LONGEST - 1e-6)), 1)
        substep = time_step / count
        driven = np.flatnonzero(table.state == BodyState.KINEMATIC)
        course = table.velocities[driven]
        course[:, :3] -= self._gravity * substep  # cancels Bullet's gravity
        pybullet.setTimeStep(substep, **self._to)
        self._points, begun = [], (table.poses.copy(), table.velocities.copy())
        self._weight = np.where(table.state >= BodyState.AWAKE, table.mass, 1e-9)
        self._way = np.zeros((len(table.state), 3))
        self._way[driven] = table.velocities[driven, :3] * time_step
        for _ in range(count):
            self.set_velocities(driven, course)
            pybullet.stepSimulation(**self._to)
            self._points.append(pybullet.getContactPoints(**self._to))
        self._read_free(time_step, substep)
        self._told = self._read_contacts()
        if looked is not None:
            looked(self._told, *begun, time_step)

    def _read_free(self, time_step: float, substep: float) -> None:
        """Read awake bodies into the table; correct those in flight to their parabola."""
        table, ids = self._table, self._table.awake
        if len(ids) > MANY:
            _advise()
        handles = self._handles[ids].tolist()
        at, velocity = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
        poses = _rows((sum(at(handle, **self._to), ()) for handle in handles), 7)
        velocities = _rows((sum(velocity(handle, **self._to), ()) for handle in handles), 6)
        before, start = table.velocities[ids], table.poses[ids]
        table.poses[ids], table.velocities[ids] = poses, velocities
        self._way[ids] = table.poses[ids, :3] - start[:, :3]
        gain = self._gravity * time_step
        change = table.velocities[ids, :3] - before[:, :3] - gain
        flies = np.abs(change).max(axis=1, initial=0.0) < _CONTACT * (norm(gain) + 1e-9)
        flying = ids[flies]
        # Bullet moves bodies by the velocity at the end of each substep (semi-implicit Euler).
        table.poses[flying, :3] -= 0.5 * time_step * substep * self._gravity
        inertia, none = table.inertia[flying], np.zeros(len(flying))
        had = motion_energy(none, inertia, start[flies, 3:], before[flies])
        has = motion_energy(none, inertia, table.poses[flying, 3:], table.velocities[flying])
        gained = has > had
        table.velocities[flying[gained], 3:] *= np.sqrt(had[gained] / has[gained])[:, None]
        self.set_poses(flying, table.poses[flying])  # resets their velocities to zero
        rolling, braked = resist_rolling(table, ids, before, self._gravity, time_step)
        table.velocities[rolling] = braked
        changed = np.union1d(flying, rolling)
        self.set_velocities(changed, table.velocities[changed])

    def contacts(self) -> np.ndarray:
        """Return the contact points of the last step, (C, 13); see `Engine.contacts`."""
        return self._told.copy()

    def _read_contacts(self) -> np.ndarray:
        count = len(self._points)
        found = [point for points in self._points for point in points]
        ids = self._ids[_rows(map(_BODIES, found), 2, int)]
        rows = _rows(map(chain.from_iterable, map(_WAYS, found)), 12)
        size = _rows(map(_SIZES, found), 4)
        begun = np.repeat(np.arange(count) / count, [len(points) for points in self._points])
        mass = self._weight[ids, None]
        way = (mass * self._way[ids]).sum(axis=1) / mass.sum(axis=1)
        rows[:, :3] -= begun[:, None] * way  # back to the start of the step
        force = (size[:, 1:, None] * rows[:, 3:].reshape(-1, 3, 3)).sum(axis=1)
        told = np.column_stack([ids, rows[:, :6], size[:, 0], force / count, size[:, 1] / count])
        return told[size[:, 1:].any(axis=1)]


def _corners(pieces: Pieces, which: np.ndarray) -> np.ndarray:
    """Return the corners of hexahedra, or of the bounding boxes of other pieces, (K, 8, 3) [m]."""
    half = 0.5 * pieces.sizes
    boxes = box_corners(-half, half).reshape(-1, 24)
    boxes[pieces.hexahedra.part] = pieces.hexahedra.corners
    return Hexahedra(which.astype(np.int32), boxes[which]).points(pieces.local_poses)


def _rows(found: Iterable[Iterable], width: int, kind: type = float) -> np.ndarray:
    """Convert sequences of numbers to rows of an array, (K, width)."""
    return np.fromiter(chain.from_iterable(found), kind).reshape(-1, width)


def _filled(column: np.ndarray, row: int, value: int) -> np.ndarray:
    """Write a value to a row of a column, extended where needed; return the column."""
    if row >= len(column):
        column = np.concatenate([column, np.full(row + 1, -1)])
    column[row] = value
    return column


@cache
def _advise() -> None:
    _LOG.warning('more than %d bodies move: engine native is faster than bullet', MANY)
