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


"""Clicks: actions of clicks on parts."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.simulation.commands import Impulse
from procphys_ros.view.picking import GROUND, Hit
from procphys_ros.view.source import Content

_RUN_UP = 6.0  # [m] before the wall that a ball starts, unless the eye is closer
_CLEARANCE = 0.01  # [m] between a ball that starts and the ground


@dataclass(frozen=True)
class Strength:
    """
    How strong clicks are.

    :ivar pull: speed that a branch is pulled with [m/s].
    :ivar ball_mass: [kg].
    :ivar ball_size: diameter [m].
    :ivar ball_speed: [m/s].
    :ivar charge: TNT [kg].
    """

    pull: float = 10.0
    ball_mass: float = 30.0
    ball_size: float = 0.3
    ball_speed: float = 25.0
    charge: float = 10.0


def command_of(hit: Hit, content: Content, direction: np.ndarray, strength: Strength) -> Any:
    """
    Turn a click into a command: pull a branch, throw a ball at a wall, set off a charge.

    :param hit: what was clicked.
    :param content: what there is.
    :param direction: of sight, unit, world, (3,).
    :param strength: how strong.
    """
    if hit.part == GROUND:
        return Explosion([*hit.point[:2].tolist(), _ground(content, hit.point)], strength.charge)
    if content.shape[hit.part] == Shape.CAPSULE:  # branches, and balls that lie around
        pull = -direction * strength.pull * content.mass[hit.part]
        return Impulse(hit.part, pull.tolist())
    return _ball(hit, content, direction, strength)


def _ground(content: Content, point: np.ndarray) -> float:
    return float(content.terrain.height(point[None])[0])


def _ball(hit: Hit, content: Content, direction: np.ndarray, strength: Strength) -> Projectile:
    """Throw a ball along the line of sight, so that it hits what was clicked."""
    start = hit.point - direction * min(_RUN_UP, hit.distance)
    start[2] = max(start[2], _ground(content, start) + 0.5 * strength.ball_size + _CLEARANCE)
    aim = hit.point - start
    aim /= max(float(np.linalg.norm(aim)), 1e-9)
    return Projectile('sphere', strength.ball_size, strength.ball_mass, start.tolist(),
                      (strength.ball_speed * aim).tolist())


def describe(hit: Hit, content: Content) -> str:
    """Say in few lines what was clicked."""
    if hit.part == GROUND:
        return f'**ground** at {hit.point[0]:.1f}, {hit.point[1]:.1f} m'
    return (f'**{content.name(hit.part)}**  \n{content.material(hit.part)}, '
            f'{content.mass[hit.part]:.3g} kg')
