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
Fracture of pieces in flight: the stresses that a blow makes in a free body, and what they break.

A free body answers a blow by accelerating as a whole. In its own frame the loads of the blow and
the inertia forces of all its parts are in balance (inertia relief), so the bonds inside carry what
a static analysis of these loads gives. Bonds and lever arms are those of the blueprint: the loads
are turned into it, not the piece out of it. Gravity accelerates all parts alike and so makes no
stress. The matrix is singular by the six rigid motions but the loads have no share in them, and
conjugate gradients that start from zero never leave the space where it is definite
(Kaasschieter 1988, J. Comput. Appl. Math. 24).
"""

from dataclasses import dataclass

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint, Law
from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry import cells, components, links, pcg, strength
from procphys_ros.physics.masonry.brittle import as_mortar, wood_utilisation
from procphys_ros.physics.masonry.graph import BondGraph

_ROUNDS = 12       # of stress and breaking per blow; what still cracks does so at the next blow
_BAND = 0.4        # a blow breaks all that is loaded above this share of the worst at once: the
#                    stress arrives everywhere before the first crack has relieved anything
_ITERATIONS = 150  # of conjugate gradients per round
_LEAST = 1e4       # [Pa] strength of what has none: dry parts hook into each other
_SLENDER = 4.0     # length of the parts over the least side of their joints, from which on pieces
#                    are members that bend: boards and battens; head joints of bricks reach 3.5
_ROUNDING = 1e-9   # of the loads: what balances up to this is in balance
_ACCURACY = 4e-3   # of the largest load on a cell: residual at which stresses are known well


@dataclass(frozen=True)
class Breakage:
    """
    What a blow broke.

    :ivar bonds: rows of the blueprint, (K,).
    :ivar load: demand over capacity of each, (K,).
    :ivar pieces: the parts of each piece that is left, the largest first; one when it held.
    :ivar share: how much of the blow the bonds could transmit before they broke, 0 to 1.
    """

    bonds: np.ndarray
    load: np.ndarray
    pieces: list[np.ndarray]
    share: float


class FreeBodies:
    """
    All bonds of a blueprint, hinges of wood and mortar alike, as far as they fly about.

    :param blueprint: parts and bonds at rest.
    :param graph: its bonds, see `as_mortar`; None = made from it.

    :ivar graph: the bonds; row = row of the blueprint.
    :ivar weakest: least force that can break a bond of each part [N], inf without bonds, (N,).
    :ivar weakest_bent: least moment that can break a bond of each part of a slender member
        [N·m], inf elsewhere, (N,).
    """

    def __init__(self, blueprint: Blueprint, graph: BondGraph | None = None):
        self.graph = BondGraph(as_mortar(blueprint)) if graph is None else graph
        self._hinges = blueprint.hinges
        self._hinge_row = np.where(blueprint.bond_law == Law.HINGE,
                                   np.cumsum(blueprint.bond_law == Law.HINGE) - 1, -1)
        axes = rotation.to_matrix(blueprint.poses[:, 3:])
        self._inertia = np.stack([
            np.stack([links.turned(axes, blueprint.inertia, i, k) for k in range(3)], axis=-1)
            for i in range(3)], axis=-2)
        self._rank = np.random.default_rng(0).permutation(len(blueprint))  # where cells start
        self._place = np.full(len(blueprint) + 1, -1, np.int32)
        graph = self.graph
        mortar = graph.mortar
        force = np.minimum(mortar.tension, mortar.cohesion) * graph.area
        self.weakest = _least(graph, force)
        side = graph.extent.min(axis=1, initial=np.inf)
        centre = np.concatenate([graph.centre, np.full((1, 3), np.inf)])  # or the ground
        length = np.linalg.norm(centre[graph.first] - centre[graph.second], axis=1)
        slender = np.isfinite(length) & (length > _SLENDER * side)
        moment = mortar.tension * graph.area * side / 6.0
        self.weakest_bent = _least(graph, np.where(slender, moment, np.inf))

    def reset(self) -> None:
        """Make every bond whole again."""
        self.graph.restore()

    def take_over(self, graph: BondGraph, parts: np.ndarray) -> None:
        """
        Go on with the bonds of parts that fall as a building left them: broken, opened or whole.

        :param graph: of the building.
        :param parts: that fall, (P,).
        """
        falls = np.zeros(graph.count + 1, bool)
        falls[parts] = True
        bonds = np.flatnonzero(falls[graph.first] & falls[graph.second])
        rows = graph.rows[bonds]
        self.graph.adopt(graph, bonds, rows)
        self.graph.cut(rows[graph.cracked[bonds]])  # nothing presses them together in flight

    def pieces(self, parts: np.ndarray) -> list[np.ndarray]:
        """List what hangs together among some parts, the largest piece first."""
        _, a, b = self._inside(parts)
        label = components.label(len(parts), a, b, np.ones(len(a), bool))[0]
        groups = components.groups(label, np.ones(len(parts), bool))
        return [parts[g] for g in sorted(groups, key=len, reverse=True)]

    def strike(self, parts: np.ndarray, wrenches: np.ndarray, wanted: int,
               energy: float = np.inf) -> Breakage:
        """
        Break a free piece by a blow.

        :param parts: what hangs together, (P,).
        :param wrenches: force and moment of the blow at the centres of mass of the parts, in the
            frame of the blueprint [N], [N·m], (P, 6).
        :param wanted: in about how many cells the piece may break; with as many as there are
            parts each is a cell.
        :param energy: that the blow takes from the motion of the bodies [J]; a piece that yields
            makes it longer and gentler, see `_gentler`.
        """
        rows, a, b = self._inside(parts)
        if wanted < len(parts):
            node, count = cells.grow(len(parts), a, b, self._rank[parts], wanted)
            across = node[a] != node[b]
            rows, a, b = rows[across], node[a[across]], node[b[across]]
        else:
            node, count = np.arange(len(parts), dtype=np.int32), len(parts)
        system = _System(self, parts, node, count, rows, a, b)
        broken, load, worst, gentler = [], [], 1.0, 1.0
        for turn in range(_ROUNDS):
            share = system.utilisation(wrenches)
            gentler = _gentler(system.strain_energy, energy) if not turn else gentler
            share *= gentler
            over = system.overloaded(share)
            worst = max(worst, float(share[over].max(initial=1.0))) if not turn else worst
            if not len(over):
                break
            broken.append(rows[over])
            load.append(share[over])
            self.graph.cut(rows[over])
            system.alive[over] = False
        if not broken:
            return Breakage(np.zeros(0, np.intp), np.zeros(0), [parts], 1.0)
        return Breakage(np.concatenate(broken), np.concatenate(load), self.pieces(parts),
                        1.0 / worst)

    def _inside(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        graph = self.graph
        return cells.inside(parts, graph.start, graph.incident, graph.alive, graph.first,
                            graph.second, self._place)


def _gentler(strain_energy: float, energy: float) -> float:
    """
    Give by which factor the forces of a blow are less because the piece itself yields.

    Contact and piece are springs in series, T² = T_c² + π²·m·c with the compliance c of the piece.
    In terms of its strain energy under the forces of a rigid one that factor T_c/T needs no m.

    :param strain_energy: of the piece under the forces of the blow [J].
    :param energy: that the blow takes from the motion [J].
    """
    return float(1.0 / np.sqrt(1.0 + np.pi ** 2 * strain_energy / max(energy, 1e-9)))


def _least(graph: BondGraph, value: np.ndarray) -> np.ndarray:
    """Give the least value of the bonds of each part, (N,)."""
    out = np.full(graph.count + 1, np.inf)
    np.minimum.at(out, graph.first, value)
    np.minimum.at(out, graph.second, value)
    return out[:-1]


class _System:
    """Stresses between the cells of one piece."""

    def __init__(self, bodies: FreeBodies, parts: np.ndarray, node: np.ndarray, count: int,
                 rows: np.ndarray, a: np.ndarray, b: np.ndarray):
        graph = bodies.graph
        self._parts, self._node, self._a, self._b = parts, node, a, b
        self._mass, self._inertia = graph.mass[parts], bodies._inertia[parts]
        self._part_centre = graph.centre[parts]
        total = np.bincount(node, self._mass, count)
        self._centre = np.column_stack([
            np.bincount(node, self._mass * self._part_centre[:, c], count) / total
            for c in range(3)])
        self._axes = graph.axes[rows]
        self._reach = np.zeros(count)
        np.maximum.at(self._reach, node, graph.reach[parts] + np.linalg.norm(
            self._part_centre - self._centre[node], axis=1))
        self._links = links.build(a, b, graph.centroid[rows], self._centre, self._axes,
                                  graph.spring[rows])
        self._patches = graph.patches(rows)
        hinge = bodies._hinge_row[rows]
        self._wooden = np.flatnonzero(hinge >= 0)
        self._hinges = bodies._hinges.take(hinge[self._wooden])
        self._start, self._incident = links.incidence(count, a, b)
        self.alive = self._patches.alive
        self._wrench = np.zeros((len(rows), 6))
        self.strain_energy = 0.0  # [J] under the last loads

    def utilisation(self, wrenches: np.ndarray) -> np.ndarray:
        """Give, for every bond, over its limit how many times the loads are, see `_demand`."""
        count = len(self._centre)
        label = components.label(count, self._a, self._b, self.alive)[0]
        load = _balanced(label, self._node, self._mass, self._inertia, self._part_centre,
                         self._centre, wrenches)
        if np.abs(load).max(initial=0.0) < _ROUNDING * np.abs(wrenches).max(initial=0.0):
            self.strain_energy = 0.0
            return np.zeros(len(self._a))  # the loads move all parts alike
        blocks = np.zeros((count, 6, 6))
        self._links[~self.alive, 6:] = 0.0
        links.diagonal_inverses(np.arange(count), self._start, self._incident, self.alive,
                                self._links, self._a, blocks)
        moved = pcg.relax(self._a, self._b, self._links, blocks, load, self._reach, _ACCURACY,
                          _ITERATIONS)
        self.strain_energy = 0.5 * float((moved * load).sum())
        links.pulls(np.arange(len(self._a)), self._links, self._axes, self._a, self._b, moved,
                    self._wrench)
        patches, mortar = self._patches, self._patches.mortar
        share, self._opens = _demand(self._wrench, patches.area, patches.extent, mortar.tension,
                                     mortar.cohesion, mortar.friction, mortar.compression)
        if len(self._wooden):
            share[self._wooden] = wood_utilisation(
                self._hinges, patches.area[self._wooden], self._wrench[self._wooden])
        return share

    def overloaded(self, share: np.ndarray) -> np.ndarray:
        """Choose what breaks; a bond pressed inside its patch opens at an edge, but holds."""
        over = np.flatnonzero(self.alive & (share > 1.0))
        if not len(over):
            return over
        stays = strength.opening(self._patches, over, self._wrench[over])[0] & self._opens[over]
        over = over[~stays]
        return over[share[over] > _BAND * share[over].max(initial=0.0)]


@kernel
def _demand(wrench, area, extent, tension, cohesion, friction, compression):
    """
    Tell how many times the load that breaks each bond the load is, (K,), and if it opens, (K,).

    The bonds carry nothing before the blow, so all stresses grow in proportion; the limits are
    those of `strength.utilisation`, solved for the share of the load at which they are met.
    """
    out = np.zeros(len(wrench))
    opens = np.zeros(len(wrench), np.bool_)
    for m in range(len(wrench)):
        pull = wrench[m, 2] / area[m]
        bending = 6.0 / area[m] * (abs(wrench[m, 3]) / extent[m, 1]
                                   + abs(wrench[m, 4]) / extent[m, 0])
        across = (extent[m, 0] ** 2 + extent[m, 1] ** 2) ** 0.5
        shear = ((wrench[m, 0] ** 2 + wrench[m, 1] ** 2) ** 0.5
                 + 6.0 * abs(wrench[m, 5]) / across) / area[m]
        opening = (bending + pull) / max(tension[m], _LEAST)
        other = max((shear + friction[m] * pull) / max(cohesion[m], _LEAST),
                    (bending - pull) / compression[m])
        out[m] = max(opening, other, 0.0)
        opens[m] = opening > other
    return out, opens


@kernel
def _balanced(label, node, mass, inertia, centre, middle, wrenches):
    """
    Add the inertia forces of rigid motion to a blow, island by island, and gather them by cell.

    :param label: island of each cell, (C,); node: cell of each part, (P,).
    :param middle: centres of mass of the cells, (C, 3).
    :param wrenches: on the parts, (P, 6).
    :returns: wrench on each cell, (C, 6), in balance over every island.
    """
    count = len(middle)
    total = np.zeros(count)
    hub = np.zeros((count, 3))
    push = np.zeros((count, 6))
    tensor = np.zeros((count, 3, 3))
    for p in range(len(mass)):
        i = label[node[p]]
        total[i] += mass[p]
        for c in range(3):
            hub[i, c] += mass[p] * centre[p, c]
    for i in range(count):
        if total[i] > 0.0:
            hub[i] /= total[i]
    for p in range(len(mass)):
        i = label[node[p]]
        arm = centre[p] - hub[i]
        square = (arm * arm).sum()
        for c in range(3):
            push[i, c] += wrenches[p, c]
            tensor[i, c, c] += mass[p] * square
            for d in range(3):
                tensor[i, c, d] += inertia[p, c, d] - mass[p] * arm[c] * arm[d]
        push[i, 3] += wrenches[p, 3] + arm[1] * wrenches[p, 2] - arm[2] * wrenches[p, 1]
        push[i, 4] += wrenches[p, 4] + arm[2] * wrenches[p, 0] - arm[0] * wrenches[p, 2]
        push[i, 5] += wrenches[p, 5] + arm[0] * wrenches[p, 1] - arm[1] * wrenches[p, 0]
    for i in range(count):
        if total[i] > 0.0:
            push[i, :3] /= total[i]
            push[i, 3:] = np.linalg.solve(tensor[i], push[i, 3:])
    out = np.zeros((count, 6))
    for p in range(len(mass)):
        i = label[node[p]]
        arm = centre[p] - hub[i]
        lever = centre[p] - middle[node[p]]
        spin = push[i, 3:]
        x = wrenches[p, 0] - mass[p] * (push[i, 0] + spin[1] * arm[2] - spin[2] * arm[1])
        y = wrenches[p, 1] - mass[p] * (push[i, 1] + spin[2] * arm[0] - spin[0] * arm[2])
        z = wrenches[p, 2] - mass[p] * (push[i, 2] + spin[0] * arm[1] - spin[1] * arm[0])
        row = out[node[p]]
        row[0] += x
        row[1] += y
        row[2] += z
        row[3] += wrenches[p, 3] + lever[1] * z - lever[2] * y
        row[4] += wrenches[p, 4] + lever[2] * x - lever[0] * z
        row[5] += wrenches[p, 5] + lever[0] * y - lever[1] * x
        for c in range(3):
            for d in range(3):
                row[3 + c] -= inertia[p, c, d] * spin[d]
    return out
