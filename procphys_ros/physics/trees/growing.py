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


"""Growing: what the constants of segments are between two years of a growing tree."""

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.physics.trees.layout import (
    EXTRA_PRELOAD,
    EXTRA_STRIDE,
    LENGTH,
    PRELOAD_X,
    PRELOAD_Y,
    REACH,
    VOGEL,
)
from procphys_ros.physics.trees.layout import LIMIT as _LIMIT

MOUNT, BODY, SWING, EXTRA = 0, 7, 15, 20
SECTION, WIDTH = 26, 27
BLOCKS = slice(0, BODY), slice(BODY, SWING), slice(SWING, EXTRA), slice(EXTRA, SECTION)
"""Columns of `Forest.constants`: those of `ForestModel`, without the joint; section modulus."""
PRELOADS = [SWING + PRELOAD_X, SWING + PRELOAD_Y, EXTRA + EXTRA_PRELOAD,
            EXTRA + EXTRA_STRIDE + EXTRA_PRELOAD]
SPAN = BODY + LENGTH

THIN = 1e-3   # of its length and width, as which a segment begins, and to which one withers
LIGHT = 1e-6  # of its other constants then: lighter than by THIN³, equations lose digits
_LENGTHS = [BODY + REACH, BODY + LENGTH]
_KEPT = [*range(BODY), BODY + VOGEL, SWING + _LIMIT]


def slight(constants: np.ndarray) -> np.ndarray:
    """Return the constants of segments that are all but nothing, with their mounts, (K, 27)."""
    out = LIGHT * constants  # locked springs stay so
    out[:, _LENGTHS] = THIN * constants[:, _LENGTHS]
    out[:, _KEPT] = constants[:, _KEPT]
    return out


def ratios(one: np.ndarray, other: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """
    Compute how the lengths of parents differ, 1 for roots, (K, 1).

    :param one, other: constants, (K, 27).
    :param parents: their rows there, -1 for the ground, (K,).
    """
    ratio = np.append(one[:, SPAN] / other[:, SPAN], 1.0)
    return ratio[parents][:, None]


def between(start: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """
    Interpolate columns linearly, exactly at both ends, (K, W).

    :param start, end: (K, W); infinite numbers are those of the end.
    :param share: 0 to 1, (K, 1).
    """
    with np.errstate(invalid='ignore'):
        now = start + share * (end - start)
    return np.where((start == end) | (share >= 1.0), end, now)


def constants_between(start: np.ndarray, end: np.ndarray, bulge: np.ndarray,
                      share: np.ndarray) -> np.ndarray:
    """
    Interpolate constants, so that trees at rest stay in balance, (K, 27).

    Masses and lengths change linearly, so preloads do so to the second order.

    :param start, end: constants, (K, 27).
    :param bulge: of preloads, from `bulge`, (K, 4).
    :param share: 0 to 1, (K, 1).
    """
    now = between(start, end, share)
    turn = now[:, 3:BODY]
    size = np.sqrt((turn * turn).sum(axis=1, keepdims=True))
    np.divide(turn, size, out=turn, where=np.abs(size - 1.0) > 1e-15)
    now[:, PRELOADS] += share * (1.0 - share) * bulge
    return now


def aligned(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the start with mounts whose quaternions have the signs of those at the end."""
    out = start.copy()
    side = (start[:, 3:BODY] * end[:, 3:BODY]).sum(axis=1, keepdims=True)
    out[:, 3:BODY] *= np.where(side < 0.0, -1.0, 1.0)
    return out


def bulge(first: np.ndarray, middle: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return by how much preloads exceed linear ones, over share · (1 - share), (K, 4)."""
    return 4.0 * middle - 2.0 * (first + last)


def remounted(mount: np.ndarray, between_them: list[np.ndarray]) -> np.ndarray:
    """
    Return a mount on a new parent that has come between a segment and its old one, (7,).

    :param mount: on the old parent, (7,).
    :param between_them: mounts of the new segments from the old parent to the new one, (7,) each.
    """
    frame = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    for one in between_them:
        frame = rotation.compose(frame, one)
    return rotation.relative(frame, mount)
