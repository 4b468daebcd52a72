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
from types import SimpleNamespace

import pytest

from procphys_ros.errors import CommandError
from procphys_ros.ros.commands import CAPACITY, Command, CommandQueue
from procphys_ros.ros.newcomers import Newcomers
from procphys_ros.ros.pacing import Beat, Pacer

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
    assert run(pacer, clock, 1, 0.0) <= 15


def test_as_fast_as_possible_fills_the_budget_only():
    """Return after the budget of one call, though there is always more to do."""
    clock = FakeClock()
    pacer = Pacer(STEP, 0.0, TICK, clock)
    assert run(pacer, clock, 1, 0.01) == 4
    assert math.isnan(pacer.measured)


def test_beat_keeps_its_rate_and_makes_up_for_nothing():
    """Be due once a period, however often it is asked, and once after a standstill."""
    clock = FakeClock()
    beat = Beat(10.0, clock=clock)
    due = 0
    for _ in range(1000):
        clock.now += 0.01
        due += beat.is_due()
    assert due == pytest.approx(100, abs=1)
    clock.now += 60.0
    assert [beat.is_due() for _ in range(3)] == [True, False, False]
    assert beat.wait == pytest.approx(0.1)
    beat.rate = 1000.0
    assert beat.wait == pytest.approx(0.001)


def test_newcomers_are_told_at_once_and_twice_more():
    """Tell all to who comes, also when another goes then, and nothing to who only goes."""
    clock = FakeClock()
    newcomers = Newcomers(clock)
    assert not newcomers.are_waiting()
    newcomers.note(SimpleNamespace(total_count_change=0, current_count_change=-1))
    assert not newcomers.are_waiting()
    newcomers.note(SimpleNamespace(total_count_change=1, current_count_change=0))
    assert [newcomers.are_waiting() for _ in range(2)] == [True, False]
    told = []
    for _ in range(600):
        clock.now += TICK
        told += [clock.now] if newcomers.are_waiting() else []
    assert told == pytest.approx([101.0, 105.0], abs=TICK)


class Record:
    """A queue with what became of its commands."""

    def __init__(self, clock: FakeClock | None = None):
        self.arrivals = 0
        self.rejections: list[tuple[str, str]] = []
        self.answers: list[tuple[bool, str]] = []
        self.queue = CommandQueue(self._arrive, lambda *told: self.rejections.append(told),
                                  clock or FakeClock())

    def _arrive(self) -> None:
        self.arrivals += 1

    def submit(self, name: str, carry_out) -> None:
        """Submit a command whose answer is kept."""
        self.queue.submit(Command(name, carry_out, lambda *told: self.answers.append(told)))


def refuse() -> str:
    """Refuse as the simulation does."""
    raise CommandError('no such part')


def test_commands_are_carried_out_in_the_order_they_came():
    """Carry out nothing before the next step, then all, and answer each."""
    record = Record()
    done: list[int] = []
    for number in range(4):
        record.submit('n', lambda number=number: str(done.append(number)))
    assert not done and not record.answers and len(record.queue) == record.arrivals == 4
    record.queue.drain()
    assert done == [0, 1, 2, 3] and len(record.queue) == 0
    assert record.answers == [(True, 'None')] * 4
    assert record.queue.counts() == ({'n': 4}, {})


def test_refused_command_is_counted_and_reported():
    """Keep the reason, and go on with the next command."""
    record = Record()
    record.submit('impulse', refuse)
    record.submit('wind', lambda: 'blows')
    record.queue.drain()
    assert record.queue.counts() == ({'wind': 1}, {'impulse': 1})
    assert record.rejections == [('impulse', 'no such part')]
    assert record.queue.last_rejection == 'impulse: no such part'
    assert record.answers == [(False, 'no such part'), (True, 'blows')]


def test_queue_is_bounded_and_the_rest_is_counted():
    """Reject what does not fit, so that taken and rejected add up to all."""
    record = Record()
    for _ in range(CAPACITY + 5):
        record.submit('wind', lambda: '')
    assert len(record.queue) == CAPACITY and record.queue.rejected == {'wind': 5}
    assert len(record.answers) == 5 and not any(success for success, _ in record.answers)
    record.queue.drain()
    assert record.queue.taken == {'wind': CAPACITY}


def test_flood_of_slow_commands_leaves_time_for_steps():
    """Carry out some of them between two steps and the rest, in order, between the next."""
    clock = FakeClock()
    record = Record(clock)
    done: list[int] = []

    def slow(number: int) -> str:
        clock.now += 0.02
        done.append(number)
        return ''

    for number in range(9):
        record.submit('impulse', lambda number=number: slow(number))
    record.queue.drain()
    assert done == [0, 1, 2]
    record.queue.drain()
    assert done == [0, 1, 2, 3, 4, 5]
