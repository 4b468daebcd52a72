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


"""Loads on standing walls: what lasts, what strikes once, and what waits."""

import numpy as np
import pytest

from procphys_ros.physics.masonry.standing_loads import StandingLoads

_DT = 1.0 / 60.0


class Slow:
    """Take loads as a stress solver does that is not done with them for a while."""

    def __init__(self):
        self.given: list[np.ndarray] = []

    def set_loads(self, force: np.ndarray, moment: np.ndarray) -> None:
        self.given.append(np.hstack([force, moment]))


def push(force: float) -> np.ndarray:
    """Return one wrench along z."""
    return np.array([[0.0, 0.0, force, 0.0, 0.0, 0.0]])


def test_loads_that_jitter_wait_until_earlier_ones_are_judged():
    """Hand over what changes within a moment, then nothing before the judgement."""
    solver = Slow()
    loads = StandingLoads(3)
    for i in range(60):
        loads.set_layer('debris', np.array([1]), push(100.0 + i))
        loads.apply(solver, i * _DT)
    assert 1 < len(solver.given) <= 7
    loads.end_blows()
    loads.apply(solver, 1.0)
    assert solver.given[-1][1, 2] == pytest.approx(159.0)
    count = len(solver.given)
    loads.end_blows()
    loads.apply(solver, 1.0 + _DT)
    assert len(solver.given) == count  # and nothing while nothing changes


def test_blows_end_when_they_have_been_judged_and_those_in_between_are_kept():
    """Judge each blow once, on top of what lasts; one after the other on a part do not add up."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.set_layer('wind', np.array([0, 1]), np.repeat(push(-5.0), 2, axis=0))
    loads.add_blow(np.array([1]), push(1000.0), 10.0)
    loads.add_blow(np.array([1]), push(500.0), 10.0)  # at the same time
    loads.apply(solver, 0.0)
    assert solver.given[-1][:, 2] == pytest.approx([-5.0, 1495.0, 0.0])
    for i in range(30, 60):
        loads.add_blow(np.array([2]), push(200.0 + i), 10.0)
        loads.apply(solver, i * _DT)
    assert len(solver.given) == 1
    loads.end_blows()
    loads.apply(solver, 1.0)
    assert solver.given[-1][:, 2] == pytest.approx([-5.0, -5.0, 259.0])
    loads.end_blows()
    loads.apply(solver, 1.0 + _DT)
    assert solver.given[-1][:, 2] == pytest.approx([-5.0, -5.0, 0.0])


def test_a_blow_is_as_hard_however_long_it_waits():
    """Judge a blow after seconds as if it had just come: how fast stresses are found is no law."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.add_blow(np.array([0]), push(1000.0), 10.0)
    loads.apply(solver, 0.0)
    loads.add_blow(np.array([1]), push(1000.0), 10.0, np.array([[0.0, 0.0, 7.0]]))
    for i in range(30, 210):
        loads.apply(solver, i * _DT)
    loads.end_blows()
    loads.apply(solver, 3.5)
    assert solver.given[-1][:, 2] == pytest.approx([0.0, 1000.0, 0.0])
    assert loads.impulse_on(np.array([1]))[2] == pytest.approx(7.0)


def test_cracks_run_for_three_rounds_under_a_blow_however_long_these_take():
    """Count what fails in rounds, anew for every blow that joins."""
    solver = Slow()
    loads = StandingLoads(2)
    loads.add_blow(np.array([0]), push(1000.0), 10.0)
    loads.apply(solver, 0.0)
    for i in range(1, 6):
        for k in range(30 * i):
            loads.apply(solver, (30 * i + k) * _DT)
        assert loads.struck and loads.cracked == (i > 3), i
        loads.take_more(True)
    loads.add_blow(np.array([1]), push(1000.0), 10.0)
    loads.apply(solver, 10.0)
    assert loads.struck and not loads.cracked and loads.largest_blow == 1000.0
    loads.end_blows()
    loads.apply(solver, 11.0)
    assert not loads.struck and not solver.given[-1].any()


def test_what_leaves_a_wall_has_passed_its_blow_on():
    """Return the impulse of all blows on parts that leave, and apply it to no other part."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.add_blow(np.array([0, 1]), np.repeat(push(100.0), 2, axis=0), 10.0,
                   np.array([0.0, 0.0, 3.0]))
    loads.apply(solver, 0.0)
    loads.add_blow(np.array([1, 2]), np.repeat(push(50.0), 2, axis=0), 10.0,
                   np.array([0.0, 0.0, 2.0]))
    assert loads.take_blows(np.array([1])) == pytest.approx([0.0, 0.0, 5.0])
    assert loads.take_blows(np.array([1])) == pytest.approx(np.zeros(3))
    loads.end_blows()
    loads.apply(solver, _DT)
    assert solver.given[-1][:, 2] == pytest.approx([0.0, 0.0, 50.0])


def test_the_speed_of_what_strikes_is_known_while_its_blow_acts_or_waits():
    """Return that of the fastest on any of some parts, until all blows are over."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.add_blow(np.array([0, 1]), np.repeat(push(100.0), 2, axis=0), np.array([4.0, 7.0]))
    loads.apply(solver, 0.0)
    loads.add_blow(np.array([1]), push(50.0), 5.0)
    assert [loads.striking_speed(np.array(parts)) for parts in ([0], [0, 1], [2])] == [4, 7, 0]
    loads.end_blows()
    loads.apply(solver, _DT)
    assert loads.striking_speed(np.array([1])) == 7.0
    loads.end_blows()
    loads.resize(5)
    assert loads.striking_speed(np.arange(5)) == 0.0


def test_small_changes_of_steady_loads_ask_for_no_new_stresses():
    """Tell the solver of a change beyond a twentieth of the load, of its rest, and of its end."""
    solver, loads = Slow(), StandingLoads(3)
    told = []
    for step, force in enumerate((10e3, 10.3e3, 10.4e3, 11e3, 10.5e3, 10.5e3)):
        loads.follow('debris', np.array([1]), np.array([[0.0, 0.0, -force, 0.0, 0.0, 0.0]]))
        loads.apply(solver, float(step))
        loads.end_blows()
        told.append(-solver.given[-1][1, 2])
    assert told == [10e3, 10e3, 10e3, 11e3, 11e3, 10.5e3]
    loads.follow('debris', np.zeros(0, np.intp), np.zeros((0, 6)))
    loads.apply(solver, 9.0)
    assert not solver.given[-1].any() and loads.sources == ()
