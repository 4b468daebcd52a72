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
Leaves of a scene: where they are, which of them the wind takes, and where those come down.

The mass of a leaf that falls stays with its branch: leaves are about 3 % of the mass of a tree
and 7 % of that of the segments which carry them, while their share of the drag is most of it.
"""

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.physics.air import FOLIAGE_DRAG
from procphys_ros.physics.foliage import air_speeds, carried, Flutter
from procphys_ros.simulation import skyline
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_TURNS = 4  # steps between samples of the air for each flying leaf; it moves a metre meanwhile,
#             far less than the size of the eddies that carry it
_FLUTTER_SEED = 101  # separates random streams that share the scene's seed


def step(model: Model, state: State, dt: float) -> None:
    """
    Tear off leaves in strong wind, and move those in flight.

    Trees and flexible branches lose leaves; those of a rigid branch fall with it. Writes
    `state.leaves`, the leaf area of the forest and the drag areas of parts.
    """
    if model.settings.leaves.shedding and state.wind.enabled and len(model.leaves.queue):
        _tear_off(model, state)
    if len(state.leaves.fallen):
        _fly(model, state, dt)


def make_flutter(model: Model) -> Flutter:
    """Draw the random flutter of each leaf about its petiole."""
    return Flutter(model.blueprint.leaves, (_FLUTTER_SEED << 64) + model.seed)


def poses(model: Model, state: State, flutter: Flutter | None) -> np.ndarray:
    """
    Compute the pose of every leaf: on its branch and fluttering, in the air or on the ground.

    :param flutter: from `make_flutter`; None = leaves do not flutter.
    :returns: petiole poses, z along the leaf, world, (L, 7); NaN on parts that are gone.
    """
    leaves = model.leaves
    frames = state.shown_poses()[leaves.carriers]
    local = model.blueprint.leaves.pose
    if flutter is not None and len(local):
        exists = np.isfinite(frames).all(axis=1)
        air = np.zeros((len(frames), 3))
        air[exists] = state.wind.velocity(frames[exists, :3], state.time,
                                          threads=model.threads)
        air -= state.parts.velocities[leaves.carriers, :3]
        local = flutter.poses(leaves.carrier, frames, air, state.time, model.threads)
    out = carried(leaves.carrier, frames, local, model.threads)
    out[state.leaves.fallen.leaf] = state.leaves.fallen.poses
    return out


def _fly(model: Model, state: State, dt: float) -> None:
    own, below = state.leaves, skyline.current(model, state)
    if own.skyline is not below:
        own.skyline = below
        own.fallen.lift(below)
    flying = np.flatnonzero(own.fallen.flying)
    if len(flying):
        _sample_air(model, state, flying)
        own.fallen.step(flying, own.felt[flying], dt, below, model.threads)


def _sample_air(model: Model, state: State, flying: np.ndarray) -> None:
    """Sample the air at a share of the leaves, in turn, and at those just torn off."""
    own = state.leaves
    fresh = len(own.fallen) - len(own.felt)
    if fresh:
        own.felt = np.concatenate([own.felt, np.full((fresh, 3), np.nan)])
    own.turn = (own.turn + 1) % _TURNS
    due = flying[(flying % _TURNS == own.turn) | np.isnan(own.felt[flying, 0])]
    own.felt[due] = state.wind.velocity(own.fallen.poses[due, :3], state.time,
                                        threads=model.threads)


def _tear_off(model: Model, state: State) -> None:
    own, leaves, forest = state.leaves, model.leaves, state.forest
    air_speeds(state.trees.air, forest.velocities, forest.active, own.speed)
    torn = []
    rows = np.flatnonzero(own.speed > own.weakest)
    while len(rows):  # the weakest leaf of every row that loses any, then the next weakest
        torn.append(leaves.queue[own.next[rows]])
        own.next[rows] += 1
        own.weakest[rows] = leaves.queue_speed[own.next[rows]]
        rows = rows[own.speed[rows] > own.weakest[rows]]
    if torn:
        _let_go(model, state, np.concatenate(torn))


def _let_go(model: Model, state: State, leaf: np.ndarray) -> None:
    own, leaves = state.leaves, model.blueprint.leaves
    part = leaves.part[leaf]
    own.attached[leaf] = False
    own.fallen.let_go(leaf, rotation.compose(state.parts.poses[part], leaves.pose[leaf]),
                      state.parts.velocities[part, :3], leaves.size[leaf])
    np.subtract.at(own.left, part, model.leaves.area[leaf])
    np.subtract.at(state.parts.drag_area, part, FOLIAGE_DRAG * model.leaves.area[leaf])
    part = np.unique(part)
    share = np.clip(own.left[part] / model.blueprint.leaf_area[part], 0.0, 1.0)
    state.forest.keep_leaves(state.parts.row[part], share)
