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
Measure how the shipped trees sway and break, beside what was published, for docs/trees.md.

Frequency and damping: of a tree that 6 m/s have bent, in still air afterwards. Drag: exponent of
the speed between 10 and 25 m/s, of a tree held straight. Tip at 12 m/s: the mean distance of the
topmost segment from its place at rest. Winds: a steady wind that rises by 0.5 m/s each second on
16 trees, when a quarter, half and three quarters of them have lost wood or hold, and how many of
those lost until then were uprooted. docs/trees.md has the sources of what was published.
Run: python bench/species.py [species …]
"""

from dataclasses import replace
from pathlib import Path
import sys

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.blueprint.skeleton import LEAF_AREAL_DENSITY
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.trees import Forest
from procphys_ros.scene import Scene
from procphys_ros.simulation import Cause, Simulation

_GRAMMARS = Path(__file__).resolve().parents[1] / 'grammars'
_SPECIES = ('oak', 'beech', 'birch', 'willow', 'pine', 'spruce', 'palm', 'shrub', 'hedge')
# ln(dry mass above ground [kg]) = a + b·ln(diameter [cm]) of the species' group (Jenkins et al.
# 2003, Forest Science 49:12); green wood holds 60 % to 110 % of its dry mass of water.
_DRY_MASS = {'oak': (-2.0127, 2.4342), 'beech': (-2.0127, 2.4342), 'birch': (-1.9123, 2.3651),
             'willow': (-2.2094, 2.3867), 'pine': (-2.5356, 2.4349), 'spruce': (-2.0773, 2.3323)}
_WATER = (1.6, 2.1)
_CONIFERS = ('pine', 'spruce')
# Exponents of the speed in the drag of whole trees from 10 to 25 m/s: 2 - N of ForestGALES, which
# holds the coefficient of broadleaved trees from 20 m/s on.
_DRAG = {'oak': '1.36', 'beech': '1.32', 'birch': '1.33', 'pine': '1.25', 'spruce': '1.49',
         'willow': '1.0'}
_NOTHING = '–'  # where nothing was published
_STEP = 1.0 / 60.0  # [s]
_COUNT, _ENOUGH = 16, 12  # trees that the wind rises on, and how many of them are waited for
_FASTEST, _RISE = 60.0, 0.5  # [m/s], [m/s²]


def middle_way(tree: Blueprint, seconds: float) -> np.ndarray:
    """
    Release a tree that the wind has bent, and follow its centre of mass.

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
    """Measure frequency [Hz] and damping ratio of a tree's free sway, from its turning points."""
    way = middle_way(tree, 20.0)
    turns = np.flatnonzero((way[1:-1] - way[:-2]) * (way[2:] - way[1:-1]) < 0.0) + 1
    turns = turns[np.abs(way[turns]) > 0.05 * way[0]][:9]
    half = np.diff(turns).mean() * _STEP
    height = np.abs(np.diff(way[np.concatenate([[0], turns])]))
    decay = -np.polyfit(np.arange(len(height)), np.log(height), 1)[0]
    return 0.5 / half, decay / np.hypot(np.pi, decay)


def lean(tree: Blueprint, speed: float) -> float:
    """Measure the mean displacement of the topmost segment of a tree in wind [m]."""
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


def break_speeds(name: str) -> tuple[np.ndarray, int, int]:
    """
    Raise a wind slowly on many trees.

    :returns: speeds at which each loses wood or hold [m/s], ascending; number of uprooted trees,
        and of lost ones, when three quarters of them were.
    """
    scene = Scene.from_parameters({
        'scene': {'objects': [name]}, 'wind': {'turbulence_intensity': 0.0, 'profile': 'uniform'},
        name: {'grammar': f'{name}.lsys', 'count': _COUNT, 'layout': 'scatter', 'spacing': 14.0}})
    simulation = Simulation(scene)
    owner = np.repeat(np.arange(_COUNT), [tree.count for tree in scene.objects])
    broken = np.full(_COUNT, np.inf)
    for speed in np.arange(10.0, _FASTEST, 0.1 * _RISE):
        simulation.set_wind((speed, 0.0, 0.0))
        simulation.step(round(0.1 / simulation.time_step))
        tree = owner[simulation.blueprint.bonds[simulation.events['bond'], 1]]
        np.minimum.at(broken, tree, 10.0 + _RISE * simulation.events['time'])
        if np.isfinite(broken).sum() >= _ENOUGH:
            break  # heaps of fallen trees take their time
    roots = tree[simulation.events['cause'] == Cause.UPROOTING]
    return np.sort(broken), len(np.unique(roots)), int(np.isfinite(broken).sum())


