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

"""Punching: the set of parts that a blow tears out of a bond graph, by a minimal cut."""

from typing import NamedTuple

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.physics.masonry.capacity import at_failure, REACH, Resistance
from procphys_ros.physics.masonry.components import groups, label
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.solver import StressSolver

_LARGEST = 5.0e8  # of SciPy's flows, which are 32-bit integers: of newtons, or as many as need be
_HOPELESS = 0.05  # of what the struck parts bear one by one: what pushes less is not looked into
_ALONG = 0.5   # of the acceleration of what is struck, with which others come along: those that
#                would become faster are nearer to its motion than to rest


class Punched(NamedTuple):
    """
    Parts that come out together.

    :ivar parts: indices, ascending, (K,).
    :ivar withstood: by the bonds around them.
    """

    parts: np.ndarray
    withstood: Resistance


def punched(solver: StressSolver, striker: np.ndarray, struck: np.ndarray, force: np.ndarray,
            direction: np.ndarray, acceleration: float) -> list[Punched]:
    """
    Find what blows tear out: parts on which they push harder than the bonds around them bear.

    Of all sets of parts it is the one with the largest excess of push over resistance, the bonds
    around it being at their limits together (upper bound theorem): a minimal cut between the
    pushes and what stays, as in a network whose edges carry what bonds bear (Ford and Fulkerson
    1956). What strikes is rigid: it drives all out that it touches, or none of it. Others come
    along where it takes less force to accelerate them half as much as to hold them back. What lies
    further away than `REACH` stays, by its inertia.

    :param solver: knows the bonds and their stresses.
    :param striker: number of what strikes, from 0, in each contact, (K,).
    :param struck: part that it touches there, (K,).
    :param force: with which each striker pushes along the direction [N], (S,).
    :param direction: unit vector of the blow, world, (3,).
    :param acceleration: of what is struck, if it comes out [m/s²].
    :returns: what hangs together of it, each by itself; none where all holds.
    """
    graph = solver.graph
    striker, struck = np.unique([striker, struck], axis=1)
    if _is_hopeless(solver, striker, struck, force, direction):
        return []
    near = _around(graph, np.unique(struck))
    bonds = graph.neighbours(near)
    bonds = bonds[graph.alive[bonds]]
    node = np.full(graph.count + 1, -1)  # the sink is last: it is all else
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
    """List the parts within `REACH` of some and of their joints, (N,)."""
    place = np.concatenate([graph.centre[parts], graph.centroid[graph.neighbours(parts)]])
    centre = graph.centre[:graph.count]
    return np.flatnonzero(((centre > place.min(axis=0) - REACH)
                           & (centre < place.max(axis=0) + REACH)).all(axis=1))


def _is_hopeless(solver: StressSolver, striker: np.ndarray, struck: np.ndarray,
                 force: np.ndarray, direction: np.ndarray) -> bool:
    """Say whether all strikers push far less than what they touch bears, part by part."""
    graph = solver.graph
    contact, bonds = graph.bonds_of(struck)
    living = graph.alive[bonds]
    contact, bonds = contact[living], bonds[living]
    bears = at_failure(graph, bonds, graph.first[bonds] == struck[contact], direction,
                       solver.wrenches(bonds))[0]
    return bool((force < _HOPELESS * np.bincount(striker[contact], bears, len(force))).all())


def together(found: list[Punched]) -> Punched:
    """Take several sets as one, which bear together what each of them does."""
    own = [one.withstood for one in found]
    return Punched(np.concatenate([one.parts for one in found]), Resistance(
        np.concatenate([one.bonds for one in own]), sum(one.force for one in own),
        sum(one.energy for one in own), sum(one.rubbing for one in own)))


def _source_side(ends: tuple[np.ndarray, np.ndarray], forwards: np.ndarray, backwards: np.ndarray,
                 inertia: np.ndarray,
                 pushes: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """
    Mark the nodes on the source's side of the smallest minimal cut, (N,) bool.

    :param ends: nodes of each bond, -1 for the sink, (B,) each.
    :param forwards, backwards: what each bond bears when its first, or its second, end leaves.
    :param inertia: that keeps each node back [N], (N,).
    :param pushes: striker and node of each contact, (K,) each, and force of each striker, (S,).
    """
    striker, node, force = pushes
    everything = forwards.sum() + backwards.sum() + inertia.sum()  # more tears all out
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
