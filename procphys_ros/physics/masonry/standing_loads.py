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


"""Loads on standing walls besides their weight: one layer for each thing that presses."""


import numpy as np

from procphys_ros.geometry.linear import norm
from procphys_ros.physics.masonry import StressSolver

TOGETHER = 0.1   # [s] loads within this time act together, as their mean: about two periods of a
#                  storey-high wall, which has not responded to the first of them before
_NOTICED = 0.05  # of the largest force of a source: smaller changes need no new stresses, ...
_FAINT = 50.0    # [N] ... nor do those far below the strength of a brick's joints, some kN
_STEADY = 1e-3   # of the largest force: a load that changes by less between two looks rests
_COLUMNS = 10    # of a blow: wrench, impulse, concentrated force
_ROUNDS = 3      # with failures under a blow, about 0.06 s: cracks run through a panel
#                  while it swings out, but later crumbling must not be loaded by the blow


class StandingLoads:
    """
    Sum up the loads of different sources on standing parts for the stress solver.

    The solver is called only after changes, so that standing walls cost nothing. Changes while it
    works on earlier loads wait until these have been judged: loads that change all the time, such
    as of moving rubble, would keep it from converging.

    Blows act until no bond fails under them, or cracks have run as far as they do while a panel
    swings out. Of successive blows to one part only the strongest counts, since they act one after
    the other. Parts that they throw over become no faster than the striking body.

    :param count: number of parts, in buildings and elsewhere.
    :ivar thrown: velocities of parts when they are released [m/s], (N, 3).
    """

    _layers: dict[str, tuple[np.ndarray, np.ndarray]]
    _offered: dict[str, tuple[np.ndarray, np.ndarray]]
    _struck: list[tuple[np.ndarray, np.ndarray]]
    _waiting: np.ndarray | None
    _blows: np.ndarray | None

    def __init__(self, count: int):
        self._count = count
        self._layers, self._offered = {}, {}
        self._struck = []
        self._speed = np.zeros(count)  # of bodies that struck, until blows end [m/s]
        self.thrown = np.zeros((count, 3))
        self._waiting = None
        self._blows = None
        self._changed = False
        self._open = True
        self._opened = 0.0
        self._rounds = 0  # in which the active blows broke bonds

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the active layers."""
        return tuple(self._layers)

    def layer(self, source: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the parts (K,) and wrenches (K, 6) of one layer; none if it is not active."""
        return self._layers.get(source, (np.zeros(0, np.intp), np.zeros((0, 6))))

    def set_layer(self, source: str, parts: np.ndarray, wrenches: np.ndarray) -> None:
        """
        Replace all loads of a source.

        :param source: name of the layer, such as 'wind' or 'debris'.
        :param parts: indices, repeated ones are summed, (K,).
        :param wrenches: force at the centre of mass and moment [N], [N·m], world, (K, 6).
        """
        parts, wrenches = np.asarray(parts, np.intp), np.asarray(wrenches, float)
        before = self._layers.pop(source, None)
        if len(parts):
            self._layers[source] = parts, wrenches
        same = (before is not None and np.array_equal(before[0], parts)
                and np.array_equal(before[1], wrenches))
        self._changed |= not same and (before is not None or len(parts) > 0)

    def follow(self, source: str, parts: np.ndarray, wrenches: np.ndarray) -> None:
        """
        Replace all loads of a source that changes all the time, once they ask for new stresses.

        A load that has changed much does, and one that has come to rest.

        :param source, parts, wrenches: see `set_layer`.
        """
        if not len(parts):
            self._offered.pop(source, None)
            self.remove_layer(source)
            return
        now = self._total([(parts, wrenches)])[:, :3]
        told, offered = (np.abs(now - self._total([known])[:, :3]).max() for known in (
            self.layer(source), self._offered.get(source, self.layer(''))))
        self._offered[source] = parts, wrenches
        largest = np.abs(now).max()
        if offered <= _STEADY * largest < told or told > max(_NOTICED * largest, _FAINT):
            self.set_layer(source, parts, wrenches)

    def remove_layer(self, source: str) -> None:
        """Remove a layer, if there is one."""
        self._changed |= self._layers.pop(source, None) is not None

    def resize(self, count: int) -> None:
        """Extend the arrays for parts appended to all others, (N,) with them."""
        more = np.zeros((count - self._count, _COLUMNS))
        self._count = count
        self._speed = np.concatenate([self._speed, more[:, 0]])
        self.thrown = np.concatenate([self.thrown, more[:, :3]])
        if self._waiting is not None:
            self._waiting = np.concatenate([self._waiting, more])
        if self._blows is not None:
            self._blows = np.concatenate([self._blows, more])
        self._changed = True  # the solver is a new one

    def add_blow(self, parts: np.ndarray, wrenches: np.ndarray, speed: np.ndarray | float,
                 impulses: np.ndarray | float = 0.0, concentrated: float | None = None) -> None:
        """
        Add blows, which act until the stresses under them break no more bonds.

        :param parts: indices, repeated ones are summed, (K,).
        :param wrenches: equivalent static force at the centre of mass and moment [N],
            [N·m], world, (K, 6).
        :param speed: of the striking bodies [m/s], (K,) or one for all.
        :param impulses: of the parts when they are released [N·s], world, (K, 3).
        :param concentrated: force that they put on a part, which decides how accurately they are
            balanced [N]; None = that of each.
        """
        parts = np.asarray(parts, np.intp)
        blows = np.zeros((len(parts), _COLUMNS))
        blows[:, :6], blows[:, 6:9] = wrenches, impulses
        blows[:, 9] = norm(blows[:, :3], axis=1) if concentrated is None else concentrated
        self._struck.append((parts, blows))
        np.maximum.at(self._speed, parts, speed)

    @property
    def struck(self) -> bool:
        """Whether blows are active."""
        return self._blows is not None

    @property
    def cracked(self) -> bool:
        """Whether cracks under the present blows have reached their full length."""
        return self._rounds >= _ROUNDS

    @property
    def largest_blow(self) -> float:
        """Return the largest force that an active blow concentrates on a part [N]."""
        blows = self._blows
        return 0.0 if blows is None else float(blows[:, 9].max())

    def impulses_on(self, parts: np.ndarray) -> np.ndarray:
        """Return the impulse of active blows on each of some parts [N·s], (K, 3)."""
        return np.zeros((len(parts), 3)) if self._blows is None else self._blows[parts, 6:9]

    def striking_speed(self, parts: np.ndarray) -> float:
        """Return the speed of the fastest body that has struck any of the parts [m/s]."""
        return float(self._speed[parts].max(initial=0.0))

    def take_blows(self, parts: np.ndarray) -> np.ndarray:
        """Remove the blows on released parts; return the impulse they transmitted [N·s], (3,)."""
        total = np.zeros(3)
        for struck, blows in self._struck:
            leaves = np.isin(struck, parts)
            total += blows[leaves, 6:9].sum(axis=0)
            blows[leaves] = 0.0
        for column in (self._waiting, self._blows):
            if column is not None:
                total += column[parts, 6:9].sum(axis=0)
                column[parts] = 0.0
        self._changed |= self._blows is not None
        return total

    def relieve(self, parts: np.ndarray) -> None:
        """Take the active blows off parts that move instead."""
        if self._blows is not None:
            self._blows[parts] = 0.0
            self._changed = True

    def scale_blows(self, parts: np.ndarray, share: float) -> None:
        """Scale the active blows on parts by a share."""
        if self._blows is not None:
            self._blows[parts] *= share
            self._changed = True

    def take_more(self, broke: bool) -> None:
        """
        Record a round of failures under the applied loads.

        :param broke: whether any bond broke, and did not just crack: then other loads may follow.
        """
        self._rounds += 1
        self._open |= broke

    def end_blows(self) -> None:
        """Record that the applied loads break no more bonds."""
        self._open = True
        if self._blows is not None:
            self._blows = None
            self._changed = True
            if self._waiting is None and not self._struck:
                self._speed[:] = 0.0

    def apply(self, solver: StressSolver, time: float) -> None:
        """
        Set the loads of the solver if any has changed; once per step, before it works.

        :param solver: of the stresses in all buildings.
        :param time: [s].
        """
        if self._struck:
            self._waiting = _strongest(self._waiting, self._total(self._struck, _COLUMNS))
            self._struck.clear()
        if not self._changed and self._waiting is None:
            return
        if self._open:
            self._open, self._opened = False, time
        elif time > self._opened + TOGETHER:
            return
        if self._waiting is not None:
            self._blows = _strongest(self._blows, self._waiting)
            self._waiting, self._rounds = None, 0
        self.press(solver)

    def press(self, solver: StressSolver) -> None:
        """Set the loads of the solver to the layers and the active blows."""
        total = self._total(list(self._layers.values()))
        if self._blows is not None:
            total += self._blows[:, :6]
        solver.set_loads(total[:, :3], total[:, 3:])
        self._changed = False

    def _total(self, loads: list[tuple[np.ndarray, np.ndarray]], columns: int = 6) -> np.ndarray:
        """Sum up loads per part, (N, columns)."""
        total = np.zeros((self._count, columns))
        for parts, rows in loads:
            np.add.at(total, parts, rows)
        return total


def _strongest(blows: np.ndarray | None, others: np.ndarray) -> np.ndarray:
    """Return the blow with the larger force on each part, (N, 10)."""
    if blows is None:
        return others
    harder = norm(others[:, :3], axis=1) > norm(blows[:, :3], axis=1)
    return np.where(harder[:, None], others, blows)
