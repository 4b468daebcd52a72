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


"""Arsenal: everything that is thrown at a scene, and the walls and trees that answer."""

from collections.abc import Callable
from typing import Any
from weakref import WeakMethod

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError
from procphys_ros.physics.wind import Wind
from procphys_ros.physics.world import World
from procphys_ros.scene.strikes import Demolition, Explosion, Projectile
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import EventLog
from procphys_ros.simulation.standing.blows import Blows
from procphys_ros.simulation.standing.buildings import Buildings
from procphys_ros.simulation.standing.standing_loads import StandingLoads
from procphys_ros.simulation.standing.wall_wind import WallWind
from procphys_ros.simulation.strikes.blasts import Blasts
from procphys_ros.simulation.strikes.demolition import Charges
from procphys_ros.simulation.strikes.late_parts import missile
from procphys_ros.simulation.strikes.panes import Panes
from procphys_ros.simulation.strikes.striking import RESTITUTION, Striking
from procphys_ros.simulation.trees.grove import Grove

_MOST_FLYING = 200   # projectiles since the last reset
_MOST_WAVES = 50     # explosions whose waves are under way
_BALL_DRAG = 0.47 * 0.25 * np.pi  # Cd·A over diameter squared of a sphere (Hoerner 1965, 3-8)


class Arsenal:
    """
    Projectiles, explosions, timed charges, wind pressure: what loads and breaks what stands.

    :param blueprint: all parts and bonds of the scene as it was built.
    :param grove: its trees.
    :param buildings: its masonry.
    :param log: where broken bonds are recorded.
    :param seed: of the shapes of shards.
    :param join: adds late parts under an object's name and gives the index of the first.
    :param vanish: takes parts out of the scene for good.

    :ivar loads: on standing parts, one layer per source.
    :ivar blows: on masonry.
    :ivar panes: of glass.
    :ivar striking: projectiles, and the ledger of their blows.
    """

    def __init__(self, blueprint: Blueprint, grove: Grove, buildings: Buildings, log: EventLog,
                 seed: int, join: Callable[[Blueprint, str], int],
                 vanish: Callable[[np.ndarray], None]):
        join, vanish = _unowned(join), _unowned(vanish)
        self._join = join
        self.loads = StandingLoads(buildings.solver)
        self.blows = Blows(blueprint, buildings, self.loads, log)
        self.panes = Panes(blueprint, self.blows, seed, join, vanish)
        self.striking = Striking(blueprint, grove, self.blows, self.panes)
        self._blasts = Blasts(blueprint, grove, self.blows, self.panes)
        self._charges = Charges(blueprint, self.blows, vanish)
        self._wall_wind = WallWind(blueprint, buildings, self.loads)
        self.kick = self._blasts.kick

    def begin(self, world: World, debris: Debris, gravity: float) -> None:
        """Start anew in a world that has just been built."""
        self._world = world
        self._debris = debris
        self.loads.clear()
        self.blows.begin(world, debris)
        self.panes.begin(world, debris)
        self.striking.begin(world, gravity)
        self._blasts.begin(world, debris)
        self._charges.begin()
        self._wall_wind.begin()

    def advance(self, wind: Wind, poses: np.ndarray, time: float, time_step: float) -> None:
        """
        Let everything act that acts within the next step.

        :param wind: presses on walls.
        :param poses: of all parts, (N, 7), world.
        :param time: [s].
        :param time_step: [s].
        """
        self._charges.advance(time, time_step)
        self._blasts.advance(poses, time, time_step)
        self.striking.advance(time, time_step)
        self._wall_wind.advance(wind, time)
        self.loads.apply(time, time_step)

    def launch(self, projectile: Projectile) -> int:
        """
        Let a projectile fly.

        :returns: its part.
        :raises CommandError: when there are too many, or it would start inside of something.
        """
        number = len(self.striking)
        if number >= _MOST_FLYING:
            raise CommandError(f'{_MOST_FLYING} projectiles have been launched, no more are '
                               'allowed until the simulation is reset')
        made = missile(projectile)
        ball, size = projectile.shape == 'sphere', projectile.edges
        inside = self.striking.touched(ball, size, made.poses[0])
        if inside >= 0:
            raise CommandError(f'projectile.position is {list(projectile.position)}: it touches '
                               f'part {inside} of the scene from the start')
        part = self._join(made, f'projectile_{number}')
        velocity = np.concatenate([np.asarray(projectile.velocity, float), np.zeros(3)])
        body = self._world.add_projectile(int(made.shape[0]), size, float(projectile.mass),
                                          made.poses[0], velocity, restitution=RESTITUTION)
        self._debris.adopt(np.array([part]), np.array([body]))
        if ball:
            self._debris.set_drag_area(body, _BALL_DRAG * float(size[0]) ** 2)
        self.striking.enter(part, body, ball, size, float(projectile.mass))
        return part

    def explode(self, explosion: Explosion, blueprint: Blueprint, poses: np.ndarray,
                time: float) -> None:
        """
        Set a charge off.

        :param explosion: where and how much.
        :param blueprint: all parts there are by now.
        :param poses: of them, (N, 7), world.
        :param time: [s].
        :raises CommandError: when too many waves are under way.
        """
        if self._blasts.under_way >= _MOST_WAVES:
            raise CommandError(f'the waves of {_MOST_WAVES} explosions are under way; wait '
                               'for them to pass')
        self._blasts.explode(explosion, blueprint, poses, time)

    def demolish(self, plan: Demolition, time: float) -> int:
        """
        Start the clocks of timed charges, and say how many there are.

        :raises CommandError: when there is nothing to demolish.
        """
        return self._charges.arm(plan, time)


def _unowned(method: Callable) -> Callable:
    """
    Give the same call without keeping the method's object alive.

    The simulation owns what calls it back. A cycle of references would hold its memory, 80 MB
    and more of a large scene, until Python's collector happens to look.
    """
    reference = WeakMethod(method)

    def call(*arguments: Any) -> Any:
        owner = reference()
        assert owner is not None, 'parts of a simulation outlived it'
        return owner(*arguments)
    return call
