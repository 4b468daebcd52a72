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


"""Subset: what is done to some trees of a forest, or read of them, but their steps."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.trees.layout import ACROSS, ALONG, MASS
from procphys_ros.physics.trees.state import AXIS

_AXIS = int(AXIS)


@kernel
def rows_of(plan, trees):
    """List the rows of some trees, tree by tree, (R,)."""
    count = 0
    for t in trees:
        count += plan.start[t + 1] - plan.start[t]
    rows = np.empty(count, plan.row.dtype)
    place = 0
    for t in trees:
        for k in range(plan.start[t], plan.start[t + 1]):
            rows[place] = plan.row[k]
            place += 1
    return rows


@kernel
def hold(rows, state):
    """Set trees to rest at their present bends; joints go on carrying what they carried."""
    for i in rows:
        for c in range(6):
            state.velocities[i, c] = 0.0
            state.carried[i, c] = 0.0
            state.push[i, c] = 0.0
        for c in range(12):
            state.middle[i, c] = state.frame[i, c]
        state.struck[i, 0] = 0.0


@kernel
def kinetic(plan, trees, body, state):
    """Compute the kinetic energy per mass of some trees [J/kg], (K,)."""
    out = np.empty(len(trees))
    for n in range(len(trees)):
        energy, mass = 0.0, 0.0
        for k in range(plan.start[trees[n]], plan.start[trees[n] + 1]):
            i = plan.row[k]
            v = state.velocities[i]
            spin = 0.0
            for c in range(3):
                energy += body[i, MASS] * v[c] ** 2 + body[i, ACROSS] * v[3 + c] ** 2
                spin += v[3 + c] * state.frame[i, _AXIS + c]
            energy += (body[i, ALONG] - body[i, ACROSS]) * spin ** 2
            mass += body[i, MASS]
        out[n] = 0.5 * energy / mass
    return out


@kernel
def push(rows, points, impulses, root, state):
    """Apply impulses in the next step; see `Forest.push`."""
    for n in range(len(rows)):
        i, (x, y, z) = rows[n], impulses[n]
        u, v, w = points[n] - state.poses[i, :3]
        given = state.push[i]
        given[0] += x
        given[1] += y
        given[2] += z
        given[3] += v * z - w * y
        given[4] += w * x - u * z
        given[5] += u * y - v * x
        state.struck[root[i], 0] = 1.0


@kernel
def masses(plan, entry, body):
    """Compute the masses of the trees of entries of the plan [kg], (K,)."""
    total = np.full(len(plan.start) - 1, -1.0)
    tree = np.searchsorted(plan.start, entry, side='right') - 1
    out = np.empty(len(entry))
    for n in range(len(entry)):
        t = tree[n]
        if total[t] < 0.0:
            total[t] = body[plan.row[plan.start[t]:plan.start[t + 1]], MASS].sum()
        out[n] = total[t]
    return out


@kernel
def write_between(plan, trees, share, start, end, velocities, parts, poses, speeds):
    """
    Write interpolated poses of rows to their parts.

    :param share: interpolation parameter of each tree, (K,); 1 returns the end to the last bit.
    :param start: poses of all rows at the start, (S, 7).
    :param end: and at the end, (S, 7).
    :param velocities: of all rows at the end, (S, 6).
    :param parts: part of each row, (S,).
    :param poses: of all parts, (N, 7), written in place; `speeds` (N, 6) likewise.
    """
    for n in range(len(trees)):
        s = share[n]
        for k in range(plan.start[trees[n]], plan.start[trees[n] + 1]):
            i = plan.row[k]
            p = parts[i]
            for c in range(6):
                speeds[p, c] = velocities[i, c]
            if s == 1.0:
                for c in range(7):
                    poses[p, c] = end[i, c]
                continue
            same, length = 0.0, 0.0
            for c in range(3, 7):
                same += start[i, c] * end[i, c]
            side = 1.0 if same >= 0.0 else -1.0
            for c in range(7):
                first = start[i, c] if c < 3 else side * start[i, c]
                poses[p, c] = first + s * (end[i, c] - first)
                if c > 2:
                    length += poses[p, c] ** 2
            for c in range(3, 7):
                poses[p, c] /= np.sqrt(length)
