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

"""Trees that several tests share."""

import numpy as np

from procphys_ros.blueprint import Blueprint, skeleton
from procphys_ros.physics.trees import Forest

LENGTH, RADIUS, DENSITY, MODULUS = 5.0, 0.05, 900.0, 8e9  # of the beam, SI
BENDING = MODULUS * np.pi * RADIUS ** 4 / 4.0  # E·I [N·m²]


def effective_mass(forest: Forest, row: int, point: np.ndarray, way: np.ndarray,
                   dt: float = 1.0 / 60.0) -> float:
    """Compute the effective mass of a point along a unit vector, with the step's springs [kg]."""
    look = forest.predict_response(np.array([row]), np.array([point], float), dt)
    return 1.0 / float(way @ look.response[0] @ way)


def beam(segments: int = 10, **material: float) -> Blueprint:
    """Stand a uniform cantilever upright."""
    nodes = np.zeros((segments + 1, 3))
    nodes[:, 2] = np.linspace(0.0, LENGTH, segments + 1)
    material = {'density': DENSITY, 'modulus': MODULUS, **material}
    return skeleton.from_nodes(nodes, np.arange(segments + 1) - 1,
                               np.full(segments + 1, RADIUS), **material)


def bush(segments: int = 44, seed: int = 0, stiffness: float = 8e9,
         **material: float) -> Blueprint:
    """Grow a randomly branching tree."""
    rng = np.random.default_rng(seed)
    nodes, parents, radii = [np.zeros(3), np.array([0.0, 0.0, 0.6])], [-1, 0], [0.08, 0.07]
    while len(nodes) <= segments:
        start = int(rng.integers(max(1, len(nodes) // 3), len(nodes)))
        way = nodes[start] - nodes[parents[start]]
        way = way / np.linalg.norm(way) + 0.5 * rng.normal(size=3)
        nodes.append(nodes[start] + rng.uniform(0.25, 0.6) * way / np.linalg.norm(way))
        parents.append(start)
        radii.append(max(0.008, radii[start] * rng.uniform(0.7, 0.95)))
    return skeleton.from_nodes(np.array(nodes), parents, radii, modulus=stiffness, **material)
