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


"""Momentum ledger of blows and charges."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

_KEPT = 1000  # blows listed singly; older ones count in the totals only


@dataclass(frozen=True)
class Impact:
    """
    One blow of a projectile on what stands.

    :ivar time: of the step it happened in [s].
    :ivar projectile: its part.
    :ivar point: where it touched, world [m], (3,).
    :ivar parts: what it touched, (K,).
    :ivar torn: whether these came off (of trees: never, they bend first).
    :ivar lost: momentum that the projectile lost [N·s], (3,).
    :ivar carried: momentum that the struck parts took along [N·s], (3,).
    :ivar grounded: momentum that went through the wall to the ground [N·s], (3,).
    :ivar work: of fracture, taken from what moves [J].
    """

    time: float
    projectile: int
    point: np.ndarray
    parts: np.ndarray
    torn: bool
    lost: np.ndarray
    carried: np.ndarray
    grounded: np.ndarray
    work: float


@dataclass
class MomentumLedger:
    """
    The books of all blows since the start.

    :ivar recent: the last blows, oldest first.
    :ivar count: number of all blows.
    :ivar lost, carried, grounded: sums over all blows [N·s], (3,); lost = carried + grounded. Of
        masonry that blows throw over, the momentum is carried, too, from when it comes off.
    :ivar work: of fracture, sum over all blows [J].
    :ivar thrown: momentum of all that charges in walls threw, when they went off [N·s], (3,); what
        stands around the charges got as much the other way.
    :ivar waves: impulse that blast waves gave to what stood, without panes [N·s], (3,).
    :ivar blown: of that what parts took along when they came off [N·s], (3,); the rest went into
        the ground, or is in walls that still shake.
    :ivar released: energy that this moves with [J], which the charges brought.
    """

    recent: deque[Impact] = field(default_factory=lambda: deque(maxlen=_KEPT))
    count: int = 0
    lost: np.ndarray = field(default_factory=lambda: np.zeros(3))
    carried: np.ndarray = field(default_factory=lambda: np.zeros(3))
    grounded: np.ndarray = field(default_factory=lambda: np.zeros(3))
    work: float = 0.0
    thrown: np.ndarray = field(default_factory=lambda: np.zeros(3))
    released: float = 0.0
    waves: np.ndarray = field(default_factory=lambda: np.zeros(3))
    blown: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def record(self, impact: Impact) -> None:
        """Enter a blow."""
        self.recent.append(impact)
        self.count += 1
        self.lost = self.lost + impact.lost
        self.carried = self.carried + impact.carried
        self.grounded = self.grounded + impact.grounded
        self.work += impact.work

    def come_off(self, momentum: np.ndarray) -> None:
        """Enter the momentum with which masonry comes off that blows throw over [N·s], (3,)."""
        self.carried = self.carried + momentum
        self.grounded = self.grounded - momentum

    def throw(self, momentum: np.ndarray, energy: float) -> None:
        """Enter what a charge threw: the sum of its momenta [N·s], (3,), and its energy [J]."""
        self.thrown = self.thrown + momentum
        self.released += energy
