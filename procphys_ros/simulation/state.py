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


"""State: everything of a simulation that changes, and nothing else."""

from collections.abc import Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from procphys_ros.blueprint import Blueprint, chain, Joints
from procphys_ros.geometry import rotation
from procphys_ros.physics.dust import DustCloud
from procphys_ros.physics.foliage import FallingLeaves
from procphys_ros.physics.ground_motion import GroundMotion, STILL
from procphys_ros.physics.loads import WallPressure
from procphys_ros.physics.masonry import Fracture, FreeBodies, StressSolver
from procphys_ros.physics.masonry.contact_forces import BodyContacts, PieceBlow
from procphys_ros.physics.masonry.standing_loads import StandingLoads
from procphys_ros.physics.masonry.vibration import ShakenBuildings
from procphys_ros.physics.skyline import OPEN, Skyline
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.wind import Wind
from procphys_ros.physics.world import World
from procphys_ros.physics.world.kinematic import PoseInterpolator
from procphys_ros.scene import SceneObject
from procphys_ros.simulation.contact_pairs import TreeBounds, TreeContacts
from procphys_ros.simulation.events import EventLog
from procphys_ros.simulation.ledger import MomentumLedger
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import (
    Columns,
    columns_of,
    Owner,
    part_columns,
    PartNames,
    RigidBodyMap,
)
from procphys_ros.simulation.plants import GrowingState
from procphys_ros.simulation.tree_lod import LodScheduler, Observer

_FALL_SEED, _DUST_SEED = 103, 104  # separate random streams that share the scene's seed


@dataclass
class TreeState:
    """
    State of trees besides the forest.

    :ivar air: velocity of the air at every row [m/s], (S, 3).
    :ivar sizes: of the segments as obstacles [m], (S, 3).
    :ivar still: whether there is no wind at all.
    :ivar lod: scheduler of level of detail; None = all trees are stepped in every step.
    :ivar faded_air: air at a row before its tree came back into view [m/s], (S, 3).
    :ivar start_poses: of rows that are stepped several time steps ahead, (S, 7).
    :ivar chosen: trees of the plan stepped in this step, (T,) bool.
    :ivar age, quiet, down: seconds since a branch came off, has been at rest, has been near the
        ground, by its first row.
    """

    air: np.ndarray
    sizes: np.ndarray
    still: bool = True
    lod: LodScheduler | None = None
    faded_air: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    start_poses: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    chosen: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    age: dict[int, float] = field(default_factory=dict)
    quiet: dict[int, float] = field(default_factory=dict)
    down: dict[int, float] = field(default_factory=dict)


@dataclass
class BranchLoads:
    """
    Loads of branches on standing parts.

    :ivar parts: loaded ones, (K,).
    :ivar mean: smoothed force on each, and moment about its centre [N], [N·m], world, (K, 6).
    :ivar blow: excess over it within a period of a wall [N·s], [N·m·s], world, (K, 6).
    :ivar since: time since the loads were last compared with those that the solver has [s].
    """

    parts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    mean: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    blow: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    since: float = 0.0


@dataclass
class Missile:
    """
    A projectile.

    :ivar size: edges [m].
    :ivar mass: [kg].
    :ivar ahead: time of flight after its last bounce in this step [s].
    """

    part: int
    body: int
    ball: bool
    size: np.ndarray
    mass: float
    ahead: float = 0.0


@dataclass
class Wave:
    """A travelling blast wave: its impulses on parts, sorted by arrival."""

    parts: np.ndarray    # (K,)
    linear: np.ndarray   # [N·s], (K, 3)
    angular: np.ndarray  # [N·m·s], (K, 3)
    arrival: np.ndarray  # simulated time [s], (K,)
    pulse: np.ndarray    # duration [s], (K,)
    done: int = 0        # rows delivered so far


@dataclass
class BlastState:
    """
    Blasts under way.

    :ivar waves: that have not reached all parts.
    :ivar momentum: recent impulses of waves on standing parts [N·s], world, (N, 3).
    :ivar pulse: duration of the last wave at each part [s], (N,).
    :ivar passed: time when a wave last reached a part [s].
    :ivar single_left: number of bricks that may still fly singly.
    """

    momentum: np.ndarray
    pulse: np.ndarray
    waves: list[Wave] = field(default_factory=list)
    passed: float = -np.inf
    single_left: int = 0


