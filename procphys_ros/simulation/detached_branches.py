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


"""Detached branches: overloaded joints break, and large pieces stay flexible while they fall."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.terrain import height_at
from procphys_ros.physics.trees import anchors, carried_rows, CAUSES, Forest
from procphys_ros.simulation import breaking, contact_exclusions
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

SMALLEST = 8     # segments; smaller pieces bend too little to be seen
MOST = 16        # at a time; each costs about as much as a standing tree while it touches nothing,
#                  and up to a millisecond per step while it lies on many contacts
_SLOW = 0.25     # [m/s] largest speed of a segment at rest
_CALM = 0.5      # [s] at rest, after which a branch counts as lying
_LOW = 0.3       # [m] height of the lowest segment of a branch that has come down
_DOWN = 1.0      # [s] until a fallen branch becomes rigid: after impact and springback
_LONGEST = 8.0   # [s] from coming off, after which a branch becomes rigid anyway


def step(model: Model, state: State, dt: float) -> None:
    """
    Make lying branches rigid, and break the joints that the last step of the trees overloaded.

    On each root-to-tip path of a tree or branch the most overloaded joint breaks first; the joints
    above and below it are judged again in the next step, without the load that broke it. Writes
    the forest and `state.excluded`, and releases small pieces. Poses, momentum and angular
    momentum are kept.
    """
    make_rigid(model, state, dt)
    _break_joints(model, state)
    contact_exclusions.update(model, state)


def _break_joints(model: Model, state: State) -> None:
    forest = state.forest
    rows, causes, loads, bonds = forest.overloaded()
    if not len(rows):
        return
    over = loads / model.trees.capacity[rows, np.searchsorted(CAUSES, causes)]
    roots = forest.roots(rows)
    chosen: list[int] = []
    for i in np.argsort(-over, kind='stable'):
        if not any(roots[i] == roots[j] and _share_path(forest.ends, rows[i], rows[j])
                   for j in chosen):
            chosen.append(int(i))
    breaking.break_bonds(model, state, bonds[chosen], causes[chosen], over[chosen])
    rigid = [int(rows[i]) for i in chosen if not _stays_flexible(model, state, int(rows[i]))]
    _release(model, state, rigid)


def make_rigid(model: Model, state: State, dt: float) -> None:
    """
    Turn branches that are small, lie still or came down a while ago into rigid fragments.

    Branches that hold climbers stay flexible.

    Writes the clocks in `state.trees`, and releases.
    """
    forest, trees = state.forest, state.trees
    roots = forest.free_roots
    if not len(roots) and not trees.age:
        return
    size, speed, height, clings = _survey(
        roots, forest.ends, forest.active, forest.parents, forest.poses, forest.velocities,
        forest.anchors[:, anchors.STIFFNESS], model.terrain)
    ids = roots.tolist()
    trees.age = {r: trees.age.get(r, 0.0) + dt for r in ids}
    trees.quiet = {r: trees.quiet.get(r, 0.0) + dt if lies else 0.0
                   for r, lies in zip(ids, (speed < _SLOW).tolist())}
    trees.down = {r: trees.down.get(r, 0.0) + (dt if low else 0.0)
                  for r, low in zip(ids, (height < _LOW).tolist())}
    _release(model, state, [root for place, root in enumerate(ids) if not clings[place] and (
        size[place] < SMALLEST or trees.age[root] > _LONGEST - 1e-9
        or trees.quiet[root] > _CALM - 1e-9 or trees.down[root] > _DOWN - 1e-9)])


@kernel
def _survey(roots, ends, active, parents, poses, velocities, anchored, terrain):
    """
    Measure falling branches.

    :param roots: first row of each, (R,); the other columns are those of the forest.
    :returns: segments of each; largest part of a velocity [m/s]; height of the lowest middle over
        the ground [m]; whether any is anchored; (R,) each.
    """
    size, speed = np.zeros(len(roots), np.int64), np.zeros(len(roots))
    height, clings = np.full(len(roots), np.inf), np.zeros(len(roots), np.bool_)
    for n in range(len(roots)):
        rows = carried_rows(roots[n], ends[roots[n]], active, parents)
        size[n] = len(rows)
        for i in rows:
            clings[n] |= anchored[i] != 0.0
            height[n] = min(height[n],
                            poses[i, 2] - height_at(terrain, poses[i, 0], poses[i, 1]))
            for c in range(3):
                speed[n] = max(speed[n], abs(velocities[i, c]))
    return size, speed, height, clings


def _release(model: Model, state: State, rows: list[int]) -> None:
    """Make one rigid body of each branch, given their first rows in the forest."""
    pieces, velocities = [], [np.zeros((0, 6))]
    for row in rows:
        contact_exclusions.add_branch(state, row, model.trees.sizes)
        own, poses, moving = state.forest.detach(row)
        pieces.append(state.forest.parts[own])
        state.parts.poses[pieces[-1]] = poses  # the shown pose may lie between two steps
        velocities.append(moving)
    breaking.release(model, state, pieces, np.concatenate(velocities))


def _stays_flexible(model: Model, state: State, row: int) -> bool:
    """Detach a branch as a tree with a free root if worth its cost; return whether it is."""
    forest = state.forest
    rows = forest.subtree(row)
    if not _clings(forest, rows) and (len(forest.free_roots) >= MOST or len(rows) < SMALLEST):
        return False
    contact_exclusions.add_branch(state, row, model.trees.sizes)
    forest.release(row)
    return True


def _clings(forest: Forest, rows: np.ndarray) -> bool:
    return bool(forest.anchors[rows, anchors.STIFFNESS].any())


def _share_path(ends: np.ndarray, row: int, other: int) -> bool:
    return row <= other < ends[row] or other <= row < ends[other]
