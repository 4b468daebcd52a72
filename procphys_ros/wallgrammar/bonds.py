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

"""Bonds of masonry: the perpends of a course, and the units between them."""

from dataclasses import dataclass

import numpy as np

BONDS = ('running', 'stack', 'english', 'flemish', 'rubble')
_SHORTEST, _LONGEST = 0.6, 1.4  # of a unit: lengths of rubble stones
_TRIES = 6     # candidate lengths of a stone, the best of which staggers the joints


@dataclass(frozen=True)
class Course:
    """
    Perpends of one course, as a pattern that repeats along the wall.

    :ivar phase: start of the pattern, from the end of the wall [µm].
    :ivar widths: cells of one period: units with their joints [µm], (m,).
    :ivar header: mask of the cells that lie across the wall, (m,).
    """

    phase: int
    widths: np.ndarray
    header: np.ndarray

    @property
    def period(self) -> int:
        """Length after which the pattern repeats [µm]."""
        return int(self.widths.sum())

    def perpend(self, index: np.ndarray) -> np.ndarray:
        """Locate perpends by their indices [µm], (n,)."""
        starts = np.concatenate([[0], np.cumsum(self.widths)[:-1]])
        lap, place = np.divmod(index, len(self.widths))
        return self.phase + lap * self.period + starts[place]

    def first_beyond(self, x: np.ndarray) -> np.ndarray:
        """Find the index of the first perpend beyond each x [µm], (n,)."""
        starts = np.concatenate([[0], np.cumsum(self.widths)[:-1]])
        lap, rest = np.divmod(x - self.phase, self.period)
        return lap * len(self.widths) + np.searchsorted(starts, rest, side='right')


@dataclass(frozen=True)
class Layout:
    """
    Tiling of a panel by units.

    :ivar bond: one of `BONDS`.
    :ivar unit: length, width and height of a unit [µm], (3,).
    :ivar joint: thickness of the joints [µm].
    :ivar offset: shift of each course against the one below, in unit lengths (running bond).
    :ivar pieces: number of pieces that a unit splits into along its length.
    :ivar material: index of the material.
    """

    bond: str
    unit: tuple[int, int, int]
    joint: int
    offset: float
    pieces: int
    material: int

    @property
    def pitch(self) -> int:
        """Length of a unit with its joint [µm]."""
        return self.unit[0] + self.joint

    @property
    def gauge(self) -> int:
        """Height of a course with its bed joint [µm]."""
        return self.unit[2] + self.joint

    @property
    def thickness(self) -> int:
        """Thickness of the wall [µm]: one unit wide, or one unit long where headers cross it."""
        return self.unit[0] if self.crossed else self.unit[1]

    @property
    def crossed(self) -> bool:
        """Return whether the bond has headers."""
        return self.bond in ('english', 'flemish')

    @property
    def leaf(self) -> int:
        """Thickness of the outer leaf with its half of the collar joint [µm]."""
        return self.unit[1] + self.joint // 2

    def courses(self, generator: np.random.Generator, length: int, count: int) -> list[Course]:
        """
        List the courses of one vertical repeat, from the ground up.

        A course starts half a joint outside the wall, so that its first unit is flush with the
        end. English bond: courses of stretchers and of headers in turn, headers a quarter unit
        off. Flemish bond: both in each course, each header centred over a stretcher. Rubble:
        every course differs.

        :param generator: draws the lengths of rubble.
        :param length: of the wall [µm].
        :param count: number of courses of the wall.
        """
        start = -(self.joint // 2)
        stretcher, header = self.pitch, self.unit[1] + self.joint
        if self.bond == 'english':
            return [_course(start, [stretcher], [False]),
                    _course(start + stretcher // 4, [header], [True])]
        if self.bond == 'flemish':
            cells = [stretcher, header]
            return [_course(start, cells, [False, True]),
                    _course(start + sum(cells) // 2, cells, [False, True])]
        if self.bond == 'rubble':
            return self._rubble(generator, length, count)
        offset = self.offset % 1.0 if self.bond == 'running' else 0.0
        repeat = next((n for n in range(1, 13) if abs(n * offset - round(n * offset)) < 1e-6), 12)
        return [_course(start + round((k * offset % 1.0) * stretcher), [stretcher], [False])
                for k in range(repeat)]

    def _rubble(self, generator: np.random.Generator, length: int, count: int) -> list[Course]:
        """Draw the lengths of stones, with perpends far from those in the course below."""
        below, found = np.array([0.0]), []
        for _ in range(count):
            place, widths = 0.0, []
            while place < length + self.pitch:
                tried = generator.uniform(_SHORTEST, _LONGEST, _TRIES) * self.pitch
                apart = np.abs(place + tried[:, None] - below).min(axis=1)
                widths.append(round(float(tried[np.argmax(apart)])))
                place += widths[-1]
            below = np.cumsum(widths)
            found.append(_course(-(self.joint // 2), widths, [False] * len(widths)))
        return found


def _course(phase: int, widths: list[int], header: list[bool]) -> Course:
    return Course(phase, np.array(widths), np.array(header))
