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
Contact work: bound the work of tree contacts by what undoing overlaps takes.

An impulse J does the work J·(v₀ + v₁)/2, v being the velocity at which what touches moves apart.
Contacts are solved for v₁ alone. A stiff twig that swings to and fro within a step may have a v₀
along J: friction that stops it at the end of the step then gives it energy. So may a bend that is
let go by an impulse, whose tree answers in another way than it was solved for.
"""

import numpy as np

from procphys_ros.physics.touch import islands, Partners, slips
from procphys_ros.physics.trees import ContactResponse

_ROUNDING = 1e-5  # [J/kg] gain allowed per step
_SOLVED = 0.02    # relative accuracy of the solution of contacts


def too_much(partners: Partners, look: ContactResponse, free: np.ndarray, impulse: np.ndarray,
             normal: np.ndarray, out: np.ndarray, mass: np.ndarray, gain: float) -> np.ndarray:
    """
    Find the contacts of islands that gain energy.

    :param impulse: on the trees [N·s], (C, 3).
    :param normal: (C, 3).
    :param out: speed at which overlaps are undone [m/s], (C,).
    :param mass: of the trees at each contact [kg], (C,).
    :param gain: speed that weight gives in the step [m/s].
    :returns: (C,) bool.
    """
    share = look.old_share[:, None]
    mean = share * look.before + (1.0 - share) * look.velocity
    way = slips(partners._replace(motion=0.5 * (free + partners.motion)), mean)
    work = (impulse * way).sum(axis=1)
    if not (work > _ROUNDING * mass).any():
        return np.zeros(len(work), bool)
    island = islands(partners, look.place, len(look.velocity))
    total = np.bincount(island, work)
    lifted = np.bincount(island, np.maximum((impulse * normal).sum(axis=1), 0.0) * out)
    heaviest, fastest = np.zeros(len(total)), np.zeros(len(total))
    np.maximum.at(heaviest, island, mass)
    np.maximum.at(fastest, island, out)
    loose, row = np.unique(partners.body, return_index=True)
    loose, row = loose[loose >= 0], row[loose >= 0]
    inverse = partners.inverse_mass[loose]
    yields = inverse > 0.0
    np.add.at(heaviest, island[row[yields]], 1.0 / inverse[yields])
    allowed = np.minimum(lifted, heaviest * fastest * (0.5 * fastest + gain))
    slack = _ROUNDING * heaviest + _SOLVED * np.bincount(island, np.abs(work))
    return (total > allowed + slack)[island]
