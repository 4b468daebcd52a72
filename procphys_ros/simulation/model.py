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


"""Model: what a scene compiles to once; constant arrays that every step reads."""

from collections.abc import Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Law, Shape
from procphys_ros.compilation.threads import most_threads
from procphys_ros.physics.air import SHEDDING_SPEED
from procphys_ros.physics.foliage import speed_of, strengths
from procphys_ros.physics.loads import exposed_faces, outer_faces, with_joints
from procphys_ros.physics.masonry import BondGraph, first_modes, FreeBodies, Modes
from procphys_ros.physics.masonry.components import groups, label
from procphys_ros.physics.terrain import Terrain
from procphys_ros.physics.trees import Anchors, Forest
from procphys_ros.physics.wind import Wind
from procphys_ros.physics.world import Pieces
from procphys_ros.scene import SceneObject, Settings
from procphys_ros.scene.plants import ScenePlant
from procphys_ros.scene.shards import Shard
from procphys_ros.simulation import obstacles
from procphys_ros.simulation.contact_pairs import survey, survey_crowns
from procphys_ros.simulation.obstacles import Bricks, Climbers, find_shelter
from procphys_ros.simulation.spawned_parts import SHARD

_JOINT = 0.01        # [m] mortar between parts whose faces count as one wall
SETTLING = 20_000    # iterations to find the stresses of a scene before its first step
_COVERED = 0.5       # [m] before an outer face, within which another part shields it
_THICKEST = 0.025    # [m] thicker glass is not a pane
_NO_PLANTS: Mapping[str, ScenePlant] = MappingProxyType({})
_STRENGTH_SEED = 102  # separates random streams that share the scene's seed


@dataclass(frozen=True)
class TreeModel:
    """
    Trees at rest.

    :ivar forest: as grown; a state moves a copy.
    :ivar row: of each part in the forest, -1 for none, (N,).
    :ivar span: parts of the rows, as a slice where they are consecutive.
    :ivar sizes: of the segments as obstacles [m], (S, 3).
    :ivar capacity: force [N], torque [N·m] and stress [Pa] that break each joint, and moment
        [N·m] that uproots it, (S, 4).
    :ivar beside: whether the tree of each row may reach a wall, (S,) bool.
    :ivar slack: authored overlap of each row with ground and walls [m], (S,).
    :ivar crowns: the same with other trees, if standing trees collide; else None.
    :ivar climbers: anchors of climbing plants.
    """

    forest: Forest
    row: np.ndarray
    span: slice | np.ndarray
    sizes: np.ndarray
    capacity: np.ndarray
    beside: np.ndarray
    slack: np.ndarray
    crowns: np.ndarray | None
    climbers: Climbers


@dataclass(frozen=True)
class MasonryModel:
    """
    Buildings at rest.

    :ivar members: parts with mortar bonds, (N,) bool.
    :ivar graph: their bonds, intact; a state breaks a copy.
    :ivar closed_sizes: of all parts, joints included [m], (N, 3).
    :ivar face_poses, face_sizes: boxes extended to the middle of their joints, see `with_joints`.
    :ivar bricks: the parts, sorted into cells.
    """

    members: np.ndarray
    graph: BondGraph
    closed_sizes: np.ndarray
    face_poses: np.ndarray
    face_sizes: np.ndarray
    bricks: Bricks

    @cached_property
    def building(self) -> np.ndarray:
        """Return the number of the connected building of each part, (N,)."""
        graph = self.graph
        return label(graph.count, graph.first, graph.second, np.ones(len(graph), bool))[0]

    @cached_property
    def modes(self) -> Modes:
        """Estimate the first modes of the intact buildings, on first access."""
        number = np.full(len(self.members), -1)
        number[self.members] = np.unique(self.building[self.members], return_inverse=True)[1]
        return first_modes(deepcopy(self.graph), number, SETTLING)

    @cached_property
    def skin(self) -> np.ndarray:
        """Find the outer faces of buildings with a room behind them, on first access, (N, 6)."""
        found = np.zeros((len(self.members), 6), bool)
        for rows in groups(self.building, self.members):
            found[rows] = outer_faces(self.face_poses[rows], self.face_sizes[rows])
        return found & exposed_faces(self.face_poses, self.face_sizes, reach=_COVERED)


