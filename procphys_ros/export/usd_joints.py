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

"""USD joints: sprung hinges of branches, and fixed joints that break of masonry."""

from collections.abc import Sequence

import numpy as np
from pxr import Gf, Sdf

from procphys_ros.blueprint import Blueprint, Joints, JointType, Law
from procphys_ros.export.articulation import Articulation, Springs
from procphys_ros.export.content import Content
from procphys_ros.export.usd_layer import Layer, place, put, quaternion, relate
from procphys_ros.geometry import rotation
from procphys_ros.physics.trees.breaks import section_modulus

_BASE_MASS = 1.0  # [kg] without any effect: the base is fixed
_SHUT = (1.0, -1.0)  # limits that lock a degree of freedom: the lower one is the larger
_KINDS = {JointType.HINGE: 'PhysicsRevoluteJoint', JointType.SLIDER: 'PhysicsPrismaticJoint',
          JointType.BALL: 'PhysicsSphericalJoint', JointType.WELD: 'PhysicsFixedJoint',
          JointType.ROPE: 'PhysicsDistanceJoint'}
_DEGREE = np.pi / 180.0  # [rad]; USD's angular drives use degrees


def add_base(layer: Layer, root: str, frame: np.ndarray) -> tuple[str, np.ndarray]:
    """
    Write the base of an object's trees: a body that is fixed to the world.

    The joint to the world is the root of the articulation.

    :param root: path of the object.
    :param frame: of its first tree's root, world [m], (7,).
    :returns: path and pose of the body.
    """
    path, pose = f'{root}/base', np.concatenate([frame[:3], rotation.IDENTITY])
    body = layer.prim(path, 'Xform', ['PhysicsRigidBodyAPI', 'PhysicsMassAPI'])
    place(body, pose)
    put(body, 'float', 'physics:mass', _BASE_MASS)
    put(body, 'float3', 'physics:diagonalInertia', Gf.Vec3f(_BASE_MASS))
    put(body, 'quatf', 'physics:principalAxes', Gf.Quatf(1.0))
    _join(layer, f'{root}/anchor', 'PhysicsFixedJoint', ('', path), (pose, rotation.ORIGIN),
          ['PhysicsArticulationRootAPI'])
    return path, pose


def add_hinge(layer: Layer, path: str, bodies: Sequence[str], mount: np.ndarray,
              content: Content, joints: Articulation, row: int) -> None:
    """
    Write the joint of a segment: limits and drives about x and y, the others locked or sprung.

    :param bodies: paths of the parent and of the segment.
    :param mount: the joint at rest, in the frame of the parent [m], (7,).
    :param row: of the segment.
    """
    free = {'rotX': joints.bend_x, 'rotY': joints.bend_y}
    free |= {axis: springs for axis, springs in (('rotZ', joints.twist), ('transZ', joints.slide))
             if np.isfinite(springs.stiffness[row])}
    if np.isinf(joints.bend_x.stiffness[row]):
        free = {}
    limited = [axis for axis in ('transX', 'transY', 'transZ', 'rotX', 'rotY', 'rotZ')
               if axis not in free or axis in ('rotX', 'rotY')]
    seat = rotation.ORIGIN.copy()
    seat[2] = joints.slide.value[row] - joints.reach[row]
    joint = _join(layer, path, 'PhysicsJoint', bodies, (mount, seat), [
        *(f'PhysicsLimitAPI:{axis}' for axis in limited),
        *(f'PhysicsDriveAPI:{axis}' for axis in free)])
    bound = float(np.degrees(joints.limit[row]))
    for axis in limited:
        low, high = (-bound, bound) if axis in free else _SHUT
        put(joint, 'float', f'limit:{axis}:physics:low', low)
        put(joint, 'float', f'limit:{axis}:physics:high', high)
    for axis, springs in free.items():
        _drive(joint, axis, springs, row)
    force, torque = _hinge_limits(content.blueprint, int(joints.bond[row]))
    _breaks(joint, force, torque)


def add_weld(layer: Layer, path: str, bodies: Sequence[str], seats: Sequence[np.ndarray],
             force: float, torque: float) -> None:
    """
    Write a fixed joint that breaks.

    :param bodies: paths of two bodies; '' = the world.
    :param seats: the joint in the frames of both [m], (7,) each.
    :param force: breaking force [N].
    :param torque: breaking torque [N·m].
    """
    joint = _join(layer, path, 'PhysicsFixedJoint', bodies, seats)
    put(joint, 'bool', 'physics:excludeFromArticulation', True, uniform=True)
    _breaks(joint, force, torque)


