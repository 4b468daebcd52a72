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


"""Strikes: projectiles, explosions, the timed charges of a demolition, and saw cuts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.elementary import hypot
from procphys_ros.errors import CommandError
from procphys_ros.scene.solids import edges_of, SHAPES
from procphys_ros.schema import declared, ParameterGroup

_FASTEST = 400.0     # [m/s], beyond it air and wall answer with shock waves
_LARGEST = 20.0      # [m] edge of a projectile
_HEAVIEST = 1e6      # [kg] of a projectile
_FARTHEST = 1e5      # [m] from the origin
_MOST_TNT = 1e4      # [kg]
_LONGEST_WAIT = 3600.0  # [s]
_WIDEST = 100.0      # [m] radius of a charge
_MOST_CHARGES = 10_000


@dataclass(frozen=True)
class Projectile(ParameterGroup, group='projectile', error=CommandError):
    """Ball or block in flight."""

    shape: str = declared('sphere', 'of what ~/launch_projectile throws', choices=SHAPES)
    size: float | Sequence[float] = declared(
        0.3, 'its diameter, or three edges', 'm', 1e-3, _LARGEST, shown=(0.3,), any_length=True)
    mass: float = declared(30.0, 'its mass', 'kg', 1e-4, _HEAVIEST)
    position: Sequence[float] = declared(
        (0.0, -10.0, 2.0), 'where its centre starts', 'm', -_FARTHEST, _FARTHEST)
    velocity: Sequence[float] = declared(
        (0.0, 20.0, 0.0), f'how fast it starts, in all at most {_FASTEST:g}', 'm/s', -_FASTEST,
        _FASTEST)

    def __post_init__(self) -> None:
        super().__post_init__()
        edges, place = self.edges, self.position
        if place[2] < 0.5 * edges[2]:
            raise CommandError(f'projectile.position is {list(place)}: it reaches '
                               f'{0.5 * edges[2] - place[2]:.3g} m into the ground')
        speed = hypot(*self.velocity)
        if speed > _FASTEST:
            raise CommandError(f'projectile.velocity is {speed:g} m/s, it must not exceed '
                               f'{_FASTEST:g}')

    @property
    def edges(self) -> np.ndarray:
        """Return the full extents along its axes [m], (3,)."""
        return edges_of(self)


@dataclass(frozen=True)
class Explosion(ParameterGroup, group='explosion', error=CommandError):
    """A charge that goes off in the open."""

    position: Sequence[float] = declared(
        (0.0, -5.0, 1.0), 'where ~/explode sets off its charge', 'm', -_FARTHEST, _FARTHEST)
    charge: float = declared(
        10.0, 'mass of TNT of ~/explode and ~/explosion', 'kg', 1e-6, _MOST_TNT)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.position[2] < 0.0:
            raise CommandError(f'explosion.position is {list(self.position)}: that is under the '
                               'ground; z must not be below 0')


@dataclass(frozen=True)
class Cut(ParameterGroup, group='cut', error=CommandError):
    """
    A saw cut, through all that holds a part, or along a plane through a part or an object.

    :ivar normal: of the plane, of any length, (3,); 0 = no plane: a segment of a tree is cut off
        at its foot, any other part out of what it is bonded to.
    """

    target: str = declared('', 'part that ~/cut cuts off, as oak_0/17 or an index; or a whole '
                           'object, such as house, which takes a plane')
    point: Sequence[float] = declared(
        (0.0, 0.0, 0.0), 'on the plane of the cut', 'm', -_FARTHEST, _FARTHEST)
    normal: Sequence[float] = declared(
        (0.0, 0.0, 0.0), 'of that plane, of any length; 0 0 0 = no plane: all that holds the part',
        '', -_FARTHEST, _FARTHEST)
    reach: float = declared(100.0, 'of the blade from that point', 'm', 1e-3, _FARTHEST)
    hinge: float = declared(0.0, 'width of the strip of wood that a felling cut leaves, between '
                            'the notch and the cut from the back; 0 = none', 'm', 0.0, 1.0)
    towards: Sequence[float] = declared(
        (0.0, 0.0, 0.0), 'where a tree falls over its hinge; level, of any length', '',
        -_FARTHEST, _FARTHEST)

    def __post_init__(self) -> None:
        super().__post_init__()
        x, y, z = self.towards
        if self.hinge > 0.0 and (z != 0.0 or not hypot(x, y) > 0.0):
            raise CommandError(f'cut.towards is {list(self.towards)}, it must be level and have a '
                               'length where cut.hinge is not 0')


@dataclass(frozen=True)
class Demolition(ParameterGroup, group='demolition', error=CommandError):
    """
    Charges in walls, each with its moment: parallel lists.

    :ivar delays: from the command on [s], (K,).
    :ivar positions: x y z of each charge after the other, world [m], (3 K,); none = along the
        bearing walls of the ground floors, from the middle outwards.
    :ivar radii: in which a charge breaks masonry and throws it [m], (K,).
    """

    delays: Sequence[float] = declared(
        (), 'when each charge of ~/demolish goes off; no charges = along the ground-floor walls, '
        'from the middle outwards', 's', 0.0, _LONGEST_WAIT, any_length=True)
    positions: Sequence[float] = declared(
        (), 'x y z of one charge after the other', 'm', -_FARTHEST, _FARTHEST, any_length=True)
    radii: Sequence[float] = declared(
        (), 'in which each charge breaks and throws masonry', 'm', 1e-3, _WIDEST, any_length=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        delays, places, radii = self.delays, self.positions, self.radii
        if not (3 * len(delays) == len(places) == 3 * len(radii)):
            raise CommandError(
                f'demolition has {len(delays)} delays, {len(places)} numbers in positions and '
                f'{len(radii)} radii; it takes three numbers in positions for each delay and '
                'radius, or no charge at all')
        if len(delays) > _MOST_CHARGES:
            raise CommandError(f'demolition has {len(delays)} charges, {_MOST_CHARGES} are '
                               'allowed')

    def __len__(self) -> int:
        return len(self.delays)

    @property
    def places(self) -> np.ndarray:
        """Return the places of the charges [m], (K, 3)."""
        return np.array(self.positions, float).reshape(-1, 3)
