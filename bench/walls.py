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
Measure what building walls costs: time and memory from 1,000 to 100,000 bricks.

Run `python bench/walls.py`. Linear cost shows as columns that stay level down the table.
"""

from pathlib import Path
import statistics
from time import process_time
import tracemalloc

import numpy as np

from procphys_ros.wallgrammar import WallGrammar

_REPEATS = 5
_SIZES = (1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000)
_TEXT = """
building yard(width = 4, height = 3)
  footprint: (0, 0) (width, 0) (width, width) (0, width)
  facades: front
  storey_height: height
rule front -> split(x) { { ~3: bay }* }
rule bay -> split(x) { ~1: wall | 1.2: column | ~1: wall }
rule column -> split(y) { 0.9: wall | 1.2: window | 0.225: lintel | ~1: wall }
layout running { unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }
panel wall: running
panel window: glazing(timber, glass)
panel lintel: beam(concrete)
"""


def measure(grammar: WallGrammar, **defines: float) -> tuple[int, int, float, float]:
    """Build a few times; return parts, bonds, median processor time [s], peak memory [bytes]."""
    times = []
    for _ in range(_REPEATS):
        start = process_time()
        blueprint = grammar.build(**defines)
        times.append(process_time() - start)
    tracemalloc.start()
    grammar.build(**defines)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return len(blueprint), len(blueprint.bonds), statistics.median(times), peak


def main() -> None:
    """Print the curve, and the shipped buildings."""
    print(f'{"parts":>8} {"bonds":>8} {"time ms":>8} {"us/part":>8} {"MB":>7} {"kB/part":>8}')
    grammar = WallGrammar.parse(_TEXT)
    grammar.build()
    curve = []
    for size in _SIZES:
        # A 3 m wall of this pattern holds about 137 parts per metre.
        parts, bonds, time, peak = measure(grammar, width=size / (4 * 137))
        curve.append((parts, time))
        print(f'{parts:8} {bonds:8} {time * 1e3:8.1f} {time / parts * 1e6:8.2f} '
              f'{peak / 1e6:7.1f} {peak / parts / 1e3:8.2f}')
    parts, times = np.log(curve).T
    power = np.polyfit(parts[-5:], times[-5:], 1)[0]
    print(f'from {curve[-5][0]} parts on, time grows with their number to the power {power:.2f}')
    for path in sorted((Path(__file__).parents[1] / 'grammars').glob('*.wall')):
        parts, bonds, time, peak = measure(WallGrammar.load(path))
        print(f'{path.stem:>12}: {parts} parts, {bonds} bonds, {time * 1e3:.0f} ms, '
              f'{peak / 1e6:.0f} MB')
    print(f'numpy {np.__version__}, one thread')


if __name__ == '__main__':
    main()
