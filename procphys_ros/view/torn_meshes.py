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

"""Torn ends on the page: splinters of broken branches, root plates and pits."""

from typing import Any

import numpy as np

from procphys_ros.appearance import torn_wood
from procphys_ros.appearance.palette import rgba
from procphys_ros.blueprint import GROUND
from procphys_ros.view.source import Frame

_VISIBLE = 1e-3  # [m] and [-]: smaller moves are not sent


class TornMeshes:
    """
    Draw a mesh for every torn end; send nothing while nothing has broken.

    :param scene: `ViserServer.scene`.
    :param unit: length of the page [1/m].
    """

    def __init__(self, scene: Any, unit: float):
        self._scene, self._unit = scene, unit
        self._torn = torn_wood.TornEnds()
        self._drawn: dict[int, list[tuple[Any, int]]] = {}  # handles and parts, by bond
        self._ends: dict[int, list[torn_wood.End]] = {}  # the drawn ones
        self._sent: dict[str, np.ndarray] = {}

    def update(self, frame: Frame) -> None:
        """Draw the present torn ends."""
        wood = frame.content.wood
        if wood is None:
            return
        torn = self._torn.update(wood, frame.poses)
        for bond in [bond for bond in self._drawn if self._ends[bond] is not torn.get(bond)]:
            self._remove(bond)
        self._ends = dict(torn)
        for bond in set(torn) - set(self._drawn):
            self._drawn[bond] = [(self._add(f'/torn/{bond}/{i}', look, corners), part)
                                 for i, (look, part, corners) in enumerate(torn[bond])]
        for ends in self._drawn.values():
            for handle, part in ends:
                if part != GROUND:
                    self._move(handle, frame.poses[part])

    def close(self) -> None:
        """Remove all torn ends from the page."""
        for bond in list(self._drawn):
            self._remove(bond)

    def _remove(self, bond: int) -> None:
        for handle, _ in self._drawn.pop(bond):
            self._sent.pop(handle.name, None)
            handle.remove()

    def _add(self, name: str, look: str, corners: np.ndarray) -> Any:
        colour = tuple(round(255 * c) for c in rgba(look)[:3])
        return self._scene.add_mesh_simple(
            name, self._unit * corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3),
            color=colour, flat_shading=True, side='double', cast_shadow=False)

    def _move(self, handle: Any, pose: np.ndarray) -> None:
        there = bool(np.isfinite(pose).all())
        if handle.visible != there:
            handle.visible = there
        before = self._sent.get(handle.name)
        if not there or before is not None and np.abs(pose - before).max() < _VISIBLE:
            return
        self._sent[handle.name] = pose.copy()
        handle.position, handle.wxyz = self._unit * pose[:3], pose[[6, 3, 4, 5]]
