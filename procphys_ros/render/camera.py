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

import numpy as np

FIELD_OF_VIEW = 32.0  # [degrees], vertical
_MARGIN = 1.06  # the scene fills this inverse share of the frame
_SAMPLE, _ROUNDS = 20000, 5  # points looked at, and how often the target is shifted
_BEARING = np.radians(-72.0)  # the camera stands mostly to the south of the scene
_LOW, _HIGH = np.radians(4.0), np.radians(17.0)  # elevation for a lone tree and a wide scene


def frame(points: np.ndarray, size: tuple[int, int]) -> tuple:
    """
    Give the camera position, focal point and up vector that show all points.

    :param points: [m], (V, 3).
    :param size: width and height of the picture [px].
    """
    low, high = points.min(axis=0), points.max(axis=0)
    centre, extent = 0.5 * (low + high), high - low
    breadth = float(np.hypot(extent[0], extent[1]) / max(extent[2], 1e-3))
    elevation = _LOW + (_HIGH - _LOW) * np.clip((breadth - 1.5) / 6.0, 0.0, 1.0)
    back = np.array([np.cos(_BEARING) * np.cos(elevation), np.sin(_BEARING) * np.cos(elevation),
                     np.sin(elevation)])
    right = np.array([-np.sin(_BEARING), np.cos(_BEARING), 0.0])
    up = np.cross(back, right)
    slope = np.tan(np.radians(FIELD_OF_VIEW) / 2.0)
    reach = slope * np.array([size[0] / size[1], 1.0])
    some = points[::len(points) // _SAMPLE + 1]
    for _ in range(_ROUNDS):  # near things look larger: shift the target until both sides match
        offset = some - centre
        away, beside = offset @ back, offset @ np.stack([right, up], axis=-1)
        distance = _MARGIN * max(float((np.abs(beside) / reach + away[:, None]).max()), 0.5)
        seen = beside / (distance - away)[:, None]
        shift = 0.5 * distance * (seen.max(axis=0) + seen.min(axis=0))
        centre = centre + shift[0] * right + shift[1] * up
    return tuple(centre + distance * back), tuple(centre), (0.0, 0.0, 1.0)
