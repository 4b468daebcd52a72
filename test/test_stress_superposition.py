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


"""Earlier answers of the stress solver, superposed to answer new loads at once."""

from masonry_walls import wall
import numpy as np

from procphys_ros.blueprint import chain
from procphys_ros.physics.masonry import BondGraph, StressSolver

TIGHT = 1e-4  # [N]


def pushed(plan, tolerance=TIGHT):
    """Return a solver in balance under its weight, and three patterns of load."""
    solver = StressSolver(BondGraph(plan), tolerance=tolerance)
    solver.iterate(20_000)
    rng = np.random.default_rng(5)
    return solver, rng.normal(scale=3.0, size=(3, len(plan), 3))


def answer(solver, force):
    """Load a solver, let it come into balance, and give what that took."""
    before = solver.spent
    solver.set_loads(force)
    solver.iterate(20_000)
    assert solver.converged
    return solver.spent - before


def test_a_combination_of_known_loads_is_answered_at_once():
    """Need no more iterations for any sum of loads that were answered before."""
    solver, patterns = pushed(wall(15, 20))
    first = [answer(solver, force) for force in patterns]
    assert min(first) > 50
    for share in ((2.0, 0.0, 0.0), (-1.0, 0.5, 3.0), (0.0, 0.0, 0.0)):
        assert answer(solver, np.tensordot(share, patterns, 1)) < 0.3 * min(first)


def test_all_patterns_of_a_storm_are_known_at_once():
    """Keep the answers to twenty patterns, as wind from many directions has."""
    solver, _ = pushed(wall(9, 12))
    patterns = np.random.default_rng(7).normal(scale=3.0, size=(20, solver.graph.count, 3))
    first = [answer(solver, force) for force in patterns]
    shares = np.random.default_rng(8).normal(size=(5, 20))
    again = [answer(solver, np.tensordot(share, patterns, 1)) for share in shares]
    assert max(again) < 0.5 * min(first)


def test_the_answer_is_that_of_a_solver_that_knows_nothing():
    """Change nothing but the work by guessing, also after many loads and a restart."""
    plan = wall(15, 20)
    solver, patterns = pushed(plan)
    rng = np.random.default_rng(6)
    for _ in range(30):
        force = np.tensordot(rng.normal(size=3), patterns, 1) + rng.normal(size=(len(plan), 3))
        answer(solver, force)
    cold, _ = pushed(plan)
    answer(cold, force)
    scale = np.abs(cold.displacement).max()
    np.testing.assert_allclose(solver.displacement, cold.displacement, atol=1e-5 * scale)


def test_cutting_bonds_forgets_what_the_whole_wall_answered():
    """Answer a known load as the cut wall does, not as the whole one did."""
    plan = wall(15, 20)
    solver, patterns = pushed(plan)
    answer(solver, patterns[0])
    answer(solver, np.zeros_like(patterns[0]))
    solver.cut(solver.graph.neighbours(np.array([40, 41, 57])), dynamic_factor=1.0)
    solver.iterate(20_000)
    assert answer(solver, patterns[0]) > 50
    cold = StressSolver(BondGraph(plan), tolerance=TIGHT)
    cold.cut(np.flatnonzero(~solver.graph.alive))
    answer(cold, patterns[0])
    scale = np.abs(cold.wrenches()).max()
    assert np.abs(solver.wrenches() - cold.wrenches()).max() < 1e-4 * scale


def test_buildings_are_guessed_each_by_itself():
    """Answer loads on two walls in shares that no common factor would fit."""
    plan = wall(9, 12)
    solver, patterns = pushed(chain([plan, plan.placed((50.0, 0.0, 0.0))]))
    first = answer(solver, patterns[0])
    scale = np.where(np.arange(2 * len(plan)) < len(plan), 2.0, -0.7)
    assert answer(solver, scale[:, None] * patterns[0]) < 0.3 * first


def test_dying_sudden_loads_are_no_part_of_an_answer():
    """Keep guessing right while the dynamic share of a removal dies away between loads."""
    plan = wall(15, 20)
    solver, patterns = pushed(plan)
    solver.cut(solver.graph.neighbours(np.array([40, 41, 57])), dynamic_factor=2.0)
    solver.iterate(20_000)
    for force in patterns:
        solver.set_loads(force)
        solver.forget_sudden(0.5)
        solver.iterate(20_000)
    solver.forget_sudden()
    solver.iterate(20_000)
    cold = StressSolver(BondGraph(plan), tolerance=TIGHT)
    cold.cut(np.flatnonzero(~solver.graph.alive))
    answer(cold, patterns[-1])
    scale = np.abs(cold.displacement).max()
    np.testing.assert_allclose(solver.displacement, cold.displacement, atol=1e-5 * scale)
