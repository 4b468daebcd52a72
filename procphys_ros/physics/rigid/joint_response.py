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
Joint response: what joints make of changes of velocity that come from outside of the solver.

It is the projection of the changes, weighted by masses, onto those that equality rows allow.
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.rigid import joints as jointed
from procphys_ros.physics.rigid import solver

_PASSES = 2  # the second takes what the regularisation of redundant rows leaves of the first


@kernel
def respond(bodies, free, joints):
    """
    Make velocities, which stand for changes of them, compatible with joints, in place.

    :param bodies: `MovingBodies`; the last row stands for all immovable bodies.
    :param free: number of bodies that move freely.
    :param joints: between rows of bodies, along chains.
    """
    own = np.arange(free)
    state = solver._states(bodies, own, free)
    for i in own:
        solver._ease(i, bodies, state)
    system = jointed.lay_out(joints, free)
    jointed.aim(range(len(joints.kind)), joints, system, bodies, free, 0.0, state)
    count, lines = len(system.part), system.lines
    for r in range(count):
        lines[r, jointed._SOFT] = lines[r, jointed._IMPULSE] = 0.0
        system.takes_part[r] = system.part[r] == jointed._HOLDS
    jointed._factor(0, count, system)
    for _ in range(_PASSES):
        for r in range(count):
            lines[r, jointed._CHANGE] = -jointed._speed(r, system, state)
        jointed._resolve(0, count, system)
        for r in range(count):
            if system.takes_part[r]:
                jointed._push(r, lines[r, jointed._CHANGE], system, state)
    for i in own:
        for w in range(6):
            bodies.velocity[i, w] = state[i, w]
