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
Trees: the air they feel, their step, joints that break, and plants that lose their holds.

Large pieces that come off stay flexible while they fall. What climbing plants hold on to is found
when a scene is compiled (`obstacles`). Walls feel their pull as a load, trees as impulses.
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import cos
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, norm
from procphys_ros.physics.terrain import height_at
from procphys_ros.physics.trees import anchors, carried_rows, CAUSES, Forest
from procphys_ros.physics.trees.subset import write_between
from procphys_ros.physics.world import BodyState
from procphys_ros.simulation import breaking, contact_exclusions
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_BLEND = 2.0  # [s] in which a tree that comes back into view changes over to the present wind
SMALLEST = 8     # segments; smaller pieces bend too little to be seen
MOST = 16        # at a time; each costs about as much as a standing tree while it touches nothing,
#                  and up to a millisecond per step while it lies on many contacts
_SLOW = 0.25     # [m/s] largest speed of a segment at rest
_CALM = 0.5      # [s] at rest, after which a branch counts as lying
_BALANCED = 3.0  # [s] likewise, of what stands rather than lies: a tree of 10 m on its foot, a
#                  hundredth of a radian from its balance, moves faster by then
_LOW = 0.3       # [m] height of the lowest segment of a branch that has come down
_DOWN = 1.0      # [s] until a fallen branch becomes rigid: after impact and springback
_LONGEST = 8.0   # [s] from coming off, after which a branch becomes rigid anyway
_HOLD_LAYER = 'climbers'


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
    trees.still = not state.wind.moves
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


def step_joints(model: Model, state: State, dt: float) -> None:
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
    let_fall(model, state, rows[chosen].tolist())


def let_fall(model: Model, state: State, rows: list[int]) -> None:
    """
    Part branches from their trees at their first rows; what is small becomes a rigid body.

    :param rows: of the forest; what is carried by another one comes before it.
    """
    _release(model, state, [row for row in rows if not _stays_flexible(model, state, row)])


def make_rigid(model: Model, state: State, dt: float) -> None:
    """
    Turn branches that are small, lie still or came down a while ago into rigid fragments.

    A felled tree that still stands on its foot has not come down.

    Branches that hold climbers stay flexible.

    Writes the clocks in `state.trees`, and releases.
    """
    forest, trees = state.forest, state.trees
    roots = forest.free_roots
    if not len(roots) and not trees.age:
        return
    size, speed, height, flat, clings = _survey(
        roots, forest.ends, forest.active, forest.parents, forest.poses, forest.velocities,
        forest.anchors[:, anchors.STIFFNESS], model.terrain)
    ids = roots.tolist()
    trees.age = {r: trees.age.get(r, 0.0) + dt for r in ids}
    trees.quiet = {r: trees.quiet.get(r, 0.0) + dt if lies else 0.0
                   for r, lies in zip(ids, (speed < _SLOW).tolist())}
    trees.down = {r: trees.down.get(r, 0.0) + (dt if low else 0.0)
                  for r, low in zip(ids, (flat & (height < _LOW)).tolist())}
    calm = np.where(flat, _CALM, _BALANCED) - 1e-9
    _release(model, state, [root for place, root in enumerate(ids) if not clings[place] and (
        size[place] < SMALLEST or trees.age[root] > _LONGEST - 1e-9
        or trees.quiet[root] > calm[place] or trees.down[root] > _DOWN - 1e-9)])


