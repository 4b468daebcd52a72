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
Sources of dust: emission per energy dissipated by fracture and impacts.

Bond's third law (Bond 1952, Trans. AIME 193:484) is the energy of a mill that grinds coarse
material below 100 µm, its losses included. Rubble is less efficient: most of its energy goes into
friction and crushed edges, and most of the fines stay between the stones.
"""

import numpy as np

_WORK_INDEX = 13.5 * 3.6e6 / 907.2  # [J/kg] cement clinker, 13.5 kWh per short ton (Bond 1961)
_AIRBORNE = 0.05  # airborne share of the fines of a mill; our choice, by visual judgement
DUST_PER_ENERGY = _AIRBORNE / _WORK_INDEX  # [kg/J], of grains of which 80 % pass 100 µm


def lost_energy(before: np.ndarray, after: np.ndarray, gained: float) -> np.ndarray:
    """
    Distribute the energy dissipated by collisions over the bodies that lost energy [J], (K,).

    A loss of one body may be a gain of another; only the net loss has been dissipated, and is
    distributed in proportion to the losses.

    :param before: energy of each body before the collisions [J], (K,).
    :param after: the same afterwards [J], (K,).
    :param gained: energy of bodies that did not move before [J].
    """
    change = before - after
    lost = np.maximum(change, 0.0)
    total = lost.sum()
    spent = min(max(change.sum() - gained, 0.0), total)
    return lost * (spent / total) if total > 0.0 else lost
