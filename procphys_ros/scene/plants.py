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


"""Plants of a scene that can grow on while it runs, and the command that lets them."""

from collections.abc import Mapping
from dataclasses import dataclass

from procphys_ros.blueprint import Blueprint
from procphys_ros.environment.habitat import Habitat
from procphys_ros.errors import CommandError
from procphys_ros.lsystem import grow, Growth
from procphys_ros.lsystem.growth import Drawn, GrownString
from procphys_ros.physics.terrain import Terrain
from procphys_ros.scene.placement import stand_on
from procphys_ros.schema import declared, ParameterGroup

_FASTEST = 30.0  # [years/s]
_LONGEST = 1000  # [years]


@dataclass(frozen=True)
class Stand:
    """
    Plants that grow together.

    :ivar names: of those that stood when the scene was built.
    :ivar habitat: that they ask; None = their grammars ask nothing.
    """

    names: tuple[str, ...]
    habitat: Habitat | None = None


@dataclass(frozen=True)
class ScenePlant:
    """
    A plant as it stands when the scene is built.

    :ivar growth: its string; of a plant that asks nothing, the axiom.
    :ivar position: of its origin [m], (3,), world; z counts from the ground.
    :ivar yaw: turn about the vertical [rad].
    :ivar stand: that it belongs to.
    """

    growth: Growth
    position: tuple[float, ...]
    yaw: float
    stand: Stand

    def grown(self) -> Growth:
        """Return a copy of its string, grown to what stands in the scene."""
        growth = self.growth.resumed()
        if self.stand.habitat is None:
            grow([growth])
        return growth

    def place(self, drawn: Drawn, terrain: Terrain, name: str) -> Blueprint:
        """Place what it is drawn as where it stands, world."""
        return stand_on(terrain, drawn.blueprint.placed(self.position, self.yaw), name)


def advance(plants: Mapping[str, ScenePlant], stand: Stand, strings: Mapping[str, GrownString],
            due: set[str]) -> dict[str, Growth]:
    """
    Derive the next strings of some plants of a stand; the others are in their way as they are.

    :param plants: all of the scene, by name.
    :param strings: present ones of those that have grown on.
    :param due: names of those to derive.
    """
    growths = {name: (plants[name].growth.resumed(strings[name]) if name in strings
                      else plants[name].grown())
               for name in stand.names if name in due or stand.habitat is not None}
    for name in due:
        growths[name].derive()
    if stand.habitat is not None:
        answers = stand.habitat.answer([growth.ask() for growth in growths.values()])
        for name, answer in zip(growths, answers):
            if name in due:
                growths[name].tell(answer)
    return {name: growths[name] for name in due}


@dataclass(frozen=True)
class Grow(ParameterGroup, group='grow', error=CommandError):
    """Let plants grow on, a derivation step of their grammars per year."""

    target: str = declared('', 'plants that ~/grow lets grow on, an object or all called '
                           '<target>_0, <target>_1, …; empty = all')
    rate: float = declared(1.0, 'of their growth, in steps of their grammars; 0 = they stop as '
                           'they are', 'years/s', 0.0, _FASTEST)
    years: int = declared(10, 'whole years that they grow on', 'years', 0, _LONGEST)
