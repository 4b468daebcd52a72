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


"""Layout of a year: which parts a growing plant has in it, and the blueprint of its end."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from procphys_ros.blueprint import Blueprint, chain, GROUND, Hinges, Law, Leaves, Ornaments
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import Growth
from procphys_ros.physics.trees import growing
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.plants import GrowingState, PlantState
from procphys_ros.simulation.state import State

_MOST = 1 << 20  # segments or leaves that one module draws
_PART_COLUMNS = ('size', 'visual_size', 'density', 'mass', 'inertia', 'poses', 'leaf_area')
_BOND_COLUMNS = ('bond_frame', 'bond_extent', 'bond_area')


@dataclass
class Year:
    """
    A plant in a year.

    :ivar name: of the plant.
    :ivar own: its state, of the year before until `keep`.
    :ivar growth: its string at the end.
    :ivar built: as drawn then, world.
    :ivar segments, leaves: identities of what is drawn, see `Drawn`.
    :ivar parts: of the drawn segments, -1 = on a branch that has broken off, (S,).
    :ivar born: segments that are new, (B,).
    :ivar withering: parts that are no longer drawn, (D,).
    :ivar leaf_rows: of the drawn leaves, -1 = none, (L,).
    :ivar bare: leaves that are no longer drawn, (K,).
    :ivar leaf_start: sizes of the drawn leaves at the beginning [m], (L,).
    :ivar bare_start: of those no longer drawn [m], (K,).
    """

    name: str
    own: PlantState
    growth: Growth
    built: Blueprint
    segments: np.ndarray
    leaves: np.ndarray
    parts: np.ndarray
    born: np.ndarray
    withering: np.ndarray
    leaf_rows: np.ndarray
    bare: np.ndarray
    leaf_start: np.ndarray
    bare_start: np.ndarray

    def all_parts(self) -> np.ndarray:
        """Return the parts that are part of it in the year, (K,)."""
        return np.concatenate([self.parts[self.parts >= 0], self.withering])

    def kept(self) -> np.ndarray:
        """Return the segments that were there before, (K,)."""
        return np.setdiff1d(np.flatnonzero(self.parts >= 0), self.born)

    def fresh(self) -> Blueprint:
        """Return the parts that are new, on the ground and without leaves."""
        made = subset(self.built, self.born, self.born)
        bonds = made.bonds.copy()
        bonds[:, 0] = GROUND
        return replace(made, bonds=bonds)

    def keep(self, growing_state: GrowingState, number: int) -> None:
        """
        Write the state of the plant in the year, and the growth of its leaves.

        :param number: of the plant.
        """
        own, state = self.own, growing_state
        own.string, own.parts, own.segments = self.growth.string(), self.parts, self.segments
        own.leaf_rows, own.leaves, own.bare = self.leaf_rows, self.leaves, self.bare
        own.withering, own.share = self.withering, own.share - 1.0
        there = self.leaf_rows >= 0
        rows = np.concatenate([self.leaf_rows[there], self.bare])
        state.leaf = np.append(state.leaf, rows)
        state.leaf_plant = np.append(state.leaf_plant, np.full(len(rows), number))
        state.leaf_start = np.concatenate([state.leaf_start, self.leaf_start[there],
                                           self.bare_start])
        state.leaf_end = np.concatenate([state.leaf_end, self.built.leaves.size[there],
                                         np.zeros(len(self.bare))])


def subset(source: Blueprint, parts: np.ndarray, bonds: np.ndarray) -> Blueprint:
    """
    Return some segments of a blueprint, without leaves.

    :param parts: (K,).
    :param bonds: hinge that each hangs on, (K,).
    """
    place = np.full(len(source) + 1, GROUND)
    place[parts] = np.arange(len(parts))
    hinge = (np.cumsum(source.bond_law == Law.HINGE) - 1)[bonds]
    pairs = np.column_stack([place[source.bonds[bonds, 0]], np.arange(len(parts))])
    columns = {name: getattr(source, name)[parts]
               for name in ('shape', *_PART_COLUMNS, 'kind', 'material', 'texture')}
    columns |= {name: getattr(source, name)[bonds] for name in ('bond_law', *_BOND_COLUMNS)}
    return Blueprint(**columns, bonds=pairs.astype(np.int32), hinges=source.hinges.take(hinge),
                     kinds=source.kinds, materials=source.materials, textures=source.textures)


def living(state: State, parts: np.ndarray) -> np.ndarray:
    """Mark segments that stand on their roots, (K,) bool."""
    out = state.parts.owner[parts] == Owner.TREE
    rows = state.parts.row[parts[out]]
    out[out] = ~state.forest.is_free(state.forest.roots(rows))
    return out


def match(model: Model, state: State, name: str, growth: Growth, first: int) -> Year:
    """
    Find the parts that a plant keeps, gets and loses in a year.

    :param growth: its string at the end.
    :param first: number of the first new part.
    """
    own, drawn = state.growing.plants[name], growth.drawn()
    none = np.zeros(0, np.intp)
    if drawn is None:
        built, segments, leaves = Blueprint(), own.segments[:0], own.leaves[:0]
        parts = born = none
    else:
        built, segments, leaves = (model.plants[name].place(drawn, model.terrain, name),
                                   drawn.segments, drawn.leaves)
        parts, born = _parts(state, own, built, segments, first)
    before = own.all_parts()
    withering = np.setdiff1d(before[living(state, before)], parts)
    return Year(name, own, growth, built, segments, leaves, parts, born, withering, none, none,
                np.zeros(0), np.zeros(0))


def _parts(state: State, own: PlantState, built: Blueprint, segments: np.ndarray,
           first: int) -> tuple[np.ndarray, np.ndarray]:
    """Find the parts of the drawn segments, -1 on lost branches, and those that are new."""
    old = _find(own.segments, segments)
    parts = np.where(old >= 0, own.parts[old] if len(own.parts) else -1, -1)
    there = parts >= 0
    there[there] = living(state, parts[there])
    lost, parent = (old >= 0) & ~there, built.bonds[:, 0]
    while True:  # what grows on a lost branch is lost, generation by generation
        more = lost | ((parent >= 0) & lost[parent])
        if np.array_equal(more, lost):
            break
        lost = more
    born = np.flatnonzero((old < 0) & ~lost)
    parts = np.where(there & ~lost, parts, -1)
    parts[born] = first + np.arange(len(born))
    return parts, born


def _find(known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Find rows of identities (K, 2) among known ones, -1 = not there, (K,)."""
    if not len(known):
        return np.full(len(wanted), -1)
    keys, wants = (rows[:, 0] * _MOST + rows[:, 1] for rows in (known, wanted))
    order = np.argsort(keys, kind='stable')
    place = order[np.minimum(np.searchsorted(keys, wants, sorter=order), len(keys) - 1)]
    return np.where(keys[place] == wants, place, -1)


