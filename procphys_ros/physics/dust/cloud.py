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

"""Cloud: puffs of dust that drift, disperse and settle, in a ring buffer."""

from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import cbrt, exp, expm1, hypot, log, standard_normal
from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.physics.air import AIR_DENSITY, AIR_VISCOSITY
from procphys_ros.physics.dust.sources import DUST_PER_ENERGY
from procphys_ros.physics.gravity import GRAVITY
from procphys_ros.physics.skyline import keep_out, OPEN, Skyline
from procphys_ros.physics.terrain import FLAT, Terrain

GRAIN_DENSITY = 2000.0  # [kg/m³] mortar and brick
_MEDIAN, _SPREAD = 20e-6, log(2.0)  # [m], [-] of a lognormal of grain diameters by mass
# Above 60 µm Stokes' law fails (Reynolds number near 1): such grains fall at once, like sand.
_FINEST, _COARSEST = 1e-6, 60e-6  # [m]
# Extinction of grains much larger than light waves: twice their projected area.
_EXTINCTION = 3.0 / GRAIN_DENSITY  # [m³/kg], over the grain diameter: area per mass
_PUFF_MASS = 1e-4  # [kg] least mass of a puff
_MOST_BIRTHS = 0.02  # largest number of puffs emitted at once, as a share of the ring; beyond,
#                      puffs get heavier
# Concentration in the middle of a puff, and around an impact, at emission: our choice.
_YOUNG = 2e-3  # [kg/m³]
# Puffs in a neutral atmosphere have spread to 4 m after 100 m (Slade 1968, Meteorology and atomic
# energy): σ² = 2Kt with K = 0.08 m times the speed. Half of it moves puffs, half widens them.
_MIXING = 0.08  # [m]
_STILL_MIXING = 0.02  # [m²/s] mixing by falling rubble in still air; our choice
_THINNEST = 1e-4  # optical depth below which a puff is invisible


class PuffState(ArrayEnum):
    """State of a puff."""

    GONE = 0      # dispersed, or an unused row
    AIRBORNE = 1
    LYING = 2     # settled on the ground, or on a structure


_GONE, _LYING = int(PuffState.GONE), int(PuffState.LYING)


class Puffs(NamedTuple):
    """
    All present puffs of dust, one row each.

    :ivar positions: [m], world, (K, 3).
    :ivar sizes: diameter, two standard deviations to each side [m], (K,).
    :ivar opacity: share of light absorbed in the middle, 0 to 1, (K,).
    :ivar ages: [s], (K,).
    """

    positions: np.ndarray
    sizes: np.ndarray
    opacity: np.ndarray
    ages: np.ndarray

    @classmethod
    def none(cls) -> 'Puffs':
        """Return a table without puffs."""
        return cls(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0))


