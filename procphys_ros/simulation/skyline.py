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


"""Skyline: the outline of what stands, on which leaves and dust come down."""

import numpy as np

from procphys_ros.physics.skyline import Skyline
from procphys_ros.physics.touch import piece_bounds
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_PATIENCE = 0.25  # [s] that an outline stays in use while a building collapses


def current(model: Model, state: State) -> Skyline:
    """Return the present skyline; it is the same object while nothing has changed."""
    own = state.skyline
    if own.drawn is None or state.time > own.looked + _PATIENCE - 1e-9:
        own.looked = state.time
        standing = state.standing[:len(model.blueprint)]
        if own.drawn is None or not np.array_equal(standing, own.standing):
            own.standing, own.drawn = standing, _draw(model, np.flatnonzero(standing))
    return own.drawn


def _draw(model: Model, parts: np.ndarray) -> Skyline:
    source = model.blueprint
    return Skyline.over(piece_bounds(
        source.shape[parts].astype(np.uint8), source.poses[parts], source.solid_size(parts),
        np.zeros((len(parts), 6)), 0.0, 0.0), model.terrain)
