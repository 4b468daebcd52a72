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


"""What is thrown at a scene: projectiles, explosions, the timed charges of a demolition."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.scene.solids import edges_of

_FASTEST = 400.0     # [m/s], beyond it air and wall answer with shock waves
_LARGEST = 20.0      # [m] edge of a projectile
_HEAVIEST = 1e6      # [kg] of a projectile
_FARTHEST = 1e5      # [m] from the origin
_MOST_TNT = 1e4      # [kg]
_LONGEST_WAIT = 3600.0  # [s]
_WIDEST = 100.0      # [m] radius of a charge
_MOST_CHARGES = 10_000


@dataclass(frozen=True)
class Projectile:
    """
    Something that flies: a ball or a block.

    :ivar shape: 'sphere' or 'box'.
    :ivar size: diameter, or edges along its axes [m], one number or three.
    :ivar mass: [kg].
    :ivar position: of its centre, world [m], (3,).
    :ivar velocity: world [m/s], (3,).
    :raises CommandError: when a value is out of its range; the message names it and the range.
    """

    shape: str = 'sphere'
    size: float | Sequence[float] = 0.3
    mass: float = 30.0
    position: Sequence[float] = (0.0, -10.0, 2.0)
    velocity: Sequence[float] = (0.0, 20.0, 0.0)

    def __post_init__(self) -> None:
        edges = self.edges
        _number('projectile.mass', self.mass, 'kg', _HEAVIEST)
        place = _triple('projectile.position', self.position, _FARTHEST)
        if place[2] < 0.5 * edges[2]:
            raise CommandError(f'projectile.position is {place.tolist()}: it reaches '
                               f'{0.5 * edges[2] - place[2]:.3g} m into the ground')
        speed = float(np.linalg.norm(_triple('projectile.velocity', self.velocity, 1e9)))
        if speed > _FASTEST:
            raise CommandError(f'projectile.velocity is {speed:g} m/s, it must not exceed '
                               f'{_FASTEST:g}')

    @property
    def edges(self) -> np.ndarray:
        """Give full extents along its axes [m], (3,)."""
        return edges_of('projectile', self.shape, self.size, _LARGEST, CommandError)


@dataclass(frozen=True)
class Explosion:
    """
    A charge that goes off in the open.

    :ivar position: world [m], (3,).
    :ivar charge: mass of TNT with the same effect [kg].
    :raises CommandError: when a value is out of its range.
    """

    position: Sequence[float] = (0.0, -5.0, 1.0)
    charge: float = 10.0

    def __post_init__(self) -> None:
        place = _triple('explosion.position', self.position, _FARTHEST)
        if place[2] < 0.0:
            raise CommandError(f'explosion.position is {place.tolist()}: that is under the '
                               'ground; z must not be below 0')
        _number('explosion.charge', self.charge, 'kg TNT', _MOST_TNT)


@dataclass(frozen=True)
class Demolition:
    """
    Charges in walls, each with its moment: parallel lists.

    :ivar delays: from the command on [s], (K,).
    :ivar positions: x y z of each charge after the other, world [m], (3 K,); none = along the
        bearing walls of the ground floors, from the middle outwards.
    :ivar radii: in which a charge turns masonry to dust [m], (K,).
    :raises CommandError: when lengths do not match or a value is out of its range.
    """

    delays: Sequence[float] = ()
    positions: Sequence[float] = ()
    radii: Sequence[float] = ()

    def __post_init__(self) -> None:
        delays, places, radii = (_list(f'demolition.{name}', getattr(self, name))
                                 for name in ('delays', 'positions', 'radii'))
        if not (3 * len(delays) == len(places) == 3 * len(radii)):
            raise CommandError(
                f'demolition has {len(delays)} delays, {len(places)} numbers in positions and '
                f'{len(radii)} radii; it takes three numbers in positions for each delay and '
                'radius, or no charge at all')
        if len(delays) > _MOST_CHARGES:
            raise CommandError(f'demolition has {len(delays)} charges, {_MOST_CHARGES} are '
                               'allowed')
        for name, values, low, high in (('delays', delays, 0.0, _LONGEST_WAIT),
                                        ('positions', places, -_FARTHEST, _FARTHEST),
                                        ('radii', radii, 1e-3, _WIDEST)):
            if len(values) and not (values.min() >= low and values.max() <= high):
                raise CommandError(f'demolition.{name} reach from {values.min():g} to '
                                   f'{values.max():g}, they must stay within {low:g} to {high:g}')

    def __len__(self) -> int:
        return len(self.delays)

    @property
    def places(self) -> np.ndarray:
        """Give where the charges are, (K, 3) [m]."""
        return np.array(self.positions, float).reshape(-1, 3)


def _number(what: str, value: Any, unit: str, high: float) -> None:
    good = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    if not (good and math.isfinite(value) and 0.0 < value <= high):
        raise CommandError(f'{what} is {value!r}, it must be a number above 0 and not exceed '
                           f'{high:g} {unit}')


def _triple(what: str, value: Any, high: float) -> np.ndarray:
    vector = _list(what, value)
    if vector.shape != (3,) or not np.abs(vector).max() <= high:
        raise CommandError(f'{what} is {value!r}, it must be three numbers within ±{high:g}')
    return vector


def _list(what: str, value: Any) -> np.ndarray:
    try:
        numbers = np.array(value, float)
    except (TypeError, ValueError):
        numbers = np.full((), np.nan)
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise CommandError(f'{what} is {value!r}, it must be a list of finite numbers')
    return numbers
