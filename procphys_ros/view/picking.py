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


"""Picking: what a ray from the eye meets first."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.view.source import Frame

GROUND = -1
_NEAR_MISS = 0.004  # [rad] least half of a part: twigs are thinner than a pixel
_BESIDE = 2.0       # of that, along a ray that meets a face at 60 degrees
_LEAF_REACH = 0.4   # radius of the sphere that replaces a leaf, over its length


@dataclass(frozen=True)
class Hit:
    """
    The intersection of a ray with the scene.

    :ivar part: its index; `GROUND` for the ground.
    :ivar point: of intersection, world [m], (3,).
    :ivar distance: from the eye [m].
    """

    part: int
    point: np.ndarray
    distance: float


def pick(frame: Frame, origin: np.ndarray, direction: np.ndarray) -> Hit | None:
    """
    Find the first intersection of a ray: a part, a leaf (which counts as its part), or the ground.

    A thin part that the ray just misses counts if nothing else is met until well behind it.

    :param frame: the shown one.
    :param origin: the eye, world [m], (3,).
    :param direction: of the ray, world, (3,).
    :returns: None for the sky.
    """
    origin = np.asarray(origin, float)
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    parts, near, until = _distance_to_boxes(frame.poses, frame.content.size, origin, direction)
    leaves = _distance_to_leaves(frame, origin, direction)
    distance, part = np.inf, GROUND
    if len(parts):
        distance, part = parts.min(), int(parts.argmin())
    if len(leaves) and leaves.min() < distance:
        nearest = int(np.argmin(leaves))
        distance, part = leaves[nearest], int(frame.content.leaves.part[nearest])
    if until.min(initial=np.inf) < distance:
        part = int(until.argmin())
        distance = near[part]
    distance, part = min((distance, part), (_distance_to_ground(frame, origin, direction), GROUND))
    if not np.isfinite(distance):
        return None
    return Hit(part, origin + distance * direction, float(distance))


def _distance_to_ground(frame: Frame, origin: np.ndarray, direction: np.ndarray) -> float:
    if not frame.content.terrain.is_flat:
        return frame.content.terrain.range(origin, direction)
    return float(-origin[2] / direction[2]) if direction[2] < 0.0 < origin[2] else np.inf


def _distance_to_boxes(poses: np.ndarray, size: np.ndarray, origin: np.ndarray,
                       direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return where a ray meets the box of each part.

    :returns: distance at which it enters the box, inf = never, (N,); the same for boxes that are
        thickened where they are thin, though to the plane of the face, (N,); and the distance
        until which such a box hides others: those next to it lie within, (N,).
    """
    back = rotation.conjugate(poses[:, 3:])
    start = rotation.rotate(back, origin - poses[:, :3])
    along = rotation.rotate(back, direction)
    reach = np.linalg.norm(start, axis=1, keepdims=True)
    half = 0.5 * size
    thick = np.maximum(half, _NEAR_MISS * reach)
    there = np.isfinite(poses[:, 0])
    first, enter, leave = _crossed(half, start, along)
    exact = np.where((enter <= leave) & (leave > 0.0) & there, np.maximum(enter, 0.0), np.inf)
    outer, enter, leave = _crossed(thick, start, along)
    face = first[np.arange(len(outer)), outer.argmax(axis=1)]
    near = np.where((enter <= leave) & (leave > 0.0) & there,
                    np.clip(face, np.maximum(enter, 0.0), leave), np.inf)
    return exact, near, near + _BESIDE * _NEAR_MISS * reach[:, 0]


def _crossed(half: np.ndarray, start: np.ndarray,
             along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where rays enter the slabs of boxes (N, 3), and where they enter and leave all."""
    with np.errstate(divide='ignore', invalid='ignore'):
        one, other = (-half - start) / along, (half - start) / along
    first = np.nan_to_num(np.fmin(one, other), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    last = np.nan_to_num(np.fmax(one, other), nan=np.inf, posinf=np.inf, neginf=-np.inf)
    return first, first.max(axis=1, initial=-np.inf), last.min(axis=1, initial=np.inf)


def _distance_to_leaves(frame: Frame, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the distance at which a ray enters the sphere of each leaf, inf = never, (L,)."""
    leaves, poses = frame.content.leaves, frame.leaf_poses
    up = rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    centre = poses[:, :3] + 0.5 * leaves.size[:, None] * up - origin
    along = centre @ direction
    aside = np.einsum('ij,ij->i', centre, centre) - along ** 2
    depth = (_LEAF_REACH * leaves.size) ** 2 - aside
    with np.errstate(invalid='ignore'):
        return np.where((depth > 0.0) & (along > 0.0), along - np.sqrt(depth), np.inf)
