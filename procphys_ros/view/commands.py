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


"""Commands of a page about time and scenes; those about physics are the simulation's own."""

from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.simulation.commands import Impulse


@dataclass(frozen=True)
class SetPause:
    """Stop time, or let it run again."""

    paused: bool


@dataclass(frozen=True)
class Step:
    """Run one step while paused."""


@dataclass(frozen=True)
class Reset:
    """Put everything back to rest and whole."""


@dataclass(frozen=True)
class Undo:
    """Go back to the moment before the last click, gust or reset."""


@dataclass(frozen=True)
class SetSpeed:
    """Ask for a real-time factor; 0 = as fast as possible."""

    factor: float


@dataclass(frozen=True)
class StartGust:
    """Send a gust of this amplitude [m/s] through the scene."""

    amplitude: float


@dataclass(frozen=True)
class Inspect:
    """Answer what the part of this index carries."""

    part: int


@dataclass(frozen=True)
class LoadScene:
    """Put the scene of a file in place of the present one."""

    path: Path


CLICKS = (Inspect, Undo, Impulse, Projectile, Explosion)  # what is done to what a page shows
UNDONE = (Impulse, Projectile, Explosion, StartGust, Reset)  # what `Undo` takes back


def drop_clicks(waiting: Queue[Any]) -> None:
    """Take clicks out of what waits: they were meant for the scene that was shown then."""
    others = []
    try:
        while True:
            command = waiting.get_nowait()
            if not isinstance(command, CLICKS):
                others.append(command)
    except Empty:
        pass
    for command in others:
        waiting.put(command)
