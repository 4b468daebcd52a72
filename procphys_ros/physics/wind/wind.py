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


"""The wind over a scene: mean, turbulence and gusts as a function of position and time."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import threads as pool
from procphys_ros.errors import CommandError
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.wind import downwash, kernel, spectra
from procphys_ros.physics.wind.eddies import DRIFT, Eddies, make_boxes
from procphys_ros.physics.wind.hills import Hills, LEVEL
from procphys_ros.physics.wind.history import History
from procphys_ros.physics.wind.settings import (
    Gust,
    GUST_KINDS,
    MeanWind,
    Record,
    velocity_of,
    WindSettings,
)
from procphys_ros.physics.wind.shelter import Shelter
from procphys_ros.physics.wind.zones import find_factors, map_nodes, MapRows, turn_wind, zone_rows

_SLANT = np.array([1.0, *DRIFT])  # direction of travel of the eddies: along, across and up
_GUST_REACH = 5000.0  # [m] downwind of the origin, where a gust is dropped
_SLOWEST = 0.1  # [m/s] least speed of a gust's front


class Reference(NamedTuple):
    """
    Wind at the reference height above the scene origin, each (3,) [m/s], world.

    :ivar mean: the mean wind.
    :ivar turbulence: contribution of the eddies.
    :ivar gust: contribution of discrete gusts.
    """

    mean: np.ndarray
    turbulence: np.ndarray
    gust: np.ndarray


class _Boxes(NamedTuple):
    """
    Boxes of eddies as arguments of the kernel.

    :ivar boxes: a tuple per box.
    :ivar periods: lengths of the boxes, which are periodic [m], (boxes, 3).
    """

    boxes: tuple
    periods: np.ndarray


class Wind:
    """
    Air velocity as a function of position and time.

    Frozen eddies (Taylor's hypothesis) are advected through the scene by the mean wind at the
    reference height; standard deviations are the same at all heights (IEC 61400-1, normal
    turbulence model). The velocity depends on position, time and commands only, not on earlier
    calls: going back in time reproduces the same wind.

    The turbulence rotates with the mean wind about the scene's origin, and is proportional to it.

    :param settings: mean wind and turbulence.
    :param seed: of the eddies.
    :param record: of the mean wind, in place of the settings' velocity; () = none.
    :param terrain: the surface of the ground, which the wind follows.
    :param by_place: rows of a map; () = none.

    :ivar settings: the present settings.
    :ivar shelter: trees and buildings that reduce the wind, where the settings enable it.
    :ivar enabled: False = no mean wind, eddies and gusts, which travel on meanwhile.
    :ivar zones: of the settings, rows of `zones.zone_rows`, (Z, 12).
    :ivar jets: of rotors at present, rows of `downwash.jet`, (J, 8).
    """

    _terrain: Terrain
    _hills: Hills
    settings: WindSettings
    shelter: Shelter
    _history: History

    def __init__(self, settings: WindSettings, seed: int = 0, record: Record = (),
                 terrain: Terrain = FLAT, by_place: MapRows = ()):
        self._terrain = terrain
        self._seed = seed
        self._record = record
        self._nodes = map_nodes(by_place)
        self._hills = LEVEL
        self.change(settings)
        self.shelter = Shelter()
        self.reset()

    def reset(self) -> None:
        """Discard all commands: use the mean wind of the settings or the record, without gusts."""
        self.enabled = True
        self._history = History(self.settings.velocity)
        if self._record:
            self._history.follow([row[0] for row in self._record],
                                 [velocity_of(*row[1:]) for row in self._record])
        self._gusts = np.empty((0, kernel.GUST_COLUMNS))
        self.jets = np.empty((0, downwash.COLUMNS))

    def change(self, settings: WindSettings) -> None:
        """
        Change the settings; only another spectrum or reference height requires new eddies.

        :param settings: the new ones; `reset` returns to their velocity.
        """
        self.settings = settings
        self.zones = zone_rows(settings.zones)
        if settings.hills and not len(self._hills.gain):
            self._hills = Hills.over(self._terrain)

    def prepare(self) -> None:
        """Generate the eddies now, if turbulence is enabled, instead of on first use."""
        if self.settings.turbulence_intensity > 0.0:
            self._eddies()

    def set_velocity(self, velocity: Sequence[float], time: float, ramp: float = 0.0) -> None:
        """
        Change the mean wind; the eddies keep their positions and travel on from there.

        :param velocity: (3,) at the reference height [m/s], world, the direction it blows to.
        :param time: present time [s]; commands for later times, and a record, are discarded.
        :param ramp: duration of the change [s]; 0 = at once.
        :raises SceneError: when a value is not finite or out of range.
        """
        asked = MeanWind(velocity, ramp)
        self._history.steer(tuple(asked.velocity), time, asked.ramp)

    def mean_velocity(self, time: float) -> tuple[float, ...]:
        """Return the mean wind at the reference height, enabled or not [m/s]."""
        return self._history.velocity(time)

    def start_gust(self, gust: Gust, time: float) -> None:
        """
        Start a gust: its front begins upwind of the scene and travels through it.

        A cosine gust is faster air that runs into slower air. Its front moves at the speed of the
        wind behind it. Thunderstorm fronts have two thirds of that (peak gust over speed of the
        front: 1.44 in the median, Sherburn et al. 2021, Weather and Forecasting 36:1387), as the
        rest of their air rises at the front; here the wind is horizontal, and leaves and dust
        would accumulate. An EOG is an eddy advected by the mean wind (IEC 61400-1), and so is a
        lull; in still air they travel at their amplitude.

        :param gust: its shape.
        :param time: present time [s].
        :raises CommandError: when it has no direction of its own and there is no mean wind.
        """
        mean = np.asarray(self._history.velocity(time))
        speed = float(norm(mean))
        if gust.direction is None and speed == 0.0:
            raise CommandError('a gust in still air needs gust.direction, for there is no mean '
                               'wind to take it from')
        direction = mean / speed if gust.direction is None else np.asarray(gust.direction)
        travel = _front_speed(gust, mean, direction)
        row = [*(gust.amplitude * direction), *direction, travel, time, gust.upwind,
               gust.duration, gust.rise, float(GUST_KINDS.index(gust.kind))]
        gone = time - self._gusts[:, 7] > (
            self._gusts[:, 9] + (self._gusts[:, 8] + _GUST_REACH) / self._gusts[:, 6])
        self._gusts = np.vstack([self._gusts[~gone], row])

    def velocity(self, points: np.ndarray, time: float, out: np.ndarray | None = None,
                 threads: int = 1) -> np.ndarray:
        """
        Return the air velocity at points, with the jets of rotors.

        :param points: (N, 3) [m], world.
        :param time: [s].
        :param out: (N, 3) array to write to.
        :param threads: number of threads; results do not depend on it, to the last bit.
        :returns: (N, 3) [m/s], world.
        """
        out = self.open_velocity(points, time, out, threads)
        if len(self.jets):
            downwash.add_jets(np.ascontiguousarray(points, float), out, self.jets)
        return out

    def open_velocity(self, points: np.ndarray, time: float, out: np.ndarray | None = None,
                      threads: int = 1) -> np.ndarray:
        """Return the air velocity without jets of rotors, which only blow close by."""
        return self._at(points, time, out, self.settings.turbulence_intensity, self._gusts,
                        threads)

    def steady_velocity(self, points: np.ndarray, time: float, threads: int = 1) -> np.ndarray:
        """Return the mean wind at points, with shelter, but no eddies or gusts; see `velocity`."""
        return self._at(points, time, None, 0.0, self._gusts[:0], threads)

    def _at(self, points: np.ndarray, time: float, out: np.ndarray | None, intensity: float,
            gusts: np.ndarray, threads: int) -> np.ndarray:
        points = np.ascontiguousarray(points, float)
        out = np.empty_like(points) if out is None else out
        if not len(points):
            return out
        if self._blows(time, gusts):
            s = self.settings
            if not self._terrain.is_flat:  # the profile is that over the local ground
                points = points - self._terrain.height(points)[:, None] * [0.0, 0.0, 1.0]
            self._fill(points, time, out, intensity, gusts, threads,
                       len(self.zones) > 0 or self._nodes.size > 0)
            if s.hills:
                self._hills.bend(points, out)
            if s.shelter:
                self.shelter.apply(points, out, np.asarray(self._history.velocity(time)),
                                   self._profile(), s.roughness_length)
        else:
            out[:] = 0.0
        return out

    def is_still(self, time: float) -> bool:
        """Return whether there is no mean wind and no pending gust."""
        return not self._blows(time, self._gusts)

    @property
    def moves(self) -> bool:
        """Return whether the air may move at all."""
        return self.enabled or len(self.jets) > 0

    def _blows(self, time: float, gusts: np.ndarray) -> bool:
        return self.enabled and (len(gusts) > 0 or any(self._history.velocity(time)))

    def at_reference(self, time: float) -> Reference:
        """
        Return mean, turbulence and gust at the reference height above the scene origin.

        :param time: [s].
        """
        if not self.enabled:
            return Reference(np.zeros(3), np.zeros(3), np.zeros(3))
        point = np.array([[0.0, 0.0, self.settings.reference_height]])
        intensity = self.settings.turbulence_intensity
        none = self._gusts[:0]
        mean, turbulent, gusty = (
            self._fill(point, time, np.empty((1, 3)), strength, gusts)[0]
            for strength, gusts in ((0.0, none), (intensity, none), (0.0, self._gusts)))
        return Reference(mean, turbulent - mean, gusty - mean)

    def _eddies(self) -> '_Boxes':
        return _boxes(self.settings.spectrum, self.settings.reference_height, self._seed)

    def _profile(self) -> tuple:
        s = self.settings
        return kernel.profile_terms(s.profile, s.reference_height, s.roughness_length, s.exponent)

    def _fill(self, points: np.ndarray, time: float, out: np.ndarray, intensity: float,
              gusts: np.ndarray, threads: int = 1, by_place: bool = False) -> np.ndarray:
        mean = np.asarray(self._history.velocity(time))
        speed = float(norm(mean))
        way = self._history.travelled(time)
        profile = self._profile()
        axes = _wind_axes(mean, speed)
        sigma = intensity * speed
        eddies = self._eddies() if sigma > 0.0 else None
        # Reduced to a period, so that cell indices stay small at any displacement.
        travelled = () if eddies is None else tuple(
            map(tuple, np.mod(way * _SLANT, eddies.periods).tolist()))

        def fill(_: int, first: int, last: int) -> None:
            some, air = points[first:last], out[first:last]
            factors = find_factors(some, self._nodes, self.zones) if by_place else np.empty(0)
            kernel.fill_mean(some, air, axes[0], speed, profile)
            if eddies is not None:
                swirl = np.zeros_like(air) if by_place else air
                kernel.add_eddies(some, swirl, axes, travelled, sigma, eddies.boxes, profile)
                if by_place:
                    air += factors[:, 2:] * swirl
            if len(gusts):
                kernel.add_gusts(some, air, gusts, float(time), profile)
            if by_place:
                turn_wind(air, factors)
        pool.run(fill, pool.even_ranges(len(points), threads))
        return out


@lru_cache(maxsize=2)
def _boxes(spectrum: str, reference_height: float, seed: int) -> _Boxes:
    """Generate the eddies, cached for all winds of the same seed: 56 MB, read-only."""
    boxes = make_boxes(spectra.make(spectrum, reference_height), np.random.default_rng(seed))
    return _Boxes(tuple(_for_kernel(box) for box in boxes),
                  np.array([box.period for box in boxes]))


def _front_speed(gust: Gust, mean: np.ndarray, direction: np.ndarray) -> float:
    """
    Compute the speed of a gust's front along its direction [m/s].

    An opposing mean wind does not slow a gust, which might otherwise never arrive.
    """
    if gust.kind == 'cosine' and gust.amplitude > 0.0:
        return max(max(float(product(mean, direction)), 0.0) + gust.amplitude, _SLOWEST)
    return float(norm(mean)) or max(abs(gust.amplitude), _SLOWEST)


def _wind_axes(mean: np.ndarray, speed: float) -> tuple:
    """Return unit vectors along the wind, across it (horizontal) and up from it."""
    x, y, z = (mean / speed).tolist() if speed > 0.0 else (1.0, 0.0, 0.0)
    level = float(np.sqrt(x * x + y * y))
    u, v = (-y / level, x / level) if level > 1e-9 else (0.0, 1.0)
    return (x, y, z), (u, v, 0.0), (y * 0.0 - z * v, z * u - x * 0.0, x * v - y * u)


def _for_kernel(eddies: Eddies) -> tuple:
    log2_shape = tuple(int(n).bit_length() - 1 for n in eddies.field.shape[:3])
    return (eddies.field.reshape(-1), log2_shape, eddies.lags.reshape(3, 8).astype(np.float32),
            tuple((1.0 / eddies.spacing).tolist()))
