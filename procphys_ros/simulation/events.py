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


"""Record of bonds that broke: where, which, why, and how far beyond its strength."""

import numpy as np

EVENT = np.dtype([
    ('time', 'f8'),           # simulation time [s]
    ('position', 'f8', 3),    # contact point, world frame [m]
    ('bond', 'i4'),           # row in Blueprint.bonds, -1 for an anchor or a mechanism's joint
    ('part_a', 'i4'),         # first part of the bond, -1 for the ground
    ('part_b', 'i4'),         # second part
    ('cause', 'u1'),          # `physics.causes.Cause`
    ('load', 'f4'),           # load over strength at the moment of breaking
    ('crack', 'u1'),          # 1 = it still transmits pressure and friction, 0 = it is gone
])

NO_BOND = -1  # marks events of an anchor of a climbing plant, or of a joint of a mechanism
_CAPACITY = 200_000  # rows kept when nobody takes them; the oldest are dropped and counted


class EventLog:
    """
    Collect break events until they are taken.

    :ivar total: number of events recorded so far.
    :ivar forgotten: number of events dropped because nobody took them.
    """

    _chunks: list[np.ndarray]
    _bonds: list[np.ndarray]

    def __init__(self) -> None:
        self.total = 0
        self.forgotten = 0
        self._chunks = []
        self._bonds = []
        self._held = 0

    def record(self, time: float, position: np.ndarray, bond: np.ndarray, pairs: np.ndarray,
               cause: np.ndarray | int, load: np.ndarray,
               crack: np.ndarray | bool = False) -> None:
        """
        Add events.

        :param time: simulation time [s].
        :param position: contact points [m], (K, 3), world frame.
        :param bond: bond rows, (K,).
        :param pairs: the two parts of each bond, (K, 2).
        :param cause: `Cause` of all, or of each, (K,).
        :param load: load over strength, (K,).
        :param crack: whether they still transmit pressure and friction, all or each, (K,) bool; a
            cracked bond is not recorded again when it breaks.
        """
        if not len(bond):
            return  # empty chunks would pile up without a reader
        rows = np.zeros(len(bond), EVENT)
        rows['time'] = time
        rows['position'] = position
        rows['bond'] = bond
        rows['part_a'] = pairs[:, 0]
        rows['part_b'] = pairs[:, 1]
        rows['cause'] = cause
        rows['load'] = load
        rows['crack'] = crack
        self._chunks.append(rows)
        self._bonds.append(rows['bond'][rows['bond'] != NO_BOND])
        self._held += len(rows)
        self.total += len(rows)
        while self._held > _CAPACITY and len(self._chunks) > 1:
            lost = len(self._chunks.pop(0))
            self._held -= lost
            self.forgotten += lost

    @property
    def rows(self) -> np.ndarray:
        """Return all events held, oldest first, as an array of dtype `EVENT`."""
        if len(self._chunks) > 1:
            self._chunks = [np.concatenate(self._chunks)]
        return self._chunks[0] if self._chunks else np.zeros(0, EVENT)

    @property
    def bonds(self) -> np.ndarray:
        """Return the bonds of all events recorded so far, also of those taken, ascending, (K,)."""
        if len(self._bonds) > 1:
            self._bonds = [np.unique(np.concatenate(self._bonds))]
        return self._bonds[0] if self._bonds else np.zeros(0, EVENT['bond'])

    def recent(self, count: int) -> np.ndarray:
        """Return the last events held, at most `count`, oldest first."""
        chosen: list[np.ndarray] = []
        for chunk in reversed(self._chunks):
            if count <= 0:
                break
            chosen.insert(0, chunk[-count:])
            count -= len(chunk)
        return np.concatenate(chosen) if chosen else np.zeros(0, EVENT)

    def take(self) -> np.ndarray:
        """Return all events held and forget them; the counters stay."""
        rows = self.rows
        self._chunks = []
        self._held = 0
        return rows