@dataclass(frozen=True)
class GlassModel:
    """
    Window panes: thin boxes of glass.

    :ivar is_pane: whether each part is a pane, (N,) bool.
    :ivar parts: the panes, (P,).
    :ivar thickness, edge, length: least, middle and largest extent of every part [m], (N,).
    :ivar thin: axis across each pane, (P,).
    :ivar pane, frame: place in `parts` of a pane, and a part that supports it, (F,).
    """

    is_pane: np.ndarray
    parts: np.ndarray
    thickness: np.ndarray
    edge: np.ndarray
    length: np.ndarray
    thin: np.ndarray
    pane: np.ndarray
    frame: np.ndarray


@dataclass(frozen=True)
class LeafModel:
    """
    Leaves at rest.

    :ivar carriers: parts with leaves, (C,); carrier: place of each leaf's part in it, (L,).
    :ivar area: of each leaf [m²], (L,).
    :ivar critical_speed: air speed that tears each leaf off [m/s], (L,); inf = never.
    :ivar queue, queue_speed: leaves of every row of the forest, the weakest first, with an end
        mark, and their critical speeds.
    :ivar first: place of each row's first leaf in the queue, (S,).
    """

    carriers: np.ndarray
    carrier: np.ndarray
    area: np.ndarray
    critical_speed: np.ndarray
    queue: np.ndarray
    queue_speed: np.ndarray
    first: np.ndarray


@dataclass(frozen=True)
class Model:
    """
    A compiled scene.

    Parts that join later without bonds (projectiles, shards) are rows of the state only.

    :ivar settings: of the scene.
    :ivar time_step: [s].
    :ivar seed: of everything random.
    :ivar shard: share of a larger scene in this one.
    :ivar blueprint: parts and bonds, in the order of every array.
    :ivar objects: owners of names, in part order.
    :ivar wind: before any command; a state copies it.
    :ivar loose_bonds: all bonds, intact, for parts that will leave their wall or tree.
    :ivar mortar: whether each bond is mortar, (M,) bool.
    :ivar wooden: parts with a hinge, (K,).
    :ivar intruders: collision shapes of the externally moved bodies, by name.
    :ivar loaded: number of parts of the scene as it was loaded; others joined later.
    :ivar plants: that can grow on, by name.
    """

    settings: Settings
    time_step: float
    seed: int
    shard: Shard
    blueprint: Blueprint
    objects: tuple[SceneObject, ...]
    wind: Wind
    trees: TreeModel
    masonry: MasonryModel
    glass: GlassModel
    leaves: LeafModel
    loose_bonds: FreeBodies
    mortar: np.ndarray
    wooden: np.ndarray
    intruders: dict[str, Pieces]
    loaded: int
    plants: Mapping[str, ScenePlant]

    @property
    def threads(self) -> int:
        """Threads that kernels run on."""
        return most_threads(self.settings.threads)

    @property
    def gravity(self) -> float:
        """Downward acceleration [m/s²]."""
        return self.settings.gravity

    @property
    def terrain(self) -> Terrain:
        """Surface of the ground."""
        return self.settings.terrain


def compile_model(settings: Settings, shard: Shard, blueprint: Blueprint,
                  objects: Sequence[SceneObject], time_step: float, seed: int,
                  wind: Wind | None = None, loaded: int | None = None,
                  graphs: tuple[BondGraph, BondGraph] | None = None,
                  plants: Mapping[str, ScenePlant] = _NO_PLANTS) -> Model:
    """
    Compile all constant data of a scene.

    :param settings: of the scene.
    :param shard: share of a larger scene in this one.
    :param blueprint: all parts and bonds.
    :param objects: owners of the parts, in part order.
    :param time_step: [s].
    :param seed: of everything random.
    :param wind: of the scene so far; None = made from the settings.
    :param loaded: number of parts that did not join later; None = all.
    :param graphs: masonry bonds and all bonds, intact, if known, see `FreeBodies`.
    :param plants: that can grow on, by name.
    """
    graph, every = graphs or (None, None)
    masonry = _masonry(blueprint, BondGraph(blueprint) if graph is None else graph)
    loaded = len(blueprint) if loaded is None else loaded
    trees = _trees(blueprint, settings, masonry.bricks,
                   obstacles.find_holds(blueprint, objects, masonry.bricks, loaded))
    loose_bonds = FreeBodies(blueprint, every)
    mortar = blueprint.bond_law == Law.MORTAR
    wind = copy(wind) if wind else Wind(
        settings.wind, seed, settings.wind_record, settings.terrain, settings.wind_map)
    wind.shelter = find_shelter(blueprint, objects, masonry.members, settings.terrain)
    pairs = blueprint.bonds[~mortar]
    return Model(settings, time_step, seed, shard, blueprint, tuple(objects),
                 wind, trees, masonry, _glass(blueprint, loose_bonds),
                 _leaves(blueprint, settings, trees, seed), loose_bonds, mortar,
                 np.unique(pairs[pairs >= 0]), settings.intruder_pieces(), loaded, plants)


