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


"""Impulses of an explosion on boxes and slender segments, with shielding."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.physics.air import CYLINDER_DRAG
from procphys_ros.physics.loads import air_blast, faces
from procphys_ros.physics.loads.sight import Sight

_OFF_FACE = 1e-4      # [m] rays start this far off a face
_LARGEST = 1e6        # [kg] charge beyond any use (a kiloton), where the scene ends


@dataclass(frozen=True)
class Impulses:
    """
    What a blast gives to each of N bodies.

    :ivar linear: (N, 3) [N·s], world.
    :ivar angular: about the centre, (N, 3) [N·m·s], world.
    :ivar arrival: when the front comes to the centre [s] after the explosion, (N,).
    :ivar duration: of the positive phase there [s], (N,).
    """

    linear: np.ndarray
    angular: np.ndarray
    arrival: np.ndarray
    duration: np.ndarray

    def points(self, centres: np.ndarray) -> np.ndarray:
        """Return where the linear impulses would have to act, (N, 3), world."""
        square = (self.linear ** 2).sum(axis=1, keepdims=True)
        arm = np.cross(self.linear, self.angular) / np.where(square > 0.0, square, 1.0)
        return centres + arm


def blast_boxes(point: Sequence[float], charge: float, poses: np.ndarray, sizes: np.ndarray,
                blocking: np.ndarray | None = None, sight: Sight | None = None,
                ground: float = 0.0) -> Impulses:
    """
    Compute the impulses on boxes; faces that cannot see the charge get none.

    The impulse on a face seen under the angle of incidence i is that of ConWep (TM 5-855-1):
    reflected · cos² i + side-on · (1 - cos i)²; near grazing the second term fades, since it
    soon acts on the far side too. Diffraction behind bodies is left out.

    :param point: of the charge, (3,) [m], world.
    :param charge: mass of TNT [kg].
    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param blocking: which boxes shield others, (N,) bool; None = all.
    :param sight: the boxes as already listed for rays; None = list them now.
    :param ground: height of the ground below the charge [m].
    :raises CommandError: when point or charge are out of range.
    """
    place, scale, burst = _check(point, charge, ground)
    poses = np.asarray(poses, float)
    sizes = np.asarray(sizes, float)
    patches = faces.cut(poses, sizes, faces.facing(poses, sizes, place))
    if sight is None:
        sight = Sight(poses, sizes, blocking=blocking)
    free = sight.clear(patches.centre + _OFF_FACE * patches.normal, place, patches.owner)
    patches = patches.take(free)
    towards = place - patches.centre
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    cosine = np.einsum('ki,ki->k', towards, patches.normal) / distance
    z = distance / scale
    per_area = scale * face_impulse(z, cosine, burst)
    linear, angular = faces.gather(
        patches, -(per_area * patches.area)[:, None] * patches.normal, poses)
    return Impulses(linear, angular, *_times(place, scale, burst, poses))


def blast_capsules(point: Sequence[float], charge: float, poses: np.ndarray, sizes: np.ndarray,
                   sight: Sight | None = None, ground: float = 0.0) -> Impulses:
    """
    Compute the impulses on slender segments from the shadow that they throw.

    A thin body is engulfed at once: it takes half the reflected pressure for the time the front
    needs to pass it, then drag, whose pressure falls off with the square of the overpressure.

    :param point: of the charge, (3,) [m], world.
    :param charge: mass of TNT [kg].
    :param poses: (N, 7) [m], xyzw, world; the axis is z.
    :param sizes: diameter, diameter, length over the round ends, (N, 3) [m].
    :param sight: boxes that shield; None = nothing does.
    :param ground: height of the ground below the charge [m].
    :raises CommandError: when point or charge are out of range.
    """
    place, scale, burst = _check(point, charge, ground)
    poses, sizes = np.asarray(poses, float), np.asarray(sizes, float)
    away = poses[:, :3] - place
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
    away /= distance[:, None]
    diameter, length = sizes[:, 0], sizes[:, 2]
    along = np.einsum('ni,ni->n', away, _axes(poses))
    shadow = (diameter * (length - diameter) * np.sqrt(np.maximum(1.0 - along ** 2, 0.0))
              + 0.25 * np.pi * diameter ** 2)
    z = distance / scale
    peak = air_blast.overpressure(z, burst)
    passing = 0.5 * air_blast.reflected(z, burst) * diameter / air_blast.shock_speed(peak)
    drag = (CYLINDER_DRAG * air_blast.dynamic_pressure(peak)
            * scale * air_blast.duration(z, burst) / 3)
    ceiling = scale * air_blast.reflected_impulse(z, burst)
    size = np.minimum(passing + drag, ceiling) * shadow
    if sight is not None:
        size *= sight.clear(poses[:, :3], place, np.full(len(poses), -1))
    return Impulses(size[:, None] * away, np.zeros((len(poses), 3)),
                    *_times(place, scale, burst, poses))


def face_impulse(z: np.ndarray, cosine: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """
    Return the impulse of the positive phase on a face [Pa·s/kg^(1/3)].

    :param z: scaled distance [m/kg^(1/3)].
    :param cosine: of the angle between the face's normal and the direction of the charge.
    :param ground: see `air_blast`.
    """
    graze = 1.0 - cosine
    return (air_blast.reflected_impulse(z, ground) * cosine ** 2
            + air_blast.impulse(z, ground) * graze * np.minimum(graze, cosine))


def _times(point: np.ndarray, scale: float, ground: float,
           poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give when the front arrives at bodies and how long it lasts there [s], (N,) each."""
    z = np.linalg.norm(poses[:, :3] - point, axis=1) / scale
    return scale * air_blast.arrival(z, ground), scale * air_blast.duration(z, ground)


def _axes(poses: np.ndarray) -> np.ndarray:
    x, y, z, w = poses[:, 3:].T
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def _check(point: Sequence[float], charge: float,
           ground: float) -> tuple[np.ndarray, float, float]:
    """Return the place and W^(1/3) of the charge, and how far it is one on the ground."""
    place = np.asarray(point, float)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise CommandError(f'explosion.position is {list(point)}, it must be three finite numbers')
    if not (math.isfinite(charge) and 0.0 < charge <= _LARGEST):
        raise CommandError(f'explosion.charge is {charge:g} kg TNT, it must lie above 0 and not '
                           f'exceed {_LARGEST:g}')
    burst = air_blast.ground_share(charge, float(place[2]) - ground)
    return place, charge ** (1.0 / 3.0), burst
