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

"""Boxes: parts on their way into a blueprint, in whole micrometres so that faces meet."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from procphys_ros.blueprint.column_table import ColumnTable
from procphys_ros.elementary.array_enum import ArrayEnum

MICRO = 1_000_000  # micrometres per metre
SPAN = 2  # spans have an even number of pieces, to break in the middle, where they bend most


class Joint(ArrayEnum):
    """Fastening of a part to its neighbours."""

    MORTAR = 0   # laid in mortar
    FIXING = 1   # nailed, screwed, puttied
    BEARING = 2  # rests on masonry, is nailed to timber
    NAIL = 3     # as FIXING, but two such parts share a single nail: tiles, battens, rafters
    LAP = 4      # lapped over other timber and nailed
    HALVED = 5   # halved over the timber that it crosses, cogged onto the one where it ends


def micro(metres: float) -> int:
    """Round metres to whole micrometres."""
    return round(float(metres) * MICRO)


def micros(metres: ArrayLike) -> np.ndarray:
    """Round an array of metres to whole micrometres."""
    return np.rint(np.asarray(metres, float) * MICRO).astype(np.int64)


@dataclass(frozen=True)
class Boxes(ColumnTable):
    """
    Boxes, each in a frame; `cells` of neighbours meet exactly, half a joint outside the boxes.

    :ivar low, high: opposite corners [µm], (n, 3), in the frame of the box.
    :ivar before, after: joint between box and cell on the low and the high side [µm], (n, 3).
    :ivar frame: index of the frame, (n,).
    :ivar axis: axis of the frame that the length of the part runs along, (n,).
    :ivar kind: index of the kind name, (n,).
    :ivar material: index of the material, (n,).
    :ivar joint: `Joint`, (n,).
    :ivar member: pieces of equal number >= 0 are one timber or one brick, (n,).
    :ivar form: index of the part's corners in `Site.forms`; -1 = the box itself, (n,).
    """

    low: np.ndarray
    high: np.ndarray
    before: np.ndarray
    after: np.ndarray
    frame: np.ndarray
    axis: np.ndarray
    kind: np.ndarray
    material: np.ndarray
    joint: np.ndarray
    member: np.ndarray
    form: np.ndarray

    @property
    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the cells [µm], two of (n, 3)."""
        return self.low - self.before, self.high + self.after


def from_cells(low: ArrayLike, high: ArrayLike, before: ArrayLike = 0, after: ArrayLike = 0, *,
               frame: int = 0, axis: int = 0, kind: int = 0, material: int = 0,
               joint: int = Joint.MORTAR, member: int = -1, form: int = -1) -> Boxes:
    """
    Make boxes that fill cells up to their joints; columns broadcast against the cells.

    :param low: lower corners of the cells [µm], (n, 3).
    :param high: upper corners of the cells [µm], (n, 3).
    :param before: joints on the low sides [µm], (n, 3), (3,) or a number.
    :param after: joints on the high sides [µm], likewise.
    """
    low = np.atleast_2d(np.asarray(low, np.int64))
    high = np.atleast_2d(np.asarray(high, np.int64))
    before = np.broadcast_to(np.asarray(before, np.int64), low.shape)
    after = np.broadcast_to(np.asarray(after, np.int64), low.shape)

    def column(value: int) -> np.ndarray:
        return np.broadcast_to(np.asarray(value, np.int64), len(low)).copy()

    return Boxes(low + before, high - after, before.copy(), after.copy(), column(frame),
                 column(axis), column(kind), column(material), column(joint), column(member),
                 column(form))


def split_along(boxes: Boxes, longest: int, first_member: int, multiple: int = 1) -> Boxes:
    """
    Cut boxes along their length into equal pieces that stay one member, so that they can splinter.

    :param boxes: uncut members.
    :param longest: greatest length of a piece [µm].
    :param first_member: number of the first member; they are counted up from it.
    :param multiple: divisor of the number of pieces; 2 lets spans break in the middle.
    """
    rows = np.arange(len(boxes))
    start, end = boxes.low[rows, boxes.axis], boxes.high[rows, boxes.axis]
    count = np.maximum(-(-(end - start) // (longest * multiple)), 1) * multiple
    owner = np.repeat(rows, count)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    pieces = boxes.take(owner)
    low, high = pieces.low.copy(), pieces.high.copy()
    before, after = pieces.before.copy(), pieces.after.copy()
    row, axis = np.arange(len(owner)), pieces.axis
    length = end - start
    low[row, axis] = start[owner] + length[owner] * step // count[owner]
    high[row, axis] = start[owner] + length[owner] * (step + 1) // count[owner]
    before[row[step > 0], axis[step > 0]] = 0
    inner = step < count[owner] - 1
    after[row[inner], axis[inner]] = 0
    return replace(pieces, low=low, high=high, before=before, after=after,
                   member=first_member + owner)
