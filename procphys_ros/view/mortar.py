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


"""Mortar: boxes in the joints of walls, as long as their bricks stay where they are."""

from typing import Any

import numpy as np

from procphys_ros.view import shapes
from procphys_ros.view.batches import Group, MOST_BOXES, present, VISIBLE
from procphys_ros.view.source import Frame, PageContent


class MortarBoxes:
    """
    Draw the joints of one scene, and send those whose parts move.

    :param scene: `ViserServer.scene` or a substitute.
    :param unit: length of the page [1/m].
    """

    def __init__(self, scene: Any, unit: float):
        self._group = Group(scene, 'mortar', unit, VISIBLE)
        self._poses = np.zeros((0, 7))  # of the parts when their joints were placed
        self._boxes = np.zeros((0, 7))

    def update(self, frame: Frame) -> None:
        """Draw new joints, and move those whose parts have moved."""
        seats = frame.content.mortar
        if seats is None or not len(seats.bond):
            return
        known, shown = len(self._poses), np.isfinite(frame.poses[:, 0])
        before = np.full_like(frame.poses, np.nan)
        before[:known] = self._poses
        # NaN is not equal to itself: parts that appear, vanish or are gone count as moved.
        moved = ~(np.abs(frame.poses - before) <= VISIBLE).all(axis=1)
        moved &= shown | np.isfinite(before[:, 0])
        rows = np.flatnonzero(moved[seats.first] | moved[seats.second])
        if not len(rows):
            return
        self._poses = np.where(moved[:, None], frame.poses, before)
        old = len(self._boxes)
        self._boxes = np.concatenate([self._boxes, np.full((len(seats.bond) - old, 7), np.nan)])
        self._boxes[rows] = present(seats.boxes(frame.poses, shown, rows))
        for start in range(old, len(seats.bond), MOST_BOXES):
            new = np.arange(start, min(start + MOST_BOXES, len(seats.bond)))
            self._group.add(shapes.box(_look(frame.content), 0), new, self._boxes,
                            seats.size[new])
        self._group.send(self._boxes, rows)

    def close(self) -> None:
        """Remove all joints from the page."""
        self._group.close()


def _look(content: PageContent) -> str:
    return next((name for name in content.textures if 'mortar' in name), 'mortar')
