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


"""Modules: the string that an L-system rewrites, as flat arrays."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

PUSH, POP = 0, 1  # keys of the brackets in every vocabulary


class Module(NamedTuple):
    """
    One module: a symbol with its parameters.

    :ivar name: of the symbol.
    :ivar parameters: their values.
    """

    name: str
    parameters: tuple[float, ...] = ()

    def __str__(self) -> str:
        if not self.parameters:
            return self.name
        values = ','.join(f'{value:.12g}' for value in self.parameters)
        query, _, kind = self.name.partition(' ')
        return f'{query}({kind};{values})' if kind else f'{self.name}({values})'


class Vocabulary:
    """
    Keys of modules: one for each name with each number of parameters.

    :ivar names: name of each key.
    :ivar arities: number of parameters of each key.
    """

    def __init__(self) -> None:
        self._keys: dict[tuple[str, int], int] = {}
        self.names: list[str] = []
        self.arities: list[int] = []
        for bracket in '[]':
            self.key(bracket, 0)

    def key(self, name: str, arity: int) -> int:
        """Return the key of a module, which is added if new."""
        key = self._keys.setdefault((name, arity), len(self.names))
        if key == len(self.names):
            self.names.append(name)
            self.arities.append(arity)
        return key

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Modules(Sequence):
    """
    String of modules; indexing returns `Module`s, `str` the usual notation.

    :ivar vocabulary: of the keys.
    :ivar key: (M,) int32.
    :ivar values: parameters of all modules, concatenated.
    :ivar origin: index of the piece of the grammar that wrote each module, (M,) int32.
    """

    vocabulary: Vocabulary
    key: np.ndarray
    values: np.ndarray
    origin: np.ndarray

    @cached_property
    def counts(self) -> np.ndarray:
        """Count the parameters of each module, (M,)."""
        return np.asarray(self.vocabulary.arities, np.int64)[self.key]

    @cached_property
    def starts(self) -> np.ndarray:
        """Find where the parameters of each module begin in `values`, (M,)."""
        counts = self.counts
        return np.cumsum(counts) - counts

    def __len__(self) -> int:
        return len(self.key)

    def __getitem__(self, index):
        if isinstance(index, slice):
            rows = range(*index.indices(len(self)))
            starts = self.starts
            return [self._module(row, starts[row]) for row in rows]
        row = range(len(self))[index]
        return self._module(row, self.starts[row])

    def __iter__(self) -> Iterator[Module]:
        return iter(self[:])

    def _module(self, row: int, start: int) -> Module:
        key = self.key[row]
        values = self.values[start:start + self.vocabulary.arities[key]]
        return Module(self.vocabulary.names[key], tuple(values.tolist()))

    def __str__(self) -> str:
        return ''.join(map(str, self))
