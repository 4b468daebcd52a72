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


"""
Speed of L-systems: modules per second, growth of time with size, and a plain loop beside it.

Run `python bench/lsystem.py`; figures are medians of several runs in one process.
"""

from collections.abc import Callable
from pathlib import Path
import statistics
import time

from procphys_ros.lsystem import LSystem

_RUNS = 5
_LIMIT = 100_000_000  # modules
_GRAMMARS = Path(__file__).resolve().parents[1] / 'grammars'
_STOCHASTIC = """
define: s = 0.9
axiom: A(1)
production:
  A(l) -> F(l) [ +(nran(30, 5)) A(l*s) ] [ -(rand(20, 40)) A(l*s) ] : 0.5
  A(l) -> F(l) [ +(30) A(l*s) ] A(l*s) : 0.3
  A(l) -> F(l) A(l*s) A(l*s) : 0.2
"""
_CONTEXT = """
ignore: +
axiom: S(1)
production:
  S(n) < B(k) > [ B(m) ] C(w) : k + m > w - n -> B(k*0.5) [ B(m) ] C(w)
  B(k) < C(w) -> + B(w) [ B(k) C(1) ] C(w)
  S(n) -> S(n) B(n) [ B(2) ] C(1)
"""


def _median_time(work: Callable) -> float:
    """Time a call [s]."""
    work()
    times = []
    for _ in range(_RUNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def _steps_for(system: LSystem, count: int) -> int:
    steps = 0
    while len(system.derive(steps)) < count:
        steps += 1
    return steps


def _report(name: str, system: LSystem) -> None:
    """Print the rate of a whole derivation, and time per module at two sizes."""
    per_module = []
    for count in (100_000, 1_000_000):
        steps = _steps_for(system, count)
        produced = sum(len(system.derive(step)) for step in range(1, steps + 1))
        size = len(system.derive(steps))
        seconds = _median_time(lambda steps=steps: system.derive(steps))
        per_module.append(seconds / produced)
        print(f'{name:16s} {steps:3d} steps {size:9,d} modules {1e3 * seconds:8.1f} ms '
              f'{produced / seconds:12,.0f} produced/s {size / seconds:12,.0f} final/s')
    print(f'{"":16s} time per module, 1M over 100k: {per_module[1] / per_module[0]:.2f}')


def _plain_loop(steps: int) -> int:
    """
    Derive figure 2.6 a the straightforward way: a list of tuples, one module at a time.

    Its rules are written into it, which is as fast as Python gets; a loop that reads a grammar
    would be slower.
    """
    r1, r2, a0, a2, d, wr = 0.9, 0.6, 45.0, 45.0, 137.5, 0.707
    string: list[tuple] = [('A', 1.2, 0.14)]
    for _ in range(steps):
        new: list[tuple] = []
        for module in string:
            if module[0] == 'A':
                _, length, w = module
                new += [('!', w), ('F', length), ('[',), ('&', a0),
                        ('B', length * r2, w * wr), (']',), ('/', d),
                        ('A', length * r1, w * wr)]
            elif module[0] in 'BC':
                _, length, w = module
                turn, other = ('-', 'C') if module[0] == 'B' else ('+', 'B')
                new += [('!', w), ('F', length), ('[',), (turn, a2), ('$',),
                        (other, length * r2, w * wr), (']',), (other, length * r1, w * wr)]
            else:
                new.append(module)
        string = new
    return len(string)


def _compare(system: LSystem) -> None:
    steps = _steps_for(system, 1_000_000)
    ours = _median_time(lambda: system.derive(steps))
    loop = _median_time(lambda: _plain_loop(steps))
    print(f'{"plain loop":16s} {steps:3d} steps {_plain_loop(steps):9,d} modules '
          f'{1e3 * loop:8.1f} ms; ours {1e3 * ours:.1f} ms: {loop / ours:.1f} times faster')


def _read(system: LSystem) -> None:
    steps = _steps_for(system, 1_000_000)
    derive = _median_time(lambda: system.derive(steps))
    draw = _median_time(lambda: system.draw(steps))
    size = len(system.derive(steps))
    segments = len(system.draw(steps).branches)
    print(f'{"turtle":16s} {size:,d} modules, {segments:,d} segments: '
          f'{1e3 * (draw - derive):.0f} ms beside {1e3 * derive:.0f} ms of derivation')


def main() -> None:
    """Print all figures."""
    systems = {
        'abop 2.6': LSystem.load(_GRAMMARS / 'abop_2_6.lsys', max_modules=_LIMIT),
        'abop 2.7': LSystem.load(_GRAMMARS / 'abop_2_7.lsys', max_modules=_LIMIT),
        'stochastic': LSystem.parse(_STOCHASTIC, max_modules=_LIMIT),
        'context': LSystem.parse(_CONTEXT, max_modules=_LIMIT),
    }
    for name, system in systems.items():
        _report(name, system)
    _compare(systems['abop 2.6'])
    _read(systems['abop 2.6'])


if __name__ == '__main__':
    main()
