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
    A blow of a projectile to a standing part.

    :ivar time: of its step [s].
    :ivar projectile: its part.
    :ivar point: of contact, world [m], (3,).
    :ivar parts: struck ones, (K,).
    :ivar torn: whether they came off (of trees: never, they bend first).
    :ivar lost: momentum that the projectile lost [N·s], (3,).
    :ivar carried: momentum of the struck parts [N·s], (3,).
    :ivar grounded: momentum that went through the wall to the ground [N·s], (3,).
    :ivar work: of fracture, lost by the moving bodies [J].
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
    The momentum balance of all blows since the start.

    :ivar recent: the last blows, oldest first.
    :ivar count: number of all blows.
    :ivar lost, carried, grounded: sums over all blows [N·s], (3,); lost = carried + grounded. The
        momentum of masonry that blows throw over is carried, too, once it is released.
    :ivar work: of fracture, sum over all blows [J].
    :ivar thrown: momentum of all parts thrown by charges in walls [N·s], (3,); the surrounding
        masonry got the opposite.
    :ivar waves: impulse of blast waves on standing parts, without panes [N·s], (3,).
    :ivar blown: the share of it carried by released parts [N·s], (3,); the rest went into the
        ground, or is in walls that still vibrate.
    :ivar released: kinetic energy of the thrown parts [J], supplied by the charges.
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
        """Record a blow."""
        self.recent.append(impact)
        self.count += 1
        self.lost = self.lost + impact.lost
        self.carried = self.carried + impact.carried
        self.grounded = self.grounded + impact.grounded
        self.work += impact.work

    def come_off(self, momentum: np.ndarray) -> None:
        """Record the momentum of released masonry that blows threw over [N·s], (3,)."""
        self.carried = self.carried + momentum
        self.grounded = self.grounded - momentum

    def throw(self, momentum: np.ndarray, energy: float) -> None:
        """Record the sum of momenta [N·s], (3,), and the energy [J] thrown by a charge."""
        self.thrown = self.thrown + momentum
        self.released += energy
