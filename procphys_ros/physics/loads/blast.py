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
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import cbrt
from procphys_ros.errors import CommandError
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.air import CYLINDER_DRAG
from procphys_ros.physics.loads import air_blast, faces, reflections
from procphys_ros.physics.loads.sight import OFF_FACE, Sight

_LARGEST = 1e6        # [kg] largest charge (a kiloton), which exceeds the size of scenes


@dataclass(frozen=True)
class Impulses:
    """
    Impulses of a blast on N bodies.

    :ivar linear: (N, 3) [N·s], world.
    :ivar angular: about the centre, (N, 3) [N·m·s], world.
    :ivar arrival: of the front at the centre [s] after the explosion, (N,).
    :ivar peak: largest force in the direction of the impulse [N], (N,).
    """

    linear: np.ndarray
    angular: np.ndarray
    arrival: np.ndarray
    peak: np.ndarray

    @property
    def duration(self) -> np.ndarray:
        """Return the duration of a triangular pulse of that peak and impulse [s], (N,)."""
        size = norm(self.linear, axis=1)
        return 2.0 * size / np.maximum(self.peak, 1e-9)

    def points(self, centres: np.ndarray) -> np.ndarray:
        """Return the points of action of the linear impulses, (N, 3), world."""
        square = (self.linear * self.linear).sum(axis=1, keepdims=True)
        arm = np.cross(self.linear, self.angular) / np.where(square > 0.0, square, 1.0)
        return centres + arm


def blast_boxes(point: Sequence[float], charge: float, poses: np.ndarray, sizes: np.ndarray,
                blocking: np.ndarray | None = None, sight: Sight | None = None,
                ground: float = 0.0, fronts: np.ndarray | None = None,
                centres: np.ndarray | None = None,
                skin: np.ndarray | None = None) -> Impulses:
    """
    Compute the impulses on boxes.

    The impulse on a face under the angle of incidence i is that of ConWep (TM 5-855-1):
    reflected · cos² i + side-on · (1 - cos i)². The reflected pressure clears from the edges of
    the wall that a box belongs to, see `air_blast.cleared_impulse`. Faces that cannot see the
    charge get none, except for the skins of buildings, which get the side-on impulse at their
    distance like roof, side and rear walls in UFC 3-340-02, 2-15.4, without shielding. Waves
    reflected by walls around the charge add their impulses, see `reflections`.

    :param point: of the charge, (3,) [m], world.
    :param charge: mass of TNT [kg].
    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param blocking: boxes that shield others, (N,) bool; None = all.
    :param sight: existing lines of sight among the boxes; None = build them.
    :param ground: height of the ground below the charge [m].
    :param fronts: of each box's wall, across each of the box's three axes: the lesser and the
        greater of height and half the width [m], (N, 3, 2); None = infinite, without clearing.
    :param centres: reference points of moments, (N, 3) [m]; None = those of the boxes.
    :param skin: faces with a room behind them, (N, 6) bool, see `skin.outer_faces`; None = none.
    :raises CommandError: when point or charge are out of range.
    """
    place, scale, burst = _check(point, charge, ground)
    poses = np.asarray(poses, float)
    sizes = np.asarray(sizes, float)
    outer = np.zeros((len(poses), 6), bool) if skin is None else skin
    if sight is None:
        sight = Sight(poses, sizes, blocking=blocking)
    middles = poses[:, :3] if centres is None else centres
    linear, angular, force = np.zeros((3, len(poses), 3))
    mirrored = reflections.images(place, poses, sizes, burst == 0.0)
    for image in (reflections.Image(place), *mirrored):
        direct = not image.planes
        wanted = faces.facing(poses, sizes, image.place) | (outer & direct)
        loads = _wave(image, scale, burst, faces.cut(poses, sizes, wanted), sight, fronts,
                      outer & direct)
        gift = faces.gather(loads.patches, loads.impulse, middles)
        linear, angular = linear + gift[0], angular + gift[1]
        if direct:
            force, _ = faces.gather(loads.patches, loads.force, middles)
    return Impulses(linear, angular, _arrival(place, scale, burst, poses), norm(force, axis=1))


class _Loads(NamedTuple):
    """Impulse [N·s] and largest force [N] of one wave on patches of faces, (K, 3) each."""

    patches: faces.FacePatches
    impulse: np.ndarray
    force: np.ndarray


