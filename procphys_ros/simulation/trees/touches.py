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

"""Touches: where trees met something in one step."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Touches:
    """
    Every contact of trees in one step.

    :ivar row: of the forest, (C,).
    :ivar other: row of the forest that it met, -1 for none, (C,).
    :ivar body: id of the body that it met, -1 for none, (C,).
    :ivar part: standing brick that it met, -1 for none, (C,).
    :ivar point: where, world [m], (C, 3).
    :ivar impulse: on the row; what it met gets the opposite [N·s], (C, 3).
    """

    row: np.ndarray
    other: np.ndarray
    body: np.ndarray
    part: np.ndarray
    point: np.ndarray
    impulse: np.ndarray

    def __len__(self) -> int:
        return len(self.row)
