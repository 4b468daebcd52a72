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


"""Forests for the benchmarks: random branching trees with a set number of segments."""

import numpy as np

from procphys_ros.blueprint import Blueprint, skeleton

_SMALLEST, _LARGEST, _MEAN = 12, 94, 44.5  # segments per tree
_SPACING = 6.0  # [m]


def plant(count: int, seed: int = 0) -> list[Blueprint]:
    """
    Plant trees on a square grid.

    :param count: trees.
    :param seed: of sizes and shapes.
    """
    rng = np.random.default_rng(seed)
    share = (_MEAN - _SMALLEST) / (_LARGEST - _SMALLEST)
    sizes = _SMALLEST + np.rint(
        (_LARGEST - _SMALLEST) * rng.beta(3.0, 3.0 * (1.0 - share) / share, count)).astype(int)
    side = int(np.ceil(np.sqrt(count)))
    return [tree(size, rng).placed((_SPACING * (i % side), _SPACING * (i // side), 0.0))
            for i, size in enumerate(sizes)]


def tree(segments: int, rng: np.random.Generator) -> Blueprint:
    """
    Grow one tree: a trunk, boughs from it, and twigs from those.

    :param segments: how many, at least 4.
    :param rng: of the shape.
    """
    trunk = max(4, segments // 6)
    nodes, parents, radii, heading = [np.zeros(3)], [-1], [0.1], [np.array([0.0, 0.0, 1.0])]
    while len(nodes) <= segments:
        if len(nodes) <= trunk:
            start = len(nodes) - 1
            turn, thinner = 0.05, 0.94
        else:
            start = int(rng.integers(max(1, len(nodes) // 4), len(nodes)))
            turn, thinner = 0.6, rng.uniform(0.55, 0.9)
        direction = heading[start] + turn * rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        length = 0.6 if len(nodes) <= trunk else rng.uniform(0.25, 0.6)
        nodes.append(nodes[start] + length * direction)
        parents.append(start)
        radii.append(max(0.008, radii[start] * thinner))
        heading.append(direction)
    return skeleton.from_nodes(np.array(nodes), parents, radii, damping_ratio=0.05)
