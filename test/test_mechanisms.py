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


"""Mechanisms: what comes off comes off in lumps, at the worst joints that hold it."""

from masonry_walls import bonded, wall
import numpy as np

from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.physics.masonry.components import groups, label
from procphys_ros.physics.masonry.mechanisms import loosening


def comes_off(graph, share, drift):
    """Choose bonds where all parts drift; return their rows."""
    labels, _ = label(graph.count, graph.first, graph.second, graph.alive)
    return np.flatnonzero(loosening(graph, share, np.arange(graph.count), labels, drift))


def portal():
    """Lay a beam on two piers of three blocks; return graph, and the beds of each from below."""
    places = [(x, 0.0, 0.05 + 0.1 * k) for x in (0.1, 1.1) for k in range(3)]
    sizes = [(0.2, 0.2, 0.1)] * 6 + [(1.2, 0.2, 0.1)]
    graph = BondGraph(bonded(np.array([*places, (0.6, 0.0, 0.35)]), np.array(sizes)))
    x, z = graph.centroid[:, 0], graph.centroid[:, 2]
    order = np.argsort(z, kind='stable')
    return graph, order[x[order] < 0.6], order[x[order] > 0.6]


def test_what_drifts_comes_off_at_the_worst_bond_on_each_way_to_the_ground():
    """Break one bed of each pier, however overloaded others are, and none that is sound."""
    graph, left, right = portal()
    share = np.empty(len(graph))
    drift = np.append(np.zeros(6), 1.0)  # the beam drifts most
    share[left], share[right] = (2.0, 4.0, 3.0, 3.9), (9.0, 1.5, 8.0, 8.5)
    assert set(comes_off(graph, share, drift)) == {left[1], right[0]}
    share[right] = 0.2, 0.9, 0.5, 0.8
    assert set(comes_off(graph, share, drift)) == {left[1]}
    share[left] = 0.1
    assert not len(comes_off(graph, share, drift))


def test_something_comes_off_in_each_island():
    """Break the worst bed of two columns that stand apart, above and below what drifts most."""
    centres = [(x, 0.0, 0.05 + 0.1 * k) for x in (0.0, 1.0) for k in range(4)]
    graph = BondGraph(bonded(np.array(centres), (0.2, 0.2, 0.1)))
    x, z = graph.centroid[:, 0], graph.centroid[:, 2]
    share = np.where(x > 0.5, 3.0 - 4.0 * z, 2.0 + z)  # worst at the foot, or on top
    drift = np.tile([0.1, 0.2, 0.4, 0.3], 2)  # the third blocks come off
    rows = comes_off(graph, share, drift)
    assert sorted(zip(x[rows].round(), z[rows].round(1))) == [(0.0, 0.2), (1.0, 0.0)]


def test_a_wall_that_a_blow_throws_over_comes_off_as_one():
    """Push 28 bricks of a wall with 800 times their weight: what flies is whole, but a few."""
    plan = wall(14, 20)
    solver = StressSolver(BondGraph(plan))
    fracture = Fracture(solver)
    fracture.advance(5000)
    x, _, z = plan.poses[:, :3].T
    struck = (np.abs(x - x.mean()) < 0.4) & (np.abs(z - 0.6) < 0.3)
    force = np.zeros((len(plan), 3))
    force[struck, 1] = 800.0 * 9.81 * plan.mass[struck]
    solver.set_loads(force)
    while solver.supported[struck].any():
        assert fracture.advance(400)
    sizes = [len(piece) for piece in groups(solver.labels, ~solver.supported)]
    assert max(sizes) > 150 and len(sizes) < 10  # 225 bricks came off one by one before
