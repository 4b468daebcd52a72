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

"""Impact: contact time of hard bodies, and which blows act together."""

import numpy as np

from procphys_ros.elementary import cbrt

# [Pa] effective modulus of a contact, E*: a tenth of that of whole bricks, as edges and mortar
# crush.
MODULUS = 0.5e9

# [s/kg^(1/3)] Hertzian contact time of compact lumps of 1900 kg/m³ at 3 m/s, proportional to their
# size. A brick of 3 kg is in contact for 2 ms, a ball of 2 t for 18 ms.
CONTACT_TIME = 1.4e-3

# [m] height of the asperities of faces: bricks keep to 0.4·√mm of their size
# (EN 771-1, T1), faces of 60 mm to 3 mm; fragments have toothing of half a brick.
FACES, TEETH = 3e-3, 0.03

# Cosine between two directions, about 45 degrees, from which on what happens along them is one.
ALIKE = 0.7

_LIGHT = 1e-30  # [kg], [m/s] keeps rates finite


def contact_time(mass: float | np.ndarray, radius: float | np.ndarray = 0.0,
                 speed: float | np.ndarray = 0.0, uneven: float = FACES) -> np.ndarray:
    """
    Compute the contact time of hard bodies on masonry [s]; momentum over it is the mean force.

    For round bodies Hertz' 2.87·(m² / (R·E*²·v))^(1/5) (Johnson 1985, Contact Mechanics, 11.4)
    with the radius R of a ball of that mass. Its dependence on speed, v^(-1/5), is neglected. Flat
    faces first touch on their asperities, too; when the approach, 1/2.94 of speed times duration
    (the same source), exceeds their height, a spring of stiffness 2·a·E* (3.4) acts in parallel,
    with a contact time of half a period.

    :param mass: of the striking body, reduced with that of a struck body that can move,
        1 / (1/m + 1/M) [kg]; inf = immovable bodies, with infinite contact time.
    :param radius: radius a of a circle of the area of contact of flat faces [m]; 0 =
        contact in a point.
    :param speed: of approach [m/s].
    :param uneven: height of the asperities of the faces [m].
    """
    mass = np.maximum(mass, _LIGHT)
    slow = CONTACT_TIME * cbrt(mass)
    closer = np.maximum(speed, _LIGHT) * slow / 2.94
    flat = np.asarray(radius) * np.maximum(1.0 - uneven / closer, 0.0)
    rate = np.sqrt(1.0 / (slow * slow) + 2.0 * flat * MODULUS / (np.pi * np.pi * mass))
    return np.divide(1.0, rate, out=np.full_like(rate, np.inf), where=rate > 0.0)
