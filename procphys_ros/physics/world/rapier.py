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

Rapier computes in single precision, and alike with any number of threads; one is used.

Of its friction models the default is used, with one friction force per manifold: a sliding brick
feels 1.00 of its coefficient, with a force per point 0.87 to 0.97. The default does not tell its
friction forces, so that they are worked out from what the bodies' momenta lack, see `friction`.
"""

from itertools import chain

import numpy as np
import rapier3d
from scipy.sparse import csr_matrix, eye
from scipy.sparse.linalg import splu

from procphys_ros.blueprint import Shape
from procphys_ros.hexahedron import inset
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world import extents
from procphys_ros.physics.world.assembly import placed
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.engine import COLLISION_FILTERS, TERRAIN_MARGIN

ITERATIONS = 4  # substeps of the contact solver
STABILIZATION = 4  # iterations that take out the velocities with which overlaps are undone: with
#                    one a slab of 6 t on a post of 8 kg jumps at 6 Hz, for ever
STIFFNESS = rapier3d.SpringCoefficients(120.0, 10.0)  # [Hz], ratio of damping: contacts give way
#                    by M/m · g/ω² when M lies on m, a brick under 0.6 t by 6 cm with 30 Hz
DENSE_ITERATIONS = 32  # where contacts are dense; 16 hold a stack of 8 corbelled bricks no more
DENSE_STIFFNESS = rapier3d.SpringCoefficients(240.0, 10.0)  # with 30 Hz such a stack gives way by
#                     3 cm; rubble trembles with 240 Hz

_LARGEST_SPEED = 1e4  # [m/s] rapier's own limit is 400
_TOUCH = 2e-3  # [m] from which on what presses on nothing is not told as a contact
_REGULAR = 1e-6  # share of the largest entry, for bodies that only touch each other
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
        self.clear()

    def clear(self) -> None:
        """Start with an empty world, in which nothing is left of what was."""
        self._world = rapier3d.PhysicsWorld(gravity=self._gravity)
        self._world.set_num_threads(1)
        parameters = self._world.integration_parameters
        parameters.num_solver_iterations = ITERATIONS
        parameters.num_internal_stabilization_iterations = STABILIZATION
        parameters.normalized_max_linear_velocity = _LARGEST_SPEED
        self._bodies: dict[int, rapier3d.RigidBody] = {}
        self._handles: dict[int, rapier3d.RigidBodyHandle] = {}
        self._joints: dict[tuple[int, int], rapier3d.ImpulseJointHandle] = {}  # see `set_excluded`
        self._owner = np.zeros(0, np.intp)  # body of each collider
        self._inside = np.zeros((0, 7))  # its pose in it
        self._time_step = 1.0 / 60.0
        self._mass = np.zeros(0)  # [kg], infinite while immovable
        self._velocity = self._before = self._after = np.zeros((0, 3))  # [m/s] by id
        self._poses = np.zeros((0, 7))  # likewise

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self.clear()

    def refine(self, dense: bool) -> int:
        """Solve contacts finely where they are dense; rapier takes its substeps itself."""
        self.integrations = DENSE_ITERATIONS if dense else ITERATIONS
        parameters = self._world.integration_parameters
        parameters.num_solver_iterations = self.integrations
        stiffness = DENSE_STIFFNESS if dense else STIFFNESS
        parameters.contact_softness = parameters.static_contact_softness = stiffness
        parameters.contact_recycling = not dense  # contacts found before: arches give way
        return 1

    def step(self, time_step: float) -> None:
        """Let time pass [s]."""
        self._time_step = time_step
        self._before = self._velocity.copy()
        self._world.integration_parameters.dt = time_step
        self._world.step()

    def add(self, table: BodyTable, ids: np.ndarray) -> None:
        """Add bodies, (K,) ids."""
        more = max(int(ids.max()) + 1 - len(self._mass), 0)
        self._mass = np.concatenate([self._mass, np.full(more, np.inf)])
        self._velocity = np.concatenate([self._velocity, np.zeros((more, 3))])
        self._mass[ids] = np.where(table.state[ids] == BodyState.AWAKE, table.mass[ids], np.inf)
        self._velocity[ids] = table.velocities[ids, :3]
        self._poses = np.concatenate([self._poses, np.zeros((more, 7))])
        self._poses[ids] = table.poses[ids]
        for body in ids.tolist():
            state, pieces = BodyState(table.state[body]), table.pieces(body)
            colliders = [
                _collider(shape, size)
                for shape, size in zip(pieces.shapes.tolist(), pieces.sizes.tolist())]
            for piece, corners in zip(pieces.hexahedra.part, pieces.hexahedra.corners):
                colliders[piece] = _hull(corners)
            poses = pieces.local_poses.tolist()
            if state == BodyState.GROUND:
                colliders, poses = [_ground(self._terrain)], [_SAME]
            handle = self._world.add_body(_rigid_body(table, body, state), [
                _set_up(collider, table, body, state, pose)
                for collider, pose in zip(colliders, poses)])
            self._handles[body] = handle
            self._bodies[body] = self._world.rigid_bodies[handle]
            self._own(body, [owned.index for owned in self._bodies[body].colliders], poses)

    def _own(self, body: int, colliders: list[int], poses: list[list[float]]) -> None:
        """Note what body colliders belong to, and their poses in it."""
        more = max(colliders) + 1 - len(self._owner)
        if more > 0:
            room = max(more, len(self._owner))
            self._owner = np.concatenate([self._owner, np.zeros(room, np.intp)])
            self._inside = np.concatenate([self._inside, np.zeros((room, 7))])
        self._owner[colliders], self._inside[colliders] = body, poses

    def set_excluded(self, pairs: np.ndarray, excluded: bool) -> None:
        """Let pairs of bodies pass through each other, or meet again, (K, 2) ids."""
        joints = self._world.impulse_joints
        for one, other in pairs.tolist():
            if excluded:
                self._joints[one, other] = joints.insert(
                    self._handles[one], self._handles[other],
                    rapier3d.GenericJoint.builder(_FREE).contacts_enabled(False), True)
            else:
                joints.remove(self._joints.pop((one, other)), True)

    def remove(self, ids: np.ndarray) -> None:
        """Take bodies out, (K,) ids."""
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
        """Let immovable bodies move, (K,) ids; their masses were given when they were added."""
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
            moved.linvel = rapier3d.Vec3(*velocity[:3])
            moved.angvel = rapier3d.Vec3(*velocity[3:])

    def set_swept(self, ids: np.ndarray, radii: np.ndarray) -> None:
        """Sweep bodies along their steps, (K,), where the radius is not 0."""
        for body, radius in zip(ids.tolist(), radii.tolist()):
            self._bodies[body].ccd_enabled = radius > 0.0

    def read(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Read poses (K, 7) and velocities (K, 6) of centres of mass, world axes."""
        rows = []
        for body in ids.tolist():
            moved = self._bodies[body]
            rows.append((*moved.translation.to_tuple(), *moved.rotation.to_tuple(),
                         *moved.linvel.to_tuple(), *moved.angvel.to_tuple()))
        table = np.array(rows).reshape(-1, 13)
        table[:, 3:7] /= np.linalg.norm(table[:, 3:7], axis=1, keepdims=True)
        self._poses[ids] = table[:, :7]
        self._velocity[ids] = table[:, 7:10]
        self._after = self._velocity.copy()
        return table[:, :7], table[:, 7:]

    def are_near(self, table: BodyTable, pairs: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Tell which pairs of bodies, taken for boxes, are less than a distance apart, (P,)."""
        return extents.are_near(table, pairs, distance)

    def contacts(self) -> np.ndarray:
        """Read the contact points of the last step, (C, 13); see `Engine.contacts`."""
        owners, normals, found, count = [], [], [], []
        for pair in self._world.narrow_phase.contact_pairs():
            if pair.has_any_active_contact and _touches(pair):
                both = pair.collider1.index, pair.collider2.index
                for manifold in pair.manifolds:
                    touching = [point for point in manifold.points
                                if point.impulse > 0.0 or point.dist < _TOUCH]
                    if touching:
                        found += touching
                        count.append(len(touching))
                        owners.append(both)
                        normals.append(manifold.data.normal.to_tuple())
        local = [point.local_p2 for point in found]
        sizes = _rows([(point.dist, point.impulse) for point in found], 2)
        return self._table(np.repeat(np.array(owners, np.intp).reshape(-1, 2), count, axis=0),
                           _rows([point.to_tuple() for point in local], 3),
                           np.repeat(_rows(normals, 3), count, axis=0), sizes)

    def _table(self, owners: np.ndarray, local: np.ndarray, normal: np.ndarray,
               sizes: np.ndarray) -> np.ndarray:
        """
        Turn contacts of rapier into rows of `Engine.contacts`.

        :param owners: indices of two colliders, (C, 2).
        :param local: points in the frame of the second [m], (C, 3).
        :param normal: towards the second, (C, 3).
        :param sizes: distance [m] and impulse along the normal [N·s], (C, 2).
        """
        ids = self._owner[owners]
        second, body = (np.ascontiguousarray(rows[:, 1]) for rows in (owners, ids))
        point = placed(local, second, self._inside, body, self._poses)
        impulse = -sizes[:, 1:] * normal
        impulse += self._friction(ids.T, impulse, sizes[:, 1])
        return np.column_stack([ids, point, -normal, sizes[:, 0], impulse / self._time_step,
                                sizes[:, 1] / self._time_step])

    def _friction(self, ids: np.ndarray, impulse: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """
        Work out what else contacts did to bodies than their normal impulses say, (C, 3).

        :param ids: of the bodies, (2, C).
        :param impulse: along the normals, on the first bodies [N·s], (C, 3).
        :param normal: the same without direction, (C,).
        """
        mass = self._mass[:len(self._before)]
        change = self._after[:len(mass)] - self._before - np.array(self._gravity) * self._time_step
        return friction(ids, impulse, normal, np.where(np.isfinite(mass), mass, 0.0), change)


def _touches(pair: rapier3d.ContactPair) -> bool:
    """Say whether any contact of a pair is told; copies of all its contacts take longer."""
    if pair.total_impulse_magnitude() > 0.0:
        return True
    deepest = pair.find_deepest_contact()
    return deepest is not None and deepest.dist < _TOUCH


def _rows(tuples: list[tuple], width: int) -> np.ndarray:
    """Turn tuples into rows; `fromiter` is twice as fast as `array`."""
    return np.fromiter(chain.from_iterable(tuples), float, width * len(tuples)).reshape(-1, width)


def _collider(shape: int, size: list[float]) -> rapier3d.ColliderBuilder:
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


def _set_up(collider: rapier3d.ColliderBuilder, table: BodyTable, body: int, state: BodyState,
            pose: list[float]) -> rapier3d.ColliderBuilder:
    """Give a collider its place, surface and filter; masses belong to bodies here."""
    rule = rapier3d.CoefficientCombineRule.GEOMETRIC_MEAN
    return (collider.position((pose[:3], pose[3:])).density(0.0)
            .friction(float(table.friction[body])).friction_combine_rule(rule)
            .restitution(float(table.restitution[body])).restitution_combine_rule(rule)
            .collision_groups(_GROUPS[state]))


def _rigid_body(table: BodyTable, body: int, state: BodyState) -> rapier3d.RigidBodyBuilder:
    """Build a body without its shapes."""
    pose, velocity = table.poses[body].tolist(), table.velocities[body].tolist()
    builder = (rapier3d.RigidBody.dynamic() if state >= BodyState.AWAKE
               else rapier3d.RigidBody.fixed())
    builder = builder.position((pose[:3], pose[3:])).can_sleep(False)
    if state == BodyState.GROUND:
        return builder
    if state >= BodyState.AWAKE:
        builder = builder.linvel(velocity[:3]).angvel(velocity[3:])
    return builder.ccd_enabled(bool(table.swept_radius[body] > 0.0)).additional_mass_properties(
        rapier3d.MassProperties((0.0, 0.0, 0.0), float(table.mass[body]),
                                table.inertia[body].tolist()))


def friction(ids: np.ndarray, impulse: np.ndarray, normal: np.ndarray, mass: np.ndarray,
             change: np.ndarray) -> np.ndarray:
    """
    Share out among contacts what the momenta of bodies lack, the least that does it.

    Least squares weighed by the normal impulses: W Aᵀ (A W Aᵀ)⁻¹ r, with A the incidence of
    contacts and bodies, and r the change of momentum beyond gravity and normal impulses.

    :param ids: of the two bodies of each contact, (2, C).
    :param impulse: along the normals, on the first bodies [N·s], (C, 3).
    :param normal: the same without direction [N·s], (C,).
    :param mass: of all bodies [kg], 0 for those that nothing moves, (B,).
    :param change: of their velocities beyond gravity [m/s], (B, 3).
    :returns: on the first bodies [N·s], (C, 3).
    """
    moved = np.unique(ids[(mass[ids] > 0.0) & (normal > 0.0)])
    if not len(moved):
        return np.zeros_like(impulse)
    row = np.full(len(mass), -1)
    row[moved] = np.arange(len(moved))
    side, contact = np.nonzero((row[ids] >= 0) & (normal > 0.0))
    incidence = csr_matrix((1.0 - 2.0 * side, (row[ids[side, contact]], contact)),
                           (len(moved), len(normal)))
    weighed = incidence.multiply(normal)
    matrix = (weighed @ incidence.T).tocsc()
    matrix += _REGULAR * matrix.diagonal().max() * eye(len(moved), format='csc')
    lacking = mass[moved, None] * change[moved] - incidence @ impulse
    return weighed.T @ splu(matrix).solve(np.asarray(lacking))
