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


"""Wind settings and discrete gusts, validated on construction."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from procphys_ros.elementary import cos, hypot, sin
from procphys_ros.errors import SceneError
from procphys_ros.physics.wind.zones import zone_rows
from procphys_ros.schema import declared, ParameterGroup

PROFILES = ('log', 'power', 'uniform')
SPECTRA = ('kaimal', 'von_karman')
GUST_KINDS = ('eog', 'cosine')
FASTEST = 150.0  # [m/s] above every wind measured on the ground (113 m/s, Barrow Island, 1996)
_SHORTEST_RISE = 0.01  # [s]


Record = tuple[tuple[float, ...], ...]  # rows of time and what `velocity_of` takes


@dataclass(frozen=True)
class WindSettings(ParameterGroup, group='wind'):
    """
    Describe the mean wind and its turbulence.

    :ivar exponent: of the power profile; IEC 61400-1 has 0.2, over smooth ground 0.14.
    :ivar reference_height: height of `velocity` [m]; it also determines the size of the eddies.
    """

    velocity: Sequence[float] = declared(
        (0.0, 0.0, 0.0), 'mean air velocity at wind.reference_height, the direction it blows to',
        'm/s', -FASTEST, FASTEST)
    turbulence_intensity: float = declared(
        0.15, 'standard deviation along the wind over mean speed', '', 0.0, 1.0)
    profile: str = declared('log', 'growth of the mean wind with height', choices=PROFILES)
    roughness_length: float = declared(
        0.03, 'of the log profile; grass 0.03, forest about 1', 'm', 1e-6, 5.0)
    exponent: float = declared(0.2, 'of the power profile', '', 0.0, 1.0)
    reference_height: float = declared(
        10.0, 'height at which wind.velocity holds', 'm', 0.5, 300.0)
    spectrum: str = declared('kaimal', 'spectrum of the turbulence', choices=SPECTRA)
    shelter: bool = declared(
        False, 'whether stands of trees and buildings, as they were built, shelter what is in '
        'their lee')
    hills: bool = declared(
        False, 'whether the terrain makes the wind faster over crests and slower in hollows')
    zones: Sequence[str] = declared(
        (), 'boxes in which the wind differs, each "name=value …" with position=x,y,z of the '
        'middle [m, z from the ground], size=x,y,z [m], yaw [rad], fade beyond the faces [1 m], '
        'the factors speed and turbulence [0 … 5], turn to the left [rad]; where they overlap, '
        'the last one counts')
    map: str = declared(
        '', 'CSV file of a grid of places x, y, z [m, from the ground] with the factors speed, '
        'turn, turbulence of wind.zones, interpolated; its first line names its columns',
        takes_effect='reload')
    file: str = declared(
        '', 'CSV file of time [s], speed [m/s] and direction [degrees it blows from, clockwise '
        'from north (+y)], and perhaps upward speed [m/s], that the mean wind follows instead of '
        'wind.velocity',
        takes_effect='reload')

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_speed(self.velocity)
        zone_rows(self.zones)
        if self.profile == 'log' and self.roughness_length >= self.reference_height:
            raise SceneError(
                f'wind.roughness_length is {self.roughness_length:g} m, it must lie below '
                f'wind.reference_height ({self.reference_height:g} m)')


@dataclass(frozen=True)
class MeanWind(ParameterGroup, group='wind'):
    """Describe a change of the mean wind."""

    velocity: Sequence[float] = declared(
        (0.0, 0.0, 0.0), 'mean air velocity, the direction it blows to', 'm/s', -FASTEST, FASTEST)
    ramp: float = declared(0.0, 'how long the change takes', 's', 0.0, 1e6)

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_speed(self.velocity)


@dataclass(frozen=True)
class Gust(ParameterGroup, group='gust'):
    """
    Describe one discrete gust, which crosses the scene as a front.

    :ivar amplitude: peak of a cosine gust, V_gust of an EOG (whose peak is 0.74 of it, and
        whose dips are 0.27 of it) [m/s]; negative = a lull.
    :ivar kind: 'cosine' (rise, hold, fall; a front that is faster than the mean wind) or 'eog'
        (extreme operating gust: dip, peak, dip; the mean wind carries it).
    :ivar upwind: distance of the front from the scene origin when the gust starts [m]; points
        further upwind are hit by the gust at once.
    """

    amplitude: float = declared(
        10.0, 'change of the wind at the peak of ~/gust', 'm/s', -FASTEST, FASTEST)
    duration: float = declared(5.0, 'from the first change to the last', 's', 0.05, 3600.0)
    rise: float | None = declared(
        None, 'time a cosine gust takes to rise, and to fall; 0 = half of gust.duration', 's',
        0.0, 1800.0, shown=0.0)
    direction: Sequence[float] | None = declared(
        None, 'where the gust blows to; all 0 = along the mean wind', shown=(0.0, 0.0, 0.0))
    kind: str = declared(
        'cosine', 'cosine (rise, hold, fall) or eog (IEC 61400-1 extreme operating gust)',
        choices=GUST_KINDS)
    upwind: float = declared(
        30.0, 'distance of the gust front from the origin when it starts', 'm', 0.0, 10000.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        half = 0.5 * self.duration
        rise = half if self.rise is None else self.rise
        if not _SHORTEST_RISE <= rise <= half:
            raise SceneError(f'gust.rise is {rise:g} s, it must lie from {_SHORTEST_RISE:g} to '
                             f'half of gust.duration ({half:g})')
        object.__setattr__(self, 'rise', rise)
        if self.direction is not None:
            length = hypot(*self.direction)
            if not length > 0.0:
                raise SceneError(f'gust.direction is {list(self.direction)}, it must have a '
                                 'length')
            object.__setattr__(self, 'direction', tuple(c / length for c in self.direction))


def velocity_of(speed: float, direction: float, up: float = 0.0) -> tuple[float, float, float]:
    """
    Convert a wind as reported by weather stations to a velocity [m/s], (3,), world (x is east).

    :param speed: level [m/s].
    :param direction: that the wind comes from, clockwise from north [degrees].
    :param up: upward [m/s].
    """
    bearing = math.radians(direction)
    return -speed * sin(bearing), -speed * cos(bearing), up


def _check_speed(velocity: Sequence[float]) -> None:
    if hypot(*velocity) > FASTEST:
        raise SceneError(f'wind.velocity is {list(velocity)} m/s, its length must not exceed '
                         f'{FASTEST:g}')
