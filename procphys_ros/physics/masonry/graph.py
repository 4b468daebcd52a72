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


"""The bond graph: rigid parts joined by springs spread over their contact patches."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Law, Mortar
from procphys_ros.geometry import rotation
from procphys_ros.physics.masonry import links, members

HUB = 24  # bonds; a part with more of them (a slab) is long compared with its neighbours


class BondGraph:
    """
    Mortar bonds of a blueprint as flat arrays, in the frame of its poses.

    A bond is a bed of springs over its patch: relative displacement of the two parts at the
    centroid meets k_n·A along the normal and k_s·A along the patch; relative rotation meets
    k_n·I_x, k_n·I_y (bending) and k_s·(I_x + I_y) (twist), with I_x = A·e_y²/12.

    :ivar count: number of parts of the blueprint, N.
    :ivar rows: row of each bond in `Blueprint.bonds`, (M,).
    :ivar first, second: parts that the bond joins, the normal points from first to second;
        N is the ground, (M,) int32.
    :ivar alive: bonds that still carry load, (M,) bool.
    :ivar cracked: living bonds with only pressure and friction, see `joints`, (M,) bool.
    :ivar coupling: of the cracked ones, see `links`, (M, 6).
    :ivar grip: present share of the stiffness of a bond, (M,).
    :ivar held: remaining share of the stiffness of a cracked reinforced bond; 1 in all other
        bonds, (M,).
    :ivar centroid: middle of the patch [m], (M, 3).
    :ivar axes: bond frame, columns are x, y along the patch and z the normal, (M, 3, 3).
    :ivar area: of the patch [m²], (M,).
    :ivar extent: patch along its x and y [m], (M, 2).
    :ivar whole_extent: the same before any opening [m], (M, 2).
    :ivar spring: stiffness along x, y, z [N/m] and about x, y, z [N·m/rad], (M, 6).
    :ivar mortar: strengths and stiffnesses, one row per bond.
    :ivar mass: of the parts [kg], (N,).
    :ivar centre: centres of mass [m], (N, 3).
    :ivar reach: half of the longest side of a part, the lever arm that converts its residual
        moment to a force [m], (N,).
    :ivar pieces: parts between two reinforced bonds, see `members`.
    :ivar start, incident: bonds of part i are incident[start[i]:start[i + 1]].
    """

    mortar: Mortar
    pieces: members.MemberPieces

    def __init__(self, blueprint: Blueprint):
        self._take_parts(blueprint)
        pair = blueprint.bonds[self.rows].astype(np.int32)
        if np.any(pair[:, 0] == pair[:, 1]):
            raise ValueError('a bond must join two different parts')
        pair[pair == GROUND] = self.count
        self.first = np.ascontiguousarray(pair[:, 0])
        self.second = np.ascontiguousarray(pair[:, 1])
        self.centroid = np.array(blueprint.bond_frame[self.rows, :3], float)
        self.axes = rotation.to_matrix(blueprint.bond_frame[self.rows, 3:])
        self.area = np.array(blueprint.bond_area[self.rows], float)
        self.extent = np.array(blueprint.bond_extent[self.rows], float)
        self.spring = np.empty((len(self), 6))
        self.links = np.empty((len(self), 18))
        self.start, self.incident = links.incidence(self.count, self.first, self.second)
        self._set_whole()
        self._spread(np.arange(len(self)))

    @classmethod
    def chained(cls, blueprint: Blueprint,
                graphs: Sequence[tuple['BondGraph', int]]) -> 'BondGraph':
        """
        Concatenate the graphs of blueprints that follow each other in one blueprint.

        :param graphs: undamaged graphs, each with the row of its first part; they have all bonds.
        """
        graph = cls.__new__(cls)
        graph._take_parts(blueprint)
        for name in ('first', 'second'):
            column = [np.where(getattr(known, name) == known.count, graph.count,
                               getattr(known, name) + first) for known, first in graphs]
            setattr(graph, name, np.concatenate(column, dtype=np.int32))
        for name in ('centroid', 'axes', 'area', 'extent', 'spring', 'links'):
            setattr(graph, name, np.concatenate([getattr(known, name) for known, _ in graphs]))
        degree, before, incident = np.zeros(graph.count, np.int64), 0, []
        for known, first in graphs:
            degree[first:first + known.count] = np.diff(known.start)
            incident.append(known.incident + np.int32(before))
            before += len(known)
        graph.start = np.concatenate([[0], np.cumsum(degree)])
        graph.incident = np.concatenate(incident)
        graph._set_whole()
        return graph

    def _take_parts(self, blueprint: Blueprint) -> None:
        self.rows = np.flatnonzero(blueprint.bond_law == Law.MORTAR)
        self.count = len(blueprint)
        self.mass = np.array(blueprint.mass, float)
        self.centre = np.array(blueprint.poses[:, :3], float)
        self.reach = np.maximum(0.5 * np.max(blueprint.size, axis=1, initial=0.0), 1e-3)
        self.mortar = blueprint.mortar

    def _set_whole(self) -> None:
        self.alive = np.ones(len(self), bool)
        self.cracked = np.zeros(len(self), bool)
        self.coupling = np.zeros((len(self), 6))
        self.grip = np.ones(len(self))
        self.held = np.ones(len(self))
        self._rest = (self.centroid.copy(), self.area.copy())
        self.whole_extent = self.extent.copy()
        self.pieces = members.pieces(np.flatnonzero(self.mortar.reinforcement > 0.0),
                                     (self.first, self.second), self.count, self.centroid,
                                     self.axes)

    def __len__(self) -> int:
        return len(self.rows)

    def _spread(self, bonds: np.ndarray) -> None:
        """Spread the springs of the mortar over the patches of some bonds."""
        normal = self.mortar.normal_stiffness[bonds] * self.area[bonds]
        shear = self.mortar.shear_stiffness[bonds] * self.area[bonds]
        x_square, y_square = (np.square(self.extent[bonds]) / 12.0).T
        self.spring[bonds] = self.held[bonds, None] * np.column_stack([
            shear, shear, normal, normal * y_square, normal * x_square,
            shear * (x_square + y_square)])
        self.links[bonds] = links.build(self.first[bonds], self.second[bonds],
                                        self.centroid[bonds], self.centre, self.axes[bonds],
                                        self.spring[bonds])

    def cut(self, bonds: np.ndarray) -> None:
        """Break bonds; they carry no load from now on."""
        self.alive[bonds] = False
        self.cracked[bonds] = False
        self.links[bonds, 6:] = 0.0

    def narrow(self, bonds: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """
        Reduce the patch of some bonds to the part that has not opened.

        :param low, high: corners of that part, bond frame, from the present centroid [m], (K, 2).
        """
        middle = 0.5 * (low + high)
        share = (high - low) / self.extent[bonds]
        self.centroid[bonds] += np.einsum('kij,kj->ki', self.axes[bonds][:, :, :2], middle)
        self.area[bonds] *= share.prod(axis=1)
        self.extent[bonds] = high - low
        self.cracked[bonds] = False
        self.grip[bonds] = 1.0
        self._spread(bonds)

    def weaken(self, bonds: np.ndarray, share: np.ndarray) -> None:
        """Scale the stiffness of reinforced bonds, (K,) rows, by a share each, (K,)."""
        self.held[bonds] *= share
        self._spread(bonds)

    def narrowed(self, bonds: np.ndarray) -> np.ndarray:
        """Mark the bonds that have been narrowed, (K,) bool."""
        return np.any(self.extent[bonds] != self.whole_extent[bonds], axis=1)

    def has_cracked(self, bonds: np.ndarray) -> np.ndarray:
        """Mark the bonds that have cracked, reinforced ones included, (K,) bool."""
        return self.cracked[bonds] | (self.held[bonds] < 1.0)

    def adopt(self, other: 'BondGraph', theirs: np.ndarray, mine: np.ndarray) -> None:
        """
        Copy the state of bonds from the same bonds in another graph.

        :param theirs: rows there, (K,).
        :param mine: rows here, (K,).
        """
        for name in ('alive', 'cracked', 'grip', 'held', 'centroid', 'area', 'extent'):
            getattr(self, name)[mine] = getattr(other, name)[theirs]
        opened = mine[self.narrowed(mine) | (self.held[mine] < 1.0)]
        self._spread(opened)
        self.links[mine[~self.alive[mine]], 6:] = 0.0

    def restore(self) -> None:
        """Restore every bond."""
        changed = ~self.alive | self.cracked | (self.held < 1.0)
        changed |= self.narrowed(np.arange(len(self)))
        self.alive[:] = True
        self.cracked[:] = False
        self.grip[:] = 1.0
        self.held[:] = 1.0
        self.centroid, self.area = (a.copy() for a in self._rest)
        self.extent = self.whole_extent.copy()
        self._spread(np.flatnonzero(changed))

    def bonds_of(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """List the bonds of each part, dead ones included: index into parts, and row, (B,)."""
        parts = np.atleast_1d(parts)
        first, count = self.start[parts], self.start[parts + 1] - self.start[parts]
        own = np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)
        return np.repeat(np.arange(len(parts)), count), self.incident[own]

    def neighbours(self, parts: np.ndarray) -> np.ndarray:
        """List the bonds of any of the parts, dead ones included, sorted."""
        found = np.zeros(len(self), bool)
        found[self.bonds_of(parts)[1]] = True
        return np.flatnonzero(found).astype(self.incident.dtype)

    def parts_of(self, bonds: np.ndarray) -> np.ndarray:
        """List the parts that some bonds join, sorted."""
        touched = np.zeros(self.count + 1, bool)  # the last entry is the ground
        touched[self.first[bonds]] = touched[self.second[bonds]] = True
        return np.flatnonzero(touched[:-1])

    def boundary(self, parts: np.ndarray) -> np.ndarray:
        """List the living bonds between a set of parts and its surroundings."""
        inside = np.zeros(self.count + 1, bool)  # the last entry is the ground
        inside[parts] = True
        bonds = self.neighbours(parts)
        crossing = inside[self.first[bonds]] != inside[self.second[bonds]]
        return bonds[crossing & self.alive[bonds]]

    def grounded(self) -> np.ndarray:
        """Mark the living bonds to the ground, (M,) bool."""
        return self.alive & ((self.first == self.count) | (self.second == self.count))
