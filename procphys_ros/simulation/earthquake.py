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
Earthquakes: everything is computed in the frame of the ground, which is accelerated.

There, what is loose or grows feels gravity less the acceleration of the ground. Standing buildings
sway in their first modes, and their stresses are those of the static forces that bend them so.
"""

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.ground_motion import recorded, STILL, synthetic
from procphys_ros.physics.masonry.vibration import ShakenBuildings
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_SEED = 0x6571   # of synthetic motions, apart from other random numbers


def begin(model: Model, state: State, command: Earthquake) -> None:
    """
    Begin an earthquake, in the place of one that is under way; writes `state.shaking`.

    :raises CommandError: if it begins behind the end of its record.
    """
    record, own = model.settings.ground_record, state.shaking
    direction = np.array([*command.direction[:2], 0.0])
    direction /= norm(direction)
    if record:
        if command.start >= record[-1][0]:
            raise CommandError(f'earthquake.start is {command.start:g} s, the record of '
                               f'ground.motion ends at {record[-1][0]:g} s')
        own.motion = recorded(record, command.start, command.scale, direction)
    else:
        own.motion = synthetic(command.peak, command.duration, command.frequency,
                               command.damping, direction,
                               np.random.default_rng([_SEED, model.seed, command.seed]))
    own.began, own.acts = state.time, True


def shake(model: Model, state: State, dt: float) -> None:
    """
    Shake the ground for a step; writes `state.shaking`, loads, and what bodies and trees feel.

    Bodies do not fall asleep while what they feel changes.
    """
    own = state.shaking
    if not own.acts:
        return
    since = state.time - own.began
    felt = np.array([0.0, 0.0, -model.gravity])
    if since >= own.motion.duration:
        own.acts, own.motion, own.buildings = False, STILL, ShakenBuildings.none()
    else:
        felt -= own.motion.mean_acceleration(since, since + dt)
        _sway(model, state, since, dt)
    state.world.set_gravity(felt)
    state.forest.set_felt_gravity(felt)
    if state.trees.lod is not None:
        state.trees.lod.wake(np.arange(len(state.trees.lod.held)))


def _sway(model: Model, state: State, since: float, dt: float) -> None:
    """Let standing buildings sway, and strike them with what they have not borne before."""
    own, graph = state.shaking, state.solver.graph
    standing = np.flatnonzero(state.standing[:model.masonry.graph.count])
    if not len(standing):
        return
    modes = model.masonry.modes
    before, after = (own.motion.at(time)[0] for time in (since, since + dt))
    own.buildings.step(modes, before, after, dt)
    own.buildings.recall(modes.building[np.minimum(graph.first, graph.second)],
                         graph.cracked | ~graph.alive)
    rows, peaks = own.buildings.take_peaks(modes, after)
    struck = standing[np.isin(modes.building[standing], rows)]
    if len(struck):
        force = modes.forces(peaks, model.masonry.graph.mass)[struck]
        state.loads.add_blow(struck, np.hstack([force, np.zeros_like(force)]), 0.0,
                             concentrated=0.0)
