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
Simulate many random grammars for 60 steps, and print every one that fails.

The generator and what is asserted are those of `test/test_random_grammars.py`, with other seeds
and more grammars per scene: 196 trees and 4 walls. Trees and walls stand in one row, too far apart
to meet.

    python bench/random_grammars.py --count 50000
    python bench/random_grammars.py --count 2000 --first 30000   # go on from there
"""

import argparse
from pathlib import Path
import sys
from time import process_time
import traceback

from hypothesis import given, HealthCheck, Phase, seed, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from random_grammars import even, trees, walls
from random_scenes import faults, Sample

_TREES, _WALLS = 196, 4  # of one scene
_DRAWN = 14              # trees, or one wall, per example of hypothesis, whose examples are short


def draw(number: int) -> tuple[list[Sample], float]:
    """Draw the grammars of one scene, and its wind [m/s]."""
    found: list[Sample] = []
    winds: list[float] = []
    quiet = settings(max_examples=_TREES // _DRAWN, database=None, deadline=None,
                     phases=[Phase.generate], suppress_health_check=list(HealthCheck))

    @seed(number)
    @quiet
    @given(st.lists(trees(), min_size=_DRAWN, max_size=_DRAWN), walls(), even(0.0, 50.0))
    def collect(grown: list[Sample], built: Sample, wind: float) -> None:
        found.extend(grown)
        winds.append(wind)
        if len(winds) <= _WALLS:
            found.append(built)

    collect()
    return found, winds[-1]


def main() -> None:
    """Run scene after scene, and say how many grammars failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--count', type=int, default=50_000, help='grammars')
    parser.add_argument('--first', type=int, default=0, help='grammars to leave out')
    options = parser.parse_args()
    done, failed = options.first, 0
    while done < options.first + options.count:
        samples, wind = draw(1 + done // (_TREES + _WALLS))
        try:
            for fault in faults(samples, wind):
                failed += 1
                print(fault, flush=True)
        except Exception:  # the aim is to list what ends a simulation, not to end with it
            failed += 1
            traceback.print_exc()
            print(f'scene {1 + done // (_TREES + _WALLS)}, wind {wind:g}', flush=True)
        done += len(samples)
        print(f'{done} grammars, {failed} failed, {process_time():.0f} s', flush=True)
    print(f'{done - options.first} grammars, {failed} failed')


if __name__ == '__main__':
    main()
