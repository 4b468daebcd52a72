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

"""The queue of commands, and the answers of services: what the node is without ROS."""

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.ros.commands import CAPACITY, Command, CommandQueue
from procphys_ros.ros.services import Answers, BUSY

DEADLINE = 0.15  # [s]


class FakeClock:
    """A clock that is moved by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Record:
    """A queue with what became of its commands."""

    def __init__(self, clock: FakeClock | None = None):
        self.calls = 0
        self.rejections: list[tuple[str, str]] = []
        self.answers: list[tuple[bool, str]] = []
        self.queue = CommandQueue(self._be_called, lambda *told: self.rejections.append(told),
                                  clock or FakeClock())

    def _be_called(self) -> None:
        self.calls += 1

    def submit(self, name: str, carry_out) -> None:
        """Submit a command as from a topic, and keep its answer."""
        self.queue.submit(Command(name, carry_out, lambda *told: self.answers.append(told)))

    def call(self, name: str, carry_out=lambda: 'done') -> Command:
        """Submit a command as from a service, and keep its answer."""
        command = Command(name, carry_out, lambda *told: self.answers.append(told))
        self.queue.call(command)
        return command


def doer(clock: FakeClock) -> tuple[list[str], Callable[[str], str]]:
    """Return a command that takes a millisecond, and the list of those carried out."""
    done: list[str] = []

    def act(name: str) -> str:
        clock.now += 0.001
        done.append(name)
        return ''

    return done, act


def refuse() -> str:
    """Refuse as the simulation does."""
    raise CommandError('no such part')


def test_commands_are_carried_out_in_the_order_they_came():
    """Carry out nothing before the next step, then all, and answer each."""
    record = Record()
    done: list[int] = []
    for number in range(4):
        record.submit('n', lambda number=number: str(done.append(number)))
    assert not done and not record.answers and len(record.queue) == 4
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
    assert record.rejections == [('impulse', 'no such part', None)]
    assert record.queue.last_rejection == 'impulse: no such part'
    assert record.answers == [(False, 'no such part'), (True, 'blows')]


def test_a_reason_is_one_line_whatever_was_named():
    """Write line breaks and lone surrogates of a name by their codes."""
    record = Record()

    def refuse():
        raise CommandError('there is no part "oak\n[ERROR] ä\udce4"')
    record.submit('impulse', refuse)
    record.queue.drain()
    assert record.answers == [(False, r'there is no part "oak\n[ERROR] ä\udce4"')]


def test_queue_is_bounded_and_the_rest_is_counted():
    """Reject what does not fit, so that taken and rejected add up to all."""
    record = Record()
    for _ in range(CAPACITY + 5):
        record.submit('wind', lambda: '')
    assert len(record.queue) == CAPACITY and record.queue.rejected == {'wind': 5}
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


def test_calls_and_topics_keep_the_order_they_came_in():
    """Carry out what came on topics and what services ask for one after the other."""
    record = Record()
    done: list[int] = []
    for number in range(6):
        (record.call if number % 3 == 1 else record.submit)(
            'n', lambda number=number: str(done.append(number)))
    record.queue.drain()
    assert done == [0, 1, 2, 3, 4, 5]


def test_calls_overtake_a_flood():
    """Come to every call within one turn, however much waits before it, and to the rest later."""
    clock = FakeClock()
    record = Record(clock)
    done, act = doer(clock)
    for _ in range(1000):
        record.submit('impulse', lambda: act('impulse'))
    for name in ('gust', 'reset'):
        record.call(name, lambda name=name: act(name))
    begin = clock.now
    record.queue.drain()
    assert done[-2:] == ['gust', 'reset'] and clock.now - begin < 0.1
    left = len(record.queue)
    assert left == 1000 - (len(done) - 2) > 0
    while len(record.queue):
        record.queue.drain()
    assert record.queue.taken == {'impulse': 1000, 'gust': 1, 'reset': 1}


def test_while_a_flood_is_caught_up_with_calls_come_first():
    """Come to a call before all that came earlier on topics; in its order once that is done."""
    clock = FakeClock()
    record = Record(clock)
    done, act = doer(clock)
    for _ in range(80):
        record.submit('impulse', lambda: act('impulse'))
    record.queue.drain()
    assert set(done) == {'impulse'} and not record.queue.is_called and not record.calls
    done.clear()
    record.call('gust', lambda: act('gust'))
    assert record.queue.is_called and record.calls == 1
    record.queue.drain()
    assert done[:2] == ['gust', 'impulse'] and not len(record.queue)
    done.clear()
    record.submit('wind', lambda: act('wind'))
    record.call('gust', lambda: act('gust'))
    record.queue.drain()
    assert done == ['wind', 'gust']


@pytest.mark.parametrize('error', [
    ZeroDivisionError('division by zero'), ValueError('x' * 10_000), RecursionError(),
    UnicodeDecodeError('utf-8', b'\xff', 0, 1, 'invalid start byte'), OSError(36, 'too long'),
    SceneError('\ud800 is no name'), MemoryError()], ids=lambda e: type(e).__name__)
def test_no_exception_of_a_command_ends_the_queue(error):
    """Reject it with a reason that can be sent, tell defects apart, and go on."""
    record = Record()

    def fail() -> str:
        raise error
    record.call('reset', fail)
    record.call('gust')
    record.queue.drain()
    (success, reason), after = record.answers
    assert not success and len(reason.encode('utf-8')) < 1000 and after == (True, 'done')
    assert record.queue.counts() == ({'gust': 1}, {'reset': 1})
    name, told, defect = record.rejections[0]
    assert (name, told) == ('reset', reason) and record.queue.last_rejection == f'reset: {reason}'
    if isinstance(error, SceneError):
        assert defect is None and 'is no name' in reason
    else:
        assert defect is error and type(error).__name__ in reason


def test_withdrawn_call_is_not_carried_out():
    """Take a call back while it waits, and not once it was begun with."""
    record = Record()
    command = record.call('reset')
    assert record.queue.is_waiting(command) and record.queue.withdraw(command)
    record.queue.drain()
    assert not record.answers and not record.queue.taken
    command = record.call('reset')
    record.queue.drain()
    assert not record.queue.withdraw(command) and record.answers == [(True, 'done')]


class Timer:
    """A timer that is fired by hand."""

    def __init__(self):
        self.runs = True

    def cancel(self):
        """Stop."""
        self.runs = False

    def reset(self):
        """Start."""
        self.runs = True

    def is_canceled(self):
        """Return whether it is stopped."""
        return not self.runs


class ManualAnswers:
    """Answers over a queue that is drained by hand, with a clock of its own."""

    def __init__(self):
        self.clock = FakeClock()
        self.record = Record(self.clock)
        node = SimpleNamespace(create_timer=lambda *_: Timer(), executor=None)
        self.answers = Answers(node, self.record.queue, lambda: DEADLINE, None, self.clock)
        self.results: list[tuple[bool, str]] = []

    def ask(self, name: str, prepare):
        """Ask, and keep the answer when it comes; gives what goes on with it."""
        pending = self.answers.ask(name, prepare)

        def go_on() -> None:
            try:
                pending.send(None)
            except StopIteration as end:
                self.results.append(end.value)
        go_on()
        return go_on


def test_an_answer_says_what_became_of_the_command():
    """Answer when it was carried out, not before, with what happened or why not."""
    manual = ManualAnswers()
    waiting = [manual.ask('gust', lambda: lambda: 'blows'), manual.ask('impulse', lambda: refuse)]
    assert not manual.results
    manual.record.queue.drain()
    for go_on in waiting:
        go_on()
    assert manual.results == [(True, 'blows'), (False, 'no such part')]


def test_a_command_that_is_not_come_to_is_refused_and_never_carried_out():
    """Refuse what waits longer than the deadline as busy; what is asked is then not done later."""
    manual = ManualAnswers()
    done: list[str] = []
    first = manual.ask('reset', lambda: lambda: str(done.append('reset')))
    manual.clock.now += 0.6 * DEADLINE
    second = manual.ask('gust', lambda: lambda: str(done.append('gust')))
    manual.answers.look()
    manual.clock.now += 0.6 * DEADLINE
    manual.answers.look()
    first()
    [(success, message)] = manual.results
    assert not success and message.startswith(BUSY)
    manual.record.queue.drain()
    second()
    assert done == ['gust'] and manual.results[1] == (True, 'None')
    assert manual.record.queue.counts() == ({'gust': 1}, {'reset': 1})


def test_every_one_of_many_clients_is_answered_by_the_deadline():
    """Answer all of a thousand calls when one look falls behind the deadline."""
    manual = ManualAnswers()
    waiting = [manual.ask('gust', lambda: lambda: 'blows') for _ in range(1000)]
    manual.clock.now += DEADLINE + 0.001
    manual.answers.look()
    for go_on in waiting:
        go_on()
    assert len(manual.results) == 1000 and not any(success for success, _ in manual.results)
    assert len(manual.record.queue) == 0


def test_a_look_in_another_thread_loses_no_call():
    """Refuse a call at its deadline although others were looked at while it was being made."""
    manual = ManualAnswers()
    call = manual.record.queue.call

    def call_late(command):
        manual.answers.look()
        call(command)
    manual.record.queue.call = call_late
    go_on = manual.ask('gust', lambda: lambda: 'blows')
    manual.clock.now += 1.1 * DEADLINE
    manual.answers.look()
    go_on()
    [(success, message)] = manual.results
    assert not success and message.startswith(BUSY)


def test_what_cannot_be_prepared_is_refused_at_once():
    """Say why, and count it, without waiting for the simulation."""
    manual = ManualAnswers()

    def prepare():
        raise CommandError('projectile.mass is 0')
    with pytest.raises(StopIteration) as end:
        manual.answers.ask('launch_projectile', prepare).send(None)
    assert end.value.value == (False, 'projectile.mass is 0')
    assert manual.record.queue.counts() == ({}, {'launch_projectile': 1})
