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


"""Load checks: warnings about a scene before it starts."""

from collections.abc import Sequence
from dataclasses import replace
import logging

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Law, Shape
from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import Failures
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.touch import overlap_box, overlaps, piece_bounds
from procphys_ros.physics.trees import Anchors
from procphys_ros.scene import SceneObject
from procphys_ros.scene.cues import Blow, Cue
from procphys_ros.scene.placement import FOOTING
from procphys_ros.simulation.obstacles import REACH
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_LOG = logging.getLogger(__name__)
_HANGING = 0.02  # [m] above the ground from which on an object is reported as hanging
_SUNK = 0.01     # [m] below the ground from which on an object is reported as sunk
_OVERLAP = 0.01  # [m] depth from which on objects overlap: twice what roofs have by their tiles
_TWIGS = 0.2     # [m] the same for trees and walls: thinner twigs give way
_CAPACITIES = {Cause.FORCE: 'BreakForce', Cause.TWIST: 'BreakTorque', Cause.BENDING: 'Strength',
               Cause.UPROOTING: 'RootMoment'}
_MOST = 10       # lines about overlaps; more would not help


def check_places(blueprint: Blueprint, objects: Sequence[SceneObject],
                 terrain: Terrain = FLAT) -> list[str]:
    """List misplaced objects: those below the ground, hanging, or overlapping."""
    if not len(blueprint) or not objects:
        return []
    present = np.ones(len(blueprint), bool)
    pairs = _pairs(blueprint, objects, present)
    return (_sunk(blueprint, objects, terrain) + _hanging(blueprint, objects, terrain)
            + _overlapping(blueprint, objects, present, pairs))


def check_added(state: State, terrain: Terrain = FLAT) -> list[str]:
    """List position errors of the last object, which has just joined a running scene."""
    blueprint = replace(state.blueprint, poses=state.shown_poses())
    objects, present = state.objects, state.parts.owner != Owner.GONE
    added = len(objects) - 1
    pairs = [pair for pair in _pairs(blueprint, objects, present) if added in pair]
    return (_sunk(blueprint, objects[added:], terrain)
            + _hanging(blueprint, objects[added:], terrain)
            + _overlapping(blueprint, objects, present, pairs))


def burden(state: State) -> str:
    """Name what things at rest bear."""
    laden = state.snow.snow > 0.0 or state.snow.ice > 0.0
    return 'its own weight and its snow' if laden else 'its own weight'


def check_trees(state: State, objects: Sequence[SceneObject], anchors: Anchors) -> list[str]:
    """List the trees that break or buckle under their weight, and climbers without anchors."""
    blueprint, forest = state.blueprint, state.forest
    row, cause, ratio = forest.overloaded_by_weight()
    part = forest.parts[row]
    lines = []
    for thing in objects:
        own = np.flatnonzero((part >= thing.first) & (part < thing.first + thing.count))
        if len(own):
            worst = own[np.argmax(ratio[own])]
            x, y, z = blueprint.bond_frame[forest.bonds[row[worst]], :3]
            lines.append(
                f'{thing.name} does not carry {burden(state)}: {len(own)} of {thing.count} '
                f'joints are overloaded, the worst at ({x:.2f}, {y:.2f}, {z:.2f}) m by '
                f'{ratio[worst]:.3g} times its {_CAPACITIES[Cause(cause[worst])]}')
    return lines + _buckling(state, objects) + _idle_climbers(blueprint, objects, anchors)


def _buckling(state: State, objects: Sequence[SceneObject]) -> list[str]:
    """List the trees that a breath topples, because they are too slender for their weight."""
    roots, shares = state.forest.buckling()
    part = state.forest.parts[roots]
    lines = []
    for thing in objects:
        own = shares[(part >= thing.first) & (part < thing.first + thing.count)]
        if len(own) and own.min() < 1.0:
            lines.append(f'{thing.name} is too slender to stand upright: it buckles under '
                         f'{own.min():.3g} times its own weight')
    return lines


