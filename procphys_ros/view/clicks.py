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


"""Clicks: tools, and the commands of clicks with them."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.scene.strikes import Cut, Explosion, Projectile
from procphys_ros.simulation.commands import Impulse
from procphys_ros.view.picking import GROUND, Hit
from procphys_ros.view.source import PageContent
from procphys_ros.view.surroundings import Vicinity

_RUN_UP = 6.0  # [m] from the start of a ball to its target, unless the eye is closer
_CLEARANCE = 0.01  # [m] between a starting ball and the ground


class Tool(StrEnum):
    """The tool that a click applies."""

    LOOK = 'look'
    PUSH = 'push'
    PULL = 'pull'
    BALL = 'throw a ball'
    CHARGE = 'set off a charge'
    SAW = 'saw off'


@dataclass(frozen=True)
class Strength:
    """
    Strengths of the tools.

    :ivar push: velocity change of a part by a push or a pull [m/s].
    :ivar ball_mass: [kg].
    :ivar ball_size: diameter [m].
    :ivar ball_speed: [m/s].
    :ivar charge: TNT [kg].
    """

    push: float = 10.0
    ball_mass: float = 30.0
    ball_size: float = 0.3
    ball_speed: float = 25.0
    charge: float = 10.0


def effect(tool: Tool, strength: Strength) -> str:
    """Describe the effect of a click."""
    momentum = strength.ball_mass * strength.ball_speed
    energy = 0.5e-3 * momentum * strength.ball_speed
    return {
        Tool.LOOK: 'A click shows what it is and what it carries.',
        Tool.PUSH: f'A click pushes a part away: {strength.push:g} m/s times its mass.',
        Tool.PULL: f'A click pulls a part closer: {strength.push:g} m/s times its mass.',
        Tool.BALL: f'A click throws a ball there: {momentum:,.0f} N·s, {energy:,.1f} kJ.',
        Tool.CHARGE: f'A click sets off {strength.charge:g} kg TNT there.',
        Tool.SAW: 'A click saws a branch off at its foot, or any other part out.'}[tool]


def command_of(tool: Tool, hit: Hit, content: PageContent, direction: np.ndarray,
               strength: Strength, vicinity: Vicinity) -> Any:
    """
    Convert a click to a command; None = only show the part.

    :param tool: selected tool.
    :param hit: clicked part or ground.
    :param content: of the scene.
    :param direction: of sight, unit, world, (3,).
    :param strength: of the tools.
    :param vicinity: range of the tools on the ground.
    :raises CommandError: if the tool has no effect there.
    """
    if tool is Tool.LOOK:
        return None
    if hit.part == GROUND and not vicinity.holds(hit.point):
        raise CommandError('too far away: tools reach the ground '
                           f'up to {vicinity.margin:.0f} m around the scene')
    if tool is Tool.CHARGE:
        place = hit.point.tolist()
        if hit.part == GROUND:
            place[2] = _ground(content, hit.point)
        return Explosion(place, strength.charge)
    if tool is Tool.BALL:
        return _ball(hit, content, direction, strength)
    if hit.part == GROUND:
        raise CommandError(f'the ground cannot be moved: {tool} a part')
    if tool is Tool.SAW:
        return Cut(str(hit.part))
    way = direction if tool is Tool.PUSH else -direction
    return Impulse(hit.part, (way * strength.push * content.mass[hit.part]).tolist())


def mark_of(command: Any) -> tuple[str, np.ndarray]:
    """Label a command, and return its direction, world, (3,); 0 = all directions."""
    if isinstance(command, Explosion):
        return f'{command.charge:g} kg TNT', np.zeros(3)
    if isinstance(command, Projectile):
        way = np.array(command.velocity)
        return f'{command.mass:g} kg at {np.linalg.norm(way):.3g} m/s', way
    if isinstance(command, Cut):
        return 'cut', np.zeros(3)
    way = np.array(command.linear)
    return f'{np.linalg.norm(way):.3g} N·s', way


def _ground(content: PageContent, point: np.ndarray) -> float:
    return float(content.terrain.height(point[None])[0])


def _ball(hit: Hit, content: PageContent, direction: np.ndarray, strength: Strength) -> Projectile:
    """Launch a ball along the line of sight, such that it hits the clicked point."""
    start = hit.point - direction * min(_RUN_UP, hit.distance)
    start[2] = max(start[2], _ground(content, start) + 0.5 * strength.ball_size + _CLEARANCE)
    aim = hit.point - start
    aim /= max(float(np.linalg.norm(aim)), 1e-9)
    return Projectile('sphere', strength.ball_size, strength.ball_mass, start.tolist(),
                      (strength.ball_speed * aim).tolist())


def describe(hit: Hit, content: PageContent) -> str:
    """Describe the clicked part or ground in few lines."""
    if hit.part == GROUND:
        return f'**ground** at {hit.point[0]:.1f}, {hit.point[1]:.1f} m'
    return (f'**{content.name(hit.part)}**  \n{content.material(hit.part)}, '
            f'{content.mass[hit.part]:.3g} kg')


def title(hit: Hit, content: PageContent) -> str:
    """Return the name of the clicked part or ground."""
    return 'ground' if hit.part == GROUND else content.name(hit.part)
