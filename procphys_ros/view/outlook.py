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


"""Outlook: where to look at a scene from, its objects, and pictures of what is seen."""

from collections.abc import Callable
import io
from typing import Any

import numpy as np

from procphys_ros.render import camera
from procphys_ros.view import surroundings
from procphys_ros.view.source import Frame, PageContent
from procphys_ros.view.surroundings import Vicinity

ALL, _PERSON = 'all', 'person'  # the whole scene, and the eye height of a person
SIDES = {'above': (0.0, -0.02, 1.0), 'south': (0.0, -1.0, 0.15), 'west': (-1.0, 0.0, 0.15),
         'north': (0.0, 1.0, 0.15), 'east': (1.0, 0.0, 0.15),
         _PERSON: (0.3, -1.0, 0.0)}  # towards the eye
_EYE_HEIGHT = 1.6  # [m] of a person
_PATIENCE = 30.0  # [s] to wait for the picture of a browser
_NONE = '–'


class Outlook:
    """
    Build the folder "View", and move the camera of its user.

    :param gui: `ViserServer.gui`.
    :param seen: returns the shown frame, and the length of the page [1/m].
    """

    def __init__(self, gui: Any, seen: Callable[[], tuple[Frame | None, float]]):
        self._seen = seen
        self._parts: dict[str, list[int]] = {}  # of objects, by their names
        self._listed = 0
        with gui.add_folder('View', expand_by_default=False):
            self.side = gui.add_button_group('from', [ALL, *SIDES])
            self.object = gui.add_dropdown('object', [_NONE], hint='look at one of them')
            self.picture = gui.add_button('save picture')
        self.side.on_click(lambda event: self._go(
            event, lambda frame: from_side(frame, self.side.value)))
        self.object.on_update(lambda event: self._go(event, self._chosen))
        self.picture.on_click(self._save)

    def list_objects(self, content: PageContent, is_new: bool) -> None:
        """
        List the objects of a scene.

        :param content: of the scene.
        :param is_new: whether the scene has changed.
        """
        if is_new:
            self._parts, self._listed = {}, 0
        if self._listed == len(content):
            return
        for part in range(self._listed, len(content)):
            self._parts.setdefault(content.name(part).rpartition('/')[0], []).append(part)
        self._listed = len(content)
        self.object.options = (_NONE, *self._parts)

    def _go(self, event: Any, place: Callable[[Frame], tuple[np.ndarray, np.ndarray] | None]
            ) -> None:
        """Move a client's camera to eye and target by a function, unless it returns None."""
        frame, unit = self._seen()
        stand = place(frame) if frame is not None and event.client is not None else None
        if stand is not None:
            with event.client.atomic():
                event.client.camera.position, event.client.camera.look_at = (
                    unit * stand[0], unit * stand[1])

    def _chosen(self, frame: Frame) -> tuple[np.ndarray, np.ndarray] | None:
        return at_parts(frame, np.array(self._parts.get(self.object.value, ()), int))

    def _save(self, event: Any) -> None:
        """Send a client the picture of its view, as a file."""
        from PIL import Image
        client = event.client
        try:
            seen = client.get_render(client.camera.image_height, client.camera.image_width,
                                     timeout=_PATIENCE)
        except (TimeoutError, RuntimeError):  # it has left, or stopped drawing
            return
        data = io.BytesIO()
        Image.fromarray(seen).save(data, 'png')
        client.send_file_download('procphys_ros.png', data.getvalue(), save_immediately=True)


def from_side(frame: Frame, side: str) -> tuple[np.ndarray, np.ndarray]:
    """
    Return eye and target [m] for a view of the whole scene.

    :param frame: the scene.
    :param side: `ALL`, or one of `SIDES`.
    """
    if side == ALL:
        return surroundings.standpoint(frame)
    vicinity, back = Vicinity.of(frame), np.array(SIDES[side])
    eye = vicinity.middle + vicinity.margin / np.linalg.norm(back) * back
    if side == _PERSON:
        eye[2] = frame.content.terrain.height(eye[None])[0] + _EYE_HEIGHT
    return eye, vicinity.middle


def at_parts(frame: Frame, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return eye and target [m] for a view of some parts, (K,); None if none remain."""
    parts = parts[parts < len(frame.poses)]
    parts = parts[np.isfinite(frame.poses[parts, 0])]
    if not len(parts):
        return None
    return surroundings.look_at(
        camera.corners(frame.poses[parts], frame.content.size[parts]))
