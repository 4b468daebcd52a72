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

"""Stability: every part must be bonded to the ground."""

from collections.abc import Sequence

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.blueprint import GROUND
from procphys_ros.geometry.rotation import rotate
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.boxes import Boxes, MICRO
from procphys_ros.wallgrammar.construction import Site


def check_connected(boxes: Boxes, patches: Sequence[Patches], frames: np.ndarray,
                    site: Site) -> None:
    """
    Check that every part of a building is bonded to the ground, directly or indirectly.

    :param boxes: all parts.
    :param patches: all bonds.
    :param frames: pose of each frame [m], (f, 7).
    :param site: for names and place in errors.
    :raises GrammarError: naming an unsupported part.
    """
    pair = np.concatenate([p.pair for p in patches])
    ground = len(boxes)
    nodes = np.where(pair == GROUND, ground, pair)
    graph = scipy.sparse.coo_array((np.ones(len(nodes), np.int8), (nodes[:, 0], nodes[:, 1])),
                                   shape=(ground + 1, ground + 1))
    group = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    loose = np.flatnonzero(group[:ground] != group[ground])
    if len(loose):
        row = loose[0]
        centre = (boxes.low[row] + boxes.high[row]) / (2.0 * MICRO)
        frame = frames[boxes.frame[row]]
        x, y, z = frame[:3] + rotate(frame[3:], centre)
        raise site.place.error(
            f'{len(loose)} parts would hang in the air, the first a '
            f'{site.kinds[boxes.kind[row]]} at ({x:.2f}, {y:.2f}, {z:.2f}) m: nothing bonds it '
            f'to the ground; put wall under it')