@kernel
def _survey(roots, ends, active, parents, poses, velocities, anchored, terrain):
    """
    Measure falling branches.

    :param roots: first row of each, (R,); the other columns are those of the forest.
    :returns: segments of each; largest part of a velocity [m/s]; height of the lowest middle over
        the ground [m]; whether it lies rather than stands, from its first segment to its middle;
        whether any is anchored; (R,) each.
    """
    size, speed = np.zeros(len(roots), np.int64), np.zeros(len(roots))
    height, clings = np.full(len(roots), np.inf), np.zeros(len(roots), np.bool_)
    flat = np.zeros(len(roots), np.bool_)
    for n in range(len(roots)):
        rows = carried_rows(roots[n], ends[roots[n]], active, parents)
        size[n] = len(rows)
        x, y, z = 0.0, 0.0, 0.0
        for i in rows:
            x += poses[i, 0] - poses[roots[n], 0]
            y += poses[i, 1] - poses[roots[n], 1]
            z += poses[i, 2] - poses[roots[n], 2]
            clings[n] |= anchored[i] != 0.0
            height[n] = min(height[n],
                            poses[i, 2] - height_at(terrain, poses[i, 0], poses[i, 1]))
            for c in range(3):
                speed[n] = max(speed[n], abs(velocities[i, c]))
        flat[n] = z * z <= x * x + y * y
    return size, speed, height, flat, clings


def _release(model: Model, state: State, rows: list[int]) -> None:
    """Make one rigid body of each branch, given their first rows in the forest."""
    pieces, velocities = [], [np.zeros((0, 6))]
    for row in rows:
        contact_exclusions.add_branch(state, row, state.trees.sizes)
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
    contact_exclusions.add_branch(state, row, state.trees.sizes)
    forest.release(row)
    return True


def _clings(forest: Forest, rows: np.ndarray) -> bool:
    return bool(forest.anchors[rows, anchors.STIFFNESS].any())


def _share_path(ends: np.ndarray, row: int, other: int) -> bool:
    return row <= other < ends[row] or other <= row < ends[other]


def step_climbers(model: Model, state: State, dt: float) -> None:
    """
    Release overloaded anchors and those without a host; apply the pull of the others.

    Writes anchors and impulses of the forest, `state.climbers`, break events and loads on walls.
    """
    own = state.climbers
    if not own.holds.any():
        return
    _let_go(model, state)
    _follow_trees(model, state, dt)
    load_climbed_walls(model, state)


def load_climbed_walls(model: Model, state: State) -> None:
    """Apply the pull of climbing plants to walls if it has changed much."""
    climbers = model.trees.climbers
    chosen = np.flatnonzero(state.climbers.holds & (climbers.host_row < 0))
    force = -_pulls(state.forest, climbers.row[chosen])
    host = climbers.anchors.host[chosen]
    arm = climbers.place[chosen] - model.blueprint.poses[host, :3]
    state.loads.follow(_HOLD_LAYER, host, np.hstack([force, cross(arm, force)]))


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
    breaking.break_holds(model, state, lost, np.maximum(load[loose], 1.0), grows[loose])


def _follow_trees(model: Model, state: State, dt: float) -> None:
    """Move anchors with the trees that hold them, and apply the pull to these trees."""
    forest = state.forest
    row, host, arm = _on_trees(model, state)
    if not len(row):
        return
    place, velocity = forest.poses[host, :3] + arm, forest.velocities[host]
    speed = velocity[:, :3] + cross(velocity[:, 3:], arm)
    pull = forest.rest_anchors[row, anchors.FORCE:] - _pulls(forest, row)
    felt = np.ones(len(row), bool)
    if state.trees.lod is not None:  # a tree that stands still absorbs no impulse
        felt = ~state.trees.lod.stand_still(forest, host)
    forest.push(host[felt], place[felt], dt * pull[felt])
    forest.anchors[row, anchors.TARGET:anchors.FORCE] = place + 0.5 * dt * speed


def lean_climbers(model: Model, state: State) -> None:
    """Move anchors with trees bent by a steady wind, and load these trees with the pull."""
    forest = state.forest
    row, host, arm = _on_trees(model, state)
    forest.anchors[row, anchors.TARGET:anchors.FORCE] = forest.poses[host, :3] + arm
    pull = forest.rest_anchors[row, anchors.FORCE:] - _pulls(forest, row)
    forest.anchors[host] = forest.rest_anchors[host]
    np.add.at(forest.anchors[:, anchors.FORCE:], host, pull)


def end_climbers_lean(model: Model, state: State) -> None:
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
