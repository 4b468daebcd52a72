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
Torn wood: jagged ends, stumps, scars, and the root plates of trees that were uprooted.

What is whole costs nothing: which joints have broken is told by poses alone.
"""

from collections.abc import Iterator

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint, GROUND, Law

TORN, SOIL = 'torn_wood', 'soil'  # names of looks
_APART = 0.05     # [m] the two sides of a joint that is whole stay closer than that
_SPIKES = 9       # around a broken end
_LONGEST = 2.4    # of the splinters, in radii of the wood
_STRAIGHT = 0.85  # cosine to its parent's axis from which on a branch carries it on
# A plate reaches about four stem diameters to each side, and half as deep (Mattheck and Breloer
# 1994, The Body Language of Trees: 1.2 m for a stem of 0.3 m; at second hand).
_PLATE, _DEPTH = 4.0, 0.5
_RIM, _ROOTS = 14, 8  # corners of the plate, roots that stick out of it
_OVER = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # turns z around


def broken_ends(blueprint: Blueprint, poses: np.ndarray,
                shown: np.ndarray) -> Iterator[tuple[str, int, np.ndarray]]:
    """
    Find the joints of trees that have come apart, and cover both their sides.

    :param blueprint: parts and bonds.
    :param poses: of the parts, world, (N, 7).
    :param shown: parts that exist, (N,) bool.
    :returns: for each side the look, the part, and corners of triangles, world [m], (T, 9).
    """
    hinge = np.flatnonzero(blueprint.bond_law == Law.HINGE)
    parent, child = blueprint.bonds[hinge].T
    frame = blueprint.bond_frame[hinge]
    rooted = parent == GROUND
    inner = rotation.relative(blueprint.poses[child], frame)
    outer = np.where(rooted[:, None], frame, rotation.relative(blueprint.poses[parent], frame))
    here = rotation.compose(poses[child], inner)
    there = np.where(rooted[:, None], frame, rotation.compose(poses[parent], outer))
    stretches = np.isfinite(blueprint.hinges.stretch_stiffness)
    gap = np.linalg.norm(here[:, :3] - there[:, :3], axis=1)
    stays = rooted | shown[parent]
    apart = ~(shown[child] & stays & ((gap < _APART) | stretches))
    uproots = rooted & _roots_give_first(blueprint, hinge)
    for i in np.flatnonzero(apart & shown[child]):
        width = float(blueprint.bond_extent[hinge[i], 0])
        if uproots[i]:
            yield from _uprooted(here[i], frame[i], width, int(child[i]), int(hinge[i]))
        else:
            back = rotation.compose(here[i], _OVER)
            yield TORN, int(child[i]), placed(back, splinters(width, int(hinge[i])))
    for i in np.flatnonzero(apart & ~rooted & stays):
        width, wood = float(blueprint.bond_extent[hinge[i], 0]), int(parent[i])
        along = rotation.rotate(outer[i, 3:], np.array([0.0, 0.0, 1.0]))[2]
        stub = 0.0 if along > _STRAIGHT else 0.5 * float(blueprint.visual_size[wood, 1])
        yield TORN, wood, placed(there[i], splinters(width, int(hinge[i]) + 1, stub))


def splinters(width: float, seed: int, stub: float = 0.0) -> np.ndarray:
    """
    Draw a jagged end at the origin that points along z.

    :param width: diameter of the wood [m].
    :param seed: of the shape.
    :param stub: length of wood before the splinters [m].
    :returns: corners of triangles [m], (T, 9).
    """
    rng = np.random.default_rng(seed)
    radius, count = 0.5 * width, 2 * _SPIKES
    turn = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    side = rng.uniform(0.0, 2.0 * np.pi)  # wood tears off longer on one side
    height = rng.uniform(0.2, 1.0, count) * (0.65 + 0.35 * np.cos(turn - side))
    height[1::2] *= 0.25
    foot = np.column_stack([0.98 * radius * circle, np.full(count, -0.4 * radius)])
    tip = np.column_stack([radius * rng.uniform(0.6, 0.95, (count, 1)) * circle,
                           stub + _LONGEST * radius * height])
    middle = np.broadcast_to([0.0, 0.0, stub + 0.1 * radius], foot.shape)
    after, ahead = np.roll(foot, -1, axis=0), np.roll(tip, -1, axis=0)
    return np.concatenate([np.hstack([foot, after, ahead]), np.hstack([foot, ahead, tip]),
                           np.hstack([tip, ahead, middle])])


def root_plate(width: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Draw what a falling tree lifts out of the ground: soil below the origin, and roots.

    :param width: diameter of the stem at its foot [m].
    :param seed: of the shape.
    :returns: corners of the triangles of soil and of roots [m], (T, 9) each.
    """
    rng = np.random.default_rng(seed)
    reach = _PLATE * width
    turn = 2.0 * np.pi * (np.arange(_RIM) + rng.uniform(-0.3, 0.3, _RIM)) / _RIM
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [np.tile([0.0, 0.0, 0.08 * reach], (_RIM, 1))]
    for far, low in ((0.8, 0.0), (1.0, -0.25), (0.6, -0.75)):
        rings.append(np.column_stack([
            far * reach * rng.uniform(0.85, 1.15, (_RIM, 1)) * circle,
            _DEPTH * reach * low * rng.uniform(0.7, 1.3, _RIM)]))
    rings.append(np.tile([0.0, 0.0, -_DEPTH * reach], (_RIM, 1)))
    soil = []
    for first, second in zip(rings[:-1], rings[1:]):
        next_first, next_second = np.roll(first, -1, axis=0), np.roll(second, -1, axis=0)
        soil += [np.hstack([first, second, next_second]),
                 np.hstack([first, next_second, next_first])]
    return np.concatenate(soil), _roots(reach, width, rng)


