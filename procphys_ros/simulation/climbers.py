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
Climbers: plants that are anchored to a wall or tree until their holds are torn off.

What they hold on to is found when a scene is compiled (`holds`). Walls feel the pull as a load,
trees as impulses.
"""

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.trees import anchors, Forest
from procphys_ros.simulation import breaking
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_CHANGE = 0.25    # of the largest load: smaller changes need no new stresses
_LEAST = 50.0     # [N] likewise
_LAYER = 'climbers'


def step(model: Model, state: State, dt: float) -> None:
    """
    Release overloaded anchors and those without a host; apply the pull of the others.

    Writes anchors and impulses of the forest, `state.climbers`, break events and loads on walls.
    """
    own = state.climbers
    if not own.holds.any():
        return
    _let_go(model, state)
    _follow_trees(model, state, dt)
    load_walls(model, state)


def load_walls(model: Model, state: State) -> None:
    """Apply the pull of climbing plants to walls if it has changed much."""
    climbers, own = model.trees.climbers, state.climbers
    chosen = np.flatnonzero(own.holds & (climbers.host_row < 0))
    force = np.zeros((len(own.holds), 3))
    force[chosen] = -_pulls(state.forest, climbers.row[chosen])
    change = np.abs(force - own.given).max(initial=0.0)
    if change <= max(_CHANGE * np.abs(own.given).max(initial=0.0), _LEAST) and not own.fresh:
        return
    own.given, own.fresh = force, False
    host = climbers.anchors.host[chosen]
    arm = climbers.place[chosen] - model.blueprint.poses[host, :3]
    state.loads.set_layer(_LAYER, host, np.hstack([force[chosen],
                                                   np.cross(arm, force[chosen])]))


def _let_go(model: Model, state: State) -> None:
    climbers, own, parts = model.trees.climbers, state.climbers, state.parts
    held = np.flatnonzero(own.holds)
    row, host = climbers.row[held], climbers.anchors.host[held]
    load = (norm(_pulls(state.forest, row), axis=1)
            / climbers.anchors.strength[held])
    wooden = climbers.host_row[held] >= 0
    there = np.where(wooden, parts.owner[host] == Owner.TREE, parts.owner[host] == Owner.STANDING)
    grows = parts.owner[climbers.anchors.part[held]] == Owner.TREE
    loose = ~there | ~grows | (load > 1.0)
    if not loose.any():
        return
    lost = held[loose]
    own.fresh = True
    breaking.break_holds(model, state, lost, np.maximum(load[loose], 1.0), grows[loose])


def _follow_trees(model: Model, state: State, dt: float) -> None:
    """Move anchors with the trees that hold them, and apply the pull to these trees."""
    forest = state.forest
    row, host, arm = _on_trees(model, state)
    if not len(row):
        return
    place, velocity = forest.poses[host, :3] + arm, forest.velocities[host]
    speed = velocity[:, :3] + np.cross(velocity[:, 3:], arm)
    pull = forest.rest_anchors[row, anchors.FORCE:] - _pulls(forest, row)
    felt = np.ones(len(row), bool)
    if state.trees.lod is not None:  # a tree that stands still absorbs no impulse
        felt = ~state.trees.lod.stand_still(forest, host)
    forest.push(host[felt], place[felt], dt * pull[felt])
    forest.anchors[row, anchors.TARGET:anchors.FORCE] = place + 0.5 * dt * speed


def lean(model: Model, state: State) -> None:
    """Move anchors with trees bent by a steady wind, and load these trees with the pull."""
    forest = state.forest
    row, host, arm = _on_trees(model, state)
    forest.anchors[row, anchors.TARGET:anchors.FORCE] = forest.poses[host, :3] + arm
    pull = forest.rest_anchors[row, anchors.FORCE:] - _pulls(forest, row)
    forest.anchors[host] = forest.rest_anchors[host]
    np.add.at(forest.anchors[:, anchors.FORCE:], host, pull)


def end_lean(model: Model, state: State) -> None:
    """Remove the loads of `lean` from trees; from now on every step applies them as impulses."""
    host = _on_trees(model, state)[1]
    state.forest.anchors[host] = state.forest.rest_anchors[host]


def _on_trees(model: Model, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows held by trees, their hosts, and the arms from the hosts [m], (K, 3)."""
    climbers, forest = model.trees.climbers, state.forest
    chosen = np.flatnonzero(state.climbers.holds & (climbers.host_row >= 0))
    host = climbers.host_row[chosen]
    return (climbers.row[chosen], host,
            rotation.rotate(forest.poses[host, 3:], climbers.place[chosen]))


def _pulls(forest: Forest, rows: np.ndarray) -> np.ndarray:
    """Return the forces of anchors on segments [N], (K, 3)."""
    return anchors.forces(forest.anchors[rows], forest.poses[rows, :3])
