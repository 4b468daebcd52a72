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
The coarse matrix of the stress solver: PᵀKP, where P moves aggregates of parts as rigid bodies.

Aggregates and the bonds between them are a smaller bond graph, so the matrix is assembled from
links as K itself would be.
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.links import add_stiffness, cross


class CoarseMatrix:
    """
    Sparse matrix of 6 x 6 blocks, by rows; the diagonal blocks are always there.

    :param graph: the bonds.
    :param bonds: living bonds of the parts in aggregates, (B,).
    :param owner: aggregate of each part, -1 for the ground and parts outside, (N + 1,).
    :param middle: reference points of the aggregates [m], (n, 3).

    :ivar start, column: block pattern by rows, (n + 1,) and (K,).
    :ivar blocks: (K, 6, 6).
    """

    def __init__(self, graph: BondGraph, bonds: np.ndarray, owner: np.ndarray,
                 middle: np.ndarray):
        bonds = bonds[owner[graph.first[bonds]] != owner[graph.second[bonds]]]
        one, other = owner[graph.first[bonds]], owner[graph.second[bonds]]
        low, high, pair = _pairs(np.minimum(one, other), np.maximum(one, other), len(middle))
        springs = np.zeros((len(low), 6, 6))
        _sum_springs(bonds, pair, graph.links, graph.first, graph.second, graph.centre,
                     middle[high], springs)
        own = np.zeros((len(middle), 6, 6))
        _spread(low, high, middle, springs, own)
        tied = low >= 0
        low, high, springs = low[tied], high[tied], springs[tied]
        here = np.arange(len(middle))
        row, column = np.concatenate([here, high, low]), np.concatenate([here, low, high])
        order = np.lexsort((column, row))
        self.start = np.searchsorted(row[order], np.arange(len(middle) + 1))
        self.column = column[order]
        self.blocks = np.concatenate([own, springs, springs.transpose(0, 2, 1)])[order]


@kernel
def _pairs(low, high, count):
    """
    List the pairs of aggregates that bonds join.

    :param low: lower aggregate of each bond, -1 is the ground, (K,).
    :param high: higher aggregate of each bond, (K,).
    :returns: low and high of each pair (P,), and the pair of each bond (K,).
    """
    last = np.full(count, -1)  # last pair found with the same `high`
    previous, a, b, pair = np.empty((4, len(low)), np.int64)
    made = 0
    for k in range(len(low)):
        p = last[high[k]]
        while p >= 0 and a[p] != low[k]:
            p = previous[p]
        if p < 0:
            p = made
            a[p], b[p] = low[k], high[k]
            previous[p], last[b[p]] = last[b[p]], p
            made += 1
        pair[k] = p
    return a[:made].copy(), b[:made].copy(), pair


@kernel(nogil=True)
def _sum_springs(bonds, pair, links, first, second, centre, point, out):
    """Sum the stiffness of the bonds of each pair about its reference point [m], (P, 3)."""
    for k in range(len(bonds)):
        m, p = bonds[k], pair[k]
        i, side = (first[m], 0) if first[m] < len(centre) else (second[m], 3)
        arm = (centre[i, 0] + links[m, side] - point[p, 0],
               centre[i, 1] + links[m, side + 1] - point[p, 1],
               centre[i, 2] + links[m, side + 2] - point[p, 2])
        add_stiffness(out[p], links[m], arm)


@kernel
def _spread(low, high, middle, springs, own):
    """
    Add the springs of pairs to the diagonal blocks; turn them into off-diagonal blocks.

    :param springs: about the reference point of the higher aggregate; overwritten, unless the
        pair ends on the ground, by the block (higher row, lower column), (P, 6, 6).
    :param own: diagonal blocks, added to, (n, 6, 6).
    """
    for p in range(len(low)):
        spring, a, b = springs[p], low[p], high[p]
        own[b] += spring
        if a < 0:
            continue
        arm = (middle[b, 0] - middle[a, 0], middle[b, 1] - middle[a, 1],
               middle[b, 2] - middle[a, 2])
        for r in range(6):
            turned = cross(arm, spring[r])
            for c in range(3):
                spring[r, 3 + c] += turned[c]
        for c in range(6):
            moment = cross(arm, spring[:, c])
            for r in range(3):
                own[a, r, c] += spring[r, c]
                own[a, 3 + r, c] += spring[3 + r, c] + moment[r]
        for r in range(6):
            for c in range(6):
                spring[r, c] = -spring[r, c]
