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
Reinforced bonds with cracked concrete: stress, yielding and rupture of the steel.

The steel lies near both faces of a section, z = 0.72 of its depth apart, and each layer yields at
s·A. The layer on the pulled side carries the moment over z and half of the normal force (EN
1992-1-1 6.1 with the concrete's pressure in the other layer), so that a section without normal
force yields at M = s·A·z and one without moment at N = 2·s·A.

A cracked section keeps a share of its stiffness. Where its steel yields it rotates at a constant
moment, approximated by halving that share event by event, a saw-tooth law (sequentially
linear analysis; Rots & Invernizzi 2004, Int. J. Numer. Anal. Meth. Geomech. 28, 83-96), until the
opening of the crack tears the steel.
"""

import numpy as np

from procphys_ros.compilation import subroutine
from procphys_ros.physics.masonry.graph import BondGraph

LEVER = 0.72     # z over the depth of the section: 0.9·d, with d = 0.8 of thin slabs and lintels
CRACKED = 0.25   # of the stiffness between two pieces remains after the crack: it softens a length
#                  equal to the depth of the section to I_cr/I = 0.07 (0.25 % of steel, α_e = 6),
#                  and pieces are some five times as long
_YIELDED = 0.5   # of the stiffness at each event of yielding
ELONGATION = 0.005  # [m] at which steel tears: ε_uk = 5 % (EN 1992-1-1 table C.1, class B) over
#                     the 0.1 m along which a bar slips beside a crack


@subroutine(inline='always')
def tie_stress(pull, bending):
    """
    Return the force of the tensile layer of steel over the area of the section [Pa].

    :param pull: normal force over the area, tension positive [Pa].
    :param bending: sum of the moments over their section moduli, A·e/6 [Pa].
    """
    return bending / (6.0 * LEVER) + 0.5 * pull


def give_way(graph: BondGraph, bonds: np.ndarray, wrench: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray]:
    """
    Compute the remaining share of stiffness of bonds that crack or whose steel yields.

    :param bonds: rows of reinforced bonds beyond their limit, (K,).
    :param wrench: of these, bond frame [N, N·m], (K, 6).
    :returns: share of its present stiffness, (K,), and whether the steel tears instead, (K,) bool.
    """
    whole = graph.held[bonds] == 1.0
    spring, depth = graph.spring[bonds], graph.extent[bonds][:, ::-1]
    opening = (np.maximum(wrench[:, 2], 0.0) / spring[:, 2]
               + LEVER * (depth * np.abs(wrench[:, 3:5]) / spring[:, 3:5]).sum(axis=1))
    return np.where(whole, CRACKED, _YIELDED), ~whole & (opening > ELONGATION)
