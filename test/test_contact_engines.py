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

"""The comparison of engines: overlaps against brute force, and rows that theory knows."""

from importlib import import_module
from types import ModuleType

import numpy as np
import pytest

from procphys_ros.blueprint import Hexahedra, Shape
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners
from procphys_ros.physics.world import World


@pytest.fixture(scope='module')
def bench() -> ModuleType:
    """Import the comparison, and with it what measures overlaps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(shared_folder() / 'bench'))
        return import_module('contact_engines')


def least_shadow(one, two, rng):
    """Find the least overlap of the shadows of two solids along many directions."""
    best, depth = None, np.inf
    for size in (np.inf, 0.05, 0.01, 0.002, 0.0004):
        ways = rng.normal(size=(20_000, 3))
        ways = ways if best is None else best + size * ways
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        first, second = one @ ways.T, two @ ways.T
        found = np.minimum(first.max(axis=0) - second.min(axis=0),
                           second.max(axis=0) - first.min(axis=0))
        if found.min() < depth:
            best, depth = ways[np.argmin(found)], found.min()
    return max(depth, 0.0)


def test_overlaps_are_the_least_over_all_directions(bench):
    """Place boxes and wedges at random, one of them standing: no direction parts them sooner."""
    rng, deep = np.random.default_rng(2), 0
    for n in range(40):
        sizes, turns = rng.uniform(0.1, 0.5, (2, 3)), rng.normal(size=(2, 4))
        turns /= np.linalg.norm(turns, axis=1)[:, None]
        poses = np.column_stack([[0.0, 0.0, 5.0] + rng.normal(scale=0.12, size=(2, 3)), turns])
        corners = box_corners(-0.5 * sizes, 0.5 * sizes)
        corners[:, 4:, :2] *= rng.uniform(0.3, 1.0) if n % 2 else 1.0
        cut = Hexahedra(np.arange(2), corners.reshape(2, 24)) if n % 2 else None
        wanted = least_shadow(*(poses[:, None, :3] + rotation.rotate(
            poses[:, None, 3:], corners)), rng)
        with World(engine='native') as world:
            ids = world.add_bricks(poses, sizes, np.ones(2), hexahedra=cut)
            world.thaw(ids[:1])
            assert bench.deepest_overlap(world) == pytest.approx(wanted, abs=1e-3)
        deep += wanted > 0.01
    assert deep > 15


def test_overlaps_with_the_ground_and_among_what_stands(bench):
    """Sink a loose box by 3 mm; two that stand in each other count for nothing."""
    with World(engine='native') as world:
        assert bench.deepest_overlap(world) == 0.0
        world.add_bricks(np.array([[5.0, 0, 1, 0, 0, 0, 1], [5.1, 0, 1, 0, 0, 0, 1]]),
                         np.full((2, 3), 0.2), np.ones(2))
        world.add_body(Shape.BOX, np.full(3, 0.2), 8.0, np.array([0, 0, 0.097, 0, 0, 0, 1.0]))
        assert bench.deepest_overlap(world) == pytest.approx(0.003, abs=1e-9)
        assert bench.deepest_overlap(world, awake=False) == 0.0  # it has not come to rest


@pytest.mark.parametrize('name', ['slope', 'slide_90_km', 'bounce', 'cards'])
def test_rows_run_and_keep_their_bounds(bench, name):
    """Run the quickest experiments twice in turns: within bounds, and the same both times."""
    trials = [bench.Trial('native') for _ in range(2)]
    one, two = bench.compare(bench.ROWS[name], trials)
    bounded = [figure for figure in one if figure.bound]
    assert bounded
    for figure in bounded:
        assert figure.low <= figure.value <= figure.high, figure
    assert [f.value for f in bounded] == [f.value for f in two if f.bound]


def test_nudged_runs_differ_and_can_be_repeated(bench):
    """Draw what is added to gravity: nothing in the first run, and always the same in others."""
    first, second, again = (bench.Trial('native', run=run).nudge() for run in (0, 1, 1))
    assert not first.any() and second.any() and (second == again).all()


def test_patterns_choose_rows(bench):
    """Choose by name, by pattern, and nothing that takes minutes without either."""
    assert bench.chosen(['rubble_barn*']) == ['rubble_barn_demolished', 'rubble_barn_blasted']
    assert bench.chosen(['nothing']) == []
    assert not any(name.startswith('rubble') for name in bench.chosen([]))
