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

"""Questions of plants to their environment, and the numbers of values that answer them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Blueprint

KINDS = {
    'light': (1, 4),      # share of the sky that is seen; direction of its mean
    'space': (1, 4),      # distance to what stands nearest [m]; direction
    'neighbour': (1, 4),  # distance to the nearest place that asks the same [m]; direction
    'load': (1, 2),       # bending stress over strength; bending moment [N·m]
    'sag': (3,),          # displacement by weight and wind [m]
}
"""Allowed numbers of values by kind."""

STORM = 20.0  # [m/s] strongest wind that plants grow for where nothing else is said: a full gale


class Question(NamedTuple):
    """
    Queries of one kind in one plant.

    :ivar kind: one of `KINDS`.
    :ivar points: where they stand [m], (Q, 3), in the frame of the plant.
    :ivar segments: that carry them, (Q,).
    """

    kind: str
    points: np.ndarray
    segments: np.ndarray


class Plant(NamedTuple):
    """
    A growing plant.

    :ivar built: its wood and leaves so far, part i being segment i; None = there are none yet.
    :ivar root: pose of its frame, turned about the vertical only [m], (7,), world.
    :ivar questions: at most one per kind.
    """

    built: Blueprint | None
    root: np.ndarray
    questions: Sequence[Question]