@dataclass
class WallWindState:
    """
    Wind pressure on standing walls; see `wall_loads`.

    :ivar next_look: time of the next update [s].
    :ivar parts: boxes that stood at the last survey of faces, (K,).
    :ivar exposed: their faces exposed to the wind, (K, 6) bool.
    :ivar structure: number of the connected building of each, (K,).
    :ivar tops: middle and top of each building [m], (B, 3).
    :ivar applied: wind there that was last applied to the walls [m/s], (B, 3).
    :ivar pressure: derived from the exposed faces; None = to be computed.
    """

    next_look: float = 0.0
    parts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    exposed: np.ndarray = field(default_factory=lambda: np.zeros((0, 6), bool))
    structure: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    tops: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    applied: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    pressure: WallPressure | None = None

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, 'pressure': None}


@dataclass
class IntruderState:
    """
    An externally moved body.

    :ivar path: interpolated target poses.
    :ivar body: id in the world, -1 before it is placed.
    :ivar start: its position at the beginning of the step [m], (3,).
    :ivar wrench: force and moment on it in the last step [N], [N·m], world, (6,).
    :ivar smooth_wrench: the same, low-pass filtered.
    :ivar from_wall: contribution of standing walls in this step, (6,).
    :ivar pressed: its force on them [N].
    :ivar thrust: of its rotors on it [N], (3,), in its own frame.
    :ivar disk: radius of the disk that the rotors count as [m].
    :ivar sawn: segments that it saws and does not push in this step, (K,).
    """

    path: PoseInterpolator = field(default_factory=PoseInterpolator)
    body: int = -1
    start: np.ndarray = field(default_factory=lambda: np.zeros(3))
    wrench: np.ndarray = field(default_factory=lambda: np.zeros(6))
    smooth_wrench: np.ndarray = field(default_factory=lambda: np.zeros(6))
    from_wall: np.ndarray = field(default_factory=lambda: np.zeros(6))
    pressed: float = 0.0
    thrust: np.ndarray = field(default_factory=lambda: np.zeros(3))
    disk: float = 0.0
    sawn: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))


@dataclass
class RubbleState:
    """
    Motion of rigid bodies in the last step of the engine, and pending judgements.

    :ivar velocities, poses: of all bodies just before that step, by id, (B, 6), (B, 7).
    :ivar waiting: blows to pieces that are judged in the next step.
    :ivar given: impulse of loose bodies on standing parts since their loads were last compared
        [N·s], [N·m·s], (N, 6).
    :ivar rocked: impulse of loose bodies on standing parts that rock under them [N·s], (N, 3).
    :ivar borne: by body, its parts and samples of the contact forces on it.
    :ivar since, unsampled: time since the loads were last compared, and since the last sample [s].
    """

    given: np.ndarray
    rocked: np.ndarray
    velocities: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    poses: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    waiting: list[PieceBlow] = field(default_factory=list)
    since: float = 0.0
    borne: dict[int, tuple[np.ndarray, tuple[BodyContacts, ...]]] = field(default_factory=dict)
    unsampled: float = 0.0


@dataclass
class GlassState:
    """
    Panes in loose pieces.

    :ivar load: of each pane over its strength, above 1 = cracked, (P,).
    :ivar shards: bodies of shards that were awake at the last update.
    """

    load: np.ndarray
    shards: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))


@dataclass
class LeafState:
    """
    Leaves on their branches, in the air and on the ground.

    :ivar fallen: leaves that came off.
    :ivar attached: whether each is still on its branch, (L,) bool.
    :ivar left: leaf area left on each part [m²], (N,).
    :ivar next: place of the weakest leaf left in the queue of each row of the forest, (S,).
    :ivar weakest: air speed that tears it off [m/s], (S,).
    :ivar felt: air at each fallen leaf at its last sample [m/s], (K, 3).
    :ivar turn: share of the flying leaves that is sampled next.
    :ivar speed: air speed relative to each row, workspace [m/s], (S,).
    :ivar skyline: that the fallen leaves were last lifted onto.
    """

    fallen: FallingLeaves
    attached: np.ndarray
    left: np.ndarray
    next: np.ndarray
    weakest: np.ndarray
    speed: np.ndarray
    felt: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    turn: int = 0
    skyline: Skyline = OPEN


@dataclass
class DustState:
    """
    Dust in the air and on the ground.

    :ivar cloud: all puffs; None = dust is switched off.
    :ivar skyline: that the dust was last lifted onto.
    :ivar seen, struck: numbers of break events and blows of projectiles converted to dust.
    :ivar watch: motion of fast bodies just before the step of the engine; None = none is fast.
    """

    cloud: DustCloud | None
    skyline: Skyline = OPEN
    seen: int = 0
    struck: int = 0
    watch: dict[str, np.ndarray] | None = None


