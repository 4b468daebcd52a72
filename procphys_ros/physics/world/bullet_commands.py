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
Commands to Bullet for many bodies: kernels that call its C functions by their addresses.

Python takes 8 µs to read the state of a body, of which Bullet needs 1 (decision 64). Addresses are
arguments, so that these kernels compile and load where PyBullet is not installed.
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.compilation.native import call, load

_SUBMIT = 'b3SubmitClientCommandAndWaitStatus'
# The functions whose addresses each kernel takes, in this order.
READ = ('b3RequestActualStateCommandInit', _SUBMIT, 'b3GetStatusActualState')
SET_POSES = ('b3CreatePoseCommandInit', _SUBMIT, 'b3CreatePoseCommandSetBasePosition',
             'b3CreatePoseCommandSetBaseOrientation')
SET_VELOCITIES = ('b3CreatePoseCommandInit', _SUBMIT, 'b3CreatePoseCommandSetBaseLinearVelocity',
                  'b3CreatePoseCommandSetBaseAngularVelocity')

DYNAMICS = ('b3InitChangeDynamicsInfo', _SUBMIT, 'b3ChangeDynamicsInfoSetLateralFriction',
            'b3ChangeDynamicsInfoSetRestitution', 'b3ChangeDynamicsInfoSetLinearDamping',
            'b3ChangeDynamicsInfoSetAngularDamping', 'b3ChangeDynamicsInfoSetMass',
            'b3ChangeDynamicsInfoSetLocalInertiaDiagonal',
            'b3ChangeDynamicsInfoSetActivationState', 'b3CollisionFilterCommandInit',
            'b3SetCollisionFilterGroupMask')

_DOUBLE = 8  # [bytes]
_BASE = np.int32(-1)  # the only link of a rigid body
_DISABLE_SLEEPING, _SLEEP = np.int32(2), np.int32(8)  # eActivationState...


@kernel
def read(functions, world, bodies, poses, velocities):
    """
    Read places, attitudes and velocities.

    :param functions: addresses of `READ`, (3,).
    :param world: Bullet's handle.
    :param bodies: Bullet's numbers, (K,).
    :param poses, velocities: written, (K, 7) and (K, 6).
    """
    found = np.zeros(2, np.int64)
    at = found.ctypes.data
    for k in range(len(bodies)):
        command = call(functions[0], (world, np.int32(bodies[k])))
        status = call(functions[1], (world, command))
        call(functions[2], (status, 0, 0, 0, 0, at, at + _DOUBLE, 0))
        for c in range(7):
            poses[k, c] = load(found[0] + c * _DOUBLE)
        for c in range(6):
            velocities[k, c] = load(found[1] + c * _DOUBLE)


@kernel
def set_poses(functions, world, bodies, poses):
    """
    Set places and attitudes.

    :param functions: addresses of `SET_POSES`, (4,).
    :param poses: (K, 7).
    """
    for k in range(len(bodies)):
        p = poses[k]
        command = call(functions[0], (world, np.int32(bodies[k])))
        call(functions[2], (command, p[0], p[1], p[2]))
        call(functions[3], (command, p[3], p[4], p[5], p[6]))
        call(functions[1], (world, command))


@kernel
def set_velocities(functions, world, bodies, velocities):
    """
    Set linear and angular velocities.

    :param functions: addresses of `SET_VELOCITIES`, (4,).
    :param velocities: (K, 6), row after row.
    """
    at = velocities.ctypes.data
    for k in range(len(bodies)):
        command = call(functions[0], (world, np.int32(bodies[k])))
        call(functions[2], (command, at + 6 * _DOUBLE * k))
        call(functions[3], (command, at + (6 * k + 3) * _DOUBLE))
        call(functions[1], (world, command))


@kernel
def set_up(functions, world, bodies, frees, holds, surfaces, mass, inertia, filters):
    """
    Give new bodies all that they are not made with, one after the other.

    :param functions: addresses of `DYNAMICS`, (11,).
    :param frees, holds: whether a body moves, or stands still though it has a mass, (K,) bool.
    :param surfaces: friction and restitution, (K, 2).
    :param mass: [kg], (K,).
    :param inertia: principal moments [kg·m²], (K, 3).
    :param filters: group and mask, (K, 2) int32.
    """
    for k in range(len(bodies)):
        body = np.int32(bodies[k])
        _set_surface(functions, world, body, surfaces[k])
        if frees[k]:
            _set_free(functions, world, body, mass[k], inertia, k)
        elif holds[k]:
            _set_held(functions, world, body)
        _set_filter(functions, world, body, filters[k])


@kernel
def thaw(functions, world, bodies, mass, inertia, filters):
    """Make bodies movable, never to sleep, see `set_up`."""
    for k in range(len(bodies)):
        body = np.int32(bodies[k])
        _set_free(functions, world, body, mass[k], inertia, k)
        _set_filter(functions, world, body, filters[k])


@kernel
def freeze(functions, motion, world, bodies, filters):
    """
    Make bodies immovable at no cost per step, see `set_up`.

    :param motion: addresses of `SET_VELOCITIES`, (4,).
    """
    still = np.zeros((1, 6))
    for k in range(len(bodies)):  # one by one: the order of commands matters
        body = np.int32(bodies[k])
        set_velocities(motion, world, bodies[k:k + 1], still)
        _set_held(functions, world, body)
        _set_filter(functions, world, body, filters[k])


@subroutine
def _set_surface(functions, world, body, surface):
    """Set what is multiplied by that of what a body touches, and take its damping away."""
    command = call(functions[0], (world,))
    call(functions[2], (command, body, _BASE, surface[0]))
    call(functions[3], (command, body, _BASE, surface[1]))
    call(functions[4], (command, body, 0.0))
    call(functions[5], (command, body, 0.0))
    call(functions[1], (world, command))


@subroutine
def _set_free(functions, world, body, mass, inertia, row):
    command = call(functions[0], (world,))
    call(functions[6], (command, body, _BASE, mass))
    call(functions[7], (command, body, _BASE, inertia.ctypes.data + 3 * _DOUBLE * row))
    call(functions[8], (command, body, _DISABLE_SLEEPING))
    call(functions[1], (world, command))


@subroutine
def _set_held(functions, world, body):
    command = call(functions[0], (world,))
    call(functions[6], (command, body, _BASE, 0.0))
    call(functions[8], (command, body, _SLEEP))
    call(functions[1], (world, command))


@subroutine
def _set_filter(functions, world, body, group_mask):
    """Set what it is, and what it meets."""
    command = call(functions[9], (world,))
    call(functions[10], (command, body, _BASE, group_mask[0], group_mask[1]))
    call(functions[1], (world, command))
