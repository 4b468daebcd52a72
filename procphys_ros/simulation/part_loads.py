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

from procphys_ros import rotation
from procphys_ros.blueprint import Law
from procphys_ros.linear import norm, product
from procphys_ros.physics.masonry import strength
from procphys_ros.physics.trees.breaks import section_modulus
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State


@dataclass(frozen=True)
class PartLoad:
    """
    What the joints of a part carry.

    :ivar force: largest of its bonds' [N]; a branch has the one at its base.
    :ivar moment: largest of its bonds' [N·m].
    :ivar share: of what they withstand, 1 = about to break.
    """

    force: float = 0.0
    moment: float = 0.0
    share: float = 0.0


def load_of(state: State, part: int) -> PartLoad:
    """
    Give the load of a part; nothing for what is loose.

    :param state: after a step, or at rest.
    :param part: its index.
    """
    owner = state.parts.owner[part]
    if owner == Owner.TREE:
        return _branch(state, part)
    return _brick(state, part) if owner == Owner.STANDING else PartLoad()


def describe(state: State, part: int) -> str:
    """Describe the state of a part in one line."""
    owner, name = state.parts.owner[part], state.names.name(part)
    if owner == Owner.GONE:
        return f'{name} exists no more'
    if owner == Owner.BODY:
        return f'{name} is loose, {norm(state.parts.velocities[part, :3]):.2g} m/s'
    load = load_of(state, part)
    return (f'{name} carries {load.force:.3g} N and {load.moment:.3g} N·m, '
            f'{100.0 * load.share:.2g} % of its strength')


def _branch(state: State, part: int) -> PartLoad:
    row = int(state.parts.row[part])
    wrench, bond = state.forest.joint_wrenches[row], int(state.forest.bonds[row])
    force, moment = float(norm(wrench[:3])), float(norm(wrench[3:]))
    source = state.blueprint
    hinge = int(np.count_nonzero(source.bond_law[:bond] == Law.HINGE))
    axis = rotation.rotate(state.parts.poses[part, 3:], np.array([0.0, 0.0, 1.0]))
    twist = abs(float(product(wrench[3:], axis)))
    bending = float(np.sqrt(max(moment * moment - twist * twist, 0.0)))
    stress = bending / float(section_modulus(source.bond_extent[bond, 0]))
    own = source.hinges
    share = max(force / own.break_force[hinge], twist / own.break_torque[hinge],
                stress / own.strength[hinge], bending / own.root_moment[hinge])
    return PartLoad(force, moment, float(share))


def _brick(state: State, part: int) -> PartLoad:
    graph = state.solver.graph
    bonds = graph.incident[graph.start[part]:graph.start[part + 1]]
    bonds = bonds[graph.alive[bonds]]
    if not len(bonds):
        return PartLoad()
    wrench = state.solver.wrenches()
    share, _ = strength.utilisation(graph, wrench)
    size = norm(wrench[bonds].reshape(-1, 2, 3), axis=2).max(axis=0)
    return PartLoad(float(size[0]), float(size[1]), float(share[bonds].max()))