def drag_exponent(tree: Blueprint) -> float:
    """Fit the exponent of the speed in the drag of a tree too stiff to bend, 10 to 25 m/s."""
    stiff = replace(tree.hinges, swing_stiffness=np.full(len(tree), 1e9))
    drag = []
    for speed in (10.0, 25.0):
        forest = Forest(replace(tree, hinges=stiff))
        held = []
        for _ in range(30):
            forest.step(_STEP, np.tile([speed, 0.0, 0.0], (len(forest), 1)))
            held.append(-forest.joint_wrenches[0, 0])
        drag.append(np.mean(held))
    return float(np.log(drag[1] / drag[0]) / np.log(2.5))


def published_frequency(name: str, breast: float, height: float) -> str:
    """Return the published frequency of trees by breast height diameter and height [m]."""
    slenderness = 100.0 * breast / height ** 2
    if name in _CONIFERS:
        line = 0.0766 + 3.1219 * slenderness
        return f'up to {line:.2f}' if name == 'pine' else f'{line:.2f} and more'
    if name in _DRY_MASS:
        models = sorted((-0.039 + 3.12 * slenderness, 0.055 + 2.34 * slenderness))
        return f'{min(0.17, models[0]):.2f} to {models[1]:.2f}'
    return _NOTHING


def published_mass(name: str, breast: float) -> str:
    """Return the published green mass above ground of trees by that diameter [m]."""
    if name not in _DRY_MASS:
        return _NOTHING
    first, power = _DRY_MASS[name]
    dry = np.exp(first + power * np.log(100.0 * breast))
    return f'{_WATER[0] * dry:.0f} to {_WATER[1] * dry:.0f}'


def _beside(measured: str, published: str) -> str:
    return measured if published == _NOTHING else f'{measured} ({published})'


def _shown(speed: float) -> str:
    return f'{speed:.0f}' if np.isfinite(speed) else f'over {_FASTEST:.0f}'


def row(name: str) -> str:
    """Measure one species; return its row of the table."""
    tree = LSystem.load(_GRAMMARS / f'{name}.lsys').build(seed=0)
    height = (2.0 * tree.poses - tree.bond_frame)[:, 2].max()
    breast = tree.bond_extent[0, 0]
    if height > 4.0:
        breast = np.interp(1.3, tree.bond_frame[:3, 2], tree.bond_extent[:3, 0])
    rate, damping = sway(tree)
    bare_rate, bare_damping = sway(bare(tree))
    speeds, uprooted, lost = break_speeds(name)
    tall = name in _DRY_MASS
    quarters = [_shown(speeds[_COUNT * k // 4 - 1]) for k in (1, 2, 3)]
    return '| ' + ' | '.join([
        name, f'{height:.1f}', f'{100.0 * breast:.0f}',
        _beside(f'{height / breast:.0f}', '30 to 60' if tall else _NOTHING),
        _beside(f'{tree.mass.sum():.0f}', published_mass(name, breast)),
        f'{tree.leaf_area.sum():.0f}',
        _beside(f'{rate:.2f}', published_frequency(name, breast, height)),
        _beside(f'{damping:.3f}', '0.04 to 0.12' if tall else _NOTHING),
        f'{bare_rate:.2f}', _beside(f'{bare_damping:.3f}', '0.01 to 0.08' if tall else _NOTHING),
        _beside(f'{drag_exponent(tree):.2f}', _DRAG.get(name, _NOTHING)),
        f'{lean(tree, 12.0):.2f}',
        f'{quarters[1]} ({quarters[0]} to {quarters[2]})', f'{uprooted} of {lost}']) + ' |'


def main() -> None:
    """Print the table."""
    print('| species | height [m] | trunk [cm] | height over trunk | mass [kg] | leaves [m²] | '
          'frequency [Hz] | damping | leafless [Hz] | damping | drag ~ u^ | tip at 12 m/s [m] | '
          'half lost at [m/s] | uprooted |')
    print('|' + 14 * '---|')
    for name in sys.argv[1:] or _SPECIES:
        print(row(name), flush=True)


if __name__ == '__main__':
    main()
