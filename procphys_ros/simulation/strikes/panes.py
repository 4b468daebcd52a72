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


"""Panes of glass: they break by bending long before their frames let go, and into pieces."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.physics.masonry import Resistance
from procphys_ros.physics.world import World
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.standing.blows import Blows
from procphys_ros.simulation.strikes.late_parts import shards

_STRENGTH = 45e6     # [Pa] of annealed float glass, EN 572-1
_MODULUS = 70e9      # [Pa] the same
_POISSON = 0.23      # the same
_THICKEST = 0.025    # [m] thicker glass is no pane
_POINT_STRESS = 1.3  # stress·thickness² over a force in the middle, spread over about a thickness
_POINT_SAG = 0.0116  # sag·stiffness/(force·edge²), square plate on supports (Timoshenko, table 23)
_PLATE_STRESS = 0.2874  # stress·thickness²/(pressure·edge²), square plate (Roark, table 11.4)
_REACH = 0.1         # [m] wider than what strikes it is the glass that feels a blow in time
_SPRING = 0.4        # [m/s] standard deviation of the speed that bent glass lends to its shards
_SPIN = 3.0          # [rad/s] the same of their spin
PIECES = 4           # along each side
_FEWER = 40          # panes at once, above which each breaks into fewer pieces


@dataclass(frozen=True)
class CrackedPane:
    """
    A pane about to break.

    :ivar part: index.
    :ivar pieces: its shards.
    :ivar share: velocity of each shard over that of the glass under the blow, (S,).
    :ivar mass: of the glass that moves with what strikes it [kg].
    :ivar resistance: of the pane against a blow in one point.
    """

    part: int
    pieces: Blueprint
    share: np.ndarray
    mass: float
    resistance: Resistance


class Panes:
    """
    All window panes of a scene.

    :param blueprint: all parts of the scene; thin boxes of glass are panes.
    :param blows: cuts them out of their frames.
    :param seed: of the shapes of shards.
    :param join: adds late parts under an object's name and gives the index of the first.
    :param vanish: takes parts out of the scene for good.

    :ivar parts: indices of all panes, (P,).
    :ivar log: where broken bonds are recorded.
    """

    def __init__(self, blueprint: Blueprint, blows: Blows, seed: int,
                 join: Callable[[Blueprint, str], int],
                 vanish: Callable[[np.ndarray], None]):
        self._blueprint = blueprint
        self._blows = blows
        self._seed = seed
        self._join = join
        self._vanish = vanish
        self.log = blows.log
        glass = np.array([name == 'glass' for name in blueprint.materials] or [False])
        self._is_pane = (glass[blueprint.material] & (blueprint.shape == Shape.BOX)
                         & (blueprint.size.min(axis=1, initial=np.inf) < _THICKEST))
        self.parts = np.flatnonzero(self._is_pane)
        self._thickness, self._edge, _ = np.sort(blueprint.size, axis=1).T

    def begin(self, world: World, debris: Debris) -> None:
        """Start anew in a world that has just been built."""
        self._world = world
        self._debris = debris

    def are(self, parts: np.ndarray) -> np.ndarray:
        """Say which parts are panes, (K,) bool."""
        return self._is_pane[parts]

    def pressure(self, parts: np.ndarray) -> np.ndarray:
        """Give the steady pressure at which panes break [Pa], (K,)."""
        slenderness = self._edge[parts] / self._thickness[parts]
        return _STRENGTH / (_PLATE_STRESS * slenderness ** 2)

    def deceleration(self, parts: np.ndarray) -> np.ndarray:
        """Give how hard the edges of panes may be stopped across the glass [m/s²], (K,)."""
        return self.pressure(parts) / (self._blueprint.density[parts] * self._thickness[parts])

    def point_force(self, parts: np.ndarray) -> np.ndarray:
        """Give the force in one point that panes withstand [N], (K,)."""
        return _STRENGTH * self._thickness[parts] ** 2 / _POINT_STRESS

    def crack(self, part: int, point: np.ndarray | None = None, size: float = 0.0,
              count: int = 1) -> CrackedPane:
        """
        Prepare a pane for breaking.

        :param part: index.
        :param point: where it is struck, world [m], (3,); None = everywhere.
        :param size: of what strikes it there [m].
        :param count: of panes that break together.
        """
        source = self._blueprint
        parts = self._cut(part, source.poses[part], PIECES if count < _FEWER else PIECES // 2)
        share, mass = np.ones(len(parts)), float(parts.mass.sum())
        thin, edge = float(self._thickness[part]), float(self._edge[part])
        if point is not None:
            edge = min(edge, size + _REACH)
            mass = min(mass, float(source.density[part]) * thin * edge ** 2)
            distance = np.linalg.norm(parts.poses[:, :3] - point, axis=1)
            share = np.exp(-(distance / (0.5 * size + _REACH)) ** 2)
            share *= mass / float(parts.mass @ share)
        force = float(self.point_force(np.array([part]))[0])
        stiffness = _MODULUS * thin ** 3 / (12.0 * (1.0 - _POISSON ** 2))
        energy = 0.5 * force ** 2 * _POINT_SAG * edge ** 2 / stiffness
        return CrackedPane(part, parts, share, mass,
                           Resistance(np.zeros(0, np.intp), force, energy))

    def shatter(self, pane: CrackedPane, velocity: np.ndarray, load: float, time: float,
                cause: Cause = Cause.IMPACT) -> None:
        """
        Let a pane fly in pieces.

        :param pane: from `crack`.
        :param velocity: of the glass under the blow [m/s], world, (3,).
        :param load: over what it withstood.
        :param time: of the simulation [s].
        :param cause: of its bonds' breaking.
        """
        gone = np.array([pane.part])
        self._blows.cut_out(gone, cause, load, time)
        self._blows.remove(gone)
        velocities = np.zeros((len(pane.pieces), 6))
        velocities[:, :3] = pane.share[:, None] * velocity
        self._scatter(pane.part, pane.pieces, velocities)

    def burst(self, part: int, pose: np.ndarray, velocity: np.ndarray,
              pieces: int) -> np.ndarray:
        """
        Put shards in the place of a pane that no body carries any more.

        :param part: index.
        :param pose: where it was, world, (7,).
        :param velocity: of it, world axes, (6,); its shards go on as it did: v + ω × r, ω.
        :param pieces: along each side.
        :returns: ids of the bodies of the shards.
        """
        parts = self._cut(part, pose, pieces)
        velocities = np.tile(velocity, (len(parts), 1))
        velocities[:, :3] += np.cross(velocity[3:], parts.poses[:, :3] - pose[:3])
        return self._scatter(part, parts, velocities)

    def _cut(self, part: int, pose: np.ndarray, pieces: int) -> Blueprint:
        source, rng = self._blueprint, np.random.default_rng([self._seed, part])
        return shards(source.size[part], float(source.density[part]), pose,
                      source.textures[source.texture[part]],
                      source.materials[source.material[part]], pieces, pieces, rng)

    def _scatter(self, part: int, pieces: Blueprint, velocities: np.ndarray) -> np.ndarray:
        """Let shards fly, (S, 6) velocities, instead of their pane; give their bodies."""
        self._vanish(np.array([part]))
        first = self._join(pieces, f'pane_{part}')
        bodies = self._world.add_bricks(pieces.poses, pieces.size, pieces.mass)
        self._world.thaw(bodies, velocities + self._spring(part, pieces))
        self._debris.adopt(np.arange(first, first + len(pieces)), bodies)
        return bodies

    def _spring(self, part: int, pieces: Blueprint) -> np.ndarray:
        """Give what shards gain as the bent pane springs back, without momentum, (S, 6)."""
        rng = np.random.default_rng([self._seed, part, 1])
        gained = rng.normal(0.0, [_SPRING] * 3 + [_SPIN] * 3, (len(pieces), 6))
        gained[:, :3] -= pieces.mass @ gained[:, :3] / pieces.mass.sum()
        return gained
