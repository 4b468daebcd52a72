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


"""Patterns of rays: directions of the rows and columns of a sensor."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import subroutine
from procphys_ros.elementary import cos, functions, sin, tan
from procphys_ros.geometry.linear import norm


class Pattern(NamedTuple):
    """
    Directions of rays in the frame of the sensor: x ahead, y left, z up.

    Row 0 is the uppermost, column 0 the leftmost, as in an image.

    :ivar is_pinhole: whether rows and columns are uniform in a plane ahead, not in angles.
    :ivar width: of all columns, [rad], or of a plane 1 m ahead [m].
    :ivar height: of all rows, likewise.
    :ivar directions: unit vectors, (V, H, 3).
    """

    is_pinhole: bool
    width: float
    height: float
    directions: np.ndarray


def spherical(rows: int, columns: int, height: float, width: float) -> Pattern:
    """
    Create the rays of a lidar, uniform in elevation and azimuth.

    :param height: vertical field of view [rad], at most π.
    :param width: horizontal field of view [rad], at most 2 π.
    """
    elevation = height * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    azimuth = width * (0.5 - (np.arange(columns) + 0.5) / columns)[None, :]
    directions = np.stack(np.broadcast_arrays(
        cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth),
        sin(elevation)), axis=-1)
    return Pattern(False, width, height, np.ascontiguousarray(directions))


def pinhole(rows: int, columns: int, height: float, width: float) -> Pattern:
    """
    Create the rays of a depth camera, uniform in the image.

    :param height: vertical field of view [rad], below π.
    :param width: horizontal field of view [rad], below π.
    """
    tall, wide = 2.0 * tan(0.5 * height), 2.0 * tan(0.5 * width)
    z = tall * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    y = wide * (0.5 - (np.arange(columns) + 0.5) / columns)[None, :]
    directions = np.stack(np.broadcast_arrays(1.0, y, z), axis=-1)
    directions = directions / norm(directions, axis=-1, keepdims=True)
    return Pattern(True, float(wide), float(tall), np.ascontiguousarray(directions))


@subroutine
def window(is_pinhole, centre, x, y, z):
    """
    Compute outer bounds of the directions to a box.

    :param is_pinhole: as of `Pattern`.
    :param centre: of the box in the frame of the sensor [m], (3,).
    :param x, y, z: half its edges as vectors in that frame [m], (3,) each.
    :returns: middle, least and greatest column coordinate about it, least and greatest row
        coordinate; inf where unbounded.
    """
    if is_pinhole:
        ax, ay = 1.0, 0.0
    else:
        across = np.sqrt(centre[0] ** 2 + centre[1] ** 2)
        ax, ay = (centre[0] / across, centre[1] / across) if across > 0.0 else (1.0, 0.0)
    least, farthest = np.inf, 0.0  # distance from the sensor along its axis, and from its axis
    left, right, low, high = -np.inf, np.inf, np.inf, -np.inf
    bottom, top = np.inf, -np.inf
    for corner in range(8):
        i = 1.0 if corner & 1 else -1.0
        j = 1.0 if corner & 2 else -1.0
        k = 1.0 if corner & 4 else -1.0
        px = centre[0] + i * x[0] + j * y[0] + k * z[0]
        py = centre[1] + i * x[1] + j * y[1] + k * z[1]
        pz = centre[2] + i * x[2] + j * y[2] + k * z[2]
        ahead, aside = ax * px + ay * py, ax * py - ay * px
        least = min(least, ahead)
        farthest = max(farthest, ahead * ahead + aside * aside)
        bottom, top = min(bottom, pz), max(top, pz)
        if ahead > 0.0:
            left, right = max(left, aside / ahead), min(right, aside / ahead)
            low, high = min(low, pz / ahead), max(high, pz / ahead)
    if is_pinhole:
        if least <= 0.0:
            return 0.0, -np.inf, np.inf, -np.inf, np.inf
        return 0.0, right, left, low, high
    farthest = np.sqrt(farthest)
    near = max(least, 0.0)
    up = functions.atan2(top, near if top > 0.0 else farthest)
    down = functions.atan2(bottom, near if bottom < 0.0 else farthest)
    if least <= 0.0:
        return 0.0, -np.inf, np.inf, down, up
    return functions.atan2(ay, ax), functions.atan(right), functions.atan(left), down, up
