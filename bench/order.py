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
Ask how much the extent of a collapse depends on what it should not depend on.

An arcade of two spans loses the stones of its middle pier, a few at a time, in several orders, and
in one order with fewer and more iterations of the stress solver per step. Prints, for mortars of
several strengths, the share of the other stones that came down, and the spread of these.

    python bench/order.py
    python bench/order.py --orders 3 --strengths 0.05 0.2
"""

import argparse
from pathlib import Path
import sys

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / 'test')]

from masonry_walls import bonded, BRICK, JOINT, wall_boxes  # noqa: E402, I100

from procphys_ros.blueprint import Blueprint  # noqa: E402
from procphys_ros.physics.causes import Cause  # noqa: E402
from procphys_ros.scene import Scene  # noqa: E402
from procphys_ros.simulation import breaking, masonry, Simulation  # noqa: E402
from procphys_ros.simulation.parts import Owner  # noqa: E402

_COURSES = 30  # 2.3 m
_RISE = 1.35  # of the openings [m]
_PIER = 0.45  # length of the pier between them [m]
_ABUTMENT = 1.7  # beside them [m]
_AT_ONCE = 4  # stones
_PAUSE = 0.2  # [s] between them
_AFTER = 4.0  # [s]
_ITERATIONS = (0.4, 2.5)  # of those that a step has
_AWAY = np.array([0.0, 50.0, 0.2, 0.0, 0.0, 0.0, 1.0])


def arcade(span: float, strength: float) -> Blueprint:
    """
    Lay a wall with two openings.

    :param span: of each opening [m].
    :param strength: of the mortar in tension and in shear [Pa].
    """
    first = _ABUTMENT, _ABUTMENT + span
    second = first[1] + _PIER, first[1] + _PIER + span
    holes = [(low, 0.0, high, _RISE) for low, high in (first, second)]
    length = round((second[1] + _ABUTMENT) / (BRICK[0] + JOINT))
    return bonded(*wall_boxes(length, _COURSES, holes), tension=strength, cohesion=strength)


def stones_down(span: float, strength: float, order: int, iterations: float = 1.0) -> float:
    """
    Measure the share of the other stones that come down when the pier is taken out.

    :param span: see `arcade`.
    :param strength: of the mortar in tension and in shear [Pa].
    :param order: seed of the order in which stones are taken out.
    :param iterations: of the stress solver, times those that a step has.
    """
    kept = masonry._PACE, masonry._WORK
    masonry._PACE, masonry._WORK = iterations * kept[0], iterations * kept[1]
    try:
        scene = Scene()
        scene.add(arcade(span, strength))
        simulation = Simulation(scene)
        pier = _pier(simulation, span)
        for stones in np.array_split(np.random.default_rng(order).permutation(pier),
                                     -(-len(pier) // _AT_ONCE)):
            _take_out(simulation, stones)
            simulation.step(round(_PAUSE / simulation.time_step))
        simulation.step(round(_AFTER / simulation.time_step))
        owner = simulation.state.parts.owner
        rest = np.setdiff1d(np.arange(len(owner)), pier)
        down = float(np.mean(owner[rest] != Owner.STANDING))
        simulation.close()
        return down
    finally:
        masonry._PACE, masonry._WORK = kept


def _pier(simulation: Simulation, span: float) -> np.ndarray:
    x, _, z = simulation.blueprint.poses[:, :3].T
    low = _ABUTMENT + span
    return np.flatnonzero((x > low) & (x < low + _PIER) & (z < _RISE))


def _take_out(simulation: Simulation, stones: np.ndarray) -> None:
    """Set stones free, and lay them aside."""
    state = simulation.state
    stones = stones[state.parts.owner[stones] == Owner.STANDING]
    breaking.release(simulation.model, state, list(stones[:, None]), cause=Cause.IMPACT)
    for stone in stones.tolist():
        simulation.set_body_state(stone, _AWAY + [stone, 0, 0, 0, 0, 0, 0], np.zeros(6))


def main() -> None:
    """Print a row per span and mortar."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('--orders', type=int, default=5, help='in which stones are taken out')
    parser.add_argument('--spans', type=float, nargs='+', default=[0.9, 1.35],
                        help='of the openings [m]')
    parser.add_argument('--strengths', type=float, nargs='+', default=[0.02, 0.05, 0.1, 0.2],
                        help='of mortars [MPa]')
    asked = parser.parse_args()
    print('span [m]  mortar [MPa]  spread  down in each order; with iterations times '
          + ', '.join(map(str, _ITERATIONS)), flush=True)
    for span in asked.spans:
        for strength in asked.strengths:
            orders = [stones_down(span, 1e6 * strength, seed) for seed in range(asked.orders)]
            others = [stones_down(span, 1e6 * strength, 0, share) for share in _ITERATIONS]
            print(f'{span:8.2f}  {strength:12.3f}  {np.ptp(orders + others):6.3f}  '
                  + ' '.join(f'{share:.3f}' for share in orders) + '; '
                  + ' '.join(f'{share:.3f}' for share in others), flush=True)


if __name__ == '__main__':
    main()