def _idle_climbers(blueprint: Blueprint, objects: Sequence[SceneObject],
                   anchors: Anchors) -> list[str]:
    child = blueprint.bonds[blueprint.bond_law == Law.HINGE, 1]
    clings = np.zeros(len(blueprint), bool)
    clings[child] = blueprint.hinges.cling > 0.0
    holds = np.zeros(len(blueprint), bool)
    holds[anchors.part] = True
    return [f'{thing.name} clings to nothing: no wall or tree is within {REACH:g} m of the middle '
            'of any of its segments' for thing in objects
            if clings[(own := slice(thing.first, thing.first + thing.count))].any()
            and not holds[own].any()]


def check_cues(state: State, cues: Sequence[Cue]) -> list[str]:
    """List the cues that strike parts which do not exist, at least not yet."""
    lines = []
    for cue in cues:
        if isinstance(cue.what, Blow):
            try:
                state.names.index(cue.what.target)
            except CommandError as error:
                lines.append(f'scene.cues: "{cue.text}" has no part to strike so far: {error}')
    return lines


def log(lines: Sequence[str]) -> tuple[str, ...]:
    """Log warnings, a line each, and return them."""
    for line in lines:
        _LOG.warning(line)
    return tuple(lines)


def describe_failures(blueprint: Blueprint, objects: Sequence[SceneObject],
                      rounds: Sequence[Failures], rows: np.ndarray,
                      loose: np.ndarray, bears: str = 'its own weight') -> list[str]:
    """
    Describe the objects that crack or break under what they bear, and where first.

    :param rounds: of failure, in their order.
    :param rows: of the blueprint's bonds, by row of the bond graph.
    :param loose: falling parts, (K,).
    :param bears: see `burden`.
    """
    if not rounds:
        return []
    bond = rows[np.concatenate([r.bond for r in rounds])]
    broken = np.concatenate([r.broken for r in rounds])
    told = broken | ~_dry(blueprint)[bond]
    bond, broken = bond[told], broken[told]
    part = blueprint.bonds[bond].max(axis=1)
    lines = []
    for thing in objects:
        inside = (part >= thing.first) & (part < thing.first + thing.count)
        if not inside.any():
            continue
        falls = np.count_nonzero((loose >= thing.first) & (loose < thing.first + thing.count))
        x, y, z = blueprint.bond_frame[bond[inside][0], :3]
        lines.append(
            f'{thing.name} does not carry {bears}: '
            f'{len(np.unique(bond[inside & ~broken]))} joints crack, '
            f'{len(np.unique(bond[inside & broken]))} break, the first at ({x:.2f}, {y:.2f}, '
            f'{z:.2f}) m; {falls} of {thing.count} parts fall')
    return lines


def _dry(blueprint: Blueprint) -> np.ndarray:
    """Mark joints without strength, whose cracks are not failures, (M,) bool."""
    found = np.zeros(len(blueprint.bonds), bool)
    mortar = blueprint.mortar
    found[blueprint.bond_law == Law.MORTAR] = (mortar.tension == 0.0) & (mortar.cohesion == 0.0)
    return found


def _hanging(blueprint: Blueprint, objects: Sequence[SceneObject],
             terrain: Terrain) -> list[str]:
    """Report built objects that neither reach the ground nor stand on another object."""
    up = np.abs(rotation.to_matrix(blueprint.poses[:, 3:])[:, 2])
    height = blueprint.poses[:, 2] - 0.5 * (up * blueprint.size).sum(axis=1)
    height = height - terrain.height(blueprint.poses)
    lowest, highest = blueprint.bonds.min(axis=1), blueprint.bonds.max(axis=1)
    lines = []
    for thing in objects:
        own = (highest >= thing.first) & (highest < thing.first + thing.count)
        least = height[thing.first:thing.first + thing.count].min(initial=np.inf)
        if own.any() and (lowest[own] >= thing.first).all() and least > _HANGING:
            lines.append(f'{thing.name} stands {least:.2f} m above the ground, so nothing holds '
                         f'it, and it falls; put its origin at z = 0, or name what it stands on '
                         f'as {thing.name}.on')
    return lines


