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

"""Flight: move bodies without contact along their exact parabola."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.world.body_table import BodyTable

_CONTACT = 1e-4  # [m/s] least change of speed by a contact, above the rounding of rapier ...
_ROUNDING = 1e-6  # ... at this share of the speed


def correct_flight(bodies: BodyTable, ids: np.ndarray, before: np.ndarray, gravity: np.ndarray,
                   time_step: float, integrations: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Correct the poses of bodies that touched nothing to those of velocity Verlet.

    Engines move bodies with the velocity of the end of a step (semi-implicit Euler), which gives
    a fall n + 1 / n of its way after n steps. What rests on something needs that: contacts are
    solved for the velocity at the end.

    :param ids: bodies that moved, (K,).
    :param before: their velocities before the step, (K, 6).
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :param integrations: steps of Euler that the engine took in it.
    :returns: bodies, (M,), and their poses, (M, 7).
    """
    flies = ids[_flies(ids, before, gravity * time_step, bodies.velocities, bodies.pushed)]
    poses = bodies.poses[flies]
    poses[:, :3] -= 0.5 * gravity * (time_step * time_step) / integrations
    return flies, poses


@kernel
def _flies(ids, before, gain, velocities, pushed):
    """List the rows of bodies that only gravity has given speed to, (M,)."""
    found = np.zeros(len(ids), np.bool_)
    for k in range(len(ids)):
        other = fastest = 0.0
        for c in range(3):
            after = velocities[ids[k], c]
            other = max(other, abs(after - before[k, c] - gain[c]))
            fastest = max(fastest, abs(after))
        found[k] = other < _CONTACT + _ROUNDING * fastest and not pushed[ids[k]]
    return np.flatnonzero(found)
