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

"""Flight: what nothing but gravity moves follows its parabola exactly."""

import numpy as np

from procphys_ros.physics.world.body_table import BodyTable

_CONTACT = 1e-4  # [m/s] least change of speed by a contact, above the rounding of rapier ...
_ROUNDING = 1e-6  # ... at this share of the speed


def correct_flight(bodies: BodyTable, ids: np.ndarray, before: np.ndarray, gravity: np.ndarray,
                   time_step: float, integrations: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Put bodies that touched nothing where velocity Verlet has them.

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
    after = bodies.velocities[ids, :3]
    other = np.abs(after - before[:, :3] - gravity * time_step).max(axis=1, initial=0.0)
    least = _CONTACT + _ROUNDING * np.abs(after).max(axis=1, initial=0.0)
    flies = ids[(other < least) & ~bodies.pushed[ids]]
    poses = bodies.poses[flies]
    poses[:, :3] -= 0.5 * gravity * time_step ** 2 / integrations
    return flies, poses
