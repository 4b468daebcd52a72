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
Strength of mortar bonds: Mohr-Coulomb with a tension cut-off and a compression cap.

Rigid parts on a bed of springs: the normal stress is linear over the patch, its extremes are
N/A ± M_x/W_x ± M_y/W_y with W_x = A·e_y/6, and the twist adds T·r/(I_x + I_y) at the corner to the
mean shear. Limits after Lourenço & Rots 1997, J. Eng. Mech. 123(7): σ <= f_t, |τ| <= c + μ·p with
p the mean compression, compression <= f_c. Utilisation is demand over capacity where compression
counts as capacity, so that it stays finite and equals 1 exactly on the limit:

    tension      bending stress / (f_t + p), for a pulled bond (N/A + bending stress) / f_t
    shear        |τ| / (c + μ·p), pulled c - μ·N/A down to its value at the cut-off
    compression  (p + bending stress) / f_c

With f_t = 0 the first is eccentricity over kern: a dry bed opens once the resultant leaves the
middle third. `fracture.Fracture` decides what happens to bonds beyond a limit. In reinforced bonds
(`ties`) the yielding of steel replaces the first limit once they have cracked.
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry.graph import BondGraph, HUB
from procphys_ros.physics.masonry.members import with_largest_moments
from procphys_ros.physics.masonry.ties import tie_stress

_TENSION, _COMPRESSION = int(Cause.TENSION), int(Cause.COMPRESSION)  # for kernels
_LEAST = 1.0        # [Pa], keeps the utilisation of a bond without strength and pressure finite
_LIGAMENT = 0.05    # least share of the whole side that may stay closed: less is crushed
_BLOCK = 1e-3       # of the side of the patch: least side of the block under the resultant
_MARGIN = 0.95      # of the side that balances the resultant: utilisation 0.9 once opened


@subroutine
def _crush(wrench, extent, compression):
    """
    Return the utilisation in compression of a cracked joint: pressure over block strength.

    The block is rectangular, uniformly stressed and centred on the resultant (EN 1996-1-1, 6.1.2).
    """
    if not wrench[2] < 0.0:
        return 0.0
    length = max(extent[0] - 2.0 * abs(wrench[4] / wrench[2]), _BLOCK * extent[0])
    width = max(extent[1] - 2.0 * abs(wrench[3] / wrench[2]), _BLOCK * extent[1])
    return -wrench[2] / (compression * length * width)


@subroutine
def _is_free(wrench):
    """Return whether a bond is unloaded, as in fallen islands."""
    free = True
    for c in range(6):
        free &= wrench[c] == 0.0
    return free


@kernel
def _utilise(alive, cracked, held, wrench, area, extent, tension, cohesion, friction, compression,
             reinforcement, out, cause):
    for m in range(len(alive)):
        out[m] = 0.0
        cause[m] = _TENSION
        if not alive[m]:
            continue
        if cracked[m]:
            out[m] = _crush(wrench[m], extent[m], compression[m])
            cause[m] = _COMPRESSION
            continue
        if _is_free(wrench[m]):
            continue
        pull = wrench[m, 2] / area[m]
        press = max(-pull, 0.0)
        bending = 6.0 / area[m] * (abs(wrench[m, 3]) / extent[m, 1]
                                   + abs(wrench[m, 4]) / extent[m, 0])
        across = np.sqrt(extent[m, 0] ** 2 + extent[m, 1] ** 2)
        shear = (np.sqrt(wrench[m, 0] ** 2 + wrench[m, 1] ** 2)
                 + 6.0 * abs(wrench[m, 5]) / across) / area[m]
        opening = (bending + max(pull, 0.0)) / max(tension[m] + press, _LEAST)
        if held[m] < 1.0:
            opening = tie_stress(max(pull, 0.0), bending) / (reinforcement[m] + 0.5 * press)
        share = (
            opening,
            shear / max(cohesion[m] - friction[m] * min(pull, tension[m]), _LEAST),
            (press + bending) / compression[m],
        )
        for c in range(3):
            if share[c] > out[m]:
                out[m] = share[c]
                cause[m] = _TENSION + c  # tension, shear, compression: consecutive numbers


