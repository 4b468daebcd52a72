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


"""Response: how much mass a point of a tree shows to a push, from the factors of the step."""

from numba import njit
import numpy as np

from procphys_ros.physics.trees import joints
from procphys_ros.physics.trees.joints import RADIAL, STRETCH, TANGENTIAL, TWIST
from procphys_ros.physics.trees.layout import EXTRA_STIFFNESS, EXTRA_STRIDE
from procphys_ros.physics.trees.passes import hand_on
from procphys_ros.physics.trees.state import Joint

_SPRUNG = int(Joint.SPRUNG)
_FREE = int(Joint.FREE)


@njit(cache=True)
def yielding(k, rows, above, model, state, scratch, point, direction, dt):
    """
    Give the velocity along a direction that a unit impulse along it makes [1/kg].

    Walks from the hit segment to the root and back; the factors must be those of this pose. The
    factor's drives and loads are overwritten.

    :param k: place of the hit segment in its tree.
    :param point: where the impulse acts [m], (3,), world.
    :param direction: unit vector, (3,), world.
    """
    a, frame = scratch.inertia, state.frame
    arm = point - frame[rows[k], :3]
    push = np.empty(6)
    push[:3] = np.cross(arm, direction)
    push[3:] = direction
    path = [k]
    while True:
        k = path[-1]
        i = rows[k]
        a[k, 21:27] = push
        if model.joint[i] == _FREE:
            break
        for j in (STRETCH, TWIST, TANGENTIAL, RADIAL):
            pass_on(i, k, j, model, state, scratch, push)
        if above[k] < 0:
            break
        up = rows[above[k]]
        push[:3] += np.cross(frame[i, :3] - frame[up, :3], push[3:])
        path.append(above[k])
    for k in path[::-1]:
        i = rows[k]
        if model.joint[i] == _FREE:
            joints.solve_free(k, scratch)
            continue
        hand_on(k, above[k], i, rows[above[k]], frame, scratch.motion)
        joints.take_swing(i, k, dt, state, scratch)
        if model.joint[i] == _SPRUNG:
            joints.take_extra(i, k, dt, model, state, scratch)
    m = scratch.motion[path[0]]
    return np.dot(direction, m[3:6] + np.cross(m[:3], arm))


@njit(cache=True)
def pass_on(i, k, j, model, state, scratch, push):
    """Let degree of freedom j of row i give way to a push, as elimination does."""
    frame, stop, f = state.frame, state.stop, scratch.factor
    if j in (STRETCH, TWIST):
        if np.isinf(model.extra[i, EXTRA_STRIDE * (j - TWIST) + EXTRA_STIFFNESS]):
            return
        axis = (frame[i, 9], frame[i, 10], frame[i, 11])
    else:
        n1, n2 = stop[i, 0], stop[i, 1]
        if n1 == 0.0 and n2 == 0.0:
            n1 = 1.0
        if j == RADIAL:
            axis = joints.mix(frame, i, n1, n2)
        else:
            axis = joints.mix(frame, i, -n2, n1)
    start = 3 if j == STRETCH else 0
    drive = push[start] * axis[0] + push[start + 1] * axis[1] + push[start + 2] * axis[2]
    f[k, j, 7] = drive
    for c in range(6):
        push[c] -= f[k, j, c] * f[k, j, 6] * drive
