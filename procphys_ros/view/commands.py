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

from procphys_ros.scene.strikes import Cut, Explosion, Projectile
from procphys_ros.simulation.commands import Impulse


@dataclass(frozen=True)
class SetPause:
    """Pause or resume the simulation."""

    paused: bool


@dataclass(frozen=True)
class Step:
    """Run one step while paused."""


@dataclass(frozen=True)
class Reset:
    """Reset everything to rest and undamaged."""


@dataclass(frozen=True)
class Undo:
    """Restore the state before the last click, gust, earthquake or reset."""


@dataclass(frozen=True)
class SetSpeed:
    """Set the real-time factor; 0 = as fast as possible."""

    factor: float


@dataclass(frozen=True)
class StartGust:
    """Send a gust of this amplitude [m/s] through the scene."""

    amplitude: float


@dataclass(frozen=True)
class StartEarthquake:
    """Shake the ground with up to this acceleration [m/s²]."""

    peak: float


@dataclass(frozen=True)
class Inspect:
    """Answer the load of the part of this index."""

    part: int


@dataclass(frozen=True)
class LoadScene:
    """Replace the present scene by that of a file."""

    path: Path


# Actions on the scene that a page shows.
CLICKS = (Inspect, Undo, Impulse, Projectile, Explosion, Cut)
# Actions that `Undo` reverts.
UNDONE = (Impulse, Projectile, Explosion, Cut, StartGust, StartEarthquake, Reset)


def drop_clicks(waiting: Queue[Any]) -> None:
    """Remove clicks from waiting commands: they were meant for the scene shown before."""
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
