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

from typing import Any

import numpy as np

SHAPES = ('sphere', 'box')


def edges_of(solid: Any) -> np.ndarray:
    """
    Return the full extents of a solid along its axes [m], (3,).

    :param solid: a group of parameters with a shape, and a size of one number or three.
    :raises ProcPhysError: of the group's class, when there is no such solid.
    """
    if len(solid.size) not in (1, 3):
        raise solid.error(f'{solid.group}.size is {list(solid.size)}, it must be one number or '
                          'three')
    edges = np.broadcast_to(np.array(solid.size), 3).copy()
    if solid.shape == 'sphere' and np.ptp(edges) > 0.0:
        raise solid.error(f'{solid.group}.size is {edges.tolist()}; a sphere has one diameter')
    return edges