def _masonry(blueprint: Blueprint, graph: BondGraph) -> MasonryModel:
    members = np.zeros(len(blueprint), bool)
    pairs = blueprint.bonds[blueprint.bond_law == Law.MORTAR]
    members[pairs[pairs != GROUND]] = True
    return MasonryModel(members, graph, blueprint.size + _JOINT,
                        *with_joints(blueprint), Bricks(blueprint, np.flatnonzero(members)))


def _trees(blueprint: Blueprint, settings: Settings, bricks: Bricks,
           anchors: Anchors) -> TreeModel:
    forest = Forest(blueprint, (0.0, 0.0, -settings.gravity), climbers=anchors)
    row = np.full(len(blueprint), -1, np.intp)
    row[forest.parts] = np.arange(len(forest))
    hinge_row = np.cumsum(blueprint.bond_law == Law.HINGE) - 1
    hinges = blueprint.hinges
    capacity = np.column_stack([hinges.break_force, hinges.break_torque, hinges.strength,
                                hinges.root_moment])[hinge_row[forest.bonds]]
    sizes = blueprint.solid_size(forest.parts)
    beside, slack = survey(forest, sizes, bricks, settings.terrain)
    crowns = survey_crowns(forest, sizes) if settings.trees.contact else None
    return TreeModel(forest, row, _span(forest.parts), sizes, capacity, beside, slack, crowns,
                     obstacles.place_holds(forest, anchors, row))


def _span(parts: np.ndarray) -> slice | np.ndarray:
    """Return consecutive parts as a slice, which copies several times faster."""
    if len(parts) and np.array_equal(parts, np.arange(parts[0], parts[0] + len(parts))):
        return slice(int(parts[0]), int(parts[0]) + len(parts))
    return parts


def _glass(blueprint: Blueprint, loose_bonds: FreeBodies) -> GlassModel:
    glass = np.array([name == 'glass' for name in blueprint.materials] or [False])
    broken = np.array([name == SHARD for name in blueprint.kinds] or [False])
    is_pane = (glass[blueprint.material] & (blueprint.shape == Shape.BOX)
               & (blueprint.size.min(axis=1, initial=np.inf) < _THICKEST)
               & ~broken[blueprint.kind])
    parts = np.flatnonzero(is_pane)
    thickness, edge, length = np.sort(blueprint.size, axis=1).T
    row = np.full(len(blueprint) + 1, -1)
    row[parts] = np.arange(len(parts))
    graph = loose_bonds.graph
    ends = np.concatenate([np.column_stack([graph.first, graph.second]),
                           np.column_stack([graph.second, graph.first])])
    held = row[ends[:, 0]] >= 0
    return GlassModel(is_pane, parts, thickness, edge, length,
                      np.argmin(blueprint.size[parts], axis=1), row[ends[held, 0]], ends[held, 1])


def _leaves(blueprint: Blueprint, settings: Settings, trees: TreeModel, seed: int) -> LeafModel:
    leaves = blueprint.leaves
    area = leaves.size * leaves.size  # as `Blueprint.leaf_area` has it
    carriers, carrier = np.unique(leaves.part, return_inverse=True)
    rng = np.random.default_rng((_STRENGTH_SEED << 64) + seed)
    usual = settings.leaves.shedding_speed / SHEDDING_SPEED
    force = strengths(area, usual * leaves.shedding_speed, rng)
    speed = speed_of(force / np.maximum(area, 1e-12))
    row = trees.row[leaves.part]
    held = np.flatnonzero((row >= 0) & (leaves.size > 0.0))
    queued = held[np.lexsort((speed[held], row[held]))]
    count = np.bincount(row[held], minlength=len(trees.forest))
    ends = np.cumsum(count + 1) - 1
    queue_speed = np.full(len(queued) + len(count), np.inf)
    queue = np.full(len(queue_speed), -1, np.intp)
    places = np.delete(np.arange(len(queue)), ends)
    queue_speed[places] = speed[queued]
    queue[places] = queued
    return LeafModel(carriers, carrier, area, speed, queue, queue_speed, ends - count)
