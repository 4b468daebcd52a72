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

"""Shelter: the obstacles of a scene to the wind, as built."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.wind import Shelter
from procphys_ros.scene import SceneObject


def find_shelter(blueprint: Blueprint, objects: Sequence[SceneObject],
                 masonry: np.ndarray, terrain: Terrain = FLAT) -> Shelter:
    """
    Measure the sizes of trees and buildings.

    :param blueprint: all parts.
    :param objects: owners of the parts; each is one tree (or bush) or one building.
    :param masonry: whether each part is in a building, (N,) bool.
    :param terrain: the surface of the ground; heights are above it.
    """
    trees, buildings = [], []
    axes = np.abs(rotation.to_matrix(blueprint.poses[:, 3:]))
    reach = 0.5 * np.einsum('nij,nj->ni', axes, blueprint.visual_size)
    low, high = blueprint.poses[:, :3] - reach, blueprint.poses[:, :3] + reach
    high[:, 2] -= terrain.height(blueprint.poses)
    for own in objects:
        parts = slice(own.first, own.first + own.count)
        area, built = blueprint.leaf_area[parts], masonry[parts]
        if area.sum() > 0.0:
            leafy = area > 0.0
            middle = np.average(blueprint.poses[parts, :2], axis=0, weights=area)
            away = norm(blueprint.poses[parts, :2][leafy] - middle, axis=1)
            trees.append([*middle, high[parts, 2][leafy].max(), away.max(), area.sum()])
        elif built.any():
            buildings.append([*low[parts, :2][built].min(axis=0),
                              *high[parts][built].max(axis=0)])
    return Shelter(np.array(trees).reshape(-1, 5), np.array(buildings).reshape(-1, 5))
