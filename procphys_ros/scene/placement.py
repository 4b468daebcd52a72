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


"""Placement on a terrain: trees stand where their roots are, buildings on stepped footings."""

from dataclasses import replace
import math

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.blueprint import Blueprint, box_inertia, chain, GROUND, Law, Mortar, Shape
from procphys_ros.elementary import atan2, cos, hypot, sin
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import product
from procphys_ros.physics.terrain import Terrain
from procphys_ros.physics.world.merging import merge_boxes

FOOTING = 'footing'  # kind of the blocks below a building
_EMBEDDED = 0.1   # [m] that footings reach into the ground at least
_STEP = 0.2       # [m] height of the steps of footings
_LENGTH = 0.8     # [m] of a step along the wall at most
_LEVEL = 0.02     # [m] largest gap below a wall without footing
_LOOKS = 9        # samples of the ground along each side of a block
# Concrete C30/37, as the wall grammars have it: EN 1992-1-1 Table 3.1; between soil and concrete
# the modulus is over a metre of ground.
_DENSITY, _TENSION, _COHESION, _FRICTION, _COMPRESSION = 2400.0, 3.5e6, 0.9e6, 0.7, 30e6
_NORMAL_STIFFNESS, _SHEAR_STIFFNESS = 33e9, 14e9  # [Pa/m]


def unbonded(blueprint: Blueprint, height: float) -> Blueprint:
    """
    Remove the ground bonds of a building that is placed above the ground.

    :param blueprint: the object.
    :param height: of its origin above the ground [m].
    """
    held = (blueprint.bonds[:, 0] == GROUND) & (blueprint.bond_law == Law.MORTAR)
    if height <= _LEVEL or not held.any():
        return blueprint
    return replace(blueprint, bonds=blueprint.bonds[~held], bond_law=blueprint.bond_law[~held],
                   bond_frame=blueprint.bond_frame[~held],
                   bond_extent=blueprint.bond_extent[~held], bond_area=blueprint.bond_area[~held],
                   mortar=blueprint.mortar.take(~held[blueprint.bond_law == Law.MORTAR]))


def stand_on(terrain: Terrain, placed: Blueprint, name: str) -> Blueprint:
    """
    Place an object on the ground: its heights count from there.

    Plants are raised one by one, by the ground at their roots. A building is raised as a whole
    by the highest ground under its plan, and gets footings where the ground is lower. A mechanism
    is raised as a whole by the highest ground under the parts that are tied to it.

    :param terrain: the surface of the ground.
    :param placed: the object over level ground.
    :param name: of the object, for messages.
    :raises SceneError: when it stands outside of the terrain.
    """
    if terrain.is_flat or not len(placed):
        return placed
    mortar = placed.bond_law == Law.MORTAR
    tied = np.concatenate([placed.bonds, placed.joints.parts])
    based = tied[tied[:, 0] == GROUND, 1]
    feet = based if len(based) else np.array([int(np.argmin(placed.poses[:, 2]))])
    _check_inside(terrain, placed.poses[feet, :2], name)
    if len(placed.joints):
        lift = float(terrain.height(placed.poses[feet, :2]).max())
        return _raised(placed, np.full(len(placed), lift))
    if not mortar.any():
        return _raised(placed, _of_plants(terrain, placed))
    base = placed.bonds[mortar & (placed.bonds[:, 0] == GROUND), 1]
    plan = np.unique(base) if len(base) else feet
    height = _highest(terrain, placed, plan)
    raised = _raised(placed, np.full(len(placed), height))
    return _with_footings(terrain, raised, plan) if len(base) else raised


def _check_inside(terrain: Terrain, places: np.ndarray, name: str) -> None:
    high = terrain.low + terrain.edge * (np.array(terrain.heights.shape) - 1.0)
    outside = np.flatnonzero(((places < terrain.low) | (places > high)).any(axis=1))
    if len(outside):
        x, y = places[outside[0]]
        raise SceneError(
            f'{name} stands at ({x:.1f}, {y:.1f}) m, outside of the terrain, which reaches from '
            f'({terrain.low[0]:.1f}, {terrain.low[1]:.1f}) to ({high[0]:.1f}, {high[1]:.1f}) m; '
            'make the terrain larger, or move the object')


def _raised(blueprint: Blueprint, lift: np.ndarray) -> Blueprint:
    """Lift each part by its own height [m], (N,), bonds and joints with their second parts."""
    poses, frames = blueprint.poses.copy(), blueprint.bond_frame.copy()
    joints = blueprint.joints.frame.copy()
    joints[:, 2] += lift[blueprint.joints.parts[:, 1]]
    poses[:, 2] += lift
    if len(frames):
        frames[:, 2] += lift[blueprint.bonds[:, 1]]
    return replace(blueprint, poses=poses, bond_frame=frames,
                   joints=replace(blueprint.joints, frame=joints))


