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


"""Part loads: forces and utilisation of the bonds of one part."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Law
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.masonry import strength
from procphys_ros.physics.trees.breaks import section_modulus
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State


@dataclass(frozen=True)
class PartLoad:
    """
    The load of the joints of a part.

    :ivar force: largest of its bonds [N]; for a branch, at its base.
    :ivar moment: largest of its bonds [N·m].
    :ivar share: of their strength, 1 = about to break.
    """

    force: float = 0.0
    moment: float = 0.0
    share: float = 0.0


def load_of(state: State, part: int) -> PartLoad:
    """
    Return the load of a part, as `loads_of`.

    :param part: its index.
    """
    return PartLoad(*loads_of(state, np.array([part]))[0].tolist())


def loads_of(state: State, parts: np.ndarray) -> np.ndarray:
    """
    Compute the loads of parts.

    :param state: between two steps.
    :param parts: indices, (K,).
    :returns: columns as in `PartLoad`, (K, 3); 0 for loose or gone parts, NaN for trees before
        their first step, which computes their joint loads.
    """
    out = np.zeros((len(parts), 3))
    owner = state.parts.owner[parts]
    for kind, compute in ((Owner.TREE, _branches), (Owner.STANDING, _bricks)):
        own = np.flatnonzero(owner == kind)
        if len(own):
            out[own] = compute(state, parts[own])
    return out


def describe(state: State, part: int) -> str:
    """Describe the state of a part in one line."""
    owner, name = state.parts.owner[part], state.names.name(part)
    if owner == Owner.GONE:
        return f'{name} exists no more'
    if owner == Owner.BODY:
        return f'{name} is loose, {norm(state.parts.velocities[part, :3]):.2g} m/s'
    load = load_of(state, part)
    if np.isnan(load.force):
        return f'{name} has a load from the first step on'
    return (f'{name} carries {load.force:.3g} N and {load.moment:.3g} N·m, '
            f'{100.0 * load.share:.2g} % of its strength')


def _branches(state: State, parts: np.ndarray) -> np.ndarray:
    rows, source = state.parts.row[parts], state.blueprint
    wrench, bonds = state.forest.joint_wrenches[rows], state.forest.bonds[rows]
    hinges = source.hinges.take((np.cumsum(source.bond_law == Law.HINGE) - 1)[bonds])
    force, moment = norm(wrench[:, :3], axis=1), norm(wrench[:, 3:], axis=1)
    axis = rotation.rotate(state.forest.poses[rows, 3:], np.array([0.0, 0.0, 1.0]))
    twist = np.abs((wrench[:, 3:] * axis).sum(axis=1))
    bending = np.sqrt(np.maximum(moment * moment - twist * twist, 0.0))
    stress = bending / section_modulus(source.bond_extent[bonds, 0])
    share = np.max([force / hinges.break_force, twist / hinges.break_torque,
                    stress / hinges.strength, bending / hinges.root_moment], axis=0)
    return np.column_stack([force, moment, share])


def _bricks(state: State, parts: np.ndarray) -> np.ndarray:
    graph, out = state.solver.graph, np.zeros((len(parts), 3))
    first, count = graph.start[parts], graph.start[parts + 1] - graph.start[parts]
    owner = np.repeat(np.arange(len(parts)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    bond = graph.incident[first[owner] + within]
    owner, bond = owner[graph.alive[bond]], bond[graph.alive[bond]]
    wrench = state.solver.wrenches()
    share, _ = strength.utilisation(graph, wrench)
    np.maximum.at(out, owner, np.column_stack([
        norm(wrench[bond, :3], axis=1), norm(wrench[bond, 3:], axis=1), share[bond]]))
    return out
