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

"""Wind on rubble: wake resting bodies that the wind can slide or topple."""

import numpy as np

from procphys_ros.geometry.linear import norm
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.world import BodyState
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_INTERVAL = 0.1  # [s] between checks
_FASTEST = 120.0  # [m/s] above any wind


def step(model: Model, state: State, dt: float) -> None:
    """Wake resting bodies that the wind can move; writes bodies."""
    if int(state.time / _INTERVAL + 1e-6) == int((state.time + dt) / _INTERVAL + 1e-6):
        return
    bodies = state.world.bodies
    resting = np.flatnonzero(bodies.state == BodyState.RESTING)
    resting = resting[resting < len(state.bodies.drag_area)]
    least = holding_wind(bodies.mass[resting] * model.gravity, bodies.friction[resting],
                         bodies.bounds[resting], state.bodies.drag_area[resting])
    light = least < _FASTEST
    resting, least = resting[light], least[light]
    if not len(resting):
        return
    air = state.wind.velocity(bodies.poses[resting, :3], state.time)
    state.world.thaw(resting[norm(air, axis=1) > least])


def holding_wind(weight: np.ndarray, friction: np.ndarray, bounds: np.ndarray,
                 drag_area: np.ndarray) -> np.ndarray:
    """
    Return the wind speed at which bodies on level ground begin to slide or topple [m/s], (K,).

    The drag ½ ρ Cd A v² acts at half the height, and the weight at the middle of the base.

    :param weight: [N], (K,).
    :param friction: Coulomb coefficient, (K,).
    :param bounds: axis-aligned [m], (K, 6).
    :param drag_area: Cd A [m²], (K,).
    """
    extent = bounds[:, 3:] - bounds[:, :3]
    slender = extent[:, :2].min(axis=1) / np.maximum(extent[:, 2], 1e-9)
    most = weight * np.minimum(friction, slender)
    return np.sqrt(most / np.maximum(0.5 * AIR_DENSITY * drag_area, 1e-12))
