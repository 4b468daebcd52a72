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


"""Wind arrow: an arrow over the scene that points to where the mean wind blows to."""

from typing import Any

import numpy as np

from procphys_ros.view.surroundings import Vicinity

_LENGTH, _LIFT = 0.35, 0.12  # of the arrow and of its height over the scene, over its radius
_SHAFT, _HEAD = 0.02, 0.05  # radii over its length
_COLOUR = (245, 245, 250)
_CALM = 0.05  # [m/s] below which there is none


class WindArrow:
    """
    Draw an arrow with the speed beside it; send only changes of the wind.

    :param scene: `ViserServer.scene`.
    :param unit: length of the page [1/m].
    :param vicinity: of the scene below it.
    """

    def __init__(self, scene: Any, unit: float, vicinity: Vicinity):
        self._scene, self._unit, self._vicinity = scene, unit, vicinity
        self._handles: list[Any] = []
        self._shown: tuple[float, ...] = ()

    def show(self, wind: tuple[float, float, float]) -> None:
        """Draw a mean wind [m/s], world, (3,)."""
        if wind == self._shown:
            return
        self.close()
        self._shown = wind
        speed = float(np.linalg.norm(wind))
        if speed < _CALM:
            return
        vicinity = self._vicinity
        length = _LENGTH * vicinity.radius
        middle = vicinity.middle
        middle[2] = vicinity.high[2] + _LIFT * vicinity.radius
        half = 0.5 * length / speed * np.array(wind)
        ends = self._unit * np.array([[middle - half, middle + half]])
        thick = self._unit * length
        self._handles = [
            self._scene.add_arrows('/wind/arrow', ends.astype(np.float32), _COLOUR,
                                   shaft_radius=_SHAFT * thick, head_radius=_HEAD * thick,
                                   head_length=4.0 * _HEAD * thick),
            self._scene.add_label('/wind/speed', f'{speed:.1f} m/s',
                                  position=self._unit * middle, anchor='bottom-center')]

    def close(self) -> None:
        """Remove the arrow from the page."""
        for handle in self._handles:
            handle.remove()
        self._handles, self._shown = [], ()
