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
Downwash: the jets of air that rotors drive through the scene.

The momentum theory of an actuator disk (Rankine and Froude; Leishman 2006, section 2.2) has the
thrust T move the air at the disk by v = √(T/(2·ρ·π·R²)), and, x further on, by v·(1 + x/√(x² +
R²)), that of a vortex cylinder: 2·v in the end, in a stream contracted to R/√2. Its edge mixes
with the air around it as that of a round jet, u = exp(-((r - c)/b)²) outside of an unmixed core of
radius c, b = 0.107·x (Fischer et al. 1979, table 9.2; Albertson et al. 1950), so that from some
six diameters on u falls with 1/x. c follows from the flux of momentum, the same at all distances.
"""

import math

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import functions
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.air import AIR_DENSITY

COLUMNS = 8  # centre (3), direction of the air (3), radius of the disk, speed at the disk
_SPREAD = 0.107
_ABOVE = 2.0  # [radii] above the disk, where the air has a tenth of its speed there, it begins
_EDGE = 3.0   # [b] from the core, where exp(-9) of the speed is left, it ends
_ROOT = math.sqrt(0.5 * math.pi)


def jet(centre: np.ndarray, thrust: np.ndarray, radius: float) -> np.ndarray:
    """
    Make the row of a rotor, or of several that count as one disk.

    :param centre: of the disk [m], (3,), world.
    :param thrust: on the robot, opposite to the air [N], (3,), world, not 0.
    :param radius: of the disk [m].
    """
    size = float(norm(thrust))
    speed = math.sqrt(size / (2.0 * AIR_DENSITY * math.pi * radius * radius))
    return np.concatenate([centre, -thrust / size, [radius, speed]])


@kernel
def add_jets(points, out, jets):
    """
    Add the velocities of jets.

    :param points: [m], (N, 3).
    :param out: velocities of the air there, added to [m/s], (N, 3).
    :param jets: rows of `jet`, (J, COLUMNS).
    """
    for j in range(len(jets)):
        radius, speed = jets[j, 6], jets[j, 7]
        for n in range(len(points)):
            along, square = 0.0, 0.0
            for k in range(3):
                away = points[n, k] - jets[j, k]
                along += away * jets[j, 3 + k]
                square += away * away
            if along < -_ABOVE * radius:
                continue
            factor = 1.0 + along / math.sqrt(along * along + radius * radius)
            across = math.sqrt(max(square - along * along, 0.0))
            u = speed * factor * _profile(across, radius / math.sqrt(factor), along)
            for k in range(3):
                out[n, k] += u * jets[j, 3 + k]


@kernel
def _profile(across, radius, along):
    """
    Return the speed over that of an unmixed stream.

    :param across: distance from the axis [m].
    :param radius: of the unmixed stream there [m].
    :param along: distance from the disk [m].
    """
    b = _SPREAD * max(along, 0.0)
    # Momentum of core and edge, c² + √(π/2)·b·c + b²/2, is that of the unmixed stream, radius².
    rest = radius * radius - 0.5 * b * b
    core, peak = 0.0, 1.0
    if rest > 0.0:
        half = 0.5 * _ROOT * b
        core = math.sqrt(half * half + rest) - half
    else:
        peak = radius * math.sqrt(2.0) / b
    if across <= core:
        return peak
    if across > core + _EDGE * b:
        return 0.0
    s = (across - core) / b
    return peak * functions.exp(-s * s)