class DustCloud:
    """
    Puffs of one grain size each; when the ring is full, the oldest are overwritten.

    :param capacity: largest number of puffs.
    :param seed: of grain sizes, positions and turbulence.
    :param gravity: downward acceleration [m/s²].
    :param terrain: the surface of the ground.

    :ivar position: [m], world, (C, 3).
    :ivar deviation: standard deviation of each puff [m], (C,).
    :ivar mass: [kg], (C,).
    :ivar grain: diameter of its grains [m], (C,).
    :ivar state: `PuffState`, (C,) uint8.
    :ivar owed: emitted dust that is not yet enough for a puff [kg].
    """

    _terrain: Terrain
    _rng: np.random.Generator

    def __init__(self, capacity: int, seed: int, gravity: float = GRAVITY,
                 terrain: Terrain = FLAT):
        self._terrain = terrain
        self._seed = seed
        self._gravity = gravity
        self._noise = np.zeros((capacity, 3), np.float32)
        self.position = np.zeros((capacity, 3))
        self.deviation, self.mass, self.grain, self._fall, self._birth = np.zeros((5, capacity))
        self.state = np.zeros(capacity, np.uint8)
        self.clear()

    def clear(self) -> None:
        """Remove all dust, and restart the random numbers."""
        self._rng = np.random.default_rng(self._seed)
        self.state[:] = PuffState.GONE
        self._airborne = False
        self._next = 0
        self._time = 0.0
        self.owed = 0.0

    @property
    def dusty(self) -> bool:
        """Return whether there is dust, airborne or settled."""
        return bool(self.state.any())

    @property
    def puffs(self) -> Puffs:
        """Return the present puffs."""
        rows = np.flatnonzero(self.state)
        depth = _depth(self.mass[rows], self.grain[rows], self.deviation[rows])
        return Puffs(self.position[rows], 4.0 * self.deviation[rows], -expm1(-depth),
                     self._time - self._birth[rows])

    def raise_dust(self, points: np.ndarray, spread: np.ndarray, energy: np.ndarray) -> int:
        """
        Emit dust in proportion to energy.

        Dust not enough for a puff is kept in `owed` [kg] and emitted with the next.

        :param points: points of energy release [m], world, (K, 3).
        :param spread: standard deviation around them [m], (K,).
        :param energy: [J], (K,).
        :returns: number of emitted puffs.
        """
        if not len(energy):
            return 0
        risen = DUST_PER_ENERGY * np.asarray(energy, float)
        growing = self.owed + np.cumsum(risen)
        most = max(int(_MOST_BIRTHS * len(self.state)), 1)
        each = max(_PUFF_MASS, growing[-1] / most)
        # Slightly more, so that rounding does not drop the last puff of a full set.
        reached = np.floor(growing / each * (1.0 + 1e-12)).astype(np.intp)
        counts = np.diff(reached, prepend=0)
        self.owed = max(float(growing[-1] - reached[-1] * each), 0.0)
        source = np.repeat(np.arange(len(points)), counts)
        wide = hypot(spread, _young_deviation(risen))
        self._bear(points[source], wide[source], each)
        return len(source)

    def step(self, time_step: float, wind: Callable[[np.ndarray], np.ndarray],
             skyline: Skyline = OPEN) -> None:
        """
        Advance the drift, dispersion and settling of all puffs.

        :param time_step: [s].
        :param wind: returns the air velocity [m/s] at points [m], (K, 3) to (K, 3), world.
        :param skyline: of structures in their way.
        """
        self._time += time_step
        if not self._airborne:
            return
        rows = np.flatnonzero(self.state == PuffState.AIRBORNE)
        self._airborne = len(rows) > 0
        air = wind(self.position[rows])
        noise = self._rng.random(dtype=np.float32, out=self._noise[:len(rows)])
        _drift(rows, air, noise, time_step, skyline, self._fall, self.mass, self.grain,
               self.position, self.deviation, self.state)

    def lift(self, skyline: Skyline) -> None:
        """Release settled dust whose supporting structure is gone."""
        lying = np.flatnonzero(self.state == PuffState.LYING)
        left = lying[skyline.left_in_the_air(self.position[lying])]
        self.state[left] = PuffState.AIRBORNE
        self._airborne |= len(left) > 0

    def _bear(self, points: np.ndarray, spread: np.ndarray, mass: float) -> None:
        count = len(points)
        rows = (self._next + np.arange(count)) % len(self.state)
        self._next = int(self._next + count) % len(self.state)
        place = points + spread[:, None] * standard_normal(self._rng, (count, 3))
        ground = self._terrain.height(place)
        place[:, 2] = ground + np.abs(place[:, 2] - ground)
        grain = _MEDIAN * exp(_SPREAD * standard_normal(self._rng, count))
        self.position[rows] = place
        self.deviation[rows] = _young_deviation(mass)
        self._birth[rows] = self._time
        self.mass[rows] = mass
        self.grain[rows] = np.clip(grain, _FINEST, _COARSEST)
        self._fall[rows] = stokes_speed(self.grain[rows], self._gravity)
        self.state[rows] = PuffState.AIRBORNE
        self._airborne = True


def stokes_speed(diameter: np.ndarray, gravity: float = GRAVITY) -> np.ndarray:
    """
    Compute the settling speed of grains in still air, Δρ·g·d²/(18·μ) [m/s].

    :param diameter: of the grains [m], (K,).
    :param gravity: [m/s²].
    """
    return (GRAIN_DENSITY - AIR_DENSITY) * gravity * np.square(diameter) / (18.0 * AIR_VISCOSITY)


def _young_deviation(mass: np.ndarray | float) -> np.ndarray:
    """Compute the standard deviation of emitted dust [m], by its mass [kg], (K,)."""
    return cbrt(np.asarray(mass) / _YOUNG) / math.sqrt(2.0 * math.pi)


@kernel
def _depth(mass, grain, deviation):
    """Compute the optical depth through the middle of puffs of Gaussian profile."""
    return _EXTINCTION / grain * mass / (2.0 * math.pi * deviation ** 2)


@kernel
def _drift(rows, air, noise, dt, skyline, fall, mass, grain, position, deviation,
           state):
    """
    Move airborne puffs.

    Dust carried by turbulence is reflected at the ground, roofs and walls; only settling deposits
    it. Uniform noise, which is generated five times faster, sums to a normal random walk in a few
    steps.
    """
    for k in range(len(rows)):
        i = rows[k]
        speed = math.sqrt(air[k, 0] ** 2 + air[k, 1] ** 2 + air[k, 2] ** 2)
        widening = (_STILL_MIXING + _MIXING * speed) * dt
        step = math.sqrt(12.0 * widening)
        x, y, z = (position[i, 0] + air[k, 0] * dt + step * (noise[k, 0] - 0.5),
                   position[i, 1] + air[k, 1] * dt + step * (noise[k, 1] - 0.5),
                   position[i, 2] + air[k, 2] * dt + step * (noise[k, 2] - 0.5))
        x, y, floor = keep_out(skyline, position[i], x, y, z)
        height = abs(z - floor) - fall[i] * dt
        position[i, 0], position[i, 1], position[i, 2] = x, y, floor + max(height, 0.0)
        deviation[i] = math.sqrt(deviation[i] ** 2 + widening)
        if height <= 0.0:
            state[i] = _LYING
        elif _EXTINCTION / grain[i] * mass[i] < 2.0 * math.pi * deviation[i] ** 2 * _THINNEST:
            state[i] = _GONE
