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
Buckling: the share of its weight that a tree stands upright under.

Greenhill 1881 (Proc. Cambridge Phil. Soc. 4:65) asks how tall a column can be. Here segments are
rigid links with springs. Where a link and all above it turns by φ about a level axis, with its own
end only moved along, heights change by -φ²/2 of those along the link: the work of weight is
diagonal in the turns of links in space, the springs couple each link to the one below. Upright is
stable as long as elimination from the tips to the root leaves every pivot positive.
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine

_MOST = 1e6      # share of the weight beyond which nothing is looked for
_HALVINGS = 30   # of the range in which it lies


@kernel
def buckling_shares(roots, ends, parents, stiffness, mass, centre, joint, gravity):
    """
    Compute the share of its weight at which each tree buckles, (K,); at least `_MOST` is inf.

    :param roots: first row of each tree, (K,).
    :param ends: one past the last row of each row's subtree, (S,).
    :param parents: row of the parent, -1 for roots, (S,).
    :param stiffness: bending springs of the joints [N·m/rad], (S,).
    :param mass: [kg], (S,).
    :param centre, joint: heights of centres of mass and of joints [m], (S,).
    :param gravity: [m/s²], downwards.
    """
    carried, topples = mass.copy(), np.zeros(len(mass))
    for i in range(len(mass) - 1, -1, -1):
        topples[i] += gravity * mass[i] * (centre[i] - joint[i])
        up = parents[i]
        if up >= 0:
            carried[up] += carried[i]
            topples[up] += gravity * carried[i] * (joint[i] - joint[up])
    shares, pivots = np.empty(len(roots)), np.empty(len(mass))
    for t in range(len(roots)):
        first, last = roots[t], ends[roots[t]]
        low, high = 0.0, 1.0
        while high < _MOST and _stands(first, last, parents, stiffness, topples, high, pivots):
            low, high = high, 2.0 * high
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            if _stands(first, last, parents, stiffness, topples, share, pivots):
                low = share
            else:
                high = share
        shares[t] = low if high < _MOST else np.inf
    return shares


@subroutine
def _stands(first, last, parents, stiffness, topples, share, pivots):
    """Return whether the rows of a tree are stable under a share of their weight."""
    for i in range(first, last):
        pivots[i] = stiffness[i] - share * topples[i]
    for i in range(last - 1, first - 1, -1):
        if not pivots[i] > 0.0:
            return False
        if parents[i] >= first:
            pivots[parents[i]] += stiffness[i] - stiffness[i] * stiffness[i] / pivots[i]
    return True