def _sunk(blueprint: Blueprint, objects: Sequence[SceneObject], terrain: Terrain) -> list[str]:
    up = np.abs(rotation.to_matrix(blueprint.poses[:, 3:])[:, 2])
    size = blueprint.size
    boxes = 0.5 * (up * size).sum(axis=1)
    axes = 0.5 * up[:, 2] * np.maximum(size[:, 2] - size[:, 0], 0.0)  # stumps may be rounded off
    depth = np.where(blueprint.shape == Shape.BOX, boxes, axes) - blueprint.poses[:, 2]
    depth[blueprint.hexahedra.part] = -blueprint.hexahedra.points(
        blueprint.poses)[..., 2].min(axis=1, initial=np.inf)
    depth += terrain.height(blueprint.poses)
    depth[np.array([kind == FOOTING for kind in blueprint.kinds])[blueprint.kind]] = 0.0
    lines = []
    for thing in objects:
        own = depth[thing.first:thing.first + thing.count]
        count = np.count_nonzero(own > _SUNK)
        if count:
            lines.append(f'{thing.name} is below the ground: {count} of {thing.count} parts, by '
                         f'up to {own.max():.2f} m ({_where(terrain)})')
    return lines


def _where(terrain: Terrain) -> str:
    return 'the ground is at z = 0' if terrain.is_flat else 'the ground is the terrain'


def _mortared(blueprint: Blueprint, objects: Sequence[SceneObject]) -> np.ndarray:
    """Distinguish objects with walls from trees, (O,) bool."""
    held = np.zeros(len(blueprint), bool)
    ends = blueprint.bonds[blueprint.bond_law == Law.MORTAR]
    held[ends[ends != GROUND]] = True
    return np.array([held[thing.first:thing.first + thing.count].any() for thing in objects])


def _pairs(blueprint: Blueprint, objects: Sequence[SceneObject],
           present: np.ndarray) -> list[tuple[int, int]]:
    """Pair walls with nearby walls and trees; crowns may overlap each other."""
    built = _mortared(blueprint, objects)
    low, high = np.split(_bounds(blueprint), 2, axis=1)
    low = np.where(present[:, None], low, np.inf)
    high = np.where(present[:, None], high, -np.inf)
    parts = [slice(thing.first, thing.first + thing.count) for thing in objects]
    whole = np.array([[*low[own].min(axis=0, initial=np.inf),
                       *high[own].max(axis=0, initial=-np.inf)] for own in parts])
    there = np.flatnonzero(np.isfinite(whole).all(axis=1))
    walls = there[built[there]]
    mine, other = overlaps(whole[walls], whole[there])
    return [(mine, other) for mine, other in zip(walls[mine].tolist(), there[other].tolist())
            if mine != other and not (built[other] and other < mine)]


def _bounds(blueprint: Blueprint) -> np.ndarray:
    return piece_bounds(blueprint.shape, blueprint.poses, blueprint.size,
                        np.zeros((len(blueprint), 6)), 0.0, -0.5 * _OVERLAP)


def _overlapping(blueprint: Blueprint, objects: Sequence[SceneObject], present: np.ndarray,
                 pairs: Sequence[tuple[int, int]]) -> list[str]:
    """Report the pairs of a wall and another object that overlap, and how deep."""
    built, bounds = _mortared(blueprint, objects), _bounds(blueprint)
    lines = []
    for mine, other in pairs:
        depth, place = _deepest(blueprint, bounds, *(
            thing.first + np.flatnonzero(present[thing.first:thing.first + thing.count])
            for thing in (objects[mine], objects[other])))
        if depth > (_OVERLAP if built[other] else _TWIGS):
            x, y, z = place
            lines.append(f'{objects[mine].name} and {objects[other].name} overlap by up to '
                         f'{depth:.2f} m, at ({x:.2f}, {y:.2f}, {z:.2f}) m')
    more = len(lines) - _MOST
    return lines[:_MOST] + ([f'{more} more pairs of objects overlap'] if more > 0 else [])


def _deepest(blueprint: Blueprint, bounds: np.ndarray, mine: np.ndarray,
             theirs: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the deepest overlap of some parts with others, and its position [m]."""
    a, b = overlaps(bounds[mine], bounds[theirs])
    worst, place = 0.0, np.zeros(3)
    for part in np.unique(b):
        near = mine[a[b == part]]
        depth, _, point = overlap_box(blueprint.poses[theirs[part]],
                                      blueprint.size[theirs[part]], blueprint.poses[near],
                                      blueprint.size[near])
        if depth.max() > worst:
            worst, place = float(depth.max()), point[depth.argmax()]
    return worst, place
