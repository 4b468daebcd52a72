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
Sources of dust: how much rises for the energy that breaking and hitting set free.

Bond's third law (Bond 1952, Trans. AIME 193:484) gives what a mill takes to bring coarse stuff
below 100 µm, its losses included. Rubble is no mill: most of what it loses goes into friction and
crushed edges, and most of what is ground stays between the stones.
"""

import numpy as np

_WORK_INDEX = 13.5 * 3.6e6 / 907.2  # [J/kg] cement clinker, 13.5 kWh per short ton (Bond 1961)
_AIRBORNE = 0.05  # share of what a mill would grind that rises; our choice, by the look of it
DUST_PER_ENERGY = _AIRBORNE / _WORK_INDEX  # [kg/J], of grains of which 80 % pass 100 µm


def lost_energy(before: np.ndarray, after: np.ndarray, gained: float) -> np.ndarray:
    """
    Share out among bodies the energy that vanished when they met [J], (K,).

    What one body loses another may gain; only the balance over all has been spent, and every
    loser gets its share of it.

    :param before: energy of each body before it met others [J], (K,).
    :param after: the same afterwards [J], (K,).
    :param gained: what bodies have that did not move before [J].
    """
    change = before - after
    lost = np.maximum(change, 0.0)
    total = lost.sum()
    spent = min(max(change.sum() - gained, 0.0), total)
    return lost * (spent / total) if total > 0.0 else lost
