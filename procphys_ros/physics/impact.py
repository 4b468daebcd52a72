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

# [s/kg^(1/3)] Hertz' contact of compact lumps of 1900 kg/m³ at 3 m/s, whose time grows with their
# size, with E* = 0.5 GPa: a tenth of that of whole bricks, because edges and mortar crush. A brick
# of 3 kg is in contact for 2 ms, a ball of 2 t for 18 ms.
CONTACT_TIME = 1.4e-3


def contact_time(mass: float | np.ndarray) -> np.ndarray:
    """
    Give how long a blow of hard bodies on masonry lasts [s]; its mean force is momentum over this.

    Hertz' 2.87·(m² / (R·E*²·v))^(1/5) (Johnson 1985, Contact Mechanics, 11.4) with the radius R of
    a ball of that mass. Its dependence on speed, v^(-1/5), is left out.

    :param mass: of what strikes, reduced with that of what it strikes if this gives way,
        1 / (1/m + 1/M) [kg]; inf = nothing moves, and the blow never ends.
    """
    return CONTACT_TIME * cbrt(mass)