def _of_plants(terrain: Terrain, placed: Blueprint) -> np.ndarray:
    """Compute the lift of each part: the ground height at the root of its plant [m], (N,)."""
    inner = placed.bonds[placed.bonds[:, 0] != GROUND]
    count = len(placed)
    links = scipy.sparse.coo_matrix(
        (np.ones(len(inner)), (inner[:, 0], inner[:, 1])), (count, count))
    number, plant = scipy.sparse.csgraph.connected_components(links, directed=False)
    root = np.empty(number, np.intp)
    lowest_first = np.argsort(placed.poses[:, 2], kind='stable')
    root[plant[lowest_first[::-1]]] = lowest_first[::-1]
    held = np.flatnonzero(placed.bonds[:, 0] == GROUND)
    place = placed.poses[root, :2].copy()
    place[plant[placed.bonds[held, 1]]] = placed.bond_frame[held, :2]
    return terrain.height(place)[plant]


def _highest(terrain: Terrain, placed: Blueprint, parts: np.ndarray) -> float:
    """Find the highest ground under the bounding rectangle of some parts [m]."""
    frame = placed.poses[parts[0]]
    turn = rotation.to_matrix(rotation.from_yaw(_heading(frame)))[:2, :2]
    reach = 0.5 * hypot(placed.size[parts, 0], placed.size[parts, 1]).max()
    local = product(placed.poses[parts, :2], turn)
    low, high = local.min(axis=0) - reach, local.max(axis=0) + reach
    plan = product(np.array([low, [high[0], low[1]], high, [low[0], high[1]]]), turn.T)
    grid = _grid_points(terrain, plan)
    inside = product(grid, turn)
    inside = ((inside >= low) & (inside <= high)).all(axis=1)
    points = np.vstack([_creases(terrain, plan), grid[inside]])
    return float(terrain.height(points).max())


def _creases(terrain: Terrain, plan: np.ndarray) -> np.ndarray:
    """
    Find the points where the outline of a plan crosses edges of the triangles of the ground.

    :param plan: its corners [m], (P, 2).
    :returns: these points and the corners [m], (K, 2).
    """
    found = [plan]
    for start, end in zip(plan, np.roll(plan, -1, axis=0)):
        one, other = ((point - terrain.low) / terrain.edge for point in (start, end))
        for first, last in ((one[0], other[0]), (one[1], other[1]), (one.sum(), other.sum())):
            lines = np.arange(math.ceil(min(first, last)), max(first, last))
            if len(lines):
                found.append(start + ((lines - first) / (last - first))[:, None] * (end - start))
    return np.vstack(found)


def _grid_points(terrain: Terrain, plan: np.ndarray) -> np.ndarray:
    """List the corners of cells within the bounds of a plan, (P, 2), as (K, 2) [m]."""
    first = np.floor((plan.min(axis=0) - terrain.low) / terrain.edge).astype(int)
    last = np.ceil((plan.max(axis=0) - terrain.low) / terrain.edge).astype(int)
    x, y = (terrain.low[a] + terrain.edge * np.arange(first[a], last[a] + 1) for a in (0, 1))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _heading(pose: np.ndarray) -> float:
    axis = rotation.rotate(pose[3:], np.array([1.0, 0.0, 0.0]))
    return atan2(axis[1], axis[0])


def _with_footings(terrain: Terrain, building: Blueprint, base: np.ndarray) -> Blueprint:
    """Fill the gap between a building's lowest parts and the ground by bonded footings."""
    walls = merge_boxes(building.poses[base], building.size[base], 0.0)
    doors = _below_doors(building, base)
    blocks = [block for poses, sizes in (walls, doors) for pose, size in zip(poses, sizes)
              for block in _blocks(terrain, pose, size)]
    if not blocks:
        return building
    places, extents = (np.array(column) for column in zip(*blocks))
    bonds = building.bonds.copy()
    held = np.flatnonzero((bonds[:, 0] == GROUND) & (building.bond_law == Law.MORTAR))
    carrier = _below(places, extents, building.bond_frame[held, :3])
    bonds[held[carrier >= 0], 0] = len(building) + carrier[carrier >= 0]
    joined = chain([building, _footings(places, extents)])
    return replace(joined, bonds=np.concatenate([bonds, joined.bonds[len(bonds):]]))


