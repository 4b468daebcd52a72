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

Aggregates tied by the bonds that cross between them are a bond graph again, only smaller, so the
matrix is assembled from links as K itself would be.
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry import links
from procphys_ros.physics.masonry.graph import BondGraph


class CoarseMatrix:
    """
    Blocks of 6 x 6 numbers, by rows; the diagonal ones are always there.

    :param graph: the bonds.
    :param owner: aggregate of each part, -1 for the ground and what has none, (N + 1,).
    :param middle: reference points of the aggregates [m], (n, 3).

    :ivar start, column: places of the blocks by rows, (n + 1,) and (K,).
    :ivar blocks: (K, 6, 6).
    """

    def __init__(self, graph: BondGraph, owner: np.ndarray, middle: np.ndarray):
        n = len(middle)
        ends = owner.astype(np.int64)
        a, b = ends[graph.first], ends[graph.second]
        bonds = np.flatnonzero(graph.alive & (a != b))
        a, b = a[bonds], b[bonds]
        both = (a >= 0) & (b >= 0)
        key = np.concatenate([a * n + a, b * n + b, a * n + b, b * n + a])
        places = np.unique(np.concatenate(
            [key[np.concatenate([a >= 0, b >= 0, both, both])], np.arange(n) * (n + 1)]))
        slot = np.ascontiguousarray(np.searchsorted(places, key).reshape(4, -1).T)
        self.start, self.column = np.searchsorted(places, np.arange(n + 1) * n), places % n
        self.blocks = np.zeros((len(places), 6, 6))
        _assemble(bonds, graph.links, graph.first, graph.second, graph.centroid,
                  graph.centre, a, b, middle, slot, self.blocks)


@kernel
def _assemble(bonds, all_links, first, second, centroid, centre, left, right, middle, slot,
              blocks):
    """Add the links that cross between aggregates; slot: four blocks per bond."""
    here, there = np.empty((2, 3, 6))
    at_a, at_b = np.zeros((2, 3))
    for k in range(len(bonds)):
        m, a, b = bonds[k], left[k], right[k]
        link = all_links[m]
        if a >= 0:
            # A cracked joint is tied where it presses, all others at their centroids.
            at_a = centroid[m] - middle[a] + (link[0:3] - (centroid[m] - centre[first[m]]))
            links.add_block(blocks[slot[k, 0]], link, at_a, at_a, 1.0, here, there)
        if b >= 0:
            at_b = centroid[m] - middle[b] + (link[3:6] - (centroid[m] - centre[second[m]]))
            links.add_block(blocks[slot[k, 1]], link, at_b, at_b, 1.0, here, there)
        if a >= 0 and b >= 0:
            links.add_block(blocks[slot[k, 2]], link, at_a, at_b, -1.0, here, there)
            links.add_block(blocks[slot[k, 3]], link, at_b, at_a, -1.0, here, there)
