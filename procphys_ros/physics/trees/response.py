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

from procphys_ros.compilation import kernel
from procphys_ros.physics.trees import joints, passes
from procphys_ros.physics.trees.layout import REACH
from procphys_ros.physics.trees.passes import apart, handed_on
from procphys_ros.physics.trees.spatial import dot, shift_load
from procphys_ros.physics.trees.state import Joint

_SPRUNG = int(Joint.SPRUNG)
_FREE = int(Joint.FREE)


@kernel
def yielding(k, rows, above, model, state, scratch, point, direction):
    """
    Give the velocity along a direction that a unit impulse along it makes [1/kg].

    Walks from the hit segment to the root and back; the factors must be those of this pose. The
    factors' drives are overwritten.

    :param k: place of the hit segment in its tree.
    :param point: where the impulse acts [m], (3,), world.
    :param direction: unit vector, (3,), world.
    """
    frame, x, y, z = state.middle, direction[0], direction[1], direction[2]
    arm = point - state.poses[rows[k], :3] + reach(rows[k], model, state) * frame[rows[k], 9:]
    hit = (arm[1] * z - arm[2] * y, arm[2] * x - arm[0] * z, arm[0] * y - arm[1] * x, x, y, z)
    path = descend(k, rows, above, model, state, scratch, hit)
    motion = scratch.motion
    for k in path[::-1]:
        i = rows[k]
        if model.joint[i] == _FREE:
            joints.solve_free(k, scratch.inertia, scratch.root, motion)
            continue
        v = handed_on(k, above[k], rows, frame, motion)
        v = joints.take_swing(i, k, 1.0, v, state.stop, frame, scratch.factor, scratch.jump)
        if model.joint[i] == _SPRUNG:
            v = joints.take_extra(i, k, 1.0, v, model.extra, frame, scratch.factor, scratch.jump)
        for c in range(6):
            motion[k, c] = v[c]
    k = path[0]
    return dot(hit, (motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3], motion[k, 4],
                     motion[k, 5]))


@kernel
def reach(i, model, state):
    """Give the distance of the centre of mass of row i from its joint point [m]."""
    return model.body[i, REACH] + state.bend[i, 3]


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
        push = passes.pass_on(i, path[-1], model, state.stop, state.middle, scratch.factor, push)
        if up < 0:
            break
        x, y, z = apart(state.middle, i, rows[up])
        push = shift_load(push, x, y, z)
        path.append(up)
    return path
