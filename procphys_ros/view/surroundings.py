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


"""Surroundings: ground, sun with shadows, sky light, and where the eye stands first."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.appearance.paving import Paving
from procphys_ros.render import camera, light
from procphys_ros.view.source import Frame

_SHADOW_REACH = 18.0  # lengths of the page from the eye within which viser draws shadows (20)
_SPAN = 40.0          # side of the ground over the radius of the scene
_HAZE = 0.35          # distance at which the ground begins to fade, over that of its edge
_LIT = (3.2, 1.6)     # intensity of sun and sky, matched by eye to `render`
_WINDOW = (16, 10)    # width and height of a usual browser window
_ROOM = 1.3           # factor of distance, because a panel covers a part
_LIFT = 0.004         # [m] of the grid above the ground
_SMALLEST = 2.0       # [m] least radius of a scene
_ROWS = 64            # of the picture of the sky


@dataclass(frozen=True)
class Vicinity:
    """
    A scene and the ground around it, up to the distance from which all of it is in view.

    :ivar low, high: corners of a box around all parts and leaves, world [m], (3,).
    """

    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, frame: Frame) -> 'Vicinity':
        """Compute the vicinity of a scene, without launched balls."""
        points = _points(frame)
        return cls(points.min(axis=0), points.max(axis=0))

    @property
    def radius(self) -> float:
        """Return the radius of the bounding sphere of the box [m]."""
        return max(_SMALLEST, 0.5 * float(np.linalg.norm(self.high - self.low)))

    @property
    def margin(self) -> float:
        """Return the margin around the box [m]."""
        return self.radius / float(np.sin(0.5 * np.radians(camera.FIELD_OF_VIEW)))

    @property
    def middle(self) -> np.ndarray:
        """Return the middle of the box, world [m], (3,)."""
        return 0.5 * (self.low + self.high)

    def holds(self, point: np.ndarray) -> bool:
        """Return whether a point, world [m], (3,), is inside, seen from above."""
        inside = (self.low - self.margin <= point) & (point <= self.high + self.margin)
        return bool(inside[:2].all())


def unit_of(frame: Frame) -> float:
    """
    Choose the length of the page per metre, so that shadows reach over the whole scene.

    :param frame: the first one of the scene.
    """
    eye, target = standpoint(frame)
    away = float(np.linalg.norm(np.subtract(eye, target)))
    return min(1.0, _SHADOW_REACH / (away + Vicinity.of(frame).radius))


def arrange(server: Any, frame: Frame, unit: float) -> None:
    """
    Place ground, light and cameras around a scene.

    :param server: `ViserServer`.
    :param frame: the first one of the scene.
    :param unit: length of the page [1/m].
    """
    points = _points(frame)
    middle, span = points.mean(axis=0), _SPAN * Vicinity.of(frame).radius * unit
    ground, line = (_bytes(tone * np.array(rgba('ground')[:3])) for tone in (1.0, 0.85))
    place = float(middle[0]) * unit, float(middle[1]) * unit
    # A mesh, because a grid is drawn with translucent objects, and would be hidden by dust.
    if frame.content.terrain.is_flat:
        corners = 0.5 * span * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        corners, faces = corners + [*place, 0.0], np.array([[0, 1, 2], [0, 2, 3]])
    else:
        corners, faces = frame.content.terrain.mesh(0.5 * span / unit)
        corners = unit * corners
    server.scene.add_mesh_simple('/ground', corners, faces, color=ground, cast_shadow=False)
    _pave(server, frame.content.paving, unit)
    server.scene.add_grid(
        '/grid', span, span, position=(*place, _LIFT * unit), cell_size=unit,
        section_size=10.0 * unit, cell_color=line, section_color=line, shadow_opacity=0.0,
        fade_distance=span, visible=frame.content.terrain.is_flat)
    server.scene.configure_fog(0.5 * _HAZE * span, 0.5 * span, color=_bytes(light.SKY_LOW))
    eye, target = standpoint(frame)
    for view in (server.initial_camera, *(c.camera for c in server.get_clients().values())):
        view.fov = np.radians(camera.FIELD_OF_VIEW)
        view.position, view.look_at = unit * eye, unit * target


def _pave(server: Any, paving: Sequence[Paving], unit: float) -> None:
    """Replace the paving of the ground."""
    server.scene.remove_by_name('/paving')
    for number, one in enumerate(paving):
        server.scene.add_mesh_simple(
            f'/paving/{number}', unit * one.points, one.faces,
            color=_bytes(rgba(one.texture)[:3]), cast_shadow=False)


def light_up(server: Any) -> None:
    """Replace the default studio lights by sun and sky."""
    scene = server.scene
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_directional('/sun', color=_bytes((1.0, 0.96, 0.88)), intensity=_LIT[0],
                                cast_shadow=True, position=tuple(100.0 * light.SUN))
    scene.add_light_hemisphere('/sky', sky_color=_bytes((0.75, 0.83, 0.93)),
                               ground_color=_bytes((0.47, 0.48, 0.40)), intensity=_LIT[1])
    share = np.linspace(1.0, 0.0, _ROWS)[:, None, None] ** 0.6
    sky = share * light.SKY_HIGH + (1.0 - share) * light.SKY_LOW
    scene.set_background_image((255.0 * np.repeat(sky, 2, axis=1)).astype(np.uint8))


def standpoint(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Return eye and target [m] that show the whole scene."""
    return look_at(_points(frame))


def look_at(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return eye and target [m] that show points [m], (V, 3), with room for the panel."""
    view = camera.frame(points, _WINDOW)
    return view.target + _ROOM * (view.eye - view.target), view.target


def _bytes(colour: Sequence[float] | np.ndarray) -> tuple[int, int, int]:
    red, green, blue = (int(255 * value) for value in colour)
    return red, green, blue


def _points(frame: Frame) -> np.ndarray:
    points = np.concatenate([frame.poses[~frame.content.ball, :3], frame.leaf_poses[:, :3]])
    points = points[np.isfinite(points[:, 0])]
    return points if len(points) else np.array([[-2.0, -2.0, 0.0], [2.0, 2.0, 2.0]])
