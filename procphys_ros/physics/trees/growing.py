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
    LIMIT,
    PRELOAD_X,
    PRELOAD_Y,
    REACH,
    VOGEL,
)

BODY, SWING, EXTRA = 7, 15, 26
SECTION, WIDTH = 32, 33
BLOCKS = slice(0, BODY), slice(BODY, SWING), slice(SWING, EXTRA), slice(EXTRA, SECTION)
"""Columns of `Forest.constants`: those of `ForestModel`, without the joint; section modulus."""
PRELOADS = [SWING + PRELOAD_X, SWING + PRELOAD_Y, EXTRA + EXTRA_PRELOAD,
            EXTRA + EXTRA_STRIDE + EXTRA_PRELOAD]
SPAN = BODY + LENGTH

THIN = 1e-3   # of its length and width, as which a segment begins, and to which one withers
LIGHT = 1e-6  # of its other constants then: lighter than by THIN³, equations lose digits
_ROUNDING = 1e-14  # of the squares of quaternions
_LENGTHS = [BODY + REACH, BODY + LENGTH]
_KEPT = [*range(BODY), BODY + VOGEL, SWING + LIMIT]


def slight(constants: np.ndarray) -> np.ndarray:
    """Return the constants of segments that are all but nothing, with their mounts, (K, 33)."""
    out = LIGHT * constants  # locked springs stay so
    out[:, _LENGTHS] = THIN * constants[:, _LENGTHS]
    out[:, _KEPT] = constants[:, _KEPT]
    return out


def ratios(one: np.ndarray, other: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """
    Compute how the lengths of parents differ, 1 for roots, (K, 1).

    :param one, other: constants, (K, 33).
    :param parents: their rows there, -1 for the ground, (K,).
    """
    ratio = np.append(one[:, SPAN] / other[:, SPAN], 1.0)
    return ratio[parents][:, None]


def slope_of(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return how columns change in the whole year, 0 where they are infinite, (K, W)."""
    with np.errstate(invalid='ignore'):
        return np.where(start == end, 0.0, end - start)


def between(start: np.ndarray, end: np.ndarray, slope: np.ndarray,
            share: np.ndarray) -> np.ndarray:
    """
    Interpolate columns linearly, exactly at both ends, (K, W).

    :param start, end: (K, W).
    :param slope: from `slope_of`, (K, W).
    :param share: 0 to 1, (K,).
    """
    now = slope * share[:, None]
    now += start
    done = share >= 1.0
    if done.any():
        now[done] = end[done]
    return now


def balance(constants: np.ndarray, bulge: np.ndarray, share: np.ndarray) -> None:
    """
    Correct interpolated constants so that trees at rest stay in balance.

    Masses and lengths change linearly, so preloads do so to the second order.

    :param constants: changed in place, (K, 33 or more).
    :param bulge: of preloads, from `bulge`, (K, 4).
    :param share: 0 to 1, (K,).
    """
    turn = constants[:, 3:BODY]
    square = (turn * turn).sum(axis=1)
    bent = np.abs(square - 1.0) > _ROUNDING
    if bent.any():
        turn[bent] /= np.sqrt(square[bent])[:, None]
    constants[:, PRELOADS] += (share * (1.0 - share))[:, None] * bulge


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
    frame = rotation.ORIGIN
    for one in between_them:
        frame = rotation.compose(frame, one)
    return rotation.relative(frame, mount)