def lay_out(state: State, years: Sequence[Year]) -> tuple[Blueprint, np.ndarray]:
    """
    Make the blueprint of the whole scene with plants as they are at the end of a year.

    :returns: it, and the hinge of each part, -1 = none, (N,).
    """
    base = state.blueprint
    whole = chain([base, *(year.fresh() for year in years)])
    bonds = np.full(len(whole), -1)
    bonds[state.forest.parts] = state.forest.bonds
    bonds[len(base):] = len(base.bonds) + np.arange(len(whole) - len(base))
    columns = {name: getattr(whole, name).copy()
               for name in ('bonds', *_PART_COLUMNS, *_BOND_COLUMNS)}
    hinges = {f.name: getattr(whole.hinges, f.name).copy() for f in fields(Hinges)}
    hinge_of = np.cumsum(whole.bond_law == Law.HINGE) - 1
    for year in years:
        _write_end(year, columns, hinges, bonds, hinge_of)
        _write_withered(year, columns, bonds)
    leaves = _leaves(state, years, whole)
    return replace(whole, **columns, hinges=Hinges(**hinges), leaves=leaves,
                   ornaments=_ornaments(years, whole)), bonds


def _write_end(year: Year, columns: dict[str, np.ndarray], hinges: dict[str, np.ndarray],
               bonds: np.ndarray, hinge_of: np.ndarray) -> None:
    """Write the segments of a plant as drawn."""
    rows = np.flatnonzero(year.parts >= 0)
    parts, built = year.parts[rows], year.built
    for name in _PART_COLUMNS:
        columns[name][parts] = getattr(built, name)[rows]
    bond = bonds[parts]
    for name in _BOND_COLUMNS:
        columns[name][bond] = getattr(built, name)[rows]
    parent = built.bonds[rows, 0]
    columns['bonds'][bond, 0] = np.where(parent < 0, GROUND, year.parts[parent])
    for name, column in hinges.items():
        column[hinge_of[bond]] = getattr(built.hinges, name)[rows]


