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
_NEAR_MISS = 0.004  # [rad] tolerance around parts: twigs are thinner than a pixel
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

    :param frame: the shown one.
    :param origin: the eye, world [m], (3,).
    :param direction: of the ray, world, (3,).
    :returns: None for the sky.
    """
    origin = np.asarray(origin, float)
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    parts = _distance_to_boxes(frame.poses, frame.content.size, origin, direction)
    leaves = _distance_to_leaves(frame, origin, direction)
    candidates = []
    if len(parts):
        candidates.append((parts.min(), int(parts.argmin())))
    if len(leaves):
        nearest = int(np.argmin(leaves))
        candidates.append((leaves[nearest], int(frame.content.leaves.part[nearest])))
    candidates.append((_distance_to_ground(frame, origin, direction), GROUND))
    distance, part = min(candidates, default=(np.inf, GROUND))
    if not np.isfinite(distance):
        return None
    return Hit(part, origin + distance * direction, float(distance))


def _distance_to_ground(frame: Frame, origin: np.ndarray, direction: np.ndarray) -> float:
    if not frame.content.terrain.is_flat:
        return frame.content.terrain.range(origin, direction)
    return float(-origin[2] / direction[2]) if direction[2] < 0.0 < origin[2] else np.inf


def _distance_to_boxes(poses: np.ndarray, size: np.ndarray, origin: np.ndarray,
                       direction: np.ndarray) -> np.ndarray:
    """Return the distance at which a ray enters the box of each part, inf = never, (N,)."""
    back = rotation.conjugate(poses[:, 3:])
    start = rotation.rotate(back, origin - poses[:, :3])
    along = rotation.rotate(back, direction)
    reach = np.linalg.norm(start, axis=1, keepdims=True)
    half = 0.5 * size + _NEAR_MISS * reach
    with np.errstate(divide='ignore', invalid='ignore'):
        one, other = (-half - start) / along, (half - start) / along
    enter = np.nanmax(np.fmin(one, other), axis=1, initial=-np.inf)
    leave = np.nanmin(np.fmax(one, other), axis=1, initial=np.inf)
    met = (enter <= leave) & (leave > 0.0) & np.isfinite(poses[:, 0])
    return np.where(met, np.maximum(enter, 0.0), np.inf)


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
