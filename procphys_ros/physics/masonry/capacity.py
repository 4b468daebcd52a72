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


"""What it takes to tear parts out of a bond graph: force, momentum, energy."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.solver import StressSolver
from procphys_ros.physics.masonry.ties import ELONGATION

# Work to separate a mortar joint, per area: Lourenço 1996, Computational Strategies for Masonry
# Structures (Delft), parameters of the shear walls with f_t = 0.25 MPa, c = 0.35 MPa.
FRACTURE_ENERGY_TENSION = 18.0   # [J/m²], mode I
FRACTURE_ENERGY_SHEAR = 125.0    # [J/m²], mode II


@dataclass(frozen=True)
class Resistance:
    """
    What a set of parts withstands before it comes out along a direction.

    Tearing out takes both: a blow whose momentum over its duration (`impact.contact_time`) exceeds
    `force`, and `energy`, which is lost by what strikes.

    :ivar bonds: rows of the living bonds around the set, (K,).
    :ivar force: sum of what these bonds carry at failure [N].
    :ivar energy: work of fracture, and of rubbing until the faces have left each other [J].
    :ivar rubbing: the latter alone [J].
    """

    bonds: np.ndarray
    force: float
    energy: float
    rubbing: float = 0.0


def _at_failure(graph: BondGraph, bonds: np.ndarray, inside: np.ndarray,
                direction: np.ndarray, wrench: np.ndarray
                ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Give the force and the work at which bonds fail when one side is driven along a direction.

    The drive splits into pulling apart, pushing together and sliding; each meets its own limit
    (`strength`), with the pressure that is already there, and pushing together raises friction.
    What slides on rubs with that pressure over the length of its patch, which shrinks meanwhile:
    half of friction times length is spent.

    :param bonds: rows, (K,).
    :param inside: whether the driven side is the first part, (K,) bool.
    :param direction: unit vectors, world, (3,), or one for each bond, (K, 3).
    :param wrench: what the bonds carry now, bond frame, (K, 6).
    :returns: force [N], work of fracture and of rubbing [J], (K,) each.
    """
    mortar, area = graph.mortar, graph.area[bonds]
    outward = np.where(inside[:, None], graph.axes[bonds, :, 2], -graph.axes[bonds, :, 2])
    ahead = np.clip((outward * np.asarray(direction, float)).sum(axis=1), -1.0, 1.0)
    push, pull = np.maximum(ahead, 0.0), np.maximum(-ahead, 0.0)
    slide = np.sqrt(1.0 - ahead ** 2)
    pressure = -wrench[:, 2] / area
    friction = mortar.friction[bonds]
    whole = ~graph.cracked[bonds]  # cracked joints only rub, and have taken their work already
    shear = np.maximum(whole * mortar.cohesion[bonds] + friction * pressure, 0.0)
    steel = 2.0 * mortar.reinforcement[bonds]
    concrete = (graph.held[bonds] == 1.0) * mortar.tension[bonds]
    tension = np.maximum(whole * np.maximum(concrete, steel) + pressure, 0.0)
    crush = np.maximum(mortar.compression[bonds] - pressure, 0.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        limits = np.array([
            np.where(pull > 1e-9, tension / pull, np.inf),
            np.where(push > 1e-9, crush / push, np.inf),
            np.where(slide > friction * push - friction * pull + 1e-9,
                     shear / (slide - friction * push + friction * pull), np.inf)])
    work = (FRACTURE_ENERGY_TENSION * pull ** 2
            + FRACTURE_ENERGY_SHEAR * (slide ** 2 + push ** 2)
            + steel * ELONGATION * (pull ** 2 + slide ** 2))
    along = np.asarray(direction, float)[..., None]
    reach = np.abs((graph.axes[bonds, :, :2] * along).sum(axis=1))
    length = np.einsum('bi,bi->b', reach, graph.extent[bonds])
    rubbing = 0.5 * friction * np.maximum(pressure, 0.0) * slide ** 2 * length
    return limits.min(axis=0) * area, whole * work * area, rubbing * area


def resistance(solver: StressSolver, parts: np.ndarray, direction: np.ndarray) -> Resistance:
    """
    Give what a set of parts withstands when it is struck along a direction.

    All bonds around the set fail together at their limits, with the stresses that they carry
    now: an upper bound, close for brittle joints of like size around a brick or two.

    :param solver: knows the bonds and their stresses.
    :param parts: the struck parts, they move as one, (K,).
    :param direction: unit vector of the blow, world, (3,).
    """
    graph = solver.graph
    bonds = graph.boundary(parts)
    driven = np.zeros(graph.count + 1, bool)
    driven[parts] = True
    inside = driven[graph.first[bonds]]
    force, work, rubbing = _at_failure(graph, bonds, inside, direction, solver.wrenches(bonds))
    return Resistance(bonds, float(force.sum()), float(work.sum() + rubbing.sum()),
                      float(rubbing.sum()))


def resistances(solver: StressSolver, parts: np.ndarray,
                directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Give what parts withstand that are struck one by one, as `resistance` does for sets.

    :param solver: knows the bonds and their stresses.
    :param parts: struck, (K,).
    :param directions: unit vectors of the blows, world, (K, 3).
    :returns: force [N] and energy [J] of each, (K,).
    """
    graph = solver.graph
    count = graph.start[parts + 1] - graph.start[parts]
    blow = np.repeat(np.arange(len(parts)), count)
    bonds = graph.incident[np.arange(len(blow)) + np.repeat(
        graph.start[parts] - np.cumsum(count) + count, count)]
    living = graph.alive[bonds]
    blow, bonds = blow[living], bonds[living]
    force, work, rubbing = _at_failure(graph, bonds, graph.first[bonds] == parts[blow],
                                       directions[blow], solver.wrenches(bonds))
    return (np.bincount(blow, force, len(parts)),
            np.bincount(blow, work + rubbing, len(parts)))