def _wave(image: reflections.Image, scale: float, burst: float, patches: faces.FacePatches,
          sight: Sight, fronts: np.ndarray | None, outer: np.ndarray) -> _Loads:
    """Compute the loads of the wave of a charge, or of an image of it, on exposed patches."""
    one_sided = outer[patches.owner, patches.face]
    towards = image.place - patches.centre
    distance = np.maximum(norm(towards, axis=1), 1e-9)
    cosine = np.einsum('ki,ki->k', towards, patches.normal) / distance
    seen = cosine > 0.0
    seen[seen] = image.reaches((patches.centre + OFF_FACE * patches.normal)[seen],
                               patches.owner[seen], sight)
    felt = seen | one_sided
    patches, z, cosine = patches.take(felt), distance[felt] / scale, np.where(
        seen, cosine, 0.0)[felt]
    front = np.inf if fronts is None else fronts[patches.owner, patches.face // 2].T / scale
    waves = (air_blast.cleared_impulse(z, front, burst), air_blast.impulse(z, burst)), (
        air_blast.reflected(z, burst), air_blast.overpressure(z, burst))
    impulse, pressure = (incidence(*wave, cosine, one_sided[felt]) for wave in waves)
    inward = -patches.area[:, None] * patches.normal
    return _Loads(patches, (scale * impulse)[:, None] * inward, pressure[:, None] * inward)


def blast_capsules(point: Sequence[float], charge: float, poses: np.ndarray, sizes: np.ndarray,
                   sight: Sight | None = None, ground: float = 0.0) -> Impulses:
    """
    Compute the impulses on slender segments from their projected areas.

    A thin body is engulfed at once: it takes half the reflected pressure while the front passes
    it, then drag, whose pressure falls off with the square of the overpressure.

    :param point: of the charge, (3,) [m], world.
    :param charge: mass of TNT [kg].
    :param poses: (N, 7) [m], xyzw, world; the axis is z.
    :param sizes: diameter, diameter, length over the round ends, (N, 3) [m].
    :param sight: boxes that shield; None = no shielding.
    :param ground: height of the ground below the charge [m].
    :raises CommandError: when point or charge are out of range.
    """
    place, scale, burst = _check(point, charge, ground)
    poses, sizes = np.asarray(poses, float), np.asarray(sizes, float)
    away = poses[:, :3] - place
    distance = np.maximum(norm(away, axis=1), 1e-9)
    away /= distance[:, None]
    diameter, length = sizes[:, 0], sizes[:, 2]
    along = np.einsum('ni,ni->n', away, _axes(poses))
    shadow = (diameter * (length - diameter) * np.sqrt(np.maximum(1.0 - along * along, 0.0))
              + 0.25 * np.pi * (diameter * diameter))
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
                    _arrival(place, scale, burst, poses),
                    0.5 * air_blast.reflected(z, burst) * shadow)


def incidence(squarely: np.ndarray, side_on: np.ndarray, cosine: np.ndarray,
              one_sided: np.ndarray | bool = False) -> np.ndarray:
    """
    Compute the impulse or pressure on faces under an angle of incidence.

    :param squarely: on a face normal to the wave, (K,).
    :param side_on: on a face along the wave, (K,).
    :param cosine: of the angle between the face's normal and the direction to the charge, (K,).
    :param one_sided: faces with a room behind them, (K,) bool; a grazing wave soon presses on the
        far sides of others as well.
    """
    graze = 1.0 - cosine
    return squarely * (cosine * cosine) + side_on * graze * np.where(
        one_sided, graze, np.minimum(graze, cosine))


def _arrival(point: np.ndarray, scale: float, ground: float, poses: np.ndarray) -> np.ndarray:
    """Compute the arrival times of the front at bodies [s], (N,)."""
    z = norm(poses[:, :3] - point, axis=1) / scale
    return scale * air_blast.arrival(z, ground)


def _axes(poses: np.ndarray) -> np.ndarray:
    x, y, z, w = poses[:, 3:].T
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def _check(point: Sequence[float], charge: float,
           ground: float) -> tuple[np.ndarray, float, float]:
    """Check a charge; return its position, W^(1/3), and share of a burst on the ground."""
    place = np.asarray(point, float)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise CommandError(f'explosion.position is {list(point)}, it must be three finite numbers')
    if not (math.isfinite(charge) and 0.0 < charge <= _LARGEST):
        raise CommandError(f'explosion.charge is {charge:g} kg TNT, it must lie above 0 and not '
                           f'exceed {_LARGEST:g}')
    burst = air_blast.ground_share(charge, float(place[2]) - ground)
    return place, cbrt(charge), burst
