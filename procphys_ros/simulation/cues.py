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


"""Cues: commands that a scene executes by itself at given times."""

import logging

from procphys_ros.errors import CommandError
from procphys_ros.simulation import commands
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_LOG = logging.getLogger(__name__)
_EARLY = 1e-9  # [s] rounding of times that are sums of steps


def step(model: Model, state: State, dt: float) -> None:
    """
    Execute the cues that are due; writes what their commands write.

    A refused cue is reported in the log, and the scene goes on.
    """
    cues = model.settings.cues
    while state.cue < len(cues) and cues[state.cue].time <= state.time + _EARLY:
        cue = cues[state.cue]
        state.cue += 1
        try:
            commands.apply(model, state, cue.what)
        except CommandError as error:
            _LOG.warning('scene.cues: "%s" was refused: %s', cue.text, error)
