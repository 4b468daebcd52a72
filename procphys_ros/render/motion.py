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


"""Motion: how the camera of a film moves."""

import numpy as np

from procphys_ros.errors import SceneError
from procphys_ros.render import camera
from procphys_ros.render.camera import View
from procphys_ros.scene.scenery import CameraSettings

_FOLLOWING = 9.0  # [m] default distance from the followed part
_LAG = 0.25  # [s] in which the camera makes 63 % of a move of the part


class CameraMotion:
    """
    Compute the view of a camera at any time, in increasing order.

    :param settings: position and motion.
    :param points: that the first picture must show if no position is set [m], (P, 3).
    :param size: width and height of the picture [px].
    :param part: initial position [m], (3,), of the followed part; None = no part is followed.
    :raises SceneError: if position and target of the camera coincide.
    """

    def __init__(self, settings: CameraSettings, points: np.ndarray, size: tuple[int, int],
                 part: np.ndarray | None = None):
        self._settings = settings
        whole = camera.frame(points, size, settings.field_of_view)
        target = whole.target if part is None else part
        if settings.target is not None:
            target = np.asarray(settings.target)
        if settings.position is not None:
            eye = np.asarray(settings.position)
        else:
            eye = whole.eye if part is None else target + _FOLLOWING * whole.back
        if np.linalg.norm(eye - target) < 1e-6:
            raise SceneError(f'the camera stands where it looks, at {eye.tolist()}')
        self._first = View(eye, target, settings.field_of_view)
        self._time = 0.0
        self._part, self._moved = part, np.zeros(3)

    def view(self, time: float, part: np.ndarray | None = None) -> View:
        """
        Return the view.

        :param time: since the start of the film [s].
        :param part: position [m], (3,), of the followed part; not finite = as before.
        """
        first, motion = self._first, self._settings.motion
        step, self._time = time - self._time, time
        if motion == 'orbit':
            turn = 2.0 * np.pi * time / self._settings.period
            x, y, z = first.eye - first.target
            arm = [np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z]
            return View(first.target + arm, first.target, first.angle)
        if motion == 'follow' and part is not None and np.isfinite(part).all():
            gap = part - self._part - self._moved
            self._moved = self._moved + (1.0 - np.exp(-step / _LAG)) * gap
        return View(first.eye + self._moved, first.target + self._moved, first.angle)