def _write_withered(year: Year, columns: dict[str, np.ndarray], bonds: np.ndarray) -> None:
    """Write what a plant sheds as all but nothing."""
    parts = year.withering
    for name in ('size', 'visual_size'):
        columns[name][parts] *= growing.THIN
    for name in ('mass', 'inertia'):
        columns[name][parts] *= growing.LIGHT
    columns['leaf_area'][parts] = 0.0
    columns['bond_extent'][bonds[parts]] *= growing.THIN
    middle = np.zeros((len(parts), 7))
    middle[:, 2], middle[:, 6] = 0.5 * columns['visual_size'][parts, 2], 1.0
    columns['poses'][parts] = rotation.compose(columns['bond_frame'][bonds[parts]], middle)


def _leaves(state: State, years: Sequence[Year], whole: Blueprint) -> Leaves:
    """
    Lay out the leaves at the end of a year, with a row for each leaf that ever was.

    A leaf that is no longer drawn shrinks within the year; later its row is taken by a new one.
    """
    columns = {f.name: [getattr(whole.leaves, f.name).copy()] for f in fields(Leaves)}
    count = len(whole.leaves)
    for year in years:
        own, leaves = year.own, year.built.leaves
        there = (year.parts[leaves.part] >= 0 if len(leaves) else np.zeros(0, bool))
        old = _find(own.leaves, year.leaves)
        rows = np.where((old >= 0) & there, own.leaf_rows[old] if len(own.leaf_rows) else -1, -1)
        rows[(rows >= 0) & ~state.leaves.attached[rows]] = -1
        year.leaf_start = np.where(rows >= 0, columns['size'][0][rows], 0.0)
        gone = np.setdiff1d(own.leaf_rows[own.leaf_rows >= 0], rows)
        gone = gone[state.leaves.attached[gone]]
        free = own.bare[state.leaves.attached[own.bare]]
        fresh = np.flatnonzero(there & (rows < 0))
        taken = min(len(free), len(fresh))
        rows[fresh[:taken]] = free[:taken]
        more = len(fresh) - taken
        rows[fresh[taken:]] = count + np.arange(more)
        year.leaf_rows, year.bare = rows, np.concatenate([gone, free[taken:]])
        year.bare_start = columns['size'][0][year.bare]
        _write_leaves(year, columns, whole, rows, fresh[taken:])
        count += more
    return Leaves(**{name: np.concatenate(blocks) for name, blocks in columns.items()})


def _write_leaves(year: Year, columns: dict[str, list[np.ndarray]], whole: Blueprint,
                  rows: np.ndarray, appended: np.ndarray) -> None:
    leaves = year.built.leaves
    lookup = np.array([whole.textures.index(name) for name in year.built.textures] or [0])
    made = {name: getattr(leaves, name) for name in columns}
    made['part'] = year.parts[leaves.part] if len(leaves) else leaves.part
    made['texture'] = lookup[leaves.texture]
    place = np.flatnonzero((rows >= 0) & (rows < len(columns['part'][0])))
    for name, blocks in columns.items():
        blocks[0][rows[place]] = made[name][place]
        blocks.append(made[name][appended].astype(blocks[0].dtype))
    columns['size'][0][year.bare] = 0.0


def _ornaments(years: Sequence[Year], whole: Blueprint) -> Ornaments:
    """Add the triangles on new segments; those on old ones stay as they were."""
    columns = {f.name: [getattr(whole.ornaments, f.name)] for f in fields(Ornaments)}
    for year in years:
        found = year.built.ornaments
        found = found.take(np.isin(found.part, year.born))
        lookup = np.array([whole.textures.index(name) for name in year.built.textures] or [0])
        columns['part'].append(year.parts[found.part] if len(found) else found.part)
        columns['triangle'].append(found.triangle)
        columns['texture'].append(lookup[found.texture])
    return Ornaments(**{name: np.concatenate(blocks).astype(blocks[0].dtype)
                        for name, blocks in columns.items()})
