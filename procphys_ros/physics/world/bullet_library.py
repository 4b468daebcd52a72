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
C functions that PyBullet's library exports, as declared in its header `PhysicsClientC_API.h`.

PyBullet's Python functions make a tuple of 14 objects per contact point and keep the interpreter
while Bullet computes; these give the points as one array, and let other threads run (decision 60).
"""

from collections.abc import Callable, Sequence
import ctypes
from ctypes import c_char_p, c_double, c_int, c_void_p
from functools import cache
from importlib import util

import numpy as np

from procphys_ros.errors import SceneError

# A contact point, `b3ContactPointData` of `SharedMemoryPublic.h`: the normal points from the
# second body to the first, the friction is along two ways across it.
CONTACT = np.dtype([
    ('flags', np.intc), ('bodies', np.intc, 2), ('links', np.intc, 2), ('on_first', float, 3),
    ('on_second', float, 3), ('normal', float, 3), ('distance', float), ('pressing', float),
    ('rubbing', float, 2), ('ways', float, (2, 3))], align=True)

_TYPES = {'i': c_int, 'd': c_double, 'p': c_void_p, 's': c_char_p}
# What each function takes: what it gives. Integers, doubles, pointers and strings.
_FUNCTIONS = {
    'b3ConnectPhysicsDirect': ':p',
    'b3DisconnectSharedMemory': 'p:',
    'b3SubmitClientCommandAndWaitStatus': 'pp:p',
    'b3InitPhysicsParamCommand': 'p:p',
    'b3PhysicsParamSetGravity': 'pddd:',
    'b3PhysicsParamSetTimeStep': 'pd:',
    'b3PhysicsParamSetNumSolverIterations': 'pi:',
    'b3PhysicsParamSetDefaultContactERP': 'pd:',
    'b3PhysicsParamSetDefaultNonContactERP': 'pd:',
    'b3PhysicsParamSetWarmStartingFactor': 'pd:',
    'b3PhysicsParamSetEnableFileCaching': 'pi:',
    'b3PhysicsParamSetUseSplitImpulse': 'pi:',
    'b3PhysicsParamSetSplitImpulsePenetrationThreshold': 'pd:',
    'b3PhysicsParameterSetDeterministicOverlappingPairs': 'pi:',
    'b3InitStepSimulationCommand': 'p:p',
    'b3CreateVisualShapeCommandInit': 'p:p',
    'b3CreateVisualShapeAddBox': 'pp:i',
    'b3GetStatusVisualShapeUniqueId': 'p:i',
    'b3CreateCollisionShapeCommandInit': 'p:p',
    'b3CreateCollisionShapeAddBox': 'pp:i',
    'b3CreateCollisionShapeAddSphere': 'pd:i',
    'b3CreateCollisionShapeAddCapsule': 'pdd:i',
    'b3CreateCollisionShapeAddConvexMesh': 'ppppi:i',
    'b3CreateCollisionShapeAddHeightfield2': 'pppdpiii:i',
    'b3CreateCollisionShapeSetChildTransform': 'pipp:',
    'b3GetStatusCollisionShapeUniqueId': 'p:i',
    'b3CreateMultiBodyCommandInit': 'p:p',
    'b3CreateMultiBodyBase': 'pdiipppp:i',
    'b3CreateMultiBodySetBatchPositions': 'pppi:',
    'b3CreateMultiBodyUseMaximalCoordinates': 'p:',
    'b3CreateMultiBodySetFlags': 'pi:',
    'b3LoadUrdfCommandInit': 'ps:p',
    'b3LoadUrdfCommandSetFlags': 'pi:',
    'b3LoadUrdfCommandSetStartPosition': 'pddd:',
    'b3LoadUrdfCommandSetStartOrientation': 'pdddd:',
    'b3LoadUrdfCommandSetUseMultiBody': 'pi:',
    'b3GetStatusBodyIndex': 'p:i',
    'b3InitRemoveBodyCommand': 'pi:p',
    'b3InitChangeDynamicsInfo': 'p:p',
    'b3ChangeDynamicsInfoSetMass': 'piid:',
    'b3ChangeDynamicsInfoSetLocalInertiaDiagonal': 'piip:',
    'b3ChangeDynamicsInfoSetLateralFriction': 'piid:',
    'b3ChangeDynamicsInfoSetRestitution': 'piid:',
    'b3ChangeDynamicsInfoSetLinearDamping': 'pid:',
    'b3ChangeDynamicsInfoSetAngularDamping': 'pid:',
    'b3ChangeDynamicsInfoSetActivationState': 'pii:',
    'b3ChangeDynamicsInfoSetCcdSweptSphereRadius': 'piid:',
    'b3CollisionFilterCommandInit': 'p:p',
    'b3SetCollisionFilterGroupMask': 'piiii:',
    'b3SetCollisionFilterPair': 'piiiii:',
    'b3CreatePoseCommandInit': 'pi:p',
    'b3CreatePoseCommandSetBasePosition': 'pddd:',
    'b3CreatePoseCommandSetBaseOrientation': 'pdddd:',
    'b3CreatePoseCommandSetBaseLinearVelocity': 'pp:',
    'b3CreatePoseCommandSetBaseAngularVelocity': 'pp:',
    'b3RequestActualStateCommandInit': 'pi:p',
    'b3GetStatusActualState': 'pppppppp:i',
    'b3InitRequestContactPointInformation': 'p:p',
    'b3SetContactFilterBodyA': 'pi:',
    'b3GetContactPointInformation': 'pp:',
}


class ContactInformation(ctypes.Structure):
    """What `b3GetContactPointInformation` fills in: points, and where they are."""

    _fields_ = (('count', c_int), ('points', c_void_p))


@cache
def load_library() -> ctypes.PyDLL:
    """
    Load PyBullet's library, whose functions keep the interpreter: most take a microsecond.

    :raises SceneError: when it exports no C functions.
    """
    library = ctypes.PyDLL(_path())
    _declare(library, _FUNCTIONS)
    return library


@cache
def load_submit() -> Callable[[int, int], int]:
    """Load the function that submits commands so that other threads run while Bullet computes."""
    name = 'b3SubmitClientCommandAndWaitStatus'
    library = ctypes.CDLL(_path())
    _declare(library, {name: _FUNCTIONS[name]})
    return getattr(library, name)


def addresses(names: Sequence[str]) -> np.ndarray:
    """Give where functions begin, int64, (K,)."""
    library = load_library()
    return np.array([ctypes.cast(getattr(library, name), c_void_p).value for name in names],
                    np.int64)


def _path() -> str:
    found = util.find_spec('pybullet')
    if found is None or found.origin is None:
        raise SceneError('pybullet is not installed')
    return found.origin


def _declare(library: ctypes.CDLL, functions: dict[str, str]) -> None:
    for name, signature in functions.items():
        try:
            function = getattr(library, name)
        except AttributeError:
            raise SceneError(f'{_path()} exports no {name}: install pybullet from PyPI, or take '
                             'engine: rapier') from None
        takes, gives = signature.split(':')
        function.argtypes = [_TYPES[letter] for letter in takes]
        function.restype = _TYPES[gives] if gives else None