def add_mechanism_joint(layer: Layer, path: str, bodies: Sequence[str],
                        seats: Sequence[np.ndarray], joints: Joints, row: int) -> None:
    """
    Write a joint of a mechanism, with its axis along x: limits, spring and strengths.

    :param bodies: paths of two bodies; '' = the world.
    :param seats: the joint at rest in the frames of both [m], (7,) each.
    :param row: of the joint.
    """
    kind = JointType(joints.kind[row])
    sprung = joints.stiffness[row] > 0.0 or joints.damping[row] > 0.0
    drive = {JointType.HINGE: 'angular', JointType.SLIDER: 'linear'}.get(kind) if sprung else None
    joint = _join(layer, path, _KINDS[kind], bodies, seats,
                  [f'PhysicsDriveAPI:{drive}'] if drive else [])
    unit = _DEGREE if kind == JointType.HINGE else 1.0
    if kind in (JointType.HINGE, JointType.SLIDER):
        put(joint, 'token', 'physics:axis', 'X', uniform=True)
        for name, value in (('lowerLimit', joints.low[row]), ('upperLimit', joints.high[row])):
            if np.isfinite(value):
                put(joint, 'float', f'physics:{name}', float(value / unit))
    elif kind == JointType.ROPE:
        put(joint, 'float', 'physics:minDistance', 0.0)
        put(joint, 'float', 'physics:maxDistance', float(joints.high[row]))
    if drive:
        put(joint, 'token', f'drive:{drive}:physics:type', 'force', uniform=True)
        for name, value in (('stiffness', joints.stiffness[row] * unit),
                            ('damping', joints.damping[row] * unit),
                            ('targetPosition', joints.rest[row] / unit)):
            put(joint, 'float', f'drive:{drive}:physics:{name}', float(value))
    put(joint, 'bool', 'physics:collisionEnabled', bool(joints.collides[row]))
    put(joint, 'bool', 'physics:excludeFromArticulation', True, uniform=True)
    _breaks(joint, joints.force[row], joints.moment[row])


def pass_through(layer: Layer, path: str, roots: Sequence[str]) -> None:
    """Disable collisions between the bodies below some prims, as between crowns of trees."""
    group = layer.prim(path, 'PhysicsCollisionGroup', ['CollectionAPI:colliders'])
    relate(group, 'collection:colliders:includes', roots)
    relate(group, 'physics:filteredGroups', [path])


def mortar_limits(blueprint: Blueprint) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the force [N] and moment [N·m] that break each mortar bond, (M,) each; inf elsewhere.

    A joint of UsdPhysics has one number each, not the law of `physics.masonry.strength`: these
    are the pull or shear capacity of an uncompressed bond, and the moment about its weaker side.
    """
    mortar = blueprint.bond_law == Law.MORTAR
    force, torque = np.full((2, len(mortar)), np.inf)
    area = blueprint.bond_area[mortar]
    table = blueprint.mortar
    force[mortar] = np.minimum(table.tension, table.cohesion) * area
    torque[mortar] = table.tension * area * blueprint.bond_extent[mortar].min(axis=1) / 6.0
    return force, torque


def _hinge_limits(blueprint: Blueprint, bond: int) -> tuple[float, float]:
    """Return the force [N] and moment [N·m] that break a branch: the lesser of bend and twist."""
    row = np.count_nonzero(blueprint.bond_law[:bond] == Law.HINGE)
    hinges = blueprint.hinges
    bending = hinges.strength[row] * section_modulus(blueprint.bond_extent[bond, 0])
    return float(hinges.break_force[row]), float(min(bending, hinges.break_torque[row]))


def _drive(joint, axis: str, springs: Springs, row: int) -> None:
    unit = _DEGREE if axis.startswith('rot') else 1.0
    put(joint, 'token', f'drive:{axis}:physics:type', 'force', uniform=True)
    put(joint, 'float', f'drive:{axis}:physics:stiffness', float(springs.stiffness[row] * unit))
    put(joint, 'float', f'drive:{axis}:physics:damping', float(springs.damping[row] * unit))
    put(joint, 'float', f'drive:{axis}:physics:targetPosition', float(springs.rest[row] / unit))


def _join(layer: Layer, path: str, kind: str, bodies: Sequence[str],
          seats: Sequence[np.ndarray], apis: Sequence[str] = ()) -> Sdf.PrimSpec:
    """Begin a joint between two bodies, '' = the world, by its frames in theirs [m], (7,)."""
    joint = layer.prim(path, kind, apis)
    for number, body in enumerate(bodies):
        if body:
            relate(joint, f'physics:body{number}', [body])
    for number, seat in enumerate(seats):
        put(joint, 'point3f', f'physics:localPos{number}', Gf.Vec3f(*seat[:3].tolist()))
        put(joint, 'quatf', f'physics:localRot{number}', quaternion(seat[3:]))
    return joint


def _breaks(joint, force: float, torque: float) -> None:
    for name, value in (('breakForce', force), ('breakTorque', torque)):
        if np.isfinite(value):
            put(joint, 'float', f'physics:{name}', float(value))
