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

Intact wood costs nothing: broken joints are found from poses alone.
"""

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Law, Shape
from procphys_ros.elementary import cos, sin
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm

TORN, SOIL = 'torn_wood', 'soil'  # names of looks
_THIN = 1e-4      # [m] width of wood whose end cannot be seen: it has withered
_APART = 0.05     # [m] largest gap of an intact joint
_SPIKES = 9       # around a broken end
_LONGEST = 2.2    # of the splinters, in radii of the wood, beyond its round end
_SHORTEST = 0.85  # likewise, so that they hide the round end
_STRAIGHT = 0.85  # least cosine to its parent's axis of a branch that continues it
# A plate reaches about four stem diameters to each side, and half as deep (Mattheck and Breloer
# 1994, The Body Language of Trees: 1.2 m for a stem of 0.3 m; at second hand).
_ONWARDS = 0.75   # of the end below: least foot width of wood that continues it
_PLATE, _DEPTH = 4.0, 0.5
_RIM, _ROOTS = 14, 8  # corners of the plate, roots that project from it
_OVER = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # reverses z
_MOST = 100   # broken joints drawn at once, the first ones
_STEPS = 16   # of opening, in which roots leave the ground in messages and on the page
_PERIOD = 10  # updates per search for new ones: breaks are few

# Look, part that carries it or `GROUND`, and corners of triangles in the frame of that part, or of
# the world [m], (T, 9).
End = tuple[str, int, np.ndarray]


class Wood(Protocol):
    """Interface that finds the joints where wood has broken."""

    def apart(self, poses: np.ndarray) -> np.ndarray:
        """
        Find the joints that have come apart, (K,) persistent indices.

        :param poses: of the parts, world, (N, 7); not finite for removed parts.
        """

    def opened(self, bonds: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """
        Compute how far broken joints have opened, 0 to 1, (K,).

        :param bonds: indices of joints that have come apart, (K,).
        :param poses: of the parts, world, (N, 7); not finite for removed parts.
        """

    def ends(self, bond: int, opened: float = 1.0) -> Iterator[End]:
        """
        Make the ends on both sides of a broken joint.

        :param bond: its index.
        :param opened: how far it has opened, 0 to 1: roots leave the ground gradually.
        """


class WoodJoints:
    """
    Joints of the trees of a blueprint.

    :param blueprint: parts and bonds.
    """

    def __init__(self, blueprint: Blueprint):
        self._blueprint = blueprint
        self._bond = np.flatnonzero(blueprint.bond_law == Law.HINGE)
        self._parent, self._child = blueprint.bonds[self._bond].T
        frame = blueprint.bond_frame[self._bond]
        rest = np.concatenate([blueprint.poses, rotation.ORIGIN[None]])  # the ground comes last
        self._inner = rotation.relative(rest[self._child], frame)
        self._outer = rotation.relative(rest[self._parent], frame)
        self._stretches = np.isfinite(blueprint.hinges.stretch_stiffness)
        width = blueprint.bond_extent[self._bond, 0]
        bending = blueprint.hinges.strength * np.pi / 32.0 * (width * width * width)
        self._uproots = (self._parent == GROUND) & (blueprint.hinges.root_moment < bending)
        self._width = width

    def apart(self, poses: np.ndarray) -> np.ndarray:
        """Find the bonds that have come apart, (K,), see `Wood`."""
        here, there = self._sides(poses, np.arange(len(self._bond)))
        gap = norm(here[:, :3] - there[:, :3], axis=1)
        gone = np.append(np.isnan(poses[:, 0]), False)
        whole = (gap < _APART) | (self._stretches & np.isfinite(gap)) | (
            gone[self._child] & gone[self._parent]) | (self._width < _THIN)
        return self._bond[~whole]

    def opened(self, bonds: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Compute how far the rims of root plates have moved over their radius, see `Wood`."""
        rows = np.searchsorted(self._bond, bonds)
        here, there = self._sides(poses, rows)
        reach = _PLATE * self._width[rows]
        up = np.array([0.0, 0.0, 1.0])
        tilt = norm(rotation.rotate(here[:, 3:], up) - rotation.rotate(there[:, 3:], up), axis=1)
        moved = norm(here[:, :3] - there[:, :3], axis=1) + reach * tilt
        share = (moved - _APART) / reach
        return np.where(self._uproots[rows] & np.isfinite(share), np.clip(share, 0.0, 1.0), 1.0)

    def _sides(self, poses: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the poses of joints by their children and by their parents, (K, 7) each."""
        frames = np.concatenate([poses, rotation.ORIGIN[None]])
        return (rotation.compose(frames[self._child[rows]], self._inner[rows]),
                rotation.compose(frames[self._parent[rows]], self._outer[rows]))

    def ends(self, bond: int, opened: float = 1.0) -> Iterator[End]:
        """Make the ends on both sides of a broken bond, see `Wood`."""
        i = int(np.searchsorted(self._bond, bond))
        child, parent = int(self._child[i]), int(self._parent[i])
        width = float(self._blueprint.bond_extent[bond, 0])
        if self._uproots[i]:
            soil, roots = (opened * corners for corners in root_plate(width, bond))
            yield SOIL, child, placed(self._inner[i], soil)
            yield TORN, child, placed(self._inner[i], roots)
            pit = soil[:2 * _RIM] * np.tile([1.0, 1.0, 0.0], 3)
            yield SOIL, GROUND, pit + np.tile(self._outer[i, :3] + [0.0, 0.0, 0.01], 3)
            return
        back = rotation.compose(self._inner[i], _OVER)
        yield TORN, child, placed(back, splinters(width, bond))
        if parent != GROUND:
            along = rotation.rotate(self._outer[i, 3:], np.array([0.0, 0.0, 1.0]))[2]
            stub = 0.0 if along > _STRAIGHT else 0.5 * float(
                self._blueprint.visual_size[parent, 1])
            yield TORN, parent, placed(self._outer[i], splinters(width, bond + 1, stub))


class BrokenWood:
    """
    Broken joints of trees, where only the parts that came apart are known.

    A joint lies between the foot of a segment and the upper end of the one that bore it. The
    direction of a side branch is not known: only its own end is covered.

    :param shape: `Shape` of all parts, (N,).
    :param size: drawn extents [m], (N, 3), as `Blueprint.visual_size`.
    :param pairs: parts of the bonds that have broken, the lower one first, (K, 2); -1 = ground.
    :param uprooted: whether the roots gave way, (K,) bool.
    """

    def __init__(self, shape: np.ndarray, size: np.ndarray, pairs: np.ndarray,
                 uprooted: np.ndarray):
        known = (pairs[:, 1] >= 0) & (pairs < len(shape)).all(axis=1)
        pairs, uprooted = pairs[known], uprooted[known]
        branch = np.append(shape == Shape.CAPSULE, True)  # the ground is the last part
        wood = branch[pairs].all(axis=1)
        self._joints = {child: (parent, roots) for (parent, child), roots in zip(
            pairs[wood].tolist(), uprooted[wood].tolist())}
        self._size = size

    def apart(self, poses: np.ndarray) -> np.ndarray:
        """Return the upper segments of all joints that have broken, (K,)."""
        return np.array(list(self._joints), np.intp)

    def opened(self, bonds: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return 1 for all joints, because their former places are not known, (K,)."""
        return np.ones(len(bonds))

    def ends(self, bond: int, opened: float = 1.0) -> Iterator[End]:
        """Make the ends on both sides of the joint below a segment."""
        parent, uprooted = self._joints[bond]
        width, _, length = self._size[bond]
        foot = np.array([0.0, 0.0, -0.5 * length, 0.0, 0.0, 0.0, 1.0])
        if uprooted:
            soil, roots = root_plate(width, bond)
            yield SOIL, bond, placed(foot, soil)
            yield TORN, bond, placed(foot, roots)
            return
        yield TORN, bond, placed(rotation.compose(foot, _OVER), splinters(width, bond))
        if parent != GROUND and width > _ONWARDS * self._size[parent, 1]:
            top = np.array([0.0, 0.0, 0.5 * self._size[parent, 2], 0.0, 0.0, 0.0, 1.0])
            yield TORN, parent, placed(top, splinters(width, bond + 1))


class TornEnds:
    """Keeps the ends of torn wood, and searches for more of them at intervals."""

    def __init__(self) -> None:
        self._ends: dict[int, list[End]] = {}
        self._opened: dict[int, float] = {}
        self._turn = 0

    def forget(self) -> None:
        """Discard all ends; the next update searches for them anew."""
        self._ends, self._opened, self._turn = {}, {}, 0

    def update(self, wood: Wood, poses: np.ndarray) -> dict[int, list[End]]:
        """
        Return the ends of the first joints that have broken, by their indices.

        :param wood: finds the broken joints.
        :param poses: of the parts, world, (N, 7); not finite for removed parts.
        """
        opening = any(share < 1.0 for share in self._opened.values())
        if opening or self._turn % _PERIOD == 0:
            bonds = wood.apart(poses)[:_MOST]
            share = (1.0 + np.floor((_STEPS - 1) * wood.opened(bonds, poses))) / _STEPS
            before, self._opened = self._opened, dict(zip(bonds.tolist(), share.tolist()))
            self._ends = {bond: self._ends[bond] if before.get(bond) == now
                          else list(wood.ends(bond, now)) for bond, now in self._opened.items()}
        self._turn += 1
        return self._ends


def splinters(width: float, seed: int, stub: float = 0.0) -> np.ndarray:
    """
    Make a jagged end at the origin that points along z.

    :param width: diameter of the wood [m].
    :param seed: of the shape.
    :param stub: length of wood before the splinters [m].
    :returns: corners of triangles [m], (T, 9).
    """
    rng = np.random.default_rng(seed)
    radius, count = 0.5 * width, 2 * _SPIKES
    turn = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    circle = np.column_stack([cos(turn), sin(turn)])
    side = rng.uniform(0.0, 2.0 * np.pi)  # wood tears off longer on one side
    height = rng.uniform(0.2, 1.0, count) * (0.65 + 0.35 * cos(turn - side))
    height[1::2] *= 0.25
    foot = np.column_stack([1.06 * radius * circle, np.full(count, -0.4 * radius)])
    tip = np.column_stack([radius * rng.uniform(0.6, 0.95, (count, 1)) * circle,
                           stub + (_SHORTEST + _LONGEST * height) * radius])
    middle = np.broadcast_to([0.0, 0.0, stub + 1.05 * radius], foot.shape)
    after, ahead = np.roll(foot, -1, axis=0), np.roll(tip, -1, axis=0)
    return np.concatenate([np.hstack([foot, after, ahead]), np.hstack([foot, ahead, tip]),
                           np.hstack([tip, ahead, middle])])


def root_plate(width: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """
    Make the root plate that a falling tree lifts: soil below the origin, and roots.

    :param width: diameter of the stem at its foot [m].
    :param seed: of the shape.
    :returns: corners of the triangles of soil and of roots [m], (T, 9) each.
    """
    rng = np.random.default_rng(seed)
    reach = _PLATE * width
    turn = 2.0 * np.pi * (np.arange(_RIM) + rng.uniform(-0.3, 0.3, _RIM)) / _RIM
    circle = np.column_stack([cos(turn), sin(turn)])
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
    """Transform triangles (T, 9) from a frame (7,) to the world."""
    points = rotation.rotate(frame[3:], corners.reshape(-1, 3)) + frame[:3]
    return points.reshape(-1, 9)


def _roots(reach: float, width: float, rng: np.random.Generator) -> np.ndarray:
    """Make torn roots, three-sided cones that project from a plate."""
    turn = 2.0 * np.pi * (np.arange(_ROOTS) + rng.uniform(-0.3, 0.3, _ROOTS)) / _ROOTS
    way = np.column_stack([cos(turn), sin(turn), rng.uniform(-0.6, 0.05, _ROOTS)])
    start = 0.5 * reach * way
    end = start + reach * rng.uniform(0.5, 1.0, (_ROOTS, 1)) * way
    across = np.column_stack([-sin(turn), cos(turn), np.zeros(_ROOTS)])
    up = np.cross(way, across)
    thick = 0.15 * width * rng.uniform(0.5, 1.0, _ROOTS)[:, None]
    corners = [start + thick * (cos(a) * across + sin(a) * up)
               for a in 2.0 * np.pi * np.arange(3) / 3.0]
    return np.concatenate([np.hstack([corners[k], corners[(k + 1) % 3], end]) for k in range(3)])
