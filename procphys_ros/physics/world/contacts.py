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

"""Contacts of one step, as columns."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Contacts:
    """
    All contact points of one step.

    :ivar body_a: id, (C,) int.
    :ivar body_b: id, (C,) int.
    :ivar point: contact point, world [m], (C, 3).
    :ivar normal: unit, from b towards a, (C, 3).
    :ivar distance: gap, negative when they overlap [m], (C,).
    :ivar impulse: on a (the opposite on b) over the step, friction included [N·s], (C, 3).
    :ivar normal_impulse: its normal component [N·s], (C,).
    """

    body_a: np.ndarray
    body_b: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    distance: np.ndarray
    impulse: np.ndarray
    normal_impulse: np.ndarray

    @classmethod
    def of(cls, table: np.ndarray, time_step: float) -> 'Contacts':
        """Convert the engine's contact table (C, 13), with mean forces over the time step [s]."""
        return cls(table[:, 0].astype(np.intp), table[:, 1].astype(np.intp), table[:, 2:5],
                   table[:, 5:8], table[:, 8], table[:, 9:12] * time_step,
                   table[:, 12] * time_step)

    def __len__(self) -> int:
        return len(self.body_a)

    def on(self, body: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """
        List the contacts of one body: other ids (K,), points (K, 3), impulses on it (K, 3).

        :param body: id.
        """
        first, second = self.body_a == body, self.body_b == body
        return (np.concatenate([self.body_b[first], self.body_a[second]]),
                np.concatenate([self.point[first], self.point[second]]),
                np.concatenate([self.impulse[first], -self.impulse[second]]))

    def both_ways(self) -> 'Contacts':
        """List each contact twice, once with either body as `body_a`."""
        return Contacts(np.concatenate([self.body_a, self.body_b]),
                        np.concatenate([self.body_b, self.body_a]),
                        np.concatenate([self.point, self.point]),
                        np.concatenate([self.normal, -self.normal]),
                        np.concatenate([self.distance, self.distance]),
                        np.concatenate([self.impulse, -self.impulse]),
                        np.concatenate([self.normal_impulse, self.normal_impulse]))


def total_impulse(body: int, centre: np.ndarray, *tables: Contacts) -> np.ndarray:
    """
    Sum the contact impulses on a body: impulse [N·s] and moment about a point [N·m·s], (6,).

    :param body: id.
    :param centre: the point, world [m], (3,).
    :param tables: of one step.
    """
    touches = [table.on(body)[1:] for table in tables]
    point, impulse = (np.concatenate(columns) for columns in zip(*touches))
    return np.concatenate([impulse.sum(axis=0), np.cross(point - centre, impulse).sum(axis=0)])


def hand_on(rows: np.ndarray, former: np.ndarray, heirs: np.ndarray, bounds: np.ndarray) -> None:
    """
    Hand contacts of bodies on to the nearest of those in their place; writes `rows`.

    :param rows: of `Engine.contacts`, (C, 13).
    :param former, heirs: pairs of ids, the former ascending, (K,).
    :param bounds: of the heirs [m], (K, 6).
    """
    for side in (0, 1):
        low = np.searchsorted(former, rows[:, side])
        high = np.searchsorted(former, rows[:, side], 'right')
        rows[high == low + 1, side] = heirs[low[high == low + 1]]
        for c in np.flatnonzero(high > low + 1).tolist():
            own, point = bounds[low[c]:high[c]], rows[c, 2:5]
            gap = np.maximum(np.maximum(own[:, :3] - point, point - own[:, 3:]), 0.0)
            rows[c, side] = heirs[low[c] + np.argmin((gap * gap).sum(axis=1))]
