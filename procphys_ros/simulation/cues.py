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


"""Stage manager of a scene: makes its cues happen when their time has come."""

from collections.abc import Callable, Sequence
import logging
from typing import Any

from procphys_ros.errors import CommandError
from procphys_ros.physics.wind import Gust
from procphys_ros.scene.cues import Blow, Cue
from procphys_ros.scene.strikes import Demolition, Explosion, Projectile

_LOG = logging.getLogger(__name__)
_EARLY = 1e-9  # [s] rounding of times that are sums of steps
_ACTS: dict[type, Callable[[Any, Any], Any]] = {
    Gust: lambda simulation, gust: simulation.gust(gust),
    Blow: lambda simulation, blow: simulation.apply_impulse(blow.target, blow.linear,
                                                            blow.angular),
    Projectile: lambda simulation, projectile: simulation.launch(projectile),
    Explosion: lambda simulation, blast: simulation.explode(blast.position, blast.charge),
    Demolition: lambda simulation, demolition: simulation.demolish(demolition),
}


class Cues:
    """
    Plays the cues of a scene.

    :param cues: in the order of their times.
    """

    def __init__(self, cues: Sequence[Cue]):
        self._cues = cues
        self.reset()

    def reset(self) -> None:
        """Begin with the first cue again."""
        self._next = 0

    def play(self, simulation: Any) -> None:
        """
        Do what is due; a cue that is refused is told in the log, and the play goes on.

        :param simulation: whose time has come.
        """
        while (self._next < len(self._cues)
               and self._cues[self._next].time <= simulation.time + _EARLY):
            cue = self._cues[self._next]
            self._next += 1
            try:
                _ACTS[type(cue.what)](simulation, cue.what)
            except CommandError as error:
                _LOG.warning('scene.cues: "%s" was refused: %s', cue.text, error)
