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


"""Pacing of steps against a clock, and the queue of commands: what the node is without ROS."""

import math

import pytest

from procphys_ros.errors import CommandError
from procphys_ros.ros.commands import CAPACITY, Command, CommandQueue
from procphys_ros.ros.pacing import Pacer

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


def test_simulated_time_keeps_up_with_real_time():
    """Run two steps of 1/60 s at each tick of 1/30 s."""
    clock = FakeClock()
    pacer = Pacer(STEP, 1.0, TICK, clock)
    assert run(pacer, clock, 301, 0.001) == pytest.approx(600, abs=2)
    assert pacer.measured == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize('factor', [0.25, 0.5, 3.0])
def test_factor_scales_time(factor):
    """Run simulated time slower or faster as asked."""
    clock = FakeClock()
    pacer = Pacer(STEP, factor, TICK, clock)
    assert run(pacer, clock, 301, 0.001) == pytest.approx(600 * factor, abs=3)


def test_overload_slows_time_and_nothing_piles_up():
    """Run one step a call when each takes ten times too long, and catch up with nothing later."""
    clock = FakeClock()
    pacer = Pacer(STEP, 1.0, TICK, clock)
    assert run(pacer, clock, 100, 10 * STEP) == pytest.approx(100, abs=1)
    assert pacer.measured == pytest.approx(0.1, abs=0.01)
    assert run(pacer, clock, 300, 0.0) <= 610


def test_standstill_is_not_made_up():
    """Let go of the time that a long command took."""
    clock = FakeClock()
    pacer = Pacer(STEP, 1.0, TICK, clock)
    clock.now += 60.0
    assert run(pacer, clock, 1, 0.0) <= 7


def test_as_fast_as_possible_fills_the_budget_only():
    """Return after the budget of one call, though there is always more to do."""
    clock = FakeClock()
    pacer = Pacer(STEP, 0.0, TICK, clock)
    assert run(pacer, clock, 1, 0.01) == 4
    assert math.isnan(pacer.measured)


def test_commands_are_carried_out_in_the_order_they_came():
    """Carry out what waits before a command that is run at once."""
    done: list[int] = []

    def note(number: int) -> Command:
        return Command('n', lambda: str(done.append(number)))

    queue = CommandQueue(lambda name, reason: None)
    for number in range(3):
        queue.submit(note(number))
    assert not done and len(queue) == 3
    assert queue.run(note(3)) == (True, 'None')
    assert done == [0, 1, 2, 3] and len(queue) == 0
    assert queue.taken == {'n': 4}


def test_refused_command_is_counted_and_reported():
    """Keep the reason, and go on with the next command."""
    def refuse() -> str:
        raise CommandError('no such part')

    reports: list[tuple[str, str]] = []
    queue = CommandQueue(lambda name, reason: reports.append((name, reason)))
    queue.submit(Command('impulse', refuse))
    queue.submit(Command('wind', lambda: 'blows'))
    queue.drain()
    assert queue.rejected == {'impulse': 1} and queue.taken == {'wind': 1}
    assert reports == [('impulse', 'no such part')]
    assert queue.last_rejection == 'impulse: no such part'
    assert queue.run(Command('impulse', refuse)) == (False, 'no such part')


def test_queue_is_bounded_and_the_rest_is_counted():
    """Reject what does not fit, so that taken and rejected add up to all."""
    queue = CommandQueue(lambda name, reason: None)
    for _ in range(CAPACITY + 5):
        queue.submit(Command('wind', lambda: ''))
    assert len(queue) == CAPACITY and queue.rejected == {'wind': 5}
    queue.drain()
    assert queue.taken == {'wind': CAPACITY}
