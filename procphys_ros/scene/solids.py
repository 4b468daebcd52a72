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

"""Simple solids of scene files: sphere and box."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.errors import ProcPhysError

SHAPES = ('sphere', 'box')


def edges_of(key: str, shape: str, size: float | Sequence[float], largest: float,
             error: type[ProcPhysError]) -> np.ndarray:
    """
    Read the extents of a solid along its axes.

    :param key: of its parameters, in front of `.shape` and `.size` in messages.
    :param shape: checked to be one of `SHAPES`.
    :param size: a diameter or three edges [m].
    :param largest: that an edge may be [m].
    :param error: class of the exception.
    :returns: [m], (3,).
    :raises ProcPhysError: of that class, when there is no such solid.
    """
    if shape not in SHAPES:
        raise error(f'{key}.shape is {shape!r}, it must be one of {", ".join(SHAPES)}')
    try:
        given = np.array(size, float).ravel()
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.size not in (1, 3) or not np.isfinite(given).all():
        raise error(f'{key}.size is {size!r}, it must be one finite number or three')
    edges = np.broadcast_to(given, 3).copy()
    if not (edges > 0.0).all() or edges.max() > largest:
        raise error(f'{key}.size is {edges.tolist()} m, it must lie above 0 and not exceed '
                    f'{largest:g}')
    if shape == 'sphere' and np.ptp(edges) > 0.0:
        raise error(f'{key}.size is {edges.tolist()}; a sphere has one diameter')
    return edges
