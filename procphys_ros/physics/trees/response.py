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

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.trees import joints
from procphys_ros.physics.trees.joints import RADIAL, STRETCH, TANGENTIAL, TWIST
from procphys_ros.physics.trees.layout import EXTRA_STIFFNESS, EXTRA_STRIDE
from procphys_ros.physics.trees.passes import apart, handed_on
from procphys_ros.physics.trees.spatial import dot, relieve, shift_load
from procphys_ros.physics.trees.state import Joint

_SPRUNG = int(Joint.SPRUNG)
_FREE = int(Joint.FREE)


@kernel
def yielding(k, rows, above, model, state, scratch, point, direction, dt):
    """
    Give the velocity along a direction that a unit impulse along it makes [1/kg].

    Walks from the hit segment to the root and back; the factors must be those of this pose. The
    factors' drives are overwritten.

    :param k: place of the hit segment in its tree.
    :param point: where the impulse acts [m], (3,), world.
    :param direction: unit vector, (3,), world.
    """
    frame, x, y, z = state.frame, direction[0], direction[1], direction[2]
    arm = point - frame[rows[k], :3]
    hit = (arm[1] * z - arm[2] * y, arm[2] * x - arm[0] * z, arm[0] * y - arm[1] * x, x, y, z)
    path = descend(k, rows, above, model, state, scratch, hit)
    motion = scratch.motion
    for k in path[::-1]:
        i = rows[k]
        if model.joint[i] == _FREE:
            joints.solve_free(k, scratch.inertia, scratch.root, motion)
            continue
        v = handed_on(k, above[k], rows, frame, motion)
        v = joints.take_swing(i, k, dt, v, state.stop, frame, scratch.factor, scratch.rate)
        if model.joint[i] == _SPRUNG:
            v = joints.take_extra(i, k, dt, v, model.extra, frame, scratch.factor, scratch.rate)
        for c in range(6):
            motion[k, c] = v[c]
    k = path[0]
    return dot(hit, (motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3], motion[k, 4],
                     motion[k, 5]))


@kernel
def descend(k, rows, above, model, state, scratch, push):
    """Pass a push at entry k down to the root; give the entries passed."""
    path = [k]
    while True:
        i, up = rows[path[-1]], above[path[-1]]
        if model.joint[i] == _FREE:
            for c in range(6):
                scratch.inertia[path[-1], 21 + c] = push[c]
            break
        push = pass_on(i, path[-1], model, state, scratch.factor, push)
        if up < 0:
            break
        x, y, z = apart(state.frame, i, rows[up])
        push = shift_load(push, x, y, z)
        path.append(up)
    return path


@kernel
def pass_on(i, k, model, state, factor, push):
    """Let the joint of row i give way to a push, as elimination does; give what is left."""
    n1, n2, _ = joints.basis(state.stop, i)
    along = (state.frame[i, 9], state.frame[i, 10], state.frame[i, 11])
    if model.joint[i] == _SPRUNG:
        if not np.isinf(model.extra[i, EXTRA_STRIDE + EXTRA_STIFFNESS]):
            push = give(k, STRETCH, push[3:], along, factor, push)
        if not np.isinf(model.extra[i, EXTRA_STIFFNESS]):
            push = give(k, TWIST, push[:3], along, factor, push)
    push = give(k, TANGENTIAL, push[:3], joints.mix(state.frame, i, -n2, n1), factor, push)
    return give(k, RADIAL, push[:3], joints.mix(state.frame, i, n1, n2), factor, push)


@kernel
def give(k, d, share, axis, f, push):
    """Let one degree of freedom give way to its share of a push."""
    drive = share[0] * axis[0] + share[1] * axis[1] + share[2] * axis[2]
    f[k, d, 7] = drive
    return relieve(push, (f[k, d, 0], f[k, d, 1], f[k, d, 2], f[k, d, 3], f[k, d, 4],
                          f[k, d, 5]), f[k, d, 6] * drive)
