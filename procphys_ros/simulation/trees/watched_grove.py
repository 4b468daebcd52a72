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


"""Watched grove: trees that are simulated as closely as somebody looks at them."""

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.trees.subset import write_between
from procphys_ros.physics.wind import Wind
from procphys_ros.physics.world import State, World
from procphys_ros.scene.culling import CullingSettings
from procphys_ros.simulation.observer import Observer
from procphys_ros.simulation.trees.attention import Attention
from procphys_ros.simulation.trees.grove import Grove
from procphys_ros.simulation.trees.touches import Touches

_BLEND = 2.0  # [s] over which a tree that comes back into the view goes over to the present wind


def make_grove(blueprint: Blueprint, gravity: float, settings: CullingSettings) -> Grove:
    """Make a grove that spares trees, if any scheme for that is in use; as `WatchedGrove`."""
    return (WatchedGrove(blueprint, gravity, settings) if settings.spares_trees
            else Grove(blueprint, gravity))


class WatchedGrove(Grove):
    """
    Steps only the trees that somebody sees or that have to move, the far ones less often.

    A tree that stands still keeps its pose to the bit, and loses its velocity. When it goes on,
    the wind that it felt last goes over to the present one smoothly. A far tree is stepped ahead
    of time; what is shown lies on the way between, so that it neither lags nor jumps.

    :param blueprint: all parts of the scene.
    :param gravity: downward acceleration [m/s²].
    :param settings: schemes in use.
    """

    def __init__(self, blueprint: Blueprint, gravity: float, settings: CullingSettings):
        super().__init__(blueprint, gravity)
        self._before = np.zeros((len(self.forest), 3))
        self._begin = self.forest.poses.copy()
        self._attention = Attention(settings, self.forest)

    def reset(self) -> None:
        """Put all trees back to rest and whole; the observer stays where it is."""
        super().reset()
        self._wind[:] = 0.0
        self._attention.reset()

    @property
    def moving(self) -> int:
        """Count the trees that do not stand still."""
        return int(np.count_nonzero(~self._attention.held))

    def observe(self, observer: Observer) -> None:
        """Look from another place from now on."""
        self._attention.observer = observer

    def movers(self) -> np.ndarray:
        """List the trees that do not stand still."""
        return np.flatnonzero(~self._attention.held)

    def feel(self, wind: Wind, time: float) -> None:
        """Choose the trees that go on, and ask for the air at these."""
        self._still = False
        self._asked = wind, time
        self._attention.survey()
        self._chosen = np.zeros(len(self._attention.held), bool)
        self._choose()

    def heed(self, touches: Touches, world: World) -> None:
        """Rouse trees that are touched by what moves; others may lean and rest as they stand."""
        if not len(touches):
            return
        moves = (touches.other >= 0) | ((touches.body >= 0)
                                        & (world.bodies.state[touches.body] >= State.LOOSE))
        rows = np.concatenate([touches.row[moves], touches.other[touches.other >= 0]])
        self._attention.rouse(self._attention.of_rows(rows))
        leans = self._attention.of_rows(touches.row)
        self.forest.hold(leans[self._attention.held[leans] & (self._attention.roused[leans] == 0)])
        self._choose()

    def sway(self, time_step: float) -> None:
        """Advance the chosen trees in the air that was felt."""
        trees = np.flatnonzero(self._chosen)
        steps = self._attention.stride(trees)
        ahead = self.forest.rows_of(trees[steps > 1])
        self._begin[ahead] = self.forest.poses[ahead]
        self.forest.step_some(trees, steps, time_step, self._wind)
        self._attention.elapse(trees, self._wind, time_step)

    def carry(self, poses: np.ndarray, velocities: np.ndarray) -> None:
        """Write where the trees are that moved; see `Grove.carry`."""
        self._attention.survey()
        trees, share = self._attention.on_the_way()
        write_between(self.forest.plan, trees, share, self._begin, self.forest.poses,
                      self.forest.velocities, self.forest.parts, poses, velocities)

    def _choose(self) -> None:
        """Add to the chosen trees those that were not chosen before in this step."""
        wind, time = self._asked
        trees, back, stops = self._attention.choose(wind, time)
        self.forest.hold(stops)
        rows = self.forest.rows_of(back)
        self._before[rows] = self._wind[rows]
        fresh = trees[~self._chosen[trees]]
        self._chosen[fresh] = True
        if not len(fresh):
            return
        rows = self.forest.rows_of(fresh)
        air = wind.velocity(self.forest.poses[rows, :3], time)
        if (self._attention.since[fresh] < _BLEND).any():
            count = np.diff(self.forest.plan.start)[fresh]
            share = np.repeat(np.minimum(self._attention.since[fresh] / _BLEND, 1.0), count)
            share = (0.5 - 0.5 * np.cos(np.pi * share))[:, None]
            air = self._before[rows] + share * (air - self._before[rows])
        self._wind[rows] = air
