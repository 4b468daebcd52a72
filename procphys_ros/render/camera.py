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


"""Camera: where to stand so that the whole scene is in the picture."""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.geometry import rotation

FIELD_OF_VIEW = 32.0  # [degrees], vertical
_MARGIN = 1.06  # the scene fills this inverse share of the frame
_FEW, _ROUNDS = 100, 5  # points that are all used, and number of shifts of the target
_BEARING = np.radians(-72.0)  # the camera stands mostly to the south of the scene
_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_LOW, _HIGH = np.radians(4.0), np.radians(17.0)  # elevation for a lone tree and a wide scene


@dataclass(frozen=True)
class View:
    """
    Eye and angle of a camera.

    :ivar eye: position of the camera [m], (3,).
    :ivar target: centre of the picture [m], (3,).
    :ivar angle: vertical [degrees].
    """

    eye: np.ndarray
    target: np.ndarray
    angle: float = FIELD_OF_VIEW

    @property
    def back(self) -> np.ndarray:
        """Return the unit vector from the target to the camera, (3,)."""
        back = np.subtract(self.eye, self.target)
        return back / np.linalg.norm(back)

    @property
    def side(self) -> np.ndarray:
        """Return the unit vector to the right of the picture, (3,)."""
        side = np.cross([0.0, 0.0, 1.0], self.back)
        length = np.linalg.norm(side)  # zero for a vertical view
        return side / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])

    @property
    def up(self) -> np.ndarray:
        """Return the unit vector to the top of the picture, (3,)."""
        return np.cross(self.back, self.side)

    def projection(self, aspect: float, planes: tuple[float, float]) -> np.ndarray:
        """
        Return the matrix from the world to the picture, as in OpenGL, (4, 4).

        :param aspect: width over height.
        :param planes: smallest and largest drawn depth [m].
        """
        near, far = planes
        turn = np.eye(4)
        turn[:3, :3] = np.stack([self.side, self.up, self.back])
        turn[:3, 3] = -turn[:3, :3] @ self.eye
        slope = np.tan(np.radians(self.angle) / 2.0)
        lens = np.zeros((4, 4))
        lens[0, 0], lens[1, 1] = 1.0 / (slope * aspect), 1.0 / slope
        lens[2, 2:] = (far + near) / (near - far), 2.0 * far * near / (near - far)
        lens[3, 2] = -1.0
        return lens @ turn


def frame(points: np.ndarray, size: tuple[int, int], angle: float = FIELD_OF_VIEW) -> View:
    """
    Find the view that shows all points.

    :param points: [m], (V, 3).
    :param size: width and height of the picture [px].
    :param angle: vertical [degrees].
    """
    low, high = points.min(axis=0), points.max(axis=0)
    centre, extent = 0.5 * (low + high), high - low
    breadth = float(np.hypot(extent[0], extent[1]) / max(extent[2], 1e-3))
    elevation = _LOW + (_HIGH - _LOW) * np.clip((breadth - 1.5) / 6.0, 0.0, 1.0)
    back = np.array([np.cos(_BEARING) * np.cos(elevation), np.sin(_BEARING) * np.cos(elevation),
                     np.sin(elevation)])
    right = np.array([-np.sin(_BEARING), np.cos(_BEARING), 0.0])
    up = np.cross(back, right)
    slope = np.tan(np.radians(angle) / 2.0)
    reach = slope * np.array([size[0] / size[1], 1.0])
    some = _outermost(points)
    for _ in range(_ROUNDS):  # near objects look larger: shift the target until both sides match
        offset = some - centre
        away, beside = offset @ back, offset @ np.stack([right, up], axis=-1)
        distance = _MARGIN * max(float((np.abs(beside) / reach + away[:, None]).max()), 0.5)
        seen = beside / (distance - away)[:, None]
        shift = 0.5 * distance * (seen.max(axis=0) + seen.min(axis=0))
        centre = centre + shift[0] * right + shift[1] * up
    return View(centre + distance * back, centre, angle)


def _outermost(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull, which bound the view of all points."""
    if len(points) <= _FEW:
        return points
    try:
        hull = scipy.spatial.ConvexHull(points, qhull_options='QJ')  # they may lie in a plane
        return points[hull.vertices]
    except scipy.spatial.QhullError:  # or coincide
        return np.unique(points, axis=0)


def corners(poses: np.ndarray, size: np.ndarray, unit: np.ndarray = _CUBE) -> np.ndarray:
    """
    Transform unit points to points of pieces [m], world, (N·C, 3).

    :param poses: of the pieces, world, (N, 7).
    :param size: their extents [m], (N, 3).
    :param unit: the points relative to the extents, (C, 3); default the corners of boxes.
    """
    turned = rotation.rotate(poses[:, None, 3:], unit * size[:, None])
    return (poses[:, None, :3] + turned).reshape(-1, 3)
