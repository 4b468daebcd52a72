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


"""Trees: the air they feel, their step, and where their segments are."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import cos
from procphys_ros.physics.trees.subset import write_between
from procphys_ros.physics.world import BodyState
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_BLEND = 2.0  # [s] in which a tree that comes back into view changes over to the present wind


def sample_wind(model: Model, state: State, dt: float) -> None:
    """
    Sample the air at the trees that are stepped now; writes `state.trees`.

    Without level of detail these are all trees. With it, a tree that is not stepped keeps its pose
    to the bit and loses its velocity.
    """
    trees, forest = state.trees, state.forest
    if trees.lod is not None:
        trees.still = False
        trees.lod.update_trees(forest)
        trees.chosen = np.zeros(len(trees.lod.held), bool)
        _choose(model, state)
        return
    trees.still = not state.wind.enabled
    if not trees.still:
        state.wind.velocity(forest.poses[:, :3], state.time, trees.air, model.threads)


def movers(state: State) -> np.ndarray:
    """List the trees, places in the forest's plan, that may move in the next step."""
    if state.trees.lod is None:
        return np.arange(len(state.forest.plan.start) - 1)
    return np.flatnonzero(~state.trees.lod.held)


def wake_touched(model: Model, state: State, dt: float) -> None:
    """Wake trees in contact with moving bodies; others may lean and rest as they stand."""
    lod, forest, contacts = state.trees.lod, state.forest, state.contacts
    if lod is None or not len(contacts):
        return
    moves = (contacts.other >= 0) | ((contacts.body >= 0) & (
        state.world.bodies.state[contacts.body] >= BodyState.AWAKE))
    rows = np.concatenate([contacts.row[moves], contacts.other[contacts.other >= 0]])
    lod.wake(lod.of_rows(forest, rows))
    leans = lod.of_rows(forest, contacts.row)
    forest.hold(leans[lod.held[leans] & (lod.roused[leans] == 0)])
    _choose(model, state)


def step(model: Model, state: State, dt: float) -> None:
    """
    Advance the trees in the sampled air; writes `state.forest`.

    With level of detail a distant tree is stepped ahead of time; its shown pose is interpolated,
    so that it neither lags nor jumps.
    """
    trees, forest = state.trees, state.forest
    if trees.lod is None:
        forest.step(dt, None if trees.still else trees.air, model.threads)
        return
    chosen = np.flatnonzero(trees.chosen)
    steps = trees.lod.stride(state.observer, chosen)
    ahead = forest.rows_of(chosen[steps > 1])
    trees.start_poses[ahead] = forest.poses[ahead]
    forest.step_some(chosen, steps, dt, trees.air, model.threads)
    trees.lod.elapse(forest, chosen, trees.air, dt)


def write_poses(model: Model, state: State, dt: float) -> None:
    """Write the poses and velocities of the segments of standing and falling trees."""
    forest, parts = state.forest, state.parts
    if state.trees.lod is not None:
        state.trees.lod.update_trees(forest)
        trees, share = state.trees.lod.shown_shares()
        write_between(forest.plan, trees, share, state.trees.start_poses, forest.poses,
                      forest.velocities, forest.parts, parts.poses, parts.velocities)
    elif forest.active.all():
        rows = model.trees.span
        parts.poses[rows] = forest.poses
        parts.velocities[rows] = forest.velocities
    else:
        _scatter(forest.parts, forest.active, forest.poses, parts.poses)
        _scatter(forest.parts, forest.active, forest.velocities, parts.velocities)


def _choose(model: Model, state: State) -> None:
    """Add to the chosen trees those not chosen before in this step."""
    trees, forest = state.trees, state.forest
    assert trees.lod is not None
    found, back, stops = trees.lod.choose(forest, state.observer, state.wind, state.time)
    forest.hold(stops)
    rows = forest.rows_of(back)
    trees.faded_air[rows] = trees.air[rows]
    fresh = found[~trees.chosen[found]]
    trees.chosen[fresh] = True
    if not len(fresh):
        return
    rows = forest.rows_of(fresh)
    air = state.wind.velocity(forest.poses[rows, :3], state.time, threads=model.threads)
    since = trees.lod.since[fresh]
    if (since < _BLEND).any():
        count = np.diff(forest.plan.start)[fresh]
        share = np.repeat(np.minimum(since / _BLEND, 1.0), count)
        share = (0.5 - 0.5 * cos(np.pi * share))[:, None]
        air = trees.faded_air[rows] + share * (air - trees.faded_air[rows])
    trees.air[rows] = air


@kernel
def _scatter(parts, active, rows, out):
    """Copy the active rows to their parts."""
    for i in range(len(parts)):
        if active[i]:
            out[parts[i]] = rows[i]
