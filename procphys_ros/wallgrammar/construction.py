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

"""Construction: collection of the boxes of a building while it is built."""

from dataclasses import dataclass, field

import numpy as np

from procphys_ros.language import Place
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, micros, split_along
from procphys_ros.wallgrammar.materials import Material


@dataclass(frozen=True)
class HungLeaf:
    """
    Leaf of a door or a shutter, hung on hinges.

    :ivar box: the leaf, shut; a single row.
    :ivar pin: the axis of its hinges, from its lower to its upper end; likewise.
    :ivar post: part that it hangs on.
    :ivar outwards: sense of the turn about the upward vertical that opens it, 1 or -1.
    :ivar limits: how far it opens inwards, negative, and outwards [rad].
    :ivar name: of its kind.
    """

    box: Boxes
    pin: Boxes
    post: int
    outwards: int
    limits: tuple[float, float]
    name: str


@dataclass
class Site:
    """
    Parts under construction.

    :ivar materials: by name, in the order of their indices.
    :ivar most_parts: bound on the number of parts.
    :ivar place: of the building in its text, for errors.
    :ivar generator: draws irregularities.
    :ivar kinds: names of the kinds met so far.
    :ivar frames: pose of each frame in the building [m], 7 each; upright frames come first.
    :ivar patches: bonds between parts of different frames.
    :ivar forms: corners of the parts that are hexahedra, in their frames [m], (8, 3) each.
    :ivar hung: doors and shutters on their hinges.
    :ivar count: parts so far.
    """

    materials: dict[str, Material]
    most_parts: int
    place: Place
    generator: np.random.Generator
    kinds: list[str] = field(default_factory=list)
    frames: list[np.ndarray] = field(default_factory=list)
    patches: list[Patches] = field(default_factory=list)
    forms: list[np.ndarray] = field(default_factory=list)
    hung: list[HungLeaf] = field(default_factory=list)
    count: int = 0
    _boxes: list[Boxes] = field(default_factory=list)
    _members: int = 0

    def kind(self, name: str) -> int:
        """Return the index of a kind, which is added if new."""
        if name not in self.kinds:
            self.kinds.append(name)
        return self.kinds.index(name)

    def material(self, name: str) -> int:
        """Look up the index of a material."""
        return list(self.materials).index(name)

    def expect(self, parts: float) -> None:
        """
        Check the bound on parts before memory is allocated for them.

        :param parts: number to be added.
        :raises GrammarError: when they are too many.
        """
        if self.count + parts > self.most_parts:
            raise self.place.error(
                f'the building has more than {self.most_parts} parts (about '
                f'{self.count + parts:.0f}); make it smaller, its units larger, or raise '
                f'most_parts')

    def add(self, boxes: Boxes, longest: int = 0, multiple: int = 1) -> slice:
        """
        Add parts.

        :param boxes: the parts; pieces of one member carry numbers from `next_member` on.
        :param longest: when given, members are cut into pieces of at most this length [µm].
        :param multiple: divisor of the number of pieces of each, see `split_along`.
        :returns: rows of the parts.
        """
        if longest:
            boxes = split_along(boxes, longest, self._members, multiple)
        self.expect(len(boxes))
        self._members = max(self._members, int(boxes.member.max(initial=-1)) + 1)
        self._boxes.append(boxes)
        rows = slice(self.count, self.count + len(boxes))
        self.count += len(boxes)
        return rows

    def hexahedra(self, corners: np.ndarray, kind: int = 0, material: int = 0, frame: int = 0,
                  member: int = -1) -> Boxes:
        """
        Make parts that are hexahedra, to be added.

        :param corners: in their frame [m], (n, 8, 3).
        """
        boxes = from_cells(micros(corners.min(axis=1)), micros(corners.max(axis=1)), kind=kind,
                           material=material, frame=frame, member=member)
        boxes.form[:] = len(self.forms) + np.arange(len(boxes))
        self.forms += list(corners)
        return boxes

    @property
    def next_member(self) -> int:
        """Return the first free member number."""
        return self._members

    def boxes(self) -> Boxes:
        """Return all boxes so far, in part order."""
        return Boxes.stack(self._boxes)
