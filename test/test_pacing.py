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

"""Pacing of steps against a clock: how many are due, and what else is."""

from types import SimpleNamespace

import numpy as np
import pytest

from procphys_ros.ros import leaf_publisher
from procphys_ros.ros.late_joiners import LateJoinerTracker
from procphys_ros.ros.leaf_publisher import LeafPublisher
from procphys_ros.ros.pacing import Pacer, RateLimiter, Speedometer

STEP = 1 / 60
TICK = 1 / 30


class FakeClock:
    """A clock that is moved by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def run(pacer: Pacer, clock: FakeClock, ticks: int, cost: float) -> int:
    """Call the pacer at every tick, or as soon as it can be; each step costs time."""
    def step() -> None:
        clock.now += cost

    steps = 0
    for _ in range(ticks):
        begin = clock.now
        steps += pacer.advance(step)
        clock.now = max(clock.now, begin + TICK)
    return steps


@pytest.mark.parametrize('factor', [0.25, 0.5, 1.0, 3.0])
def test_simulated_time_keeps_up_with_its_share_of_real_time(factor):
    """Run two steps of 1/60 s at each tick of 1/30 s, or fewer or more of them as asked."""
    clock = FakeClock()
    pacer = Pacer(STEP, factor, TICK, clock)
    assert run(pacer, clock, 301, 0.001) == pytest.approx(600 * factor, abs=2)
    assert pacer.simulated == pytest.approx(10.0 * factor, abs=0.05)


def test_overload_slows_time_and_nothing_piles_up():
    """Run one step a call when each takes ten times too long, and catch up with nothing later."""
    clock = FakeClock()
    pacer = Pacer(STEP, 1.0, TICK, clock)
    assert run(pacer, clock, 100, 10 * STEP) == pytest.approx(100, abs=1)
    assert run(pacer, clock, 300, 0.0) <= 610


def test_who_is_called_between_two_steps_owes_the_rest():
    """Return after the step in which a call came, and run what was due then in the next turn."""
    clock = FakeClock()
    pacer = Pacer(STEP, 1.0, TICK, clock)
    clock.now += 5 * STEP
    assert pacer.advance(lambda: None, lambda: True) == 1 and pacer.is_behind
    assert pacer.advance(lambda: None) == 4 and not pacer.is_behind


def test_the_factor_is_that_of_the_last_second():
    """Tell half speed as such, and a standstill at once, whatever was before."""
    clock = FakeClock()
    pacer = Pacer(STEP, 1.0, TICK, clock)
    speed = Speedometer(pacer, clock)
    run(pacer, clock, 30, 0.0)
    assert speed.read() == pytest.approx(1.0, abs=0.1)
    run(pacer, clock, 30, 2 * STEP)
    assert speed.read() == pytest.approx(0.5, abs=0.05)
    clock.now += 1.0
    assert speed.read() == 0.0
    assert speed.read() == 0.0


def test_standstill_is_not_made_up():
    """Let go of the time that a long command took."""
    clock = FakeClock()
    pacer = Pacer(STEP, 1.0, TICK, clock)
    clock.now += 60.0
    assert run(pacer, clock, 1, 0.0) <= 15


def test_as_fast_as_possible_fills_the_budget_only():
    """Return after the budget of one call, though there is always more to do."""
    clock = FakeClock()
    pacer = Pacer(STEP, 0.0, TICK, clock)
    assert run(pacer, clock, 1, 0.01) == 4


def test_beat_keeps_its_rate_and_makes_up_for_nothing():
    """Be due once a period, however often it is asked, and once after a standstill."""
    clock = FakeClock()
    limiter = RateLimiter(10.0, clock=clock)
    due = 0
    for _ in range(1000):
        clock.now += 0.01
        due += limiter.is_due()
    assert due == pytest.approx(100, abs=1)
    clock.now += 60.0
    assert [limiter.is_due() for _ in range(3)] == [True, False, False]
    assert limiter.wait == pytest.approx(0.1)
    limiter.rate = 1000.0
    assert limiter.wait == pytest.approx(0.001)


def test_newcomers_are_told_at_once_and_twice_more():
    """Tell all to who comes, also when another goes then, and nothing to who only goes."""
    clock = FakeClock()
    tracker = LateJoinerTracker(clock)
    assert not tracker.are_waiting()
    tracker.note(SimpleNamespace(total_count_change=0, current_count_change=-1))
    assert not tracker.are_waiting()
    tracker.note(SimpleNamespace(total_count_change=1, current_count_change=0))
    assert [tracker.are_waiting() for _ in range(2)] == [True, False]
    told = []
    for _ in range(600):
        clock.now += TICK
        told += [clock.now] if tracker.are_waiting() else []
    assert told == pytest.approx([101.0, 105.0], abs=TICK)


def test_the_last_poses_before_time_stands_still_go_out(monkeypatch):
    """Publish what moved between two turns of a slow topic, though nothing has moved since."""
    clock, sent = SimpleNamespace(now=0.0), []
    monkeypatch.setattr(leaf_publisher, 'RateLimiter',
                        lambda rate, early: RateLimiter(rate, early, lambda: clock.now))
    monkeypatch.setattr(leaf_publisher, 'offer', lambda *_, **__: SimpleNamespace(
        publish=sent.append, get_subscription_count=lambda: 1))
    publisher = LeafPublisher(None, 'world')
    simulation = SimpleNamespace(time=0.0, leaf_poses=lambda: np.zeros((1, 7)))
    for clock.now, has_moved in ((0.0, True), (0.1, True), (0.2, False), (1.0, False),
                                 (2.0, False)):
        publisher.publish(simulation, has_moved, 1.0)
    assert len(sent) == 2
