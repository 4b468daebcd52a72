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

"""How deep bodies are in the ground, by all of their corners: a measure apart from engines."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world import Pieces

_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def lowest(pieces: Pieces, pose: np.ndarray, terrain: Terrain = FLAT) -> float:
    """Compute the distance of a body's lowest point from the ground, negative within [m]."""
    places, radii = [np.zeros((0, 3))], [np.zeros(0)]
    for piece, (shape, size) in enumerate(zip(pieces.shapes, pieces.sizes)):
        if shape == Shape.BOX:
            cut = np.flatnonzero(pieces.hexahedra.part == piece)
            own = pieces.hexahedra.corners[cut[0]].reshape(8, 3) if len(cut) else _CUBE * size
            round_by = 0.0
        else:
            half = max(0.5 * (size[2] - size[0]), 0.0)
            own, round_by = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]), 0.5 * size[0]
        local = pieces.local_poses[piece]
        places.append(local[:3] + rotation.rotate(local[3:], own))
        radii.append(np.full(len(own), round_by))
    points = pose[:3] + rotation.rotate(pose[3:], np.concatenate(places))
    level = terrain.normal(points[:, :2])[:, 2]
    over = (points[:, 2] - terrain.height(points[:, :2])) * level
    return float((over - np.concatenate(radii)).min())
