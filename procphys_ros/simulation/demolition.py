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


"""Demolition: charges in walls that are fired one after the other."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.errors import CommandError
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.masonry import cells
from procphys_ros.scene.placement import FOOTING
from procphys_ros.scene.strikes import Demolition
from procphys_ros.simulation import charges
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_BAND = (0.3, 2.0)  # [m] above the foot of a building, where charges are drilled
_SPACING = 1.1     # [m] between charges of the default plan, at least
_MARGIN = 1.1      # reach of a charge over the distance to its last brick, ...
_BEYOND = 0.02     # [m] ... and more
_SPREAD = 1.2      # [s] from the first charge, in the middle, to the last, at the corners


def arm(model: Model, state: State, plan: Demolition) -> int:
    """
    Schedule the charges of a plan.

    :param plan: if it is empty, charges are laid along the ground-floor walls.
    :returns: number of charges.
    :raises CommandError: if no building stands.
    """
    if not state.standing.any():
        raise CommandError('there is no building left to demolish')
    plan = plan if len(plan) else implosion(model, state)
    for delay, place, radius in zip(plan.delays, plan.places, plan.radii):
        state.charges.append((state.time + float(delay), place, float(radius)))
    state.charges.sort(key=lambda charge: charge[0])
    return len(plan)


def step(model: Model, state: State, dt: float) -> None:
    """Fire the charges due within the step; breaks and releases, see `charges`."""
    while state.charges and state.charges[0][0] < state.time + dt:
        _, place, radius = state.charges.pop(0)
        charges.fire(model, state, place, radius)


def implosion(model: Model, state: State) -> Demolition:
    """
    Lay charges along the walls of all ground floors, to be fired from the middle out.

    :raises CommandError: if no wall stands at the height of the charges.
    """
    source, standing = model.blueprint, state.standing[:len(model.blueprint)]
    low = source.poses[:, 2] - 0.5 * source.size[:, 2]
    graph = state.solver.graph
    on_ground = np.zeros(len(source) + 1, bool)
    for ends in (graph.first, graph.second):
        on_ground[ends[graph.grounded()]] = True
    foot = float(np.min(low[on_ground[:-1] & standing], initial=0.0))
    height = source.poses[:, 2] - foot
    if not model.terrain.is_flat:
        height = source.poses[:, 2] - _feet(model, low)
    chosen = np.flatnonzero(standing & (source.shape == Shape.BOX) & (height > _BAND[0])
                            & (height < _BAND[1]) & (source.mass < charges.HEAVY))
    if not len(chosen):
        raise CommandError('no wall stands between 0.3 and 2 m above the ground; give '
                           'demolition.positions')
    points = source.poses[chosen, :3]
    place = cells.nearest(points, points[cells.spread(points, _SPACING)])
    count = np.bincount(place)
    middles = np.column_stack([np.bincount(place, column) / count for column in points.T])
    away = norm(middles[:, :2] - middles[:, :2].mean(axis=0), axis=1)
    delays = _SPREAD * away / max(float(np.max(away)), 1e-9)
    reach = np.zeros(len(middles))  # such that no pier is left between two charges
    np.maximum.at(reach, place,
                  norm(points - middles[place], axis=1))
    return Demolition(delays.tolist(), middles.ravel().tolist(),
                      (_MARGIN * reach + _BEYOND).tolist())


def _feet(model: Model, low: np.ndarray) -> np.ndarray:
    """Return the foot of the building that each part belongs to, above its footings [m], (N,)."""
    source = model.blueprint
    footing = np.array([kind == FOOTING for kind in source.kinds])[source.kind]
    height = np.where(footing, np.inf, low)
    feet = [height[thing.first:][:thing.count].min(initial=np.inf) for thing in model.objects]
    return np.repeat(feet, [thing.count for thing in model.objects])
