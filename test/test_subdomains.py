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

"""Steps of Newton's method on what is furthest out of balance: exact, and they fail the same."""

from masonry_walls import braced
import numpy as np
import pytest

from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver, subdomains

_PUSHED = np.arange(150, 156)  # neighbours, some way up


@pytest.fixture
def chosen(monkeypatch):
    """Allow steps on a part in small walls, too; list the numbers of parts they are on."""
    choose, sizes = subdomains.furthest_off, []

    def listed(*given):
        found = choose(*given)
        if found is not None:
            sizes.append(len(found.parts))
        return found
    monkeypatch.setattr(subdomains, '_LARGE', 0)
    monkeypatch.setattr(subdomains, 'furthest_off', listed)
    return sizes


def struck(built):
    """Make a standing wall under a blow that acts from now on."""
    fracture = Fracture(StressSolver(BondGraph(built)), 2.0)
    fracture.advance(20_000)
    push = np.zeros((len(built), 3))
    push[_PUSHED, 1] = 1000.0
    fracture.solver.set_loads(push)
    return fracture


def rounds_of(fracture, count, iterations=100):
    """Work on a blow until `count` rounds have failed something; return the failures of each."""
    failed = []
    for _ in range(4000 // iterations):
        found, over = fracture.withstand(iterations, 1000.0, lambda moved: False)
        failed += [set(failures.bond.tolist()) for failures in found]
        if over or len(failed) == count:
            break
    return failed


def unbalanced(solver):
    """Add loads and true forces up from scratch, (N, 6)."""
    equilibrium = solver.equilibrium
    left = equilibrium.weight + equilibrium._given + equilibrium._sudden
    equilibrium.joints.add_pulls(np.flatnonzero(solver.graph.alive), solver.displacement, left,
                                 1.0)
    left[:-1][~solver.supported] = 0.0
    return left[:-1]


def test_the_residual_stays_exact_while_steps_are_on_a_part(chosen):
    """Compare the residual of every part with its forces, after every few iterations."""
    fracture = struck(braced(16, 30, 0.4e6))
    solver = fracture.solver
    for _ in range(60):
        fracture.withstand(7, 1000.0, lambda moved: False)
        solver._halt()
        assert np.abs(solver.equilibrium.residual[:-1] - unbalanced(solver)).max() < 1e-6
    assert len(chosen) > 10 and max(chosen) < 0.34 * solver.graph.count


def test_only_what_is_chosen_moves_in_a_step_on_a_part(chosen):
    """Look at displacements after a few iterations of such a step."""
    fracture = struck(braced(16, 30, 0.4e6))
    solver, looked = fracture.solver, 0
    while looked < 5:
        fracture.withstand(3, 1000.0, lambda moved: False)
        step = solver._step
        if step.confined and not solver.known:
            before = step._start[0]
            inside = np.zeros(len(before), bool)
            inside[step.islands.parts] = True
            assert np.array_equal(solver.displacement[~inside], before[~inside])
            ends = solver.graph.first[step.islands.bonds], solver.graph.second[step.islands.bonds]
            assert (inside[ends[0]] | inside[ends[1]]).all()
            looked += 1


def test_steps_on_a_part_fail_the_same_bonds(chosen):
    """Crack a wall under a blow in four rounds, with such steps and without."""
    built = braced(16, 30, 0.4e6)
    confined = rounds_of(struck(built), 4)
    assert chosen
    subdomains._LARGE = 10_000
    assert confined == rounds_of(struck(built), 4) and len(confined) == 4


def test_sets_are_connected_and_list_each_bond_once(chosen):
    """Choose around two places of a wall that are far from each other."""
    fracture = struck(braced(20, 30, 0.4e6))
    solver, graph = fracture.solver, fracture.solver.graph
    graph.cracked[np.flatnonzero(graph.alive)[:1]] = True
    assert not solver.converged
    sizes = np.zeros(graph.count)
    sizes[[40, 500]] = 1.0
    sets = subdomains.furthest_off(graph, solver._islands, sizes, 1.0)
    assert len(sets.part) == len(sets.bond) == 3
    assert 40 in sets.parts[:sets.part[1]] and 500 in sets.parts[sets.part[1]:]
    assert len(np.unique(sets.parts)) == len(sets.parts) == sets.part[-1]
    living = [m for m in graph.neighbours(sets.parts) if graph.alive[m]]
    assert sorted(sets.bonds.tolist()) == sorted(living)
    assert subdomains.furthest_off(graph, solver._islands, np.ones(graph.count), 1.0) is None
