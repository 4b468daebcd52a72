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


"""Scenes at rest: the state that a simulation starts from."""

import numpy as np

from procphys_ros.physics.wind import WindSettings
from procphys_ros.simulation import climbers, fragments, leaning, masonry
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State


def at_rest(model: Model, wind: WindSettings | None = None) -> tuple[State, list[str]]:
    """
    Put a scene at rest, with its trees in the initial wind.

    :param wind: replaces the scene's wind settings.
    :returns: the state, after the collapse of parts that cannot carry their weight, and warnings
        about it.
    """
    state = State.initial(model)
    if wind is not None and wind != state.wind.settings:
        state.wind.change(wind)
        state.wind.reset()
    bricks = np.flatnonzero(state.standing)
    if len(bricks):
        source = model.blueprint
        state.parts.body[bricks] = state.world.add_bricks(
            source.poses[bricks], source.size[bricks], source.mass[bricks],
            hexahedra=source.hexahedra.among(bricks), inertia=source.inertia[bricks])
    for part in np.flatnonzero(state.parts.owner == Owner.BODY):
        fragments.make_body(model, state, np.array([part]), state.parts.poses[[part]],
                            np.zeros((1, 6)))
    leaning.lean(model, state)
    climbers.load_walls(model, state)
    state.loads.apply(state.solver, 0.0)
    lines = masonry.settle(model, state)
    state.dust.seen = state.log.total
    return state, lines
