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

The generators and what is asserted are those of `test/test_random_grammars.py`; its scenes are the
first five, and its houses the first 70. Trees and walls stand in one row, too far apart to meet;
houses of several thicknesses, with piers, arches, chimneys, valleys and spires, one by one.

    python bench/random_grammars.py --count 50000
    python bench/random_grammars.py --count 2000 --first 30000   # go on from there
    python bench/random_grammars.py --houses 500
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
import sys
from time import process_time
import traceback

sys.path.insert(0, str(Path(__file__).parents[1] / 'test'))

from building_checks import count_loose, deepest_overlap, OVERLAP
from random_grammars import draw, draw_house
from random_scenes import build, faults

_TREES, _WALLS = 196, 4  # of one scene
_MOST = 6000  # parts of a house that is looked at


def scene_faults(seed: int) -> Iterator[str]:
    """Yield the faults of one of the scenes of trees and walls."""
    return faults(*draw(seed, _TREES, _WALLS))


def house_faults(seed: int) -> Iterator[str]:
    """Yield the faults of one of the houses, as it is built and when it is struck."""
    sample, wind = draw_house(seed)
    blueprint = build(sample)
    if blueprint is None or len(blueprint) > _MOST:
        return
    loose, overlap = count_loose(blueprint), deepest_overlap(blueprint)
    if loose or overlap > OVERLAP:
        yield f'{loose} parts are loose, others overlap by {overlap:.4f} m\n{sample.text}'
    yield from faults([sample], wind)


def main() -> None:
    """Run scene after scene, and say how many grammars failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--count', type=int, default=50_000, help='grammars')
    parser.add_argument('--first', type=int, default=0, help='grammars to leave out')
    parser.add_argument('--houses', type=int, default=0, help='houses, in the place of the rest')
    options = parser.parse_args()
    look: Callable[[int], Iterator[str]]
    if options.houses:
        size, look = 1, house_faults
        scenes = range(options.first, options.first + options.houses)
    else:
        size, look = _TREES + _WALLS, scene_faults
        scenes = range(1 + options.first // size,
                       1 - (-(options.first + options.count) // size))
    failed = 0
    for done, scene in enumerate(scenes, 1):
        try:
            for fault in look(scene):
                failed += 1
                print(f'scene {scene}, {fault}', flush=True)
        except Exception:  # the aim is to list what ends a simulation, not to end with it
            failed += 1
            traceback.print_exc()
            print(f'scene {scene}', flush=True)
        print(f'{done * size} grammars, {failed} failed, {process_time():.0f} s', flush=True)
    sys.exit(failed > 0)


if __name__ == '__main__':
    main()