@dataclass
class ClimberState:
    """
    Anchors of climbing plants.

    :ivar holds: anchors that still hold, (K,) bool.
    """

    holds: np.ndarray


TIED = -2  # in place of the id of a joint in the world: a rope to a branch, see `ties`


@dataclass
class MechanismState:
    """
    Joints of mechanisms, a row each as in `Blueprint.joints`.

    :ivar joint: id in the world, -1 = broken, or its parts are gone, `TIED`, (J,).
    :ivar speed: that the motor aims at [m/s], [rad/s], (J,).
    :ivar effort: greatest force or moment of the motor [N], [N·m], (J,).
    :ivar target: displacement that the motor aims at [m], [rad], (J,); NaN = it aims at a speed.
    :ivar applied: constant force or moment in place of the motor's [N], [N·m], (J,).
    """

    joint: np.ndarray
    speed: np.ndarray
    effort: np.ndarray
    target: np.ndarray
    applied: np.ndarray

    @classmethod
    def initial(cls, joints: Joints) -> Self:
        """Return the state of joints that are not in the world yet."""
        count = len(joints)
        return cls(np.full(count, -1, np.intp), joints.speed.copy(), joints.effort.copy(),
                   np.full(count, np.nan), np.zeros(count))


@dataclass
class ShakingState:
    """
    An earthquake.

    :ivar motion: of the ground.
    :ivar began: time [s].
    :ivar acts: whether the ground is accelerated.
    :ivar buildings: how they respond.
    """

    motion: GroundMotion = STILL
    began: float = 0.0
    acts: bool = False
    buildings: ShakenBuildings = field(default_factory=ShakenBuildings.none)


@dataclass
class SnowState:
    """
    Snow and ice on the scene, and how they change; see `SnowLoad` for what is aimed at.

    :ivar snow, ice, ramp: aimed at [kg/m²], [m], and the time of the change [s].
    :ivar before: snow before it [kg/m²].
    :ivar began: time of its beginning [s].
    :ivar share: of it that has come about; `told`: that buildings bear already.
    :ivar acts: whether it goes on.
    :ivar on_crowns: mass on every row of the forest before and after it [kg], (2, S).
    :ivar parts: standing parts with a load, (K,).
    :ivar on_parts: wrench on each before and after it [N], [N·m], world, (2, K, 6).
    """

    snow: float = 0.0
    ice: float = 0.0
    ramp: float = 0.0
    before: float = 0.0
    began: float = 0.0
    share: float = 1.0
    told: float = 1.0
    acts: bool = False
    on_crowns: np.ndarray = field(default_factory=lambda: np.zeros((2, 0)))
    parts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    on_parts: np.ndarray = field(default_factory=lambda: np.zeros((2, 0, 6)))


@dataclass
class SkylineState:
    """
    The skyline of standing parts.

    :ivar drawn: None = to be drawn.
    :ivar standing: parts that it was drawn for, (N,) bool.
    :ivar looked: time of the last comparison with the standing parts [s].
    """

    drawn: Skyline | None = None
    standing: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    looked: float = -np.inf


