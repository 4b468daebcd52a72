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

"""Contacts: which boxes of one frame share a face, from a hashed grid over each face plane."""

from typing import NamedTuple

import numpy as np

from procphys_ros.wallgrammar.boxes import Boxes

_BUCKET = 250_000  # [µm] side of a grid square: about one brick, so few candidates meet in it
_LEAST = 12_000    # [µm] narrower laps hold nothing, unless the parts themselves are as thin


class FaceContacts(NamedTuple):
    """
    Contacts between faces; the first part is on the low side.

    :ivar first, second: rows of the boxes, (m,).
    :ivar axis: axis of the frame that the first part's face looks along, (m,).
    :ivar low, high: contact patch [µm], (m, 3); along `axis` the joint between the two faces.
    """

    first: np.ndarray
    second: np.ndarray
    axis: np.ndarray
    low: np.ndarray
    high: np.ndarray


def spread(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Enumerate the elements of groups of given sizes.

    :param count: size of each group, (n,).
    :returns: group of each element and its position inside the group, (sum of count,) each.
    """
    group = np.repeat(np.arange(len(count)), count)
    return group, np.arange(len(group)) - np.repeat(np.cumsum(count) - count, count)


def find(boxes: Boxes) -> FaceContacts:
    """
    Find all faces that meet: opposite faces of two cells in one plane, with boxes that overlap.

    Parts that are not boxes have no contacts here, see `polygons`.
    Work and memory grow with the number of faces; a face is compared only with those in its own
    plane that share a square of the grid with it.

    :param boxes: boxes of any frames; only boxes of the same frame are compared.
    """
    cell_low, cell_high = boxes.cells
    found = [_along(boxes, cell_low, cell_high, axis) for axis in range(3)]
    return FaceContacts(*(np.concatenate(column) for column in zip(*found)))


def _along(boxes: Boxes, cell_low: np.ndarray, cell_high: np.ndarray, axis: int) -> FaceContacts:
    across = [a for a in range(3) if a != axis]
    ahead, behind = _same_planes(boxes.frame, cell_high[:, axis], cell_low[:, axis])
    cut = boxes.form >= 0
    ahead, behind = np.where(cut, -1, ahead), np.where(cut, -1, behind)
    first, second, square = _candidates(boxes, across, ahead, behind)
    low = np.maximum(boxes.low[first], boxes.low[second])
    high = np.minimum(boxes.high[first], boxes.high[second])
    size = (boxes.high - boxes.low)[:, across]
    least = np.minimum(_LEAST, np.minimum(size[first], size[second]) // 2)
    keep = ((high[:, across] - low[:, across]) > least).all(axis=1)
    # A pair may meet in several squares: only the one with the patch's lower corner counts.
    keep &= (low[:, across] // _BUCKET == square).all(axis=1)
    first, second, low, high = first[keep], second[keep], low[keep], high[keep]
    low[:, axis] = boxes.high[first, axis]
    high[:, axis] = boxes.low[second, axis]
    return FaceContacts(first, second, np.full(len(first), axis), low, high)


def _same_planes(frame: np.ndarray, ahead: np.ndarray,
                 behind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index the planes of faces; faces without an opposite face in their plane get -1."""
    n = len(frame)
    keys = np.column_stack([np.concatenate([frame, frame]), np.concatenate([ahead, behind])])
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    new = (np.diff(keys[order], axis=0) != 0).any(axis=1)
    plane = np.zeros(2 * n, np.int64)
    plane[order[1:]] = np.cumsum(new)
    size = int(np.max(plane, initial=-1)) + 1
    both = (np.bincount(plane[:n], minlength=size) > 0) & (np.bincount(plane[n:],
                                                                       minlength=size) > 0)
    plane = np.where(both[plane], plane, -1)
    return plane[:n], plane[n:]


def _candidates(boxes: Boxes, across: list[int], ahead: np.ndarray,
                behind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pair the faces that share a plane and a square; return the square too, (m, 2)."""
    if not len(boxes):
        return np.zeros(0, int), np.zeros(0, int), np.zeros((0, 2), int)
    first_square = boxes.low[:, across] // _BUCKET
    last_square = (boxes.high[:, across] - 1) // _BUCKET
    origin = first_square.min(axis=0)
    extent = last_square.max(axis=0) - origin + 1

    def squares(plane: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rows = np.flatnonzero(plane >= 0)
        wide = last_square[rows] - first_square[rows] + 1
        group, step = spread(wide[:, 0] * wide[:, 1])
        row = rows[group]
        square = first_square[row] + np.column_stack([step // wide[group, 1],
                                                      step % wide[group, 1]])
        place = square - origin
        return row, square, (plane[row] * extent[0] + place[:, 0]) * extent[1] + place[:, 1]

    row_a, square_a, key_a = squares(ahead)
    row_b, _, key_b = squares(behind)
    order = np.argsort(key_b, kind='stable')
    row_b, key_b = row_b[order], key_b[order]
    start = np.searchsorted(key_b, key_a, 'left')
    group, step = spread(np.searchsorted(key_b, key_a, 'right') - start)
    return row_a[group], row_b[start[group] + step], square_a[group]
