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

"""Fracture energy: work per area to separate a mortar joint, by failure mode."""

import numpy as np

from procphys_ros.physics.causes import Cause

# Joints of the shear walls J4D and J5D, f_t = 0.25 MPa, c = 0.35 MPa (Lourenço 1996, Computational
# strategies for masonry structures, TU Delft).
OPENING = 18.0   # [J/m²] mode I
SHEARING = 125.0  # [J/m²] mode II
# 15 + 0.43·f - 0.0036·f² N/mm at f = 10 MPa (CEB-FIP Model Code 90, taken over for masonry by
# Lourenço).
CRUSHING = 18.9e3  # [J/m²]

BY_CAUSE = np.full(len(Cause), OPENING)  # [J/m²]
BY_CAUSE[[Cause.SHEAR, Cause.IMPACT, Cause.BLAST, Cause.DEMOLITION]] = SHEARING  # torn out
BY_CAUSE[Cause.COMPRESSION] = CRUSHING