@dataclass
class State:
    """
    The complete variable state of a simulation.

    Stages read and write it; no other object keeps data between two steps.

    :ivar parts: columns with a row per part, see `part_columns`.
    :ivar objects: owners of names, in part order.
    :ivar names: of the parts.
    :ivar wind: air velocity anywhere, with the commands that it was given.
    :ivar world: rigid bodies and the engine that moves them.
    :ivar loose_bonds: bonds of parts that have left their wall or tree.
    :ivar solver, fracture: stresses in standing parts, and their failures.
    :ivar loads: on standing parts, besides their weight.
    :ivar forest: segments of standing trees, and of falling flexible ones.
    :ivar trees: the air at these, and their level of detail.
    :ivar blasts: travelling waves, and their impulses on standing parts.
    :ivar rubble: motion of rigid bodies in the last step of the engine.
    :ivar glass: loads of panes in loose pieces.
    :ivar leaves: on their branches, in the air and on the ground.
    :ivar dust: likewise.
    :ivar climbers: anchors of climbing plants.
    :ivar mechanisms: joints of mechanisms, and their motors.
    :ivar growing: plants that grow, and how.
    :ivar tree_bounds: bounds of segments and trees, kept from step to step.
    :ivar steps, time: number of steps done, and simulated time [s].
    :ivar cue: number of the scene's next cue.
    :ivar next_round: time of the next round of failures of masonry [s].
    :ivar iterations: of the stress solver left in this step.
    :ivar observer: point of view for the level of detail; None = none.
    :ivar log: broken bonds that were not taken yet.
    :ivar ledger: momentum of blows and charges since the start.
    :ivar bodies: the parts of each body of the world.
    :ivar contacts: of trees in the last step.
    :ivar branch_loads: loads of branches on standing parts.
    :ivar missiles: projectiles, in the order of their launch.
    :ivar wall_wind: wind pressure on standing walls.
    :ivar intruders: externally moved bodies, by name.
    :ivar charges: armed: time [s], place [m] and radius [m] of each, by time.
    :ivar wrenches: lasting force and torque per part [N], [N·m], (6,) each.
    :ivar skyline: height of standing parts.
    :ivar shaking: the earthquake that is under way.
    :ivar snow: snow and ice on trees and buildings.
    :ivar kerfs: depth of saw cuts into joints of segments, and into bricks [m], by part.
    :ivar wedges: angle by which wedges have still to open cuts [rad], by segment.
    :ivar excluded: pairs of parts without contact, see `contact_exclusions`, (K, 2).
    :ivar blueprints: parts of the scene and of all that joined since, to be chained.
    :ivar added: objects that users added and did not remove, as placed, by name.
    :ivar removed: names of the objects that users removed.
    """

    parts: Columns
    objects: list[SceneObject]
    names: PartNames
    wind: Wind
    world: World
    loose_bonds: FreeBodies
    solver: StressSolver
    fracture: Fracture
    loads: StandingLoads
    forest: Forest
    trees: TreeState
    blasts: BlastState
    rubble: RubbleState
    glass: GlassState
    leaves: LeafState
    dust: DustState
    climbers: ClimberState
    mechanisms: MechanismState
    growing: GrowingState = field(default_factory=GrowingState)
    tree_bounds: TreeBounds = field(default_factory=TreeBounds)
    steps: int = 0
    time: float = 0.0
    cue: int = 0
    next_round: float = 0.0
    iterations: int = 0
    observer: Observer | None = None
    log: EventLog = field(default_factory=EventLog)
    ledger: MomentumLedger = field(default_factory=MomentumLedger)
    bodies: RigidBodyMap = field(default_factory=RigidBodyMap)
    contacts: TreeContacts = field(default_factory=TreeContacts)
    branch_loads: BranchLoads = field(default_factory=BranchLoads)
    missiles: list[Missile] = field(default_factory=list)
    wall_wind: WallWindState = field(default_factory=WallWindState)
    intruders: dict[str, IntruderState] = field(default_factory=dict)
    charges: list[tuple[float, np.ndarray, float]] = field(default_factory=list)
    wrenches: dict[int, np.ndarray] = field(default_factory=dict)
    skyline: SkylineState = field(default_factory=SkylineState)
    shaking: ShakingState = field(default_factory=ShakingState)
    snow: SnowState = field(default_factory=SnowState)
    kerfs: dict[int, float] = field(default_factory=dict)
    wedges: dict[int, float] = field(default_factory=dict)
    excluded: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.intp))
    blueprints: list[Blueprint] = field(default_factory=list)
    added: dict[str, Blueprint] = field(default_factory=dict)
    removed: list[str] = field(default_factory=list)

    @classmethod
    def initial(cls, model: Model) -> 'State':
        """Make the state of a scene at rest: undamaged, stresses not solved yet."""
        count, trees, leaves = len(model.blueprint), model.trees, model.leaves
        forest = deepcopy(trees.forest)
        graph = deepcopy(model.masonry.graph)
        solver = StressSolver(graph, (0.0, 0.0, -model.gravity))
        culling, dust = model.settings.culling, model.settings.dust
        lod = LodScheduler(culling, forest) if culling.spares_trees else None
        state = cls(
            parts=part_columns(model), objects=list(model.objects),
            names=PartNames(model.objects, model.blueprint), wind=_still_to_come(model.wind),
            world=World((0.0, 0.0, -model.gravity), engine=model.settings.engine,
                        terrain=model.terrain),
            loose_bonds=deepcopy(model.loose_bonds),
            solver=solver, fracture=Fracture(solver), loads=StandingLoads(count), forest=forest,
            trees=TreeState(np.zeros((len(forest), 3)), trees.sizes.copy(), lod=lod,
                            start_poses=forest.poses.copy(),
                            faded_air=np.zeros((len(forest), 3))),
            blasts=BlastState(np.zeros((count, 3)), np.full(count, np.inf)),
            rubble=RubbleState(np.zeros((count, 6)), np.zeros((count, 3))),
            glass=GlassState(np.zeros(len(model.glass.parts))),
            leaves=LeafState(
                FallingLeaves(model.gravity, (_FALL_SEED << 64) + model.seed),
                np.ones(len(model.blueprint.leaves), bool), model.blueprint.leaf_area.copy(),
                leaves.first.copy(), leaves.queue_speed[leaves.first], np.zeros(len(forest))),
            dust=DustState(DustCloud(dust.capacity, (_DUST_SEED << 64) + model.seed,
                                     model.gravity, model.terrain) if dust.enabled else None),
            climbers=ClimberState(np.ones(len(trees.climbers.row), bool)),
            mechanisms=MechanismState.initial(model.blueprint.joints),
            blueprints=[model.blueprint])
        state.intruders = {name: IntruderState() for name in model.intruders}
        if forest.has_sagged:
            state.parts.poses[forest.parts] = forest.poses
        return state

    @property
    def standing(self) -> np.ndarray:
        """Parts that still stand where they were built, (N,) bool."""
        return self.parts.owner == Owner.STANDING

    @property
    def carrier(self) -> np.ndarray:
        """Id of the rigid body that carries each part, -1 for none, (N,)."""
        return np.where(self.parts.owner == Owner.BODY, self.parts.body, -1)

    @property
    def blueprint(self) -> Blueprint:
        """All parts and bonds, with those that joined."""
        if len(self.blueprints) > 1:
            self.blueprints = [chain(self.blueprints)]
        return self.blueprints[0]

    def shown_blueprint(self) -> Blueprint:
        """Return all parts and bonds, with plants as they are now, at rest."""
        source, own, parts, forest = self.blueprint, self.growing, self.parts, self.forest
        if not len(own.part):
            return source
        rows = parts.row[own.part]
        bonds, frames = forest.bonds[rows], source.bond_frame.copy()
        frames[bonds] = forest.rest_frames()[rows]
        middle = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(rows), 1))
        middle[:, 2] = forest.half_lengths[rows]
        poses = source.poses.copy()
        poses[own.part] = rotation.compose(frames[bonds], middle)
        leaves, size = source.leaves, source.leaves.size.copy()
        size[own.leaf] = own.leaf_sizes()
        pose, length = leaves.pose.copy(), parts.visual_size[leaves.part, 2]
        pose[:, :3] *= (length / source.visual_size[leaves.part, 2])[:, None]
        return replace(
            source, poses=poses, bond_frame=frames, size=parts.size.copy(),
            visual_size=parts.visual_size.copy(), mass=parts.mass.copy(),
            inertia=parts.inertia.copy(), leaves=replace(leaves, pose=pose, size=size))

    def shown_poses(self) -> np.ndarray:
        """Return the poses of all parts, until the next step, (N, 7); NaN = the part is gone."""
        gone = self.parts.owner == Owner.GONE
        if not gone.any():
            return self.parts.poses
        return np.where(gone[:, None], np.nan, self.parts.poses)

    def append(self, model: Model, groups: Sequence[tuple[Blueprint, str]]) -> list[int]:
        """
        Append parts without bonds; the caller assigns their bodies.

        :param groups: parts and the name of their object, once per step for all.
        :returns: the first part of each object.
        """
        if not groups:
            return []
        taken = {known.name for known in self.objects}
        firsts, first = [], len(self.parts)
        for made, name in groups:
            unique = model.shard.own(name)
            while unique in taken:
                unique += '_'
            taken.add(unique)
            self.objects.append(SceneObject(unique, first, len(made)))
            firsts.append(first)
            first += len(made)
        joined = chain([made for made, _ in groups])
        self.parts.append(**columns_of(joined), owner=Owner.BODY, row=-1)
        self.blueprints.append(joined)
        self.names.extend(self.objects[-len(groups):], joined)
        return firsts


def _still_to_come(wind: Wind) -> Wind:
    """Copy a wind without its commands; the eddies, which are constant, are shared."""
    fresh = copy(wind)
    fresh.reset()
    return fresh
