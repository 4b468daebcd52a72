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


"""
Reflections of a blast by surrounding walls, by the method of images.

A plane wall reflects a wave as if it came from the charge's mirror image behind it. That is
exact for sound; programs for shocks in rooms also sum the impulses of images. W. E. Baker
et al. 1983, Explosion Hazards and Evaluation, 3.4, count three pulses on a wall of a room, which
arrive at 1, 3 and 5 times the first one's time: those of the charge, and of two orders of images.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.loads.lattice import heading, SIX_WAYS
from procphys_ros.physics.loads.sight import SEAL, Sight

_ORDERS = 2        # largest number of reflections of a wave
_OFF = 2.0 * SEAL  # [m] distance from a plane at which rays end, and behind which it must be solid
_SAME = 0.05       # [m] largest offset of faces of one rough plane


@dataclass(frozen=True)
class Image:
    """
    A mirror image of a charge.

    :ivar place: (3,) [m], world.
    :ivar planes: reflecting planes, the last one first: a point, and the unit normal
        towards the charge, (3,) each.
    :ivar before: position of the image that each plane mirrors, (3,) each.
    """

    place: np.ndarray
    planes: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    before: tuple[np.ndarray, ...] = ()

    def reaches(self, points: np.ndarray, owners: np.ndarray, sight: Sight) -> np.ndarray:
        """
        Mark the points that the wave reaches by reflection at all of the planes, (K,) bool.

        :param points: (K, 3) [m], world.
        :param owners: box that each point lies on, (K,).
        :param sight: boxes that reflect and shield.
        """
        rows, at, own = np.arange(len(points)), points, owners
        source = self.place
        for (middle, normal), mirrored in zip(self.planes, self.before):
            height, depth = product(at - middle, normal), float(product(source - middle, normal))
            front = height > _OFF
            rows, at, own, height = rows[front], at[front], own[front], height[front]
            share = (height / (height - depth))[:, None]
            foot = at + share * (source - at)
            solid = sight.holds(foot - _OFF * normal)
            rows, at, own, foot = rows[solid], at[solid], own[solid], foot[solid] + _OFF * normal
            free = sight.clear(at, foot, own)
            rows, at, source = rows[free], foot[free], mirrored
            own = np.full(len(rows), -1)
        found = np.zeros(len(points), bool)
        found[rows[sight.clear(at, np.tile(source, (len(at), 1)), own)]] = True
        return found


def images(point: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
           floor: bool = True) -> list[Image]:
    """
    Mirror a charge in the surrounding planes, in the axis directions of the nearest box.

    :param point: of the charge, (3,) [m], world.
    :param poses: of the boxes, (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param floor: whether the plane below counts, which the curves of bursts on the ground include.
    """
    if not len(poses):
        return []
    planes: list[tuple[np.ndarray, np.ndarray]] = []
    for foot, normal in _faces(point, poses, sizes, SIX_WAYS if floor else SIX_WAYS[:5]):
        depth = product(point - foot, normal)
        if all(norm(depth * normal - product(point - other, way) * way) > _SAME
               for other, way in planes):
            planes.append((foot, normal))
    found, latest = [], [Image(point)]
    for _ in range(_ORDERS):
        latest = [Image(one.place - 2.0 * product(one.place - plane[0], plane[1]) * plane[1],
                        (plane, *one.planes), (one.place, *one.before))
                  for one in latest for plane in planes
                  if product(one.place - plane[0], plane[1]) > _OFF]
        found += latest
    return found


def _faces(point: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
           ways: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the first face hit by rays from a point in some directions: point and normal."""
    away = point - poses[:, :3]
    nearest = int(np.argmin(np.square(away).sum(axis=1)))
    axes = rotation.to_matrix(poses[:, 3:])
    offset = np.einsum('nji,nj->ni', axes, away)
    for way in rotation.rotate(heading(poses[nearest, 3:]), ways):
        along = np.einsum('nji,j->ni', axes, way)
        still = np.abs(along) < 1e-12
        rate = 1.0 / np.where(still, 1.0, along)
        ends = (-0.5 * sizes - offset) * rate, (0.5 * sizes - offset) * rate
        low, high = np.minimum(*ends), np.maximum(*ends)
        beside = still & (np.abs(offset) > 0.5 * sizes)
        low, high = np.where(still, -np.inf, low), np.where(still, np.inf, high)
        enter = low.max(axis=1)
        meets = (enter < high.min(axis=1)) & (enter > 0.0) & ~beside.any(axis=1)
        if meets.any():
            box = int(np.argmin(np.where(meets, enter, np.inf)))
            axis = int(np.argmax(low[box]))
            normal = -np.sign(along[box, axis]) * axes[box, :, axis]
            yield point + enter[box] * way, normal
