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


"""Wind settings and discrete gusts, checked when they are made."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

from procphys_ros.errors import nearest_names, SceneError

PROFILES = ('log', 'power', 'uniform')
SPECTRA = ('kaimal', 'von_karman')
GUST_KINDS = ('eog', 'cosine')
_FASTEST = 150.0  # [m/s] above every wind measured on the ground (113 m/s, Barrow Island, 1996)


@dataclass(frozen=True)
class WindSettings:
    """
    Describe the mean wind and its turbulence.

    :ivar velocity: mean air velocity at the reference height, the direction it blows to
        [m/s], (3,), world.
    :ivar turbulence_intensity: standard deviation along the wind over mean speed, 0 to 1.
    :ivar profile: growth of the mean with height: 'log', 'power' or 'uniform'.
    :ivar roughness_length: of the log profile [m]; grass 0.03, forest about 1.
    :ivar exponent: of the power profile; IEC 61400-1 has 0.2, over smooth ground 0.14.
    :ivar reference_height: where `velocity` holds [m]; it also sets the size of the eddies.
    :ivar spectrum: of the turbulence: 'kaimal' or 'von_karman'.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    velocity: Sequence[float] = (0.0, 0.0, 0.0)
    turbulence_intensity: float = 0.15
    profile: str = 'log'
    roughness_length: float = 0.03
    exponent: float = 0.2
    reference_height: float = 10.0
    spectrum: str = 'kaimal'

    def __post_init__(self):
        _store(self, 'velocity', check_vector('wind.velocity', self.velocity, _FASTEST))
        for name, low, high in (('turbulence_intensity', 0.0, 1.0), ('exponent', 0.0, 1.0),
                                ('reference_height', 0.5, 300.0), ('roughness_length', 1e-6, 5.0)):
            _store(self, name, check_number(f'wind.{name}', getattr(self, name), low, high))
        check_choice('wind.profile', self.profile, PROFILES)
        check_choice('wind.spectrum', self.spectrum, SPECTRA)
        if self.profile == 'log' and self.roughness_length >= self.reference_height:
            raise SceneError(
                f'wind.roughness_length is {self.roughness_length:g} m, it must lie below '
                f'wind.reference_height ({self.reference_height:g} m)')


@dataclass(frozen=True)
class Gust:
    """
    Describe one discrete gust, which crosses the scene as a front.

    :ivar amplitude: peak of a cosine gust, V_gust of an EOG (whose peak is 0.74 of it, and
        whose dips are 0.24 of it) [m/s]; negative = a lull.
    :ivar duration: from first change to last [s]; an EOG of IEC 61400-1 has 10.5.
    :ivar rise: time that a cosine gust takes to rise, and to fall [s]; None = half the duration.
    :ivar direction: the gust blows and travels this way, (3,), world; None = the mean wind's.
    :ivar kind: 'cosine' (rise, hold, fall; a front that is faster than the mean wind) or 'eog'
        (extreme operating gust: dip, peak, dip; the mean wind carries it).
    :ivar upwind: distance of the front from the scene origin when the gust starts [m]; what
        stands still further upwind feels the gust at once.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    amplitude: float = 10.0
    duration: float = 5.0
    rise: float | None = None
    direction: Sequence[float] | None = None
    kind: str = 'cosine'
    upwind: float = 30.0

    def __post_init__(self):
        for name, low, high in (('amplitude', -_FASTEST, _FASTEST), ('duration', 0.05, 3600.0),
                                ('upwind', 0.0, 10000.0)):
            _store(self, name, check_number(f'gust.{name}', getattr(self, name), low, high))
        check_choice('gust.kind', self.kind, GUST_KINDS)
        half = 0.5 * self.duration
        rise = half if self.rise is None else check_number('gust.rise', self.rise, 0.01, half)
        _store(self, 'rise', rise)
        if self.direction is not None:
            direction = check_vector('gust.direction', self.direction, math.inf)
            length = math.hypot(*direction)
            if not 0.0 < length < math.inf:
                raise SceneError(f'gust.direction is {list(direction)}, it must have a length')
            _store(self, 'direction', tuple(c / length for c in direction))


def extreme_operating_amplitude(speed: float, sigma: float, extreme_speed: float = 56.0,
                                diameter: float = 0.0, scale: float = 42.0) -> float:
    """
    Compute V_gust of the extreme operating gust (IEC 61400-1 ed. 3, equation 17).

    :param speed: mean wind [m/s].
    :param sigma: standard deviation of the turbulence along the wind [m/s].
    :param extreme_speed: highest 3 s mean within a year, V_e1 [m/s]; class I: 56.
    :param diameter: width of what the gust must cover at once [m].
    :param scale: turbulence scale parameter Lambda_1 [m].
    """
    return min(1.35 * (extreme_speed - speed), 3.3 * sigma / (1.0 + 0.1 * diameter / scale))


def check_number(key: str, value: object, low: float, high: float) -> float:
    """Return a finite number within [low, high], or raise SceneError naming the key."""
    if isinstance(value, (str, bytes, bool)) or not _is_number(value):
        raise SceneError(f'{key} is {value!r}, it must be a number from {low:g} to {high:g}')
    number = float(value)  # type: ignore[arg-type]
    if not low <= number <= high or math.isinf(number):
        raise SceneError(f'{key} is {number:g}, it must lie from {low:g} to {high:g}')
    return number


def check_vector(key: str, value: object, longest: float) -> tuple[float, float, float]:
    """Return three finite numbers no longer than `longest`, or raise SceneError."""
    wanted = 'it must be three finite numbers [x, y, z]'
    if isinstance(value, (str, bytes)):
        raise SceneError(f'{key} is {value!r}, {wanted}')
    try:
        x, y, z = (float(c) for c in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise SceneError(f'{key} is {value!r}, {wanted}') from None
    if not all(math.isfinite(c) for c in (x, y, z)):
        raise SceneError(f'{key} is {[x, y, z]}, {wanted}')
    if math.hypot(x, y, z) > longest:
        raise SceneError(f'{key} is {[x, y, z]}, its length must not exceed {longest:g}')
    return x, y, z


def check_choice(key: str, value: object, choices: tuple[str, ...]) -> None:
    """Raise SceneError unless the value is one of the choices."""
    if value not in choices:
        raise SceneError(f'{key} is {value!r}, it must be one of {", ".join(choices)}'
                         f'{nearest_names(str(value), choices)}')


def _is_number(value: object) -> bool:
    try:
        float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return False
    return True


def _store(target: object, name: str, value: object) -> None:
    """Replace a field of a frozen dataclass by its checked value while it is being made."""
    object.__setattr__(target, name, value)
