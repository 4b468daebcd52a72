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


"""Plants: state of those that grow while the simulation runs."""

from dataclasses import dataclass, field

import numpy as np

from procphys_ros.lsystem.growth import GrownString
from procphys_ros.physics.trees import growing

# Columns of parts that change with growth, and where they are in `GrowingState.start`.
COLUMNS = {'size': 3, 'solid_size': 3, 'visual_size': 3, 'inertia': 3, 'mass': 1, 'drag_area': 1}
PART = growing.WIDTH
WIDTH = PART + sum(COLUMNS.values())


@dataclass
class PlantState:
    """
    A plant that grows, or has grown.

    :ivar string: at the end of the year.
    :ivar parts: of its segments, in the order in which it draws them, -1 = broken off, (S,).
    :ivar segments: their identities, see `Drawn`, (S, 2).
    :ivar leaf_rows: of its leaves in the blueprint, likewise, (L,).
    :ivar leaves: their identities, (L, 2).
    :ivar withering: parts that are nothing at the end of the year, (D,).
    :ivar bare: rows of leaves that are nothing at the end of the year, (B,).
    :ivar rate: [years/s].
    :ivar share: of the year that has passed; 1 = its end.
    :ivar until: derivation steps after which it stops.
    """

    string: GrownString
    parts: np.ndarray
    segments: np.ndarray
    leaf_rows: np.ndarray
    leaves: np.ndarray
    withering: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    bare: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    rate: float = 0.0
    share: float = 1.0
    until: int = 0

    @property
    def is_due(self) -> bool:
        """Return whether its next year begins."""
        return self.rate > 0.0 and self.share >= 1.0 and self.string.steps < self.until

    def all_parts(self) -> np.ndarray:
        """Return the parts that it has, (K,)."""
        return np.concatenate([self.parts[self.parts >= 0], self.withering])


def _table(width: int) -> np.ndarray:
    return field(default_factory=lambda: np.zeros((0, width)))


def _numbers() -> np.ndarray:
    return field(default_factory=lambda: np.zeros(0, np.intp))


@dataclass
class GrowingState:
    """
    Plants that grow, and their growth in the present year.

    :ivar plants: by name, also those that have stopped.
    :ivar layouts: number of times that segments have been added.
    :ivar part: parts that change in this year, (K,).
    :ivar plant: number of the plant of each, (K,).
    :ivar start, end: constants of their segments and columns of parts then, (K, 41).
    :ivar slope: from start to end, (K, 41); None = to be computed.
    :ivar bulge: of preloads, see `growing.balance`, (K, 4).
    :ivar leaf: leaves that change in this year, (L,).
    :ivar leaf_plant: number of the plant of each, (L,).
    :ivar leaf_start, leaf_end: their sizes then [m], (L,).
    """

    plants: dict[str, PlantState] = field(default_factory=dict)
    layouts: int = 0
    part: np.ndarray = _numbers()
    plant: np.ndarray = _numbers()
    start: np.ndarray = _table(WIDTH)
    end: np.ndarray = _table(WIDTH)
    slope: np.ndarray | None = None
    bulge: np.ndarray = _table(4)
    leaf: np.ndarray = _numbers()
    leaf_plant: np.ndarray = _numbers()
    leaf_start: np.ndarray = field(default_factory=lambda: np.zeros(0))
    leaf_end: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, 'slope': None}

    def shares(self) -> np.ndarray:
        """Return the share of the year that has passed for each plant, (P,)."""
        return np.array([min(own.share, 1.0) for own in self.plants.values()])

    def leaf_sizes(self) -> np.ndarray:
        """Return the present sizes of the leaves that change [m], (L,)."""
        share = self.shares()[self.leaf_plant]
        return np.where(share >= 1.0, self.leaf_end,
                        self.leaf_start + share * (self.leaf_end - self.leaf_start))

    def owner_of(self, parts: np.ndarray) -> str:
        """Return the name of the plant that any of some parts belongs to, '' = none."""
        return next((name for name, own in self.plants.items()
                     if np.isin(parts, own.all_parts()).any()), '')

    def finish(self, name: str) -> np.ndarray:
        """End the growth of a plant that is removed, and return its parts, (K,)."""
        own = self.plants[name]
        parts = own.all_parts()
        self.forget([list(self.plants).index(name)])
        own.parts, own.withering, own.rate = np.full(len(own.parts), -1), parts[:0], 0.0
        return parts

    def forget(self, numbers: list[int]) -> None:
        """Drop the growth of the present year of some plants, given their numbers."""
        self.slope = None
        kept, green = ~np.isin(self.plant, numbers), ~np.isin(self.leaf_plant, numbers)
        for name in ('part', 'plant', 'start', 'end', 'bulge'):
            setattr(self, name, getattr(self, name)[kept])
        for name in ('leaf', 'leaf_plant', 'leaf_start', 'leaf_end'):
            setattr(self, name, getattr(self, name)[green])
