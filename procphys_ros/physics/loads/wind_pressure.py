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
Wind on the skin of a building: zones of its walls and roof, and internal pressure.

External coefficients of EN 1991-1-4, tables 7.1, 7.2 and 7.4 (c_pe,10), for wind normal to a face;
under an angle they are interpolated by the square of its cosine. Where a table gives two
values for the windward slope of a roof, their mean is used.
"""

from dataclasses import dataclass

import numpy as np

from procphys_ros.elementary import acos, cos
from procphys_ros.geometry.linear import norm

# Windward and lee walls over height/depth.
_SLENDER = np.array([0.25, 1.0, 5.0])
_FRONT, _REAR = np.array([0.7, 0.8, 0.8]), np.array([-0.3, -0.5, -0.7])
_SIDE_EDGE, _SIDE, _SIDE_END = -1.2, -0.8, -0.5  # zones A, B, C of walls along the wind
# Roofs over their pitch [degrees]; at 0 the flat roof with sharp eaves.
_PITCH = np.array([0.0, 5.0, 15.0, 30.0, 45.0, 60.0, 75.0])
_CORNER = np.array([-1.8, -0.85, -0.35, 0.1, 0.35, 0.7, 0.8])     # zone F, windward slope
_EAVES = np.array([-1.2, -0.6, -0.3, 0.1, 0.35, 0.7, 0.8])        # G
_SLOPE = np.array([-0.7, -0.3, -0.05, 0.1, 0.3, 0.7, 0.8])        # H
_LEE_RIDGE = np.array([-0.7, -0.6, -1.0, -0.5, -0.3, -0.3, -0.3])  # J
_LEE = np.array([-0.2, -0.6, -0.4, -0.4, -0.2, -0.2, -0.2])       # I
_GABLE_CORNER = np.array([-1.8, -1.6, -1.3, -1.1, -1.1, -1.1, -1.1])  # F, wind along the ridge
_GABLE_EAVES = np.array([-1.2, -1.3, -1.3, -1.4, -1.4, -1.2, -1.2])   # G
_GABLE = np.array([-0.7, -0.7, -0.6, -0.8, -0.9, -0.8, -0.8])         # H
_GABLE_END = np.array([-0.2, -0.6, -0.5, -0.5, -0.5, -0.5, -0.5])     # I
_ROOF = cos(np.radians(78.0))  # least vertical component of the normal of a roof face
_LEAK = 1e-3  # openings of a closed skin over its area: cracks of windows, doors and tiles


@dataclass(frozen=True)
class Outline:
    """
    Dimensions of buildings relative to the wind, one row per face.

    :ivar along: distance of the face behind the windward edge [m], (K,).
    :ivar end: distance to the nearer end across the wind [m], (K,).
    :ivar depth, width, height: of its building, along, across and vertical [m], (K,).
    """

    along: np.ndarray
    end: np.ndarray
    depth: np.ndarray
    width: np.ndarray
    height: np.ndarray


def outline(centres: np.ndarray, way: np.ndarray, building: np.ndarray) -> Outline:
    """
    Compute the dimensions of buildings relative to the wind.

    :param centres: of faces of their skins, (K, 3) [m], world.
    :param way: unit vector of the horizontal wind at each, (K, 2).
    :param building: number of each face's building, (K,).
    """
    along = (centres[:, :2] * way).sum(axis=1)
    across = way[:, 0] * centres[:, 1] - way[:, 1] * centres[:, 0]
    count = int(building.max(initial=-1)) + 1
    low, high = [], []
    for value in (along, across, centres[:, 2]):
        least, most = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(least, building, value)
        np.maximum.at(most, building, value)
        low.append(least[building])
        high.append(most[building])
    return Outline(along - low[0], np.minimum(across - low[1], high[1] - across),
                   high[0] - low[0], high[1] - low[1], high[2] - low[2])


def external(normals: np.ndarray, way: np.ndarray, place: Outline) -> np.ndarray:
    """
    Compute the external pressure coefficients c_pe of faces, (K,).

    :param normals: unit vectors outwards, (K, 3), world.
    :param way: unit vector of the horizontal wind, (K, 2).
    :param place: positions of the faces on their buildings.
    """
    facing = (normals[:, :2] * way).sum(axis=1)
    edge = np.minimum(place.width, 2.0 * place.height)
    wall = _wall(facing, place, edge)
    level = norm(normals[:, :2], axis=1)
    share = np.where(level > 1e-6, facing / np.maximum(level, 1e-6), -1.0)
    pitch = np.degrees(acos(np.clip(normals[:, 2], -1.0, 1.0)))
    corner = place.end < 0.25 * edge
    first = place.along < 0.1 * edge
    slope = _zones(pitch, _SLOPE, (first, _EAVES), (first & corner, _CORNER))
    behind = place.along - 0.5 * place.depth
    lee = _zones(pitch, _LEE, (behind < 0.1 * edge, _LEE_RIDGE))
    flat = _zones(pitch, _LEE, (place.along < 0.5 * edge, _SLOPE), (first, _EAVES),
                  (first & corner, _CORNER))
    gable = _zones(pitch, _GABLE_END, (place.along < 0.5 * edge, _GABLE), (first, _GABLE_EAVES),
                   (first & corner, _GABLE_CORNER))
    ridge = np.where(share < 0.0, slope, lee)
    roof = np.where(pitch < 5.0, flat, share * share * ridge + (1.0 - share * share) * gable)
    return np.where(normals[:, 2] > _ROOF, roof, wall)


def internal(area: np.ndarray, open_area: np.ndarray, coefficient: np.ndarray,
             building: np.ndarray) -> np.ndarray:
    """
    Compute the internal pressure coefficient c_pi of each building, (B,).

    EN 1991-1-4, 7.2.9 (6): it follows from the share of openings where c_pe is negative, from 0.35
    at a third to -0.3 at nine tenths (figure 7.13, height/depth up to a quarter).

    :param area: of faces of the skin [m²], (K,).
    :param open_area: of removed faces [m²], (K,).
    :param coefficient: c_pe, (K,).
    :param building: number of each face's building, (K,).
    """
    openings = _LEAK * area + open_area
    count = int(building.max(initial=-1)) + 1
    total = np.bincount(building, openings, count)
    sucked = np.bincount(building, openings * (coefficient < 0.0), count)
    return np.interp(sucked / np.maximum(total, 1e-12), [0.33, 0.9], [0.35, -0.3])


def _wall(facing: np.ndarray, place: Outline, edge: np.ndarray) -> np.ndarray:
    """Compute c_pe of walls: zone D ahead, E behind, A, B and C along the wind."""
    slender = place.height / np.maximum(place.depth, 1e-9)
    front, rear = np.interp(slender, _SLENDER, _FRONT), np.interp(slender, _SLENDER, _REAR)
    side = np.where(place.along < 0.2 * edge, _SIDE_EDGE,
                    np.where(place.along < edge, _SIDE, _SIDE_END))
    ahead = np.where(facing < 0.0, front, rear)
    square = facing * facing
    return (square * ahead + (1.0 - square) * _SIDE_END
            + np.square(1.0 - np.abs(facing)) * (side - _SIDE_END))


def _zones(pitch: np.ndarray, base: np.ndarray,
           *others: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Look up a base table, and others where they apply, later ones overriding earlier ones."""
    found = np.interp(pitch, _PITCH, base)
    for where, table in others:
        found = np.where(where, np.interp(pitch, _PITCH, table), found)
    return found
