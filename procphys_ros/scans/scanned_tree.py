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

"""Scanned tree: a file of cylinders, a plant or a skeleton as a tree that sways and breaks."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from procphys_ros.blueprint import Blueprint, Leaves, skeleton
from procphys_ros.blueprint.skeleton import Branches, shortest_turn
from procphys_ros.errors import GrammarError
from procphys_ros.geometry.linear import dot, norm
from procphys_ros.language import check_overrides, find_grammar, generator_of, Place
from procphys_ros.scans.cylinder_table import read_table
from procphys_ros.scans.cylinders import Cylinders, lowest_of, MAX_CYLINDERS
from procphys_ros.scans.foliage import spread
from procphys_ros.scans.plant_graph import read_plant
from procphys_ros.scans.repair import repair
from procphys_ros.scans.scan_file import read_scan
from procphys_ros.scans.skeleton_graph import read_skeleton

_DEFINES: Mapping[str, float] = MappingProxyType({
    'unit': 1.0, 'diameter_unit': 0.0, 'foot_diameter': 0.0, 'twig': 0.0, 'density': 900.0,
    'modulus': 8e9, 'strength': 60e6, 'yield': 0.0, 'damping': 0.05, 'preload': 1.0,
    'root_stiffness': 0.0, 'root_moment': 0.0, 'leaf_area': 0.0, 'leaf_size': 0.1,
    'leaf_below': 0.02})
_ABOVE_ZERO = ('unit', 'density', 'modulus', 'strength', 'leaf_size')
_MOST = {'unit': 1e3, 'diameter_unit': 1e3, 'preload': 1.0}
_SWING_LIMIT, _BONE_RATIO = np.pi / 3.0, 0.9  # as of `skeleton.from_nodes`
_TEXTURES = ('bark', 'leaf')


@dataclass(frozen=True)
class ScannedTree:
    """
    A tree as a file describes it.

    :ivar source: name of the file.
    :ivar cylinders: in the unit of the file.
    :ivar notes: what was put right when it was read.
    """

    source: str
    cylinders: Cylinders
    notes: tuple[str, ...] = ()
    _repaired: dict[tuple[float, ...], Cylinders] = field(default_factory=dict, repr=False,
                                                          compare=False)

    @classmethod
    def load(cls, path: str | Path) -> 'ScannedTree':
        """
        Read a file.

        :param path: of the file; its ending tells the format: .csv, .mtg or .ply.
        :raises GrammarError: when it cannot be read, with line and column where there are any.
        """
        found, source = find_grammar(path), str(path)
        raw = read_scan(found, source)
        notes: list[str] = []
        if found.suffix == '.mtg':
            cylinders, notes = read_plant(raw, source)
        elif found.suffix == '.ply':
            cylinders, notes = read_skeleton(raw, source)
        else:
            cylinders = read_table(raw, source)
        if not len(cylinders):
            raise GrammarError('there is no cylinder', source)
        return cls(source, cylinders, tuple(notes))

    @property
    def name(self) -> str:
        """Name of the file without its ending."""
        return Path(self.source).stem

    @property
    def defines(self) -> tuple[str, ...]:
        """Names of the values that `build` takes."""
        return tuple(_DEFINES)

    def build(self, /, seed: int = 0, **defines: float) -> Blueprint:
        """
        Build the blueprint of the tree; part i is the i-th cylinder that is left.

        What is wrong in the file is put right and told in one `GrammarWarning`.

        :param seed: of the places of the leaves.
        :param defines: values that replace the defaults, see docs/trees.md.
        :returns: parts and bonds at rest, rooted at the origin.
        :raises GrammarError: when a value is invalid, or nothing is left.
        """
        generator = generator_of(seed, self.source)
        values = self._values(defines)
        whole = self._sound(values)
        kept = 2.0 * whole.radius >= values['twig']
        if not kept[whole.parent < 0].any():
            raise GrammarError(f'define "twig" is {values["twig"]:g}, but the foot is '
                               f'{2.0 * whole.radius.max():.3g} m thick', self.source)
        cylinders = whole.taken(np.flatnonzero(kept))
        branches = _branches(cylinders, values)
        middle = np.column_stack([0.5 * (cylinders.start + cylinders.end), branches.attitude])
        leaves = self._leaves(whole, kept, middle, values, generator)
        return skeleton.build(branches, leaves, textures=_TEXTURES)

    def _values(self, defines: Mapping[str, float]) -> dict[str, float]:
        """Check the defines, and fill in the others."""
        check_overrides(self.defines, defines, self.source)
        values = {name: float(defines.get(name, value)) for name, value in _DEFINES.items()}
        for name, value in values.items():
            most = _MOST.get(name, np.inf)
            if not 0.0 <= value <= most or value == 0.0 and name in _ABOVE_ZERO:
                least = 'above' if name in _ABOVE_ZERO else 'not below'
                upper = f' and at most {most:g}' if most < np.inf else ''
                raise GrammarError(f'define "{name}" is {value:g}, it must be {least} 0{upper}',
                                   self.source)
        return values

    def _sound(self, values: Mapping[str, float]) -> Cylinders:
        """Scale and repair the cylinders, once for each unit."""
        unit, foot = values['unit'], values['foot_diameter']
        across = values['diameter_unit'] or unit
        if (unit, across, foot) not in self._repaired:
            read = self.cylinders
            scaled = replace(read, start=unit * read.start, end=unit * read.end,
                             radius=across * read.radius, foot=across * read.foot)
            sound, notes = repair(scaled, foot, self.source)
            if notes := [*self.notes, *notes]:
                Place(self.source).warn(f'put right: {", ".join(notes)}')
            self._repaired[unit, across, foot] = sound
        return self._repaired[unit, across, foot]

    def _leaves(self, whole: Cylinders, kept: np.ndarray, frames: np.ndarray,
                values: Mapping[str, float], generator: np.random.Generator) -> Leaves:
        """Set leaves on thin twigs; those on twigs that are left out move with what bears them."""
        area, size = values['leaf_area'], values['leaf_size']
        if not area:
            return Leaves()
        carrier = lowest_of(whole.parent, kept)
        thin = np.flatnonzero((2.0 * whole.radius < values['leaf_below']) & (carrier >= 0))
        if not len(thin):
            raise GrammarError(f'define "leaf_below" is {values["leaf_below"]:g}, but no twig is '
                               f'thinner than {2.0 * whole.radius.min():.3g} m', self.source)
        count = area / (size * size)
        if count > MAX_CYLINDERS:
            raise GrammarError(f'define "leaf_area" is {area:g}: these are {count:.0f} leaves of '
                               f'leaf_size {size:g}, at most {MAX_CYLINDERS} are possible',
                               self.source)
        number = max(1, round(count))
        part = (np.cumsum(kept) - 1)[carrier[thin]]
        return spread(whole.start[thin], whole.end[thin], number, float(np.sqrt(area / number)),
                      part, frames, generator)


def _branches(cylinders: Cylinders, values: Mapping[str, float]) -> Branches:
    """Make the segments."""
    count, parent, radius = len(cylinders), cylinders.parent, cylinders.radius
    follows = _followers(cylinders)
    below = np.where(parent < 0, cylinders.foot, np.where(follows, radius[parent], radius))
    along = cylinders.end - cylinders.start

    def each(value: float) -> np.ndarray:
        return np.full(count, value)

    return Branches(
        parent=parent.astype(np.int32), lateral=~follows, base=cylinders.start,
        attitude=shortest_turn(along), length=cylinders.length,
        width=2.0 * (below if cylinders.tapered else radius), tip_width=2.0 * radius,
        density=each(values['density']), modulus=each(values['modulus']),
        strength=each(values['strength']),
        yield_stress=each(values['yield'] or np.inf), bone_ratio=each(_BONE_RATIO),
        swing_limit=each(_SWING_LIMIT), damping_ratio=each(values['damping']),
        root_stiffness=each(values['root_stiffness'] or np.nan),
        root_moment=each(values['root_moment'] or np.inf), preload=each(values['preload']))


def _followers(cylinders: Cylinders) -> np.ndarray:
    """Find what continues each axis: what starts at its end, the thickest, the straightest."""
    parent, radius = cylinders.parent, cylinders.radius
    way = (cylinders.end - cylinders.start) / cylinders.length[:, None]
    close = norm(cylinders.start - cylinders.end[parent], axis=1) <= radius[parent]
    able = np.flatnonzero((parent >= 0) & (close | cylinders.tapered))
    straight = dot(way[able], way[parent[able]])
    ranked = able[np.lexsort((able, -straight, -radius[able], parent[able]))]
    follows = np.zeros(len(cylinders), bool)
    follows[ranked[np.unique(parent[ranked], return_index=True)[1]]] = True
    return follows
