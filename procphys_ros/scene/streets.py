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


"""Streets: placement of the houses and trees of a plan."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
import math

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND
from procphys_ros.errors import SceneError
from procphys_ros.geometry.linear import product
from procphys_ros.geometry.rotation import from_yaw, to_matrix
from procphys_ros.scene.plan import Row
from procphys_ros.scene.sources import Grammar


@dataclass(frozen=True)
class Lot:
    """
    One house or tree in its place.

    :ivar name: suffix to the name of the plan's object.
    :ivar blueprint: of it.
    :ivar position: where its origin goes, in the frame of the plan [m], (2,).
    :ivar yaw: its heading there [rad].
    """

    name: str
    blueprint: Blueprint
    position: np.ndarray
    yaw: float


def lay_out(rows: Sequence[Row], seed: int, load: Callable[[str], Grammar]) -> Iterator[Lot]:
    """
    Build and place the houses and trees of a plan.

    The fronts of houses, their sides of least y, face the street; houses stand side by side
    with a gap, each on its own width.

    :param rows: of the plan.
    :param seed: of the choice of grammars and defines, and of each grammar's random numbers.
    :param load: reads a grammar.
    :raises SceneError: when the houses of a row are wider than its street is long.
    """
    counts = {True: 0, False: 0}
    for number, row in enumerate(rows):
        rng = np.random.default_rng([seed, 24, number])
        along = row.first
        heading = row.street.heading + (0.0 if row.left else math.pi)
        for grammar, defines in row.choices(rng):
            name = f'{"house" if row.is_plots else "tree"}_{counts[row.is_plots]}'
            counts[row.is_plots] += 1
            own = int(rng.integers(2 ** 31))
            blueprint = load(grammar).build(seed=own, **defines)
            if not row.is_plots:
                place = row.street.place(along, row.beyond, row.left)
                yield Lot(name, blueprint, place, float(rng.uniform(-math.pi, math.pi)))
                along += row.gap
                continue
            low, high = plan_of(blueprint)
            width = high[0] - low[0]
            if along + width > row.street.length + 1e-6:
                raise SceneError(
                    f'{row.where}: {name} needs {along + width:.1f} m of a street that is '
                    f'{row.street.length:.1f} m long; make the street longer, or count smaller')
            front = np.array([0.5 * (low[0] + high[0]), low[1]])
            place = row.street.place(along + 0.5 * width, row.beyond, row.left)
            turn = to_matrix(from_yaw(heading))[:2, :2]
            yield Lot(name, blueprint, place - product(turn, front), heading)
            along += width + row.gap


def plan_of(blueprint: Blueprint) -> tuple[np.ndarray, np.ndarray]:
    """Compute the least and the largest x and y of the parts on the ground [m], (2,) each."""
    base = np.unique(blueprint.bonds[blueprint.bonds[:, 0] == GROUND, 1])
    base = base if len(base) else np.arange(len(blueprint))
    reach = 0.5 * np.abs(to_matrix(blueprint.poses[base, 3:])[:, :2]
                         * blueprint.size[base, None]).sum(axis=2)
    place = blueprint.poses[base, :2]
    return (place - reach).min(axis=0), (place + reach).max(axis=0)
