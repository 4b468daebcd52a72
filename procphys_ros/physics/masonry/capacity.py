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


"""Capacity: the force, momentum and energy that tear parts out of a bond graph."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics import fracture_energy
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.ties import ELONGATION

REACH = 1.0  # [m] from the struck parts, within which they drive others: the thickest walls;
#              masonry further away is the abutment that the joints are crushed against


@dataclass(frozen=True)
class Resistance:
    """
    Resistance of a set of parts to being torn out along a direction.

    Tearing out takes both: a blow whose momentum over its duration (`impact.contact_time`) exceeds
    `force`, and `energy`, which the striking body loses.

    :ivar bonds: rows of the living bonds around the set, (K,).
    :ivar force: sum of the failure loads of these bonds [N].
    :ivar energy: work of fracture, and of friction until the faces have separated [J].
    :ivar rubbing: work of friction alone [J].
    """

    bonds: np.ndarray
    force: float
    energy: float
    rubbing: float = 0.0


@subroutine
def fails(m, sign, direction, wrench, joints, strength):
    """
    Return failure load and work of a bond one side of which is driven along a direction.

    The drive splits into opening, closing and sliding; each has its own limit (`strength`) under
    the present pressure, and closing raises friction.
    Crushed bonds take the work of crushing, cracked or not.
    Sliding bonds rub under that pressure over the length of the patch, which shrinks meanwhile:
    the work is half of friction times length.

    :param m: row of the bond.
    :param sign: 1 where the driven side is the first part, else -1.
    :param direction: unit vector, world, (3,).
    :param wrench: present wrench of the bond, bond frame, (6,).
    :param joints, strength: from `joints_of`.
    :returns: force [N], work of fracture and of friction [J].
    """
    axes, area, extent, cracked, held = joints
    tension, cohesion, friction, compression, reinforcement = strength
    ahead = sign * (axes[m, 0, 2] * direction[0] + axes[m, 1, 2] * direction[1]
                    + axes[m, 2, 2] * direction[2])
    ahead = min(max(ahead, -1.0), 1.0)
    push, pull = max(ahead, 0.0), max(-ahead, 0.0)
    slide = np.sqrt(1.0 - ahead ** 2)
    pressure = -wrench[2] / area[m]
    whole = 0.0 if cracked[m] else 1.0  # cracked joints only rub; their work has been done
    steel = 2.0 * reinforcement[m]
    concrete = tension[m] if held[m] == 1.0 else 0.0
    limit = np.inf
    if pull > 1e-9:
        limit = max(whole * max(concrete, steel) + pressure, 0.0) / pull
    crushed = False
    if push > 1e-9:
        limit, crushed = min(limit, max(compression[m] - pressure, 0.0) / push), True
    against = friction[m] * (push - pull)
    if slide > against + 1e-9:
        shear = max(whole * cohesion[m] + friction[m] * pressure, 0.0) / (slide - against)
        if shear < limit:
            limit, crushed = shear, False
    pressed = fracture_energy.CRUSHING if crushed else whole * fracture_energy.SHEARING
    work = pressed * push ** 2 + whole * (
        fracture_energy.OPENING * pull ** 2 + fracture_energy.SHEARING * slide ** 2
        + steel * ELONGATION * (pull ** 2 + slide ** 2))
    length = 0.0
    for c in range(2):
        length += extent[m, c] * abs(axes[m, 0, c] * direction[0] + axes[m, 1, c] * direction[1]
                                     + axes[m, 2, c] * direction[2])
    rubbing = 0.5 * friction[m] * max(pressure, 0.0) * slide ** 2 * length
    return limit * area[m], work * area[m], rubbing * area[m]


@kernel
def _fail(bonds, inside, directions, wrench, joints, strength, out):
    for k in range(len(bonds)):
        sign = 1.0 if inside[k] else -1.0
        out[0, k], out[1, k], out[2, k] = fails(bonds[k], sign, directions[k], wrench[k], joints,
                                                strength)


def joints_of(graph: BondGraph) -> tuple[tuple, tuple]:
    """Return the arrays of bonds and of their strengths that kernels take."""
    mortar = graph.mortar
    return ((graph.axes, graph.area, graph.extent, graph.cracked, graph.held),
            (mortar.tension, mortar.cohesion, mortar.friction, mortar.compression,
             mortar.reinforcement))


def at_failure(graph: BondGraph, bonds: np.ndarray, inside: np.ndarray,
               directions: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Return failure load [N], work of fracture and of friction [J] of some bonds, (3, K)."""
    out = np.empty((3, len(bonds)))  # the copy: a view of one row would be read-only, another type
    _fail(np.asarray(bonds, np.int64), inside,
          np.array(np.broadcast_to(directions, (len(bonds), 3)), float, order='C'), wrench,
          *joints_of(graph), out)
    return out
