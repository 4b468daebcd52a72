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


"""Tests of the shipped tree grammars: sizes, masses, strength against weight and wind."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from procphys_ros.blueprint import Blueprint, GROUND
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.wind import Wind, WindSettings

_GRAMMARS = Path(__file__).resolve().parents[1] / 'grammars'
# Height [m], segments, leaf area [m2] and trunk diameter [m] that a tree of the kind may have.
_RANGES = {
    'oak': ((11.0, 15.0), (40, 70), (200, 450), (0.4, 0.7)),
    'pine': ((15.0, 18.5), (40, 65), (80, 200), (0.35, 0.5)),
    'willow': ((8.0, 11.0), (45, 70), (200, 400), (0.5, 0.7)),
    'palm': ((9.0, 12.5), (40, 60), (50, 120), (0.3, 0.45)),
    'birch': ((11.0, 13.5), (35, 60), (60, 150), (0.2, 0.32)),
    'shrub': ((1.3, 2.2), (35, 60), (10, 40), (0.03, 0.06)),
}
_SEEDS = (0, 1, 2)
_GRAVITY = 9.81  # [m/s2]
_STEP = 1.0 / 60.0  # [s]
_TREES = pytest.mark.parametrize('name', sorted(_RANGES))


@cache
def _build(name: str, seed: int = 0, **defines: float) -> Blueprint:
    return LSystem.load(_GRAMMARS / f'{name}.lsys').build(seed=seed, **defines)


def _height(tree: Blueprint) -> float:
    """Give the highest end of a segment [m]."""
    axis = tree.poses[:, :3] - tree.bond_frame[:, :3]
    return float((tree.poses[:, :3] + axis)[:, 2].max())


def _own_weight_stress(tree: Blueprint) -> np.ndarray:
    """Give the bending stress at every joint from the weight of all that it carries [Pa]."""
    weight = tree.mass * _GRAVITY
    moment_of_place = weight[:, None] * tree.poses[:, :2]
    carried = weight.copy()
    for child in range(len(tree) - 1, -1, -1):
        parent = tree.bonds[child, 0]
        if parent != GROUND:
            carried[parent] += carried[child]
            moment_of_place[parent] += moment_of_place[child]
    lever = moment_of_place / carried[:, None] - tree.bond_frame[:, :2]
    section_modulus = np.pi * tree.bond_extent[:, 0] ** 3 / 32.0
    return carried * np.linalg.norm(lever, axis=1) / section_modulus


def _breaks(tree: Blueprint, speed: float, seconds: float) -> int:
    """Count the joints that a rising, then steady turbulent wind overloads at some time."""
    forest = Forest(tree)
    wind = Wind(WindSettings(velocity=(speed, 0.0, 0.0), turbulence_intensity=0.15), seed=0)
    broken: set[int] = set()
    for i in range(round(seconds / _STEP)):
        rise = min(1.0, i * _STEP / 3.0)
        forest.step(_STEP, rise * wind.velocity(forest.poses[:, :3], i * _STEP))
        broken.update(int(row) for row in forest.overloaded()[0])
    assert np.isfinite(forest.poses).all()
    return len(broken)


@_TREES
@pytest.mark.parametrize('seed', _SEEDS)
def test_size_is_that_of_the_species(name, seed):
    """Hold height, segments, leaf area and trunk within what the species reaches."""
    tree = _build(name, seed)
    height, segments, area, trunk = _RANGES[name]
    assert segments[0] <= len(tree) <= segments[1]
    assert height[0] <= _height(tree) <= height[1]
    assert area[0] <= tree.leaf_area.sum() <= area[1]
    assert trunk[0] <= tree.bond_extent[:, 0].max() <= trunk[1]


@_TREES
@pytest.mark.parametrize('seed', _SEEDS)
def test_every_segment_weighs_and_hangs_on_the_ground(name, seed):
    """Follow every segment down to the ground, and find mass and inertia in each."""
    tree = _build(name, seed)
    assert (tree.mass > 0.0).all() and (tree.inertia > 0.0).all()
    parent, child = tree.bonds.T
    assert np.array_equal(np.sort(child), np.arange(len(tree)))
    assert (parent < child).all()  # with the ground at -1, no chain can end elsewhere
    roots = tree.bond_frame[parent == GROUND]
    assert len(roots) >= 1 and (np.abs(roots[:, 2]) < 0.05).all()


@_TREES
@pytest.mark.parametrize('seed', _SEEDS)
def test_wood_carries_its_own_weight(name, seed):
    """Keep the stress under own weight below a third of the strength at every joint."""
    tree = _build(name, seed)
    assert np.isfinite(tree.hinges.strength).all()
    assert (_own_weight_stress(tree) < tree.hinges.strength / 3.0).all()


@_TREES
def test_a_seed_is_an_individual(name):
    """Give the same tree for the same seed and another one for another."""
    first, same, other = _build(name, 4), _build.__wrapped__(name, 4), _build(name, 5)
    assert np.array_equal(first.poses, same.poses)
    assert np.array_equal(first.leaves.pose, same.leaves.pose)
    assert first.poses.shape != other.poses.shape or not np.allclose(first.poses, other.poses)


@_TREES
def test_height_scales_the_tree(name):
    """Grow a tree of half the height by a define, with half the trunk."""
    text = (_GRAMMARS / f'{name}.lsys').read_text(encoding='utf-8')
    height = float(text.split('define: height =')[1].split()[0])
    full, half = _build(name, 1), _build(name, 1, height=0.5 * height)
    assert _height(half) == pytest.approx(0.5 * _height(full), rel=0.02)
    assert half.bond_extent[0, 0] == pytest.approx(0.5 * full.bond_extent[0, 0], rel=1e-6)


@_TREES
def test_leaves_are_what_the_crown_is_made_of(name):
    """Fill the crown with many leaf clusters, all of them on segments and in known textures."""
    tree = _build(name)
    assert len(tree.leaves) >= (80 if name == 'palm' else 250)
    assert (tree.leaves.texture < len(tree.textures)).all()
    assert tree.leaf_area.sum() == pytest.approx((tree.leaves.size ** 2).sum())


@_TREES
def test_tree_stands_in_a_gale_and_breaks_in_a_hurricane(name):
    """Survive 15 m/s untouched; lose wood at 55 m/s (Virot 2016: trees break at about 42)."""
    tree = _build(name, 1)
    assert _breaks(tree, 15.0, 8.0) == 0
    assert _breaks(tree, 55.0, 5.0) > 0


def test_oak_forks_keep_the_area_of_wood():
    """Keep the sum of squared diameters over every fork of the oak (da Vinci's rule)."""
    tree = _build('oak')
    square = tree.bond_extent[:, 0] ** 2
    inner = tree.bonds[:, 0] != GROUND
    parent, count = tree.bonds[inner, 0], len(tree)
    beyond = np.bincount(parent, square[inner], minlength=count)
    forks = np.bincount(parent, minlength=count) > 1
    assert forks.sum() > 10
    assert beyond[forks] == pytest.approx(square[forks], rel=0.12)
