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


"""Marks: a flash and a few words where a click has acted."""

from collections import deque
from typing import Any

import numpy as np

_STAYS = 4.0  # [s] that a mark is shown
_FLASH = 1.0  # [s] in which its flash fades
_SIZE = 0.012  # radius of the flash, over the distance to the eye
_COLOUR = (255, 214, 90)
_SHAFT, _ARROW = 0.25, 6.0  # radius and length of the arrow, over the radius of the flash
_BRIGHTEST = 0.9  # opacity; opaque meshes would have to be replaced to fade


class Marks:
    """
    Draw fading marks, and send nothing while there are none.

    :param scene: `ViserServer.scene`.
    """

    def __init__(self, scene: Any):
        self._scene = scene
        self._coming: deque[tuple[np.ndarray, float, str, np.ndarray]] = deque()
        self._shown: deque[tuple[float, list[Any]]] = deque()
        self._number = 0

    def put(self, place: np.ndarray, distance: float, text: str,
            way: np.ndarray | None = None) -> None:
        """
        Show a mark from the next `update` on; thread-safe.

        :param place: position on the page, (3,).
        :param distance: from the eye, in lengths of the page.
        :param text: label.
        :param way: direction of an arrow that ends there, (3,); None or 0 = no arrow.
        """
        self._coming.append((place, _SIZE * distance, text,
                             np.zeros(3) if way is None else np.asarray(way, float)))

    def update(self, now: float) -> None:
        """
        Draw new marks, fade the others, and remove old ones.

        :param now: any clock [s].
        """
        while self._coming:
            self._shown.append((now, self._add(*self._coming.popleft())))
        while self._shown and now - self._shown[0][0] > _STAYS:
            for handle in self._shown.popleft()[1]:
                handle.remove()
        for since, (flash, *_) in self._shown:
            light = _BRIGHTEST * max(1.0 - (now - since) / _FLASH, 0.0)
            if flash.opacity != light:
                flash.opacity, flash.visible = light, light > 0.0

    def close(self) -> None:
        """Remove all marks from the page."""
        self._coming.clear()
        self.update(np.inf)

    def _add(self, place: np.ndarray, radius: float, text: str, way: np.ndarray) -> list[Any]:
        self._number += 1
        name = f'/marks/{self._number}'
        handles = [
            self._scene.add_icosphere(f'{name}/flash', radius, _COLOUR, opacity=_BRIGHTEST,
                                      cast_shadow=False, receive_shadow=False, position=place),
            self._scene.add_label(f'{name}/text', text, position=place, anchor='bottom-center')]
        if way.any():
            tail = place - _ARROW * radius * way / np.linalg.norm(way)
            handles.append(self._scene.add_arrows(
                f'{name}/arrow', np.array([[tail, place]], np.float32), _COLOUR,
                shaft_radius=_SHAFT * radius, head_radius=2.0 * _SHAFT * radius,
                head_length=radius))
        return handles