def _below_doors(building: Blueprint, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return runs of boxes that reach the foot of the walls but do not bear on the ground."""
    foot = _lower_faces(building, base)
    others = np.setdiff1d(building.bonds[building.bond_law == Law.MORTAR], np.append(base, GROUND))
    others = others[_lower_faces(building, others) < foot.min() + _LEVEL]
    if not len(others):
        return np.zeros((0, 7)), np.zeros((0, 3))
    # Boards stand on end; the footing below them is as thick as the walls.
    turn = rotation.to_matrix(building.poses[others, 3:])
    size = building.size[others]
    wall = float(np.median(np.sort(building.size[base], axis=1)[:, 1]))
    up = np.abs(turn[:, 2]).argmax(axis=1)
    along = np.where(np.arange(3) == up[:, None], 0.0, size).argmax(axis=1)
    row = np.arange(len(others))
    yaw = atan2(turn[row, 1, along], turn[row, 0, along])
    poses = building.poses[others].copy()
    poses[:, 2] -= 0.5 * (size[row, up] - _LEVEL)
    poses[:, 3:] = [rotation.from_yaw(angle) for angle in yaw]
    sizes = np.column_stack([size[row, along], np.full(len(others), wall),
                             np.full(len(others), _LEVEL)])
    return merge_boxes(poses, sizes, 0.0)


def _lower_faces(building: Blueprint, parts: np.ndarray) -> np.ndarray:
    """Compute the heights of the lowest points of boxes [m], (K,)."""
    up = np.abs(rotation.to_matrix(building.poses[parts, 3:])[:, 2])
    return building.poses[parts, 2] - 0.5 * (up * building.size[parts]).sum(axis=1)


def _blocks(terrain: Terrain, pose: np.ndarray,
            size: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Cut the footing below a run of wall into steps: poses (7,) and extents (3,)."""
    turn = rotation.to_matrix(pose[3:])
    up = int(np.argmax(np.abs(turn[2])))  # bricks may stand on end
    along = max((a for a in range(3) if a != up), key=lambda a: size[a])
    across = 3 - up - along
    yaw = atan2(turn[1, along], turn[0, along])
    way, side = np.array([cos(yaw), sin(yaw)]), np.array([-sin(yaw), cos(yaw)])
    foot = pose[2] - 0.5 * size[up]
    count = math.ceil(size[along] / _LENGTH)
    length = size[along] / count
    found = []
    for k in range(count):
        middle = pose[:2] + ((k + 0.5) * length - 0.5 * size[along]) * way
        s, t = np.meshgrid(np.linspace(-0.5, 0.5, _LOOKS) * length,
                           np.linspace(-0.5, 0.5, _LOOKS) * size[across])
        ground = terrain.height(middle + s.reshape(-1, 1) * way + t.reshape(-1, 1) * side).min()
        if foot - ground < _LEVEL:
            continue
        depth = _STEP * math.ceil((foot - ground + _EMBEDDED) / _STEP)
        place = np.concatenate([middle, [foot - 0.5 * depth], rotation.from_yaw(yaw)])
        found.append((place, np.array([length, size[across], depth])))
    return found


def _below(poses: np.ndarray, sizes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Find the block whose top each point lies on, -1 = none, (K,)."""
    found = np.full(len(points), -1)
    for k, (pose, size) in enumerate(zip(poses, sizes)):
        inside = rotation.rotate(rotation.conjugate(pose[3:]), points - pose[:3])
        on = ((np.abs(inside[:, :2]) <= 0.5 * size[:2] + 1e-6).all(axis=1)
              & (np.abs(inside[:, 2] - 0.5 * size[2]) < _LEVEL))
        found[on & (found < 0)] = k
    return found


def _footings(poses: np.ndarray, sizes: np.ndarray) -> Blueprint:
    """Make blocks of concrete that are bonded to the ground at their lower faces."""
    count = len(poses)
    mass = _DENSITY * sizes.prod(axis=1)
    frames = poses.copy()
    frames[:, 2] -= 0.5 * sizes[:, 2]
    zero = np.zeros(count, np.int16)
    return Blueprint(
        shape=np.full(count, Shape.BOX, np.uint8), size=sizes, visual_size=sizes.copy(),
        density=np.full(count, _DENSITY), mass=mass, inertia=box_inertia(mass, sizes),
        poses=poses, kind=zero, material=zero, texture=zero, leaf_area=np.zeros(count),
        bonds=np.column_stack([np.full(count, GROUND), np.arange(count)]).astype(np.int32),
        bond_law=np.full(count, Law.MORTAR, np.uint8), bond_frame=frames,
        bond_extent=sizes[:, :2].copy(), bond_area=sizes[:, 0] * sizes[:, 1],
        mortar=Mortar(*(np.full(count, value) for value in (
            _TENSION, _COHESION, _FRICTION, _COMPRESSION, _NORMAL_STIFFNESS,
            _SHEAR_STIFFNESS))),
        kinds=(FOOTING,), materials=('concrete',), textures=('concrete',))