def utilisation(graph: BondGraph, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Compute the utilisation of bonds: load over strength.

    Joints of reinforced members are checked for the moments within adjacent pieces (`members`).

    :param graph: areas, extents and strengths.
    :param wrench: force and moment in the bond frame, tension positive [N, N·m], (M, 6).
    :returns: utilisation, 1 at the limit, 0 for dead bonds, (M,), and governing limit,
        `causes.Cause`, (M,) uint8.
    """
    wrench = with_largest_moments(graph.pieces, graph.alive, graph.centroid, graph.axes, wrench)
    share = np.empty(len(graph))
    cause = np.empty(len(graph), np.uint8)
    mortar = graph.mortar
    _utilise(graph.alive, graph.cracked, graph.held, wrench, graph.area, graph.extent,
             mortar.tension, mortar.cohesion, mortar.friction, mortar.compression,
             mortar.reinforcement, share, cause)
    return share, cause


@subroutine
def _closed(wrench, extent):
    """Compute eccentricity and closed length of a pressed bond, along x, then along y [m]."""
    x, y = wrench[4] / -wrench[2], wrench[3] / wrench[2]
    kern_x, kern_y = 6.0 * abs(x) / extent[0], 6.0 * abs(y) / extent[1]  # 1: edge of middle third
    more = (kern_x + kern_y) / max(kern_x, kern_y, 1e-12)
    return (x, min(_MARGIN * 0.5 * (3.0 - kern_x * more), 1.0) * extent[0],
            y, min(_MARGIN * 0.5 * (3.0 - kern_y * more), 1.0) * extent[1])


@subroutine
def stays_closed(wrench, extent, whole_extent):
    """Return whether a bond beyond its edge tension stays partly closed, see `opening`."""
    if not wrench[2] < 0.0:
        return False
    _, x, _, y = _closed(wrench, extent)
    return x > _LIGAMENT * whole_extent[0] and y > _LIGAMENT * whole_extent[1]


@kernel
def _open(bonds, wrench, extent, whole_extent, stays, low, high):
    for k in range(len(bonds)):
        m = bonds[k]
        stays[k] = stays_closed(wrench[k], extent[m], whole_extent[m])
        low[k] = -0.5 * extent[m]
        high[k] = 0.5 * extent[m]
        if not stays[k]:
            continue
        x, length, y, width = _closed(wrench[k], extent[m])
        for c, eccentricity, closed in ((0, x, length), (1, y, width)):
            if eccentricity > 0.0:
                low[k, c] = high[k, c] - closed
            else:
                high[k, c] = low[k, c] + closed


def opening(graph: BondGraph, bonds: np.ndarray,
            wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Compute the cracked section of bonds whose edge tension exceeds the limit.

    A bond in tension breaks. A bond in compression opens from its tensile edge until the pressure,
    linear without tension, balances the resultant: it stays closed over 3·(e/2 - eccentricity)
    from the pressed edge (elementary theory of the no-tension section), less a margin so that
    opening terminates. With eccentricity along both sides, each side opens as if the other's
    eccentricity were added in proportion, a conservative estimate. If almost nothing stays closed,
    or the resultant is outside the patch, the bond breaks.

    :param bonds: rows, (K,).
    :param wrench: of these bonds, bond frame, (K, 6).
    :returns: whether each bond stays partly closed, (K,) bool, and the lower and upper corners of
        the closed part, the whole patch where the bond breaks, from the centroid in the bond
        frame [m], (K, 2) each.
    """
    stays = np.empty(len(bonds), bool)
    low, high = np.empty((2, len(bonds), 2))
    _open(np.asarray(bonds, np.intp), np.ascontiguousarray(wrench, float), graph.extent,
          graph.whole_extent, stays, low, high)
    return stays, low, high


def worst_first(graph: BondGraph, share: np.ndarray, band: float,
                hopeless: float = np.inf) -> np.ndarray:
    """
    Choose the bonds to break before stresses are solved again.

    The worst bond breaks, and with it every overloaded bond that is within `band` of it, or
    hopeless, and is worse than all others two bonds away: far enough that breaking the worst
    relieves it little. The others wait at any overload: lasting loads grow until the first
    bond breaks, so the state in which lesser bonds are overloaded is never reached.

    :param share: utilisation, (M,).
    :param band: least utilisation relative to the worst; 1 breaks the worst alone.
    :param hopeless: utilisation that the breaking of other bonds does not bring below 1.
    :returns: rows of bonds, ascending.
    """
    over = np.flatnonzero(share > 1.0)
    if not len(over):
        return over
    peak = np.zeros(graph.count + 1)
    np.maximum.at(peak, graph.first[over], share[over])
    np.maximum.at(peak, graph.second[over], share[over])
    far = np.append(np.diff(graph.start) > HUB, True)
    peak[far] = 0.0  # bonds that share only the ground or a slab are not near each other
    around = np.maximum(peak[graph.first[over]], peak[graph.second[over]])
    wider = np.zeros(graph.count + 1)
    np.maximum.at(wider, graph.first[over], around)
    np.maximum.at(wider, graph.second[over], around)
    wider[far] = 0.0
    around = np.maximum(around, np.maximum(wider[graph.first[over]], wider[graph.second[over]]))
    least = min(band * share[over].max(), hopeless)
    return over[(share[over] >= around) & (share[over] >= least)]
