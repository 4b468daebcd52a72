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

"""Punching: the set of parts that a blow tears out of a bond graph, by a minimum cut."""

from typing import NamedTuple

import numpy as np
import scipy  # subpackages are imported on first use

from procphys_ros.physics.masonry.capacity import at_failure, REACH, Resistance
from procphys_ros.physics.masonry.components import groups, label
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.solver import StressSolver

_LARGEST = 5.0e8  # of SciPy's 32-bit integer flows, in newtons or a coarser unit
_HOPELESS = 0.05  # of the resistance of the struck parts one by one: weaker blows are skipped
_ALONG = 0.5   # of the acceleration of the struck parts: others that would become faster than
#                this come along, as their motion is nearer to the struck parts' than to rest


class Punched(NamedTuple):
    """
    Connected parts that are torn out together.

    :ivar parts: indices, ascending, (K,).
    :ivar withstood: resistance of the bonds around them.
    """

    parts: np.ndarray
    withstood: Resistance


def punched(solver: StressSolver, striker: np.ndarray, struck: np.ndarray, force: np.ndarray,
            direction: np.ndarray, acceleration: float) -> list[Punched]:
    """
    Find the parts that blows tear out, by force, of the bonds around them.

    Of all sets of parts it is the one with the largest excess of push over resistance, with all
    bonds around it at their limits (upper bound theorem): a minimum cut between the pushes and
    the remaining parts, in a network with the bonds' failure loads as capacities (Ford and
    Fulkerson 1956). A striker is rigid: it drives out all parts that it touches, or none. Other
    parts come along where accelerating them half as much takes less force than breaking their
    bonds. Parts further away than `REACH` stay, by their inertia.

    :param solver: holds the bonds and their stresses.
    :param striker: number of the striker, from 0, in each contact, (K,).
    :param struck: part that it touches there, (K,).
    :param force: of each striker along the direction [N], (S,).
    :param direction: unit vector of the blow, world, (3,).
    :param acceleration: of the struck parts, if they come out [m/s²].
    :returns: the connected sets of parts torn out; empty when all bonds hold.
    """
    graph = solver.graph
    striker, struck = np.unique([striker, struck], axis=1)
    if _is_hopeless(solver, striker, struck, force, direction):
        return []
    near = _around(graph, np.unique(struck))
    bonds = graph.neighbours(near)
    bonds = bonds[graph.alive[bonds]]
    node = np.full(graph.count + 1, -1)  # the sink stands for all other parts
    node[near] = np.arange(len(near))
    ends, wrench = (node[graph.first[bonds]], node[graph.second[bonds]]), solver.wrenches(bonds)
    each = [at_failure(graph, bonds, np.full(len(bonds), first), direction, wrench)
            for first in (True, False)]
    inertia = _ALONG * acceleration * graph.mass[near]
    inertia[node[struck]] = 0.0
    leaves = np.append(_source_side(ends, each[0][0], each[1][0], inertia,
                                    (striker, node[struck], force)), False)
    joined = leaves[ends[0]] & leaves[ends[1]]
    labels, _ = label(len(near), ends[0][joined], ends[1][joined], joined[joined])
    found = []
    for rows in groups(labels, leaves[:-1]):
        own = np.zeros(len(leaves), bool)
        own[rows] = True
        around = np.flatnonzero(own[ends[0]] != own[ends[1]])
        bears, work, rubbing = np.where(own[ends[0]][around], each[0][:, around],
                                        each[1][:, around]).sum(axis=1).tolist()
        found.append(Punched(near[rows], Resistance(bonds[around], bears, work + rubbing,
                                                    rubbing)))
    return found


def _around(graph: BondGraph, parts: np.ndarray) -> np.ndarray:
    """List the parts within `REACH` of some parts and of their joints, (N,)."""
    place = np.concatenate([graph.centre[parts], graph.centroid[graph.neighbours(parts)]])
    centre = graph.centre[:graph.count]
    return np.flatnonzero(((centre > place.min(axis=0) - REACH)
                           & (centre < place.max(axis=0) + REACH)).all(axis=1))


def _is_hopeless(solver: StressSolver, striker: np.ndarray, struck: np.ndarray,
                 force: np.ndarray, direction: np.ndarray) -> bool:
    """Return whether all strikers push far less than the resistance of the struck parts."""
    graph = solver.graph
    contact, bonds = graph.bonds_of(struck)
    living = graph.alive[bonds]
    contact, bonds = contact[living], bonds[living]
    bears = at_failure(graph, bonds, graph.first[bonds] == struck[contact], direction,
                       solver.wrenches(bonds))[0]
    return bool((force < _HOPELESS * np.bincount(striker[contact], bears, len(force))).all())


def together(found: list[Punched]) -> Punched:
    """Merge several sets of parts into one, with the sum of their resistances."""
    own = [one.withstood for one in found]
    return Punched(np.concatenate([one.parts for one in found]), Resistance(
        np.concatenate([one.bonds for one in own]), sum(one.force for one in own),
        sum(one.energy for one in own), sum(one.rubbing for one in own)))


def _source_side(ends: tuple[np.ndarray, np.ndarray], forwards: np.ndarray, backwards: np.ndarray,
                 inertia: np.ndarray,
                 pushes: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """
    Mark the nodes on the source's side of the smallest minimum cut, (N,) bool.

    :param ends: nodes of each bond, -1 for the sink, (B,) each.
    :param forwards, backwards: failure load of each bond when its first, or second, end leaves.
    :param inertia: inertia force that holds each node back [N], (N,).
    :param pushes: striker and node of each contact, (K,) each, and force of each striker, (S,).
    """
    striker, node, force = pushes
    everything = forwards.sum() + backwards.sum() + inertia.sum()  # any more tears out all nodes
    force = np.minimum(force, everything + 1.0)
    count, total = len(inertia), force.sum() + 1.0  # no cut needs more
    source, sink = count + len(force), count + len(force) + 1
    first, second = (np.where(end < 0, sink, end) for end in ends)
    pushing, nodes, rigid = count + np.arange(len(force)), np.arange(count), np.ones(len(node))
    rows = [(first, second, forwards), (second, first, backwards),
            (nodes, np.full(count, sink), inertia),
            (np.full(len(force), source), pushing, force),
            (pushing[striker], node, total * rigid), (node, pushing[striker], total * rigid)]
    low, high, most = (np.concatenate(column) for column in zip(*rows))
    capacity = scipy.sparse.csr_matrix((most, (low, high)), shape=(sink + 1, sink + 1))
    unit = max(total / _LARGEST, 1.0)
    capacity.data = (np.minimum(capacity.data, total) / unit).astype(np.int32)
    flow = scipy.sparse.csgraph.maximum_flow(capacity, source, sink).flow
    left = capacity - flow
    left.eliminate_zeros()
    reached = scipy.sparse.csgraph.breadth_first_order(left, source, return_predecessors=False)
    out = np.zeros(sink + 1, bool)
    out[reached] = True
    return out[:count]