def placed(frame: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Put triangles (T, 9) of a frame (7,) into the world."""
    points = rotation.rotate(frame[3:], corners.reshape(-1, 3)) + frame[:3]
    return points.reshape(-1, 9)


def _uprooted(foot: np.ndarray, ground: np.ndarray, width: float, part: int,
              seed: int) -> Iterator[tuple[str, int, np.ndarray]]:
    """Cover the foot of a tree with its plate, and the ground with the pit it came out of."""
    soil, roots = root_plate(width, seed)
    yield SOIL, part, placed(foot, soil)
    yield TORN, part, placed(foot, roots)
    pit = root_plate(width, seed)[0][:2 * _RIM] * np.tile([1.0, 1.0, 0.0], 3)
    yield SOIL, part, pit + np.tile(ground[:3] + [0.0, 0.0, 0.01], 3)


def _roots(reach: float, width: float, rng: np.random.Generator) -> np.ndarray:
    """Draw torn roots, three-sided cones that stick out of a plate."""
    turn = 2.0 * np.pi * (np.arange(_ROOTS) + rng.uniform(-0.3, 0.3, _ROOTS)) / _ROOTS
    way = np.column_stack([np.cos(turn), np.sin(turn), rng.uniform(-0.6, 0.05, _ROOTS)])
    start = 0.5 * reach * way
    end = start + reach * rng.uniform(0.5, 1.0, (_ROOTS, 1)) * way
    across = np.column_stack([-np.sin(turn), np.cos(turn), np.zeros(_ROOTS)])
    up = np.cross(way, across)
    thick = 0.15 * width * rng.uniform(0.5, 1.0, _ROOTS)[:, None]
    corners = [start + thick * (np.cos(a) * across + np.sin(a) * up)
               for a in 2.0 * np.pi * np.arange(3) / 3.0]
    return np.concatenate([np.hstack([corners[k], corners[(k + 1) % 3], end]) for k in range(3)])


def _roots_give_first(blueprint: Blueprint, hinge: np.ndarray) -> np.ndarray:
    """Say of joints at the ground whether roots give way before the wood there, (H,) bool."""
    bending = blueprint.hinges.strength * np.pi / 32.0 * blueprint.bond_extent[hinge, 0] ** 3
    return blueprint.hinges.root_moment < bending
