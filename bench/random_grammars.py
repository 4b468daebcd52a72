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

The generator and what is asserted are those of `test/test_random_grammars.py`; its scenes are the
first ten. Trees and walls stand in one row, too far apart to meet.

    python bench/random_grammars.py --count 50000
    python bench/random_grammars.py --count 2000 --first 30000   # go on from there
"""

import argparse
from pathlib import Path
import sys
from time import process_time
import traceback

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from random_grammars import draw
from random_scenes import faults

_TREES, _WALLS = 196, 4  # of one scene


def main() -> None:
    """Run scene after scene, and say how many grammars failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--count', type=int, default=50_000, help='grammars')
    parser.add_argument('--first', type=int, default=0, help='grammars to leave out')
    options = parser.parse_args()
    size = _TREES + _WALLS
    scenes = range(options.first // size, -(-(options.first + options.count) // size))
    failed = 0
    for done, scene in enumerate(scenes, 1):
        try:
            for fault in faults(*draw(1 + scene, _TREES, _WALLS)):
                failed += 1
                print(f'scene {1 + scene}, {fault}', flush=True)
        except Exception:  # the aim is to list what ends a simulation, not to end with it
            failed += 1
            traceback.print_exc()
            print(f'scene {1 + scene}', flush=True)
        print(f'{done * size} grammars, {failed} failed, {process_time():.0f} s', flush=True)
    sys.exit(failed > 0)


if __name__ == '__main__':
    main()
