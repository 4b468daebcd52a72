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
Measure how the shipped trees sway and break, one row per species for docs/trees.md.

Frequency and damping: of a tree that 6 m/s have bent, in still air afterwards. Tip at 12 m/s: the
mean distance of the topmost segment from its place at rest. Winds: a steady wind that rises by
0.5 m/s each second on 16 trees, when the first of them and when half of them have lost wood or
hold, and how many of those lost were uprooted.
Run: python bench/species.py [species …]
"""

from dataclasses import replace
from pathlib import Path
import sys

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.trees import Forest
from procphys_ros.scene import Scene
from procphys_ros.simulation import Cause, Simulation
from procphys_ros.skeleton import LEAF_AREAL_DENSITY

_GRAMMARS = Path(__file__).resolve().parents[1] / 'grammars'
_SPECIES = ('oak', 'pine', 'birch', 'willow', 'palm', 'shrub', 'spruce', 'hedge')
# Frequencies that were published for trees of that size; docs/trees.md has the sources.
_PUBLISHED = {'oak': '0.17 to 0.62', 'pine': 'up to 0.37', 'birch': '0.25 to 0.35',
              'spruce': '0.45 and more'}
_STEP = 1.0 / 60.0  # [s]
_COUNT = 16  # trees that the wind rises on
_FASTEST, _RISE = 60.0, 0.5  # [m/s], [m/s²]


def middle_way(tree: Blueprint, seconds: float) -> np.ndarray:
    """
    Let a tree go that the wind has bent, and follow its centre of mass.

    :param tree: one tree.
    :param seconds: how long to follow it [s].
    :returns: how far downwind it is at every step [m], (T,).
    """
    forest, share = Forest(tree), tree.mass / tree.mass.sum()
    wind = np.tile([6.0, 0.0, 0.0], (len(forest), 1))
    rest = share[forest.parts] @ forest.poses[:, 0]
    for i in range(round(30.0 / _STEP)):
        forest.step(_STEP, min(1.0, i * _STEP / 10.0) * wind)
    way = []
    for _ in range(round(seconds / _STEP)):
        forest.step(_STEP)
        way.append(share[forest.parts] @ forest.poses[:, 0] - rest)
    return np.array(way)


def sway(tree: Blueprint) -> tuple[float, float]:
    """Give frequency [Hz] and damping ratio of a tree's free sway, from its turning points."""
    way = middle_way(tree, 20.0)
    turns = np.flatnonzero((way[1:-1] - way[:-2]) * (way[2:] - way[1:-1]) < 0.0) + 1
    turns = turns[np.abs(way[turns]) > 0.05 * way[0]][:9]
    half = np.diff(turns).mean() * _STEP
    height = np.abs(np.diff(way[np.concatenate([[0], turns])]))
    decay = -np.polyfit(np.arange(len(height)), np.log(height), 1)[0]
    return 0.5 / half, decay / np.hypot(np.pi, decay)


def lean(tree: Blueprint, speed: float) -> float:
    """Give how far a wind carries the topmost segment of a tree in the mean [m]."""
    forest = Forest(tree)
    top, rest = forest.poses[:, 2].argmax(), forest.poses.copy()
    wind, away = np.tile([speed, 0.0, 0.0], (len(forest), 1)), []
    for i in range(round(30.0 / _STEP)):
        forest.step(_STEP, min(1.0, i * _STEP / 5.0) * wind)
        away.append(np.linalg.norm(forest.poses[top, :3] - rest[top, :3]))
    return float(np.mean(away[len(away) // 2:]))


def bare(tree: Blueprint) -> Blueprint:
    """Take all leaves off a tree."""
    return replace(tree, mass=tree.mass - LEAF_AREAL_DENSITY * tree.leaf_area,
                   leaf_area=np.zeros(len(tree)))


def break_speeds(name: str) -> tuple[np.ndarray, int]:
    """
    Let a wind rise slowly on many trees.

    :returns: speeds at which each loses wood or hold [m/s], ascending; how many are uprooted.
    """
    scene = Scene.from_parameters({
        'scene': {'objects': [name]}, 'wind': {'turbulence_intensity': 0.0, 'profile': 'uniform'},
        name: {'grammar': f'{name}.lsys', 'count': _COUNT, 'layout': 'scatter', 'spacing': 14.0}})
    simulation = Simulation(scene)
    owner = np.repeat(np.arange(_COUNT), [tree.count for tree in scene.objects])
    for speed in np.arange(10.0, _FASTEST, 0.1 * _RISE):
        simulation.set_wind((speed, 0.0, 0.0))
        simulation.step(round(0.1 / simulation.time_step))
    uprooted = np.count_nonzero(simulation.events['cause'] == Cause.UPROOTING)
    broken = np.full(_COUNT, np.inf)
    tree = owner[simulation.blueprint.bonds[simulation.events['bond'], 1]]
    np.minimum.at(broken, tree, 10.0 + _RISE * simulation.events['time'])
    return np.sort(broken), uprooted


def _shown(speed: float) -> str:
    return f'{speed:.0f}' if np.isfinite(speed) else f'over {_FASTEST:.0f}'


def main() -> None:
    """Print the table."""
    print('| species | height [m] | trunk [cm] | mass [kg] | leaves [m²] | frequency [Hz] | '
          'published [Hz] | damping | leafless [Hz] | damping | tip at 12 m/s [m] | '
          'first lost at [m/s] | half lost at [m/s] | uprooted |')
    print('|' + 14 * '---|')
    for name in sys.argv[1:] or _SPECIES:
        tree = LSystem.load(_GRAMMARS / f'{name}.lsys').build(seed=0)
        height = (2.0 * tree.poses - tree.bond_frame)[:, 2].max()
        rate, damping = sway(tree)
        bare_rate, bare_damping = sway(bare(tree))
        speeds, uprooted = break_speeds(name)
        print(f'| {name} | {height:.1f} | {100.0 * tree.bond_extent[0, 0]:.0f} | '
              f'{tree.mass.sum():.0f} | {tree.leaf_area.sum():.0f} | {rate:.2f} | '
              f'{_PUBLISHED.get(name, "–")} | {damping:.3f} | {bare_rate:.2f} | '
              f'{bare_damping:.3f} | {lean(tree, 12.0):.2f} | {_shown(speeds[0])} | '
              f'{_shown(speeds[_COUNT // 2 - 1])} | {uprooted} of {_COUNT} |', flush=True)


if __name__ == '__main__':
    main()
