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

"""Foliage of scanned trees: leaves spread along thin twigs."""

import numpy as np

from procphys_ros.blueprint import Leaves
from procphys_ros.blueprint.skeleton import shortest_turn
from procphys_ros.elementary import cos, sin
from procphys_ros.geometry import rotation

_TEXTURE = 1  # the second name


def spread(start: np.ndarray, end: np.ndarray, count: int, size: float, carrier: np.ndarray,
           frames: np.ndarray, generator: np.random.Generator) -> Leaves:
    """
    Set leaves evenly along twigs, pointing anywhere but back to their bases.

    :param start: of twigs [m], (T, 3).
    :param end: [m], (T, 3).
    :param count: of leaves.
    :param size: of each [m].
    :param carrier: part that carries what grows on each twig, (T,) int.
    :param frames: poses of all parts [m], (N, 7).
    :param generator: of random numbers.
    """
    along = end - start
    reach = np.cumsum(np.sqrt(np.square(along).sum(axis=1)))
    spots = (np.arange(count) + generator.random(count)) / count * reach[-1]
    twig = np.minimum(np.searchsorted(reach, spots, side='right'), len(reach) - 1)
    left = np.clip((reach[twig] - spots) / np.diff(reach, prepend=0.0)[twig], 0.0, 1.0)
    place = end[twig] - left[:, None] * along[twig]
    lift, turn = generator.random(count), 2.0 * np.pi * generator.random(count)
    flat = np.sqrt(1.0 - lift * lift)
    local = np.column_stack([flat * cos(turn), flat * sin(turn), lift])
    attitude = rotation.multiply(shortest_turn(along)[twig], shortest_turn(local))
    part = carrier[twig].astype(np.int32)
    pose = rotation.relative(frames[part], np.column_stack([place, attitude]))
    return Leaves(part, pose, np.full(count, size), np.full(count, _TEXTURE, np.int16))
