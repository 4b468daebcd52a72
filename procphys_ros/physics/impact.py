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

"""Impact: how long blows of hard bodies last."""

import numpy as np

from procphys_ros.elementary import cbrt

# [Pa] effective modulus of a contact, E*: a tenth of that of whole bricks, because edges and
# mortar crush.
MODULUS = 0.5e9

# [s/kg^(1/3)] Hertz' contact of compact lumps of 1900 kg/m³ at 3 m/s, whose time grows with their
# size. A brick of 3 kg is in contact for 2 ms, a ball of 2 t for 18 ms.
CONTACT_TIME = 1.4e-3

# [m] up to which faces touch on their highest points: bricks keep to 0.4·√mm of their size
# (EN 771-1, T1), faces of 60 mm to 3 mm; what has broken off has teeth half a brick high.
FACES, TEETH = 3e-3, 0.03

_LIGHT = 1e-30  # [kg], [m/s] keeps rates finite


def contact_time(mass: float | np.ndarray, radius: float | np.ndarray = 0.0,
                 speed: float | np.ndarray = 0.0, uneven: float = FACES) -> np.ndarray:
    """
    Give how long a blow of hard bodies on masonry lasts [s]; its mean force is momentum over this.

    Of what is round Hertz' 2.87·(m² / (R·E*²·v))^(1/5) (Johnson 1985, Contact Mechanics, 11.4)
    with the radius R of a ball of that mass. Its dependence on speed, v^(-1/5), is left out. Flat
    faces meet on their highest points, too; what comes 1/2.94 of speed times duration closer (the
    same source) than these are high lies on a spring of stiffness 2·a·E* besides (3.4), on which a
    mass stays for half a period.

    :param mass: of what strikes, reduced with that of what it strikes if this gives way,
        1 / (1/m + 1/M) [kg]; inf = nothing moves, and the blow never ends.
    :param radius: a of the patch on which flat faces touch, that of a circle as large [m]; 0 =
        they touch in a point.
    :param speed: of approach [m/s].
    :param uneven: how high the highest points of the faces are [m].
    """
    mass = np.maximum(mass, _LIGHT)
    slow = CONTACT_TIME * cbrt(mass)
    closer = np.maximum(speed, _LIGHT) * slow / 2.94
    flat = np.asarray(radius) * np.maximum(1.0 - uneven / closer, 0.0)
    rate = np.sqrt(1.0 / (slow * slow) + 2.0 * flat * MODULUS / (np.pi * np.pi * mass))
    return np.divide(1.0, rate, out=np.full_like(rate, np.inf), where=rate > 0.0)
