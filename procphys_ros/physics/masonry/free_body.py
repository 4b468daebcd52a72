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

"""
Fracture of pieces in flight: stresses and broken bonds of a free body under a blow.

A free body accelerates as a whole under a blow. In its own frame the loads of the blow and
the inertia forces of all its parts are in balance (inertia relief), so a static analysis of these
loads yields the wrenches of its bonds. Bonds and lever arms are those of the blueprint: the loads
are rotated into its frame, not the piece out of it. Gravity accelerates all parts alike and so
causes no stress. The matrix is singular by the six rigid motions, but the loads have no component
along them, and conjugate gradients that start from zero stay in the subspace where it is definite
(Kaasschieter 1988, J. Comput. Appl. Math. 24).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint, Law
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.masonry import blow_kernels, cells, components, links
from procphys_ros.physics.masonry.brittle import as_mortar
from procphys_ros.physics.masonry.graph import BondGraph

_SLENDER = 4.0     # least length of the parts over the shortest side of their joints in members
#                    that bend: boards and battens; head joints of bricks reach 3.5


@dataclass(frozen=True)
class Breakage:
    """
    Bonds that a blow broke, and the pieces that are left.

    :ivar bonds: rows of the blueprint, (K,).
    :ivar load: demand over capacity of each, (K,).
    :ivar pieces: the parts of each remaining piece, the largest first; one when it held.
    :ivar share: share of the blow that the bonds transmitted before they broke, 0 to 1.
    """

    bonds: np.ndarray
    load: np.ndarray
    pieces: list[np.ndarray]
    share: float


class FreeBodies:
    """
    Bonds of the free bodies of a blueprint, hinges of wood and mortar alike.

    :param blueprint: parts and bonds at rest.
    :param graph: its bonds, see `as_mortar`; None = made from it.

    :ivar graph: the bonds; row = row of the blueprint.
    :ivar weakest: least force that breaks a bond of each part [N], inf without bonds, (N,).
    :ivar weakest_bent: least moment that breaks a bond of each part of a slender member
        [N·m], inf elsewhere, (N,).
    """

    graph: BondGraph

    def __init__(self, blueprint: Blueprint, graph: BondGraph | None = None):
        self.graph = BondGraph(as_mortar(blueprint)) if graph is None else graph
        hinged, hinges = blueprint.bond_law == Law.HINGE, blueprint.hinges
        self._wood = (np.where(hinged, np.cumsum(hinged) - 1, -1), *(
            np.array(column, float)
            for column in (hinges.break_force, hinges.break_torque, hinges.strength)))
        axes = rotation.to_matrix(blueprint.poses[:, 3:])
        self._inertia = np.ascontiguousarray(np.stack([
            np.stack([links.turned(axes, blueprint.inertia, i, k) for k in range(3)], axis=-1)
            for i in range(3)], axis=-2))
        self._rank = np.random.default_rng(0).permutation(len(blueprint))  # seeds of the cells
        self._place = np.full(len(blueprint) + 1, -1, np.int32)
        graph = self.graph
        mortar = graph.mortar
        self._strength = tuple(np.array(column, float) for column in (
            mortar.tension, mortar.cohesion, mortar.friction, mortar.compression,
            mortar.reinforcement))
        force = np.minimum(mortar.tension, mortar.cohesion) * graph.area
        force[hinged] = np.minimum(force[hinged], hinges.break_force)
        self.weakest = _least(graph, force)
        side = graph.extent.min(axis=1, initial=np.inf)
        centre = np.concatenate([graph.centre, np.full((1, 3), np.inf)])  # or the ground
        length = norm(centre[graph.first] - centre[graph.second], axis=1)
        slender = np.isfinite(length) & (length > _SLENDER * side)
        moment = mortar.tension * graph.area * side / 6.0
        moment = np.where(slender, moment, np.inf)
        moment[hinged] = np.minimum(moment[hinged], hinges.break_torque)
        self.weakest_bent = _least(graph, moment)

    def reset(self) -> None:
        """Restore every bond."""
        self.graph.restore()

    def take_over(self, graph: BondGraph, parts: np.ndarray) -> None:
        """
        Copy the bonds of falling parts from their building: broken, opened or whole.

        :param graph: bond graph of the building.
        :param parts: falling parts, (P,).
        """
        falls = np.zeros(graph.count + 1, bool)
        falls[parts] = True
        bonds = np.flatnonzero(falls[graph.first] & falls[graph.second])
        rows = graph.rows[bonds]
        self.graph.adopt(graph, bonds, rows)
        self.graph.cut(rows[graph.cracked[bonds]])  # no load presses them together in flight

    def pieces(self, parts: np.ndarray) -> list[np.ndarray]:
        """List the connected pieces of some parts, the largest first."""
        _, a, b = self._inside(parts)
        label = components.label(len(parts), a, b, np.ones(len(a), bool))[0]
        return _largest_first(parts, label)

    def strike(self, parts: np.ndarray, wrenches: np.ndarray, wanted: int,
               energy: float = np.inf) -> Breakage:
        """
        Break one free piece by a blow.

        :param parts: parts of the piece, (P,).
        :param wrenches: force and moment of the blow at the centres of mass of the parts, in the
            frame of the blueprint [N], [N·m], (P, 6).
        :param wanted: approximate number of cells between which the piece may break; when it is
            the number of parts, each part is a cell.
        :param energy: kinetic energy taken by the blow [J]; a compliant piece makes the blow
            longer and weaker.
        """
        return self.strike_all([parts], wrenches, [wanted], [energy])[0]

    def strike_all(self, pieces: Sequence[np.ndarray], wrenches: np.ndarray,
                   wanted: Sequence[int], energies: Sequence[float]) -> list[Breakage]:
        """
        Break free pieces, each by a blow, see `strike`.

        :param pieces: parts of each, no part in two of them, (P,) in all.
        :param wrenches: on the parts of all pieces, (P, 6).
        :param wanted: number of cells of each.
        :param energies: of each blow [J].
        """
        graph = self.graph
        parts = np.concatenate(pieces).astype(np.intp, copy=False)
        start = np.cumsum([0, *(len(piece) for piece in pieces)])
        rows, loads, ends, label, share = blow_kernels.strike(
            (graph.start, graph.incident, graph.first, graph.second, graph.alive, graph.cracked,
             graph.links),
            (graph.mass, graph.centre, graph.reach, self._inertia),
            (graph.centroid, graph.axes, graph.spring, graph.area, graph.extent,
             graph.whole_extent, graph.held),
            self._strength, self._wood, (self._rank, self._place),
            (parts, start, np.ascontiguousarray(wrenches, float), np.array(wanted, np.intp),
             np.array(energies, float)))
        out = []
        for k, piece in enumerate(pieces):
            own = slice(ends[k], ends[k + 1])
            left = [piece]
            if ends[k + 1] > ends[k]:
                left = _largest_first(piece, label[start[k]:start[k + 1]])
            out.append(Breakage(rows[own], loads[own], left, float(share[k])))
        return out

    def _inside(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        graph = self.graph
        return cells.inside(parts, graph.start, graph.incident, graph.alive, graph.first,
                            graph.second, self._place)


def _largest_first(parts: np.ndarray, label: np.ndarray) -> list[np.ndarray]:
    """Group parts by their labels, the largest group first."""
    groups = components.groups(label, np.ones(len(parts), bool))
    return [parts[g] for g in sorted(groups, key=len, reverse=True)]


def _least(graph: BondGraph, value: np.ndarray) -> np.ndarray:
    """Compute the least value over the bonds of each part, (N,)."""
    out = np.full(graph.count + 1, np.inf)
    np.minimum.at(out, graph.first, value)
    np.minimum.at(out, graph.second, value)
    return out[:-1]
