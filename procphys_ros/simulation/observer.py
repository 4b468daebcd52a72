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


"""Observer: what a camera sees, for the level of detail."""

import math

import numpy as np

from procphys_ros.elementary import atan, cos, sin, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.scene.culling import CullingSettings

_STRAIGHT = 0.5 * math.pi  # [rad] widest half angle that planes can bound


class Observer:
    """
    A camera that looks along the x axis of its pose, z up (REP 103).

    :param settings: view angle and range.
    :param position: [m], (3,), world.
    :param orientation: unit quaternion xyzw, (4,), world.
    """

    def __init__(self, settings: CullingSettings, position: np.ndarray, orientation: np.ndarray):
        self.position = position
        self._reach = settings.distance
        self._normals = np.zeros((0, 3))
        if settings.frustum:
            inward = _planes(settings)
            self._normals = rotation.rotate(np.tile(orientation, (len(inward), 1)), inward)

    def distance(self, centres: np.ndarray) -> np.ndarray:
        """Return the distances of points from the camera [m], (K,)."""
        return norm(centres - self.position, axis=1)

    def sees(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """
        Return which spheres reach into the view, according to its planes and its range.

        A sphere near an edge of the view may count as seen though it just misses it, never the
        other way round.

        :param centres: [m], (K, 3), world.
        :param radii: [m], (K,).
        :returns: (K,) bool.
        """
        away = centres - self.position
        seen = np.ones(len(centres), bool)
        for normal in self._normals:
            seen &= product(away, normal) >= -radii
        if self._reach > 0.0:
            seen &= np.einsum('ki,ki->k', away, away) <= np.square(self._reach + radii)
        return seen


def _planes(settings: CullingSettings) -> np.ndarray:
    """Return inward normals of the planes through the eye: sides, top, bottom, behind, (5, 3)."""
    half = 0.5 * settings.field_of_view
    up = min(half + settings.widening, _STRAIGHT)
    side = min(atan(settings.aspect * tan(half)) + settings.widening, _STRAIGHT)
    return np.array([[sin(side), cos(side), 0.0], [sin(side), -cos(side), 0.0],
                     [sin(up), 0.0, cos(up)], [sin(up), 0.0, -cos(up)],
                     [1.0, 0.0, 0.0]])
