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
The engine of rapier3d: the only module that imports it.

Rapier computes in single precision, with the same results to the bit on any number of threads.

Of its friction models the default is used, with one friction force per manifold: a sliding brick
feels 1.00 of its coefficient, with a force per point 0.87 to 0.97. The default does not tell its
friction forces, so that they are worked out from what the bodies' momenta lack, see `friction`.
"""

from collections.abc import Iterator, Sequence
from functools import cache, lru_cache

import numpy as np
import rapier3d

from procphys_ros.blueprint import Shape
from procphys_ros.hexahedron import inset
from procphys_ros.linear import norm
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world import rigid_states
from procphys_ros.physics.world.assembly import placed
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.engine import COLLISION_FILTERS, TERRAIN_MARGIN
from procphys_ros.physics.world.friction import friction
from procphys_ros.physics.world.narrow_phase import by_attributes, by_bytes, touched, Touches

ITERATIONS = 4  # substeps of the contact solver
STABILIZATION = 4  # iterations that take out the velocities with which overlaps are undone: with
#                    one a slab of 6 t on a post of 8 kg jumps at 6 Hz, for ever
STIFFNESS = rapier3d.SpringCoefficients(120.0, 10.0)  # [Hz], ratio of damping: contacts give way
#                    by M/m · g/ω² when M lies on m, a brick under 0.6 t by 6 cm with 30 Hz
DENSE_ITERATIONS = 32  # where contacts are dense; 16 hold a stack of 8 corbelled bricks no more
DENSE_STIFFNESS = rapier3d.SpringCoefficients(240.0, 10.0)  # with 30 Hz such a stack gives way by
#                     3 cm; rubble trembles with 240 Hz

_LARGEST_SPEED = 1e4  # [m/s] rapier's own limit is 400
_LENGTH_UNIT = 0.05  # [m]: rapier pads the bounds of each body by 0.04 of it. With its default of
#                      1 m it keeps pairs that are further apart than a brick is thick
_MOST_THREADS = 64  # each takes memory for its stack, also where there are fewer cores
_SKIN = 1e-3  # [m] of hulls
_SAME = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]  # a pose
_FREE = rapier3d.JointAxesMask.empty()  # a joint that holds nothing
_GROUPS = {state: rapier3d.InteractionGroups(rapier3d.Group(group), rapier3d.Group(mask))
           for state, (group, mask) in COLLISION_FILTERS.items()}


class RapierEngine:
    """
    One rapier world, see `Engine`.

    :param gravity: acceleration of awake bodies [m/s²], (3,).
    :param terrain: the surface of the ground.
    """

    name = 'rapier'
    integrations = ITERATIONS

    def __init__(self, gravity: np.ndarray, terrain: Terrain = FLAT):
        self._terrain = terrain
        self._gravity = tuple(np.asarray(gravity, float).tolist())
        self._threads = 1
        self.clear()

    def clear(self) -> None:
        """Empty the world."""
        self._world = rapier3d.PhysicsWorld(gravity=self._gravity)
        self._world.set_num_threads(self._threads)
        parameters = self._world.integration_parameters
        parameters.num_solver_iterations = ITERATIONS
        parameters.num_internal_stabilization_iterations = STABILIZATION
        _scale(parameters)
        parameters.contact_clustering = False  # or contacts with meshes tell no impulses
        self._bodies: dict[int, rapier3d.RigidBody] = {}
        self._handles: dict[int, rapier3d.RigidBodyHandle] = {}
        self._joints: dict[tuple[int, int], rapier3d.ImpulseJointHandle] = {}  # see `set_excluded`
        self._owner = np.zeros(0, np.intp)  # body of each collider
        self._inside = np.zeros((0, 7))  # its pose in it
        self._time_step = 1.0 / 60.0
        self._mass = np.zeros(0)  # [kg], infinite while immovable
        self._velocity = self._before = self._after = np.zeros((0, 3))  # [m/s] by id
        self._poses = self._started = np.zeros((0, 7))  # likewise; when the last step began

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self.clear()

    def use_threads(self, count: int) -> None:
        """Step on so many threads at most."""
        count = min(count, _MOST_THREADS)
        if count != self._threads:
            self._world.set_num_threads(count)
            self._threads = count

    def refine(self, moving: int, dense: bool) -> int:
        """Solve contacts finely where they are dense; rapier takes its substeps itself."""
        self.integrations = DENSE_ITERATIONS if dense else ITERATIONS
        parameters = self._world.integration_parameters
        parameters.num_solver_iterations = self.integrations
        stiffness = DENSE_STIFFNESS if dense else STIFFNESS
        parameters.contact_softness = parameters.static_contact_softness = stiffness
        parameters.contact_recycling = not dense  # contacts found before: arches give way
        return 1

    def step(self, time_step: float) -> None:
        """Advance time [s]."""
        self._time_step = time_step
        self._before, self._started = self._velocity.copy(), self._poses.copy()
        self._world.integration_parameters.dt = time_step
        self._world.step()

    def add(self, table: BodyTable, ids: np.ndarray) -> None:
        """Add bodies, (K,) ids."""
        self._note(table, ids)
        owners, colliders, places = [], [], []
        rigid_bodies, add_body = self._world.rigid_bodies, self._world.add_body
        for body, builder, shapes in zip(ids.tolist(), _rigid_bodies(table, ids),
                                         self._shapes(table, ids)):
            handle = self._handles[body] = add_body(builder, shapes[0])
            added = self._bodies[body] = rigid_bodies[handle]
            for collider, pose in zip(added.colliders, shapes[1]):
                owners.append(body)
                colliders.append(collider.index)
                places.append(pose)
        self._own(owners, colliders, places)

    def _note(self, table: BodyTable, ids: np.ndarray) -> None:
        """Record what contacts are computed from."""
        more = max(int(ids.max()) + 1 - len(self._mass), 0)
        if more:
            self._mass = np.concatenate([self._mass, np.full(more, np.inf)])
            self._velocity = np.concatenate([self._velocity, np.zeros((more, 3))])
            self._poses = np.concatenate([self._poses, np.zeros((more, 7))])
        self._mass[ids] = np.where(table.state[ids] == BodyState.AWAKE, table.mass[ids], np.inf)
        self._velocity[ids] = table.velocities[ids, :3]
        self._poses[ids] = table.poses[ids]

    def _shapes(self, table: BodyTable, ids: np.ndarray) -> Iterator[tuple[list, list]]:
        """Give the colliders of each body, and their poses in it."""
        plain = (table.least[ids] > 0.0) & (table.hexahedron_count[ids] == 0)
        columns = zip(ids.tolist(), plain.tolist(), table.state[ids].tolist(),
                      table.first_piece[ids].tolist(), table.friction[ids].tolist(),
                      table.restitution[ids].tolist())
        for body, is_plain, state, piece, *surface in columns:
            if is_plain:
                yield [_plain(int(table.piece_shape[piece]),
                              tuple(table.piece_size[piece].tolist()), state, *surface)], [_SAME]
            elif state == BodyState.GROUND:
                yield [_set_up(_ground(self._terrain), state, *surface)], [_SAME]
            else:
                pieces = table.pieces(body)
                colliders = [_collider(shape, size) for shape, size in zip(
                    pieces.shapes.tolist(), pieces.sizes.tolist())]
                for number, corners in zip(pieces.hexahedra.part, pieces.hexahedra.corners):
                    colliders[number] = _hull(corners)
                poses = pieces.local_poses.tolist()
                yield [_set_up(collider.position((pose[:3], pose[3:])), state, *surface)
                       for collider, pose in zip(colliders, poses)], poses

    def _own(self, bodies: list[int], colliders: list[int], poses: list[list[float]]) -> None:
        """Record the bodies that colliders belong to, and their poses in these."""
        more = max(colliders) + 1 - len(self._owner)
        if more > 0:
            room = max(more, len(self._owner))
            self._owner = np.concatenate([self._owner, np.zeros(room, np.intp)])
            self._inside = np.concatenate([self._inside, np.zeros((room, 7))])
        self._owner[colliders], self._inside[colliders] = bodies, poses

    def set_excluded(self, pairs: np.ndarray, excluded: bool) -> None:
        """Exclude pairs of bodies from collision, or include them again, (K, 2) ids."""
        joints = self._world.impulse_joints
        for one, other in pairs.tolist():
            if excluded:
                self._joints[one, other] = joints.insert(
                    self._handles[one], self._handles[other],
                    rapier3d.GenericJoint.builder(_FREE).contacts_enabled(False), True)
            else:
                joints.remove(self._joints.pop((one, other)), True)

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies, (K,) ids."""
        for body in ids.tolist():
            self._world.remove_body(self._handles.pop(body))
            del self._bodies[body]

    def freeze(self, ids: np.ndarray) -> None:
        """Make bodies immovable, at no cost per step, (K,) ids."""
        self._mass[ids], self._velocity[ids] = np.inf, 0.0
        for body in ids.tolist():
            frozen = self._bodies[body]
            frozen.linvel = frozen.angvel = rapier3d.Vec3(0.0, 0.0, 0.0)
            frozen.body_type = rapier3d.RigidBodyType.FIXED
            self._set_filter(frozen, BodyState.FIXED)

    def thaw(self, table: BodyTable, ids: np.ndarray) -> None:
        """Make immovable bodies movable, (K,) ids; `add` has given their masses."""
        self._mass[ids] = table.mass[ids]
        for body in ids.tolist():
            self._bodies[body].body_type = rapier3d.RigidBodyType.DYNAMIC
            self._set_filter(self._bodies[body], BodyState.AWAKE)

    def _set_filter(self, body: rapier3d.RigidBody, state: BodyState) -> None:
        for handle in body.colliders:
            self._world.colliders[handle].collision_groups = _GROUPS[state]

    def set_poses(self, ids: np.ndarray, poses: np.ndarray) -> None:
        """Set centres of mass and principal axes, world, (K, 7)."""
        self._poses[ids] = poses
        for body, pose in zip(ids.tolist(), poses.tolist()):
            self._bodies[body].position = rapier3d.Isometry3(pose[:3], pose[3:])

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set linear [m/s] and angular velocities [rad/s], world axes, (K, 6)."""
        self._velocity[ids] = velocities[:, :3]
        for body, velocity in zip(ids.tolist(), velocities.tolist()):
            moved = self._bodies[body]
            moved.linvel, moved.angvel = velocity[:3], velocity[3:]

    def set_swept(self, ids: np.ndarray, radii: np.ndarray) -> None:
        """Sweep bodies along their steps, (K,), where the radius is not 0."""
        for body, radius in zip(ids.tolist(), radii.tolist()):
            self._bodies[body].ccd_enabled = radius > 0.0

    def read(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Read poses (K, 7) and velocities (K, 6) of centres of mass, world axes."""
        moved = [self._bodies[body] for body in ids.tolist()]
        table = rigid_states.by_bytes(moved) if _bytes_are_known() else None
        if table is None:
            table = rigid_states.by_attributes(moved)
        table[:, 3:7] /= norm(table[:, 3:7], axis=1, keepdims=True)
        self._poses[ids] = table[:, :7]
        self._velocity[ids] = table[:, 7:10]
        self._after = self._velocity.copy()
        return table[:, :7], table[:, 7:]

    def contacts(self) -> np.ndarray:
        """Read the contact points of the last step, (C, 13); see `Engine.contacts`."""
        narrow_phase, touches = self._world.narrow_phase, None
        if self._terrain.is_flat and _bytes_are_known():
            touches = by_bytes(narrow_phase)
        return self._table(touches or by_attributes(narrow_phase))

    def touched(self, body: int) -> list[int]:
        """List the ids that a body presses, or nearly touches."""
        narrow_phase = self._world.narrow_phase
        return [int(self._owner[other]) for collider in self._bodies[body].colliders
                for other in touched(narrow_phase, collider)]

    def _table(self, touches: Touches) -> np.ndarray:
        """Turn contacts of rapier into rows of `Engine.contacts`."""
        owners, local, normal, sizes = touches
        ids = self._owner[owners]
        second, body = (np.ascontiguousarray(rows[:, 1]) for rows in (owners, ids))
        point = placed(local, second, self._inside, body, self._started)  # when it was found
        impulse = -sizes[:, 1:] * normal
        impulse += self._friction(ids.T, impulse, sizes[:, 1])
        return np.column_stack([ids, point, -normal, sizes[:, 0], impulse / self._time_step,
                                sizes[:, 1] / self._time_step])

    def _friction(self, ids: np.ndarray, impulse: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """
        Compute the friction of contacts from what normal impulses leave unexplained, (C, 3).

        :param ids: of the bodies, (2, C).
        :param impulse: along the normals, on the first bodies [N·s], (C, 3).
        :param normal: the same without direction, (C,).
        """
        mass = self._mass[:len(self._before)]
        change = self._after[:len(mass)] - self._before - np.array(self._gravity) * self._time_step
        return friction(ids, impulse, normal, np.where(np.isfinite(mass), mass, 0.0), change)


def _scale(parameters: rapier3d.IntegrationParameters) -> None:
    """Make bounds of bodies tight, and leave all other lengths and speeds as they are."""
    parameters.normalized_max_linear_velocity = _LARGEST_SPEED
    for name in ('allowed_linear_error', 'contact_recycle_distance', 'max_corrective_velocity',
                 'max_linear_velocity', 'prediction_distance'):
        length = getattr(parameters, f'normalized_{name}')  # in units of 1 m so far
        setattr(parameters, f'normalized_{name}', length / _LENGTH_UNIT)
    parameters.length_unit = _LENGTH_UNIT


@cache
def _bytes_are_known() -> bool:
    """Try on a small world whether bytes of this version of rapier are read right."""
    world = rapier3d.PhysicsWorld(gravity=(0.0, 0.0, -9.81))
    world.set_num_threads(1)
    world.add_body(rapier3d.RigidBody.fixed(), [_ground(FLAT)])
    bodies = []
    corners = np.array([[x, y, z] for z in (-0.1, 0.1) for y in (-0.1, 0.1) for x in (-0.1, 0.1)])
    for place, collider in enumerate((
            _collider(Shape.BOX, [0.2, 0.2, 0.2]), _collider(Shape.CAPSULE, [0.2, 0.2, 0.2]),
            _collider(Shape.CAPSULE, [0.2, 0.2, 0.4]), _hull(corners.ravel()))):
        for height in (0.1, 0.3, 0.52):
            body = rapier3d.RigidBody.dynamic().position(([0.19 * place, 0.0, height], _SAME[3:]))
            bodies.append(world.rigid_bodies[world.add_body(body.can_sleep(False),
                                                            [collider.density(1e3)])])
    for _ in range(4):
        world.step()
        slow, quick = by_attributes(world.narrow_phase), by_bytes(world.narrow_phase)
        if quick is None or not all(map(np.array_equal, slow, quick)):
            return False
        states = rigid_states.by_bytes(bodies)
        if states is None or not np.array_equal(states, rigid_states.by_attributes(bodies)):
            return False
    return len(slow.owners) > 0


def _collider(shape: int, size: Sequence[float]) -> rapier3d.ColliderBuilder:
    """Begin the collider of a piece; a capsule no longer than wide is a sphere."""
    if shape == Shape.BOX:
        return rapier3d.Collider.cuboid(*(0.5 * extent for extent in size))
    radius, straight = 0.5 * size[0], 0.5 * (size[2] - size[0])
    if straight <= 0.0:
        return rapier3d.Collider.ball(radius)
    return rapier3d.Collider.capsule_z(straight, radius)


def _hull(corners: np.ndarray) -> rapier3d.ColliderBuilder:
    """
    Begin the collider of a hexahedron, (24,), as a smaller one with a skin.

    Between two hulls that just touch rapier finds overlaps of up to half a metre.
    """
    return rapier3d.Collider.round_convex_hull(inset(corners.reshape(1, 8, 3), _SKIN)[0], _SKIN)


def _ground(terrain: Terrain) -> rapier3d.ColliderBuilder:
    """Begin the collider of the ground."""
    if terrain.is_flat:
        return rapier3d.Collider.halfspace((0.0, 0.0, 1.0))
    points, faces = terrain.padded(TERRAIN_MARGIN).mesh()
    return rapier3d.Collider.trimesh(points, faces, rapier3d.TriMeshFlags.FIX_INTERNAL_EDGES)


@lru_cache(1024)
def _plain(shape: int, size: tuple[float, float, float], state: int, friction: float,
           restitution: float) -> rapier3d.ColliderBuilder:
    """Build the collider of a plain body once for all alike."""
    return _set_up(_collider(shape, size), state, friction, restitution)


def _set_up(collider: rapier3d.ColliderBuilder, state: int, friction: float,
            restitution: float) -> rapier3d.ColliderBuilder:
    """Give a collider its surface and filter; masses belong to bodies here."""
    rule = rapier3d.CoefficientCombineRule.GEOMETRIC_MEAN
    return (collider.density(0.0).friction(friction).friction_combine_rule(rule)
            .restitution(restitution).restitution_combine_rule(rule)
            .collision_groups(_GROUPS[BodyState(state)]))


def _rigid_bodies(table: BodyTable, ids: np.ndarray) -> Iterator[rapier3d.RigidBodyBuilder]:
    """Build bodies without their shapes."""
    state, swept = table.state[ids], table.swept_radius[ids] > 0.0
    moves = state >= BodyState.AWAKE
    columns = (state == BodyState.GROUND, moves, swept, table.poses[ids], table.velocities[ids],
               table.mass[ids], table.inertia[ids])
    dynamic = rapier3d.RigidBody.dynamic().can_sleep(False)
    fixed = rapier3d.RigidBody.fixed().can_sleep(False)
    for is_ground, moving, is_swept, pose, velocity, mass, inertia in zip(
            *(column.tolist() for column in columns)):
        builder = (dynamic if moving else fixed).position((pose[:3], pose[3:]))
        if moving:
            builder = builder.linvel(velocity[:3]).angvel(velocity[3:])
        if is_swept:
            builder = builder.ccd_enabled(True)
        yield builder if is_ground else builder.additional_mass_properties(
            rapier3d.MassProperties((0.0, 0.0, 0.0), mass, inertia))
