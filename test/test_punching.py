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

"""What blows punch out of a wall is the set with the largest excess of push over resistance."""

from itertools import combinations

from masonry_walls import bonded, resistance_of, wall
import numpy as np
import pytest

from procphys_ros.physics.masonry import (
    BondGraph,
    punched,
    punching,
    StressSolver,
    together,
)

_ACROSS = np.array([0.0, 1.0, 0.0])


def excess(solver, push, parts, direction):
    """Compute the push on a set of parts in excess of what the bonds around it bear [N]."""
    return push[parts].sum() - resistance_of(solver, parts, direction).force


def strike_singly(solver, struck, force, direction, acceleration=0.0):
    """Strike each part by its own striker."""
    return punched(solver, np.arange(len(struck)), np.asarray(struck), np.asarray(force),
                   direction, acceleration)


@pytest.mark.parametrize('seed', range(8))
def test_no_other_set_has_a_larger_excess(seed):
    """Strike a wall of ten bricks in any direction, and compare with all its 1,023 sets."""
    rng = np.random.default_rng(seed)
    solver = StressSolver(BondGraph(wall(3, 3)), tolerance=1e-6)
    solver.iterate(500)
    count, direction = solver.graph.count, rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    push = np.where(rng.random(count) < 0.5, rng.uniform(0.0, 60e3, count), 0.0)
    held = np.where(push > 0.0, 0.0, rng.uniform(0.0, 500.0) * solver.graph.mass)
    struck = np.flatnonzero(push)
    acceleration = 2.0 * float(held.max() / solver.graph.mass[held.argmax()])
    found = strike_singly(solver, struck, push[struck], direction, acceleration)
    most = max(excess(solver, push - held, np.array(parts), direction)
               for size in range(1, count + 1) for parts in combinations(range(count), size))
    bonds = len(solver.graph) + count  # each rounded to a newton
    if not found:
        assert most < bonds
        return
    whole = together(found)
    assert excess(solver, push - held, whole.parts, direction) == pytest.approx(most, abs=bonds)
    assert whole.withstood.force == pytest.approx(
        resistance_of(solver, whole.parts, direction).force)
    for one in found:
        assert one.withstood.energy == pytest.approx(
            resistance_of(solver, one.parts, direction).energy)
        assert np.array_equal(np.sort(one.withstood.bonds), solver.graph.boundary(one.parts))


def test_two_blows_far_from_each_other_punch_two_holes():
    """Strike a long wall at both ends, and at one of them too weakly."""
    solver = StressSolver(BondGraph(wall(30, 10)))
    ends = [153, 175]
    alone = resistance_of(solver, np.array([ends[0]]), _ACROSS).force
    for share, out in (([1.1, 1.1], [[153], [175]]), ([1.1, 0.9], [[153]]), ([0.9, 0.9], [])):
        found = strike_singly(solver, ends, np.array(share) * alone, _ACROSS, 1e4)
        assert [one.parts.tolist() for one in found] == out


def test_what_strikes_drives_out_all_that_it_touches_or_nothing():
    """Strike two bricks: as hard as one of them bears nothing moves, as both bear both do."""
    solver = StressSolver(BondGraph(wall(30, 10)))
    pair = np.array([153, 175])
    alone = resistance_of(solver, pair[:1], _ACROSS).force
    for share, out in ((1.9, []), (2.1, [153, 175])):
        found = punched(solver, np.zeros(2, int), pair, np.array([share * alone]), _ACROSS, 1e4)
        assert [part for one in found for part in one.parts.tolist()] == out


def test_forces_of_any_size_are_compared(monkeypatch):
    """Push with more newtons than an integer holds: what cannot stay goes, by the least cut."""
    solver, struck = StressSolver(BondGraph(wall(30, 10))), np.array([153])
    small = together(strike_singly(solver, struck, [np.inf], _ACROSS, 1e4))
    assert small.parts.tolist() == [153]
    for largest in (1e8, 1e5):
        monkeypatch.setattr(punching, '_LARGEST', largest)
        for force in (1e6, 1e12, np.inf):
            one, = strike_singly(solver, struck, [force], _ACROSS, 1e4)
            assert one.parts.tolist() == [153]
            assert one.withstood.force == small.withstood.force


def test_others_come_along_when_there_is_time():
    """Drive a course out of a pier: slowly with all above it, quickly alone."""
    middle = np.arange(12)[:, None] * [0.0, 0.0, 0.075] + [0.0, 0.0, 0.0325]
    solver = StressSolver(BondGraph(bonded(middle, [0.215, 0.1025, 0.065])))
    for acceleration, out in ((10.0, list(range(5, 12))), (1e4, [5])):
        one, = strike_singly(solver, [5], [1e6], _ACROSS, acceleration)
        assert one.parts.tolist() == out
