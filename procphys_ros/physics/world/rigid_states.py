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

"""
Poses and velocities of rapier's bodies: attribute by attribute, or their bytes.

Bytes of a position and of two vectors take half as long as their twelve numbers one by one. What
is before the numbers, and their order, is rapier's own affair: bytes are read only where both ways
have been seen to give the same, see `RapierEngine`.
"""

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np

# Position, velocity and spin of a body, each behind a mark and the number of its layout.
_BODY = np.dtype([('', 'V8'), ('rotation', '<f4', 4), ('translation', '<f4', 3),
                  ('', 'V8'), ('linear', '<f4', 3), ('', 'V8'), ('angular', '<f4', 3)])


def by_attributes(bodies: Sequence[Any]) -> np.ndarray:
    """Read places, attitudes, velocities and spins of `rapier3d.RigidBody`s, (K, 13)."""
    values = chain.from_iterable(chain.from_iterable(
        (body.translation.to_tuple(), body.rotation.to_tuple(), body.linvel.to_tuple(),
         body.angvel.to_tuple()) for body in bodies))
    return np.fromiter(values, float, 13 * len(bodies)).reshape(-1, 13)


def by_bytes(bodies: Sequence[Any]) -> np.ndarray | None:
    """Read the same from bytes; None = there are not as many as there should be."""
    data = b''.join(chain.from_iterable(
        (body.position.to_bytes(), body.linvel.to_bytes(), body.angvel.to_bytes())
        for body in bodies))
    if len(data) != _BODY.itemsize * len(bodies):
        return None
    rows = np.frombuffer(data, _BODY)
    table = np.empty((len(bodies), 13))
    table[:, :3], table[:, 3:7] = rows['translation'], rows['rotation']
    table[:, 7:10], table[:, 10:] = rows['linear'], rows['angular']
    return table
