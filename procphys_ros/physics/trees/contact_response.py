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
Contact response: predicted motion of points of trees, and its response to impulses.

Contact impulses are solved for before the step. They depend linearly on the velocity of every
contact point at the end of the step without contact, and on the velocity change of each point by
an impulse at another point of the same tree (the Delassus operator), springs, dampers and drag of
the step included. Each tree is factored once for all its points.
"""

from dataclasses import dataclass, replace

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.compilation import threads as pool
from procphys_ros.physics.trees import integrator, joints, parallel, passes, subset
from procphys_ros.physics.trees.layout import (
    ACROSS,
    ALONG,
    EXTRA_STIFFNESS,
    EXTRA_STRIDE,
    MASS,
    REACH,
    STIFFNESS,
)
from procphys_ros.physics.trees.spatial import shift_load
from procphys_ros.physics.trees.state import ForestState, Scratch, SegmentJoint, TraversalPlan

_SPRUNG = int(SegmentJoint.SPRUNG)
_FREE = int(SegmentJoint.FREE)
# A spring k held at F stores F²/2k; with the midpoint rule, in which it acts as a mass of k·dt²/4,
# it releases up to four times that in one step.
_IMPLICIT = 4.0


@dataclass(frozen=True)
class ContactResponse:
    """
    Predicted motion of points on trees, and its response to impulses.

    The response of point f to an impulse at point e of the same tree is
    `response[first[e] + place[f] * count[e] + place[e]]`.

    :ivar velocity: at the end of the next step without contact [m/s], (E, 3).
    :ivar before: velocity at the beginning of the step [m/s], (E, 3).
    :ivar old_share: weight of `before` in the mean velocity of the step: one half, as
        points move with the mean of old and new velocities, or zero where a limit acts, (E,).
    :ivar energy: energy that contact may take from the whole tree: kinetic at the end of the step,
        and four times that of springs, the most released in an implicit step [J], (E,).
    :ivar held: whether a bend of the tree is at its limit; an impulse that lifts it off
        invalidates this response, (E,) bool.
    :ivar tree: number of the tree of each point, among the touched trees, (E,).
    :ivar first: start of the responses of this tree, (E,).
    :ivar place: index of the point among those on its tree, (E,).
    :ivar count: number of points on its tree, (E,).
    :ivar response: velocity per impulse [1/kg], (B, 3, 3).
    """

    velocity: np.ndarray
    before: np.ndarray
    old_share: np.ndarray
    energy: np.ndarray
    held: np.ndarray
    tree: np.ndarray
    first: np.ndarray
    place: np.ndarray
    count: np.ndarray
    response: np.ndarray

    def renewed(self, ends: np.ndarray, fresh: 'ContactResponse') -> 'ContactResponse':
        """
        Replace the predictions of some trees by new ones; points are sorted by tree.

        :param ends: mask of the points on them, (E,) bool.
        :param fresh: predictions of these points.
        """
        columns = {name: getattr(self, name).copy()
                   for name in ('velocity', 'before', 'old_share', 'energy', 'held')}
        for name, column in columns.items():
            column[ends] = getattr(fresh, name)
        response = self.response.copy()
        response[np.repeat(ends, self.count)] = fresh.response
        return replace(self, **columns, response=response)


def predict_response(plan: TraversalPlan, entry: np.ndarray, points: np.ndarray,
                     impulses: np.ndarray, model: tuple, state: ForestState,
                     workspaces: list[Scratch], wind: np.ndarray, gravity: np.ndarray, dt: float,
                     threads: int) -> ContactResponse:
    """
    Predict motion and response of points in one step; the state is unchanged.

    :param entry: entries of the touched rows in the plan, (E,).
    :param points: on these rows [m], (E, 3), world.
    :param impulses: at the points [N·s], (E, 3), or none, (0, 3).
    :param workspaces, threads: as of `parallel.step`.
    :param wind: of the next step, (S, 3).
    """
    trees, order, begin, tree, place = _by_tree(plan.start, entry)
    size = np.diff(begin)
    base = np.concatenate([[0], np.cumsum(size * size)])
    velocity, before = np.empty((len(entry), 3)), np.empty((len(entry), 3))
    old_share, energy = np.zeros(len(entry)), np.empty(len(entry))
    held = np.zeros(len(entry), bool)
    response = np.empty((int(base[-1]), 3, 3))

    def foresee(place: int, first: int, last: int) -> None:
        _foresee(plan, trees[first:last], order, begin[first:last + 1], base[first:last + 1],
                 entry, points, impulses, model, state, workspaces[place], wind, gravity, dt,
                 velocity, before, old_share, energy, held, response)
    work = np.diff(plan.start)[trees] * (1 + size)  # each impulse takes another pass of its tree
    ranges = pool.group_ranges(np.append(0, np.cumsum(work)), threads)
    parallel.run(foresee, ranges, plan, workspaces)
    return ContactResponse(velocity, before, old_share, energy, held, tree, base[tree], place,
                           size[tree], response)


@kernel
def _by_tree(start, entry):
    """
    Sort points by tree.

    :param start: of the plan.
    :param entry: of the points in the plan, (E,).
    :returns: trees, ascending, (T,); points tree by tree, (E,); start of the points of each tree,
        and their end, (T + 1,); tree of each point among these, (E,); and its index among the
        points of its tree, (E,).
    """
    owner = np.searchsorted(start, entry, side='right') - 1
    count = np.zeros(len(start) - 1, np.int64)
    place, tree = np.empty(len(entry), np.int64), np.empty(len(entry), np.int64)
    for e in range(len(entry)):
        place[e] = count[owner[e]]
        count[owner[e]] += 1
    trees = np.flatnonzero(count)
    begin = np.zeros(len(trees) + 1, np.int64)
    for n in range(len(trees)):
        begin[n + 1] = begin[n] + count[trees[n]]
        count[trees[n]] = n
    order = np.empty(len(entry), np.int64)
    for e in range(len(entry)):
        tree[e] = count[owner[e]]
        order[begin[tree[e]] + place[e]] = e
    return trees, order, begin, tree, place


@kernel(nogil=True)
def _foresee(plan, trees, order, begin, base, entry, points, impulses, model, state, scratch,
             wind, gravity, dt, velocity, before, old_share, energy, held, response):
    moved = np.empty(3)
    for n in range(len(trees)):
        first, last = plan.start[trees[n]], plan.start[trees[n] + 1]
        rows, above = plan.row[first:last], plan.above[first:last]
        ends = order[begin[n]:begin[n + 1]]
        own = entry[ends] - first
        kept = _kept(rows, state)
        if len(impulses):
            subset.push(rows[own], points[ends], impulses[ends], plan.root, state)
        theta = integrator.solve(rows, above, model, state, scratch, wind, gravity, dt)
        kicked = theta < 1.0 and state.struck[rows[0], 0] != 0.0
        limited = theta == 1.0 or state.stop[rows].any()
        whole = _energy(rows, model, state, scratch, dt, theta)
        for k, e in zip(own, ends):
            energy[e], held[e] = whole, limited
            arm = _arm(k, rows, model, state, points[e])
            _read(k, scratch.motion, arm, dt, velocity[e])
            _carried(k, rows, state, scratch, points[e], before[e])
            if theta < 1.0:
                velocity[e] -= before[e]  # the mean velocity twice, less the old one
                old_share[e] = 0.5
            if kicked:
                _read(k, scratch.kick, arm, 1.0, moved)
                velocity[e] += moved
        _respond(_paths(own, above), rows, above, model, state, scratch, own, points[ends],
                 response[base[n]:base[n + 1]])
        _put_back(rows, kept, state)


@subroutine
def _kept(rows, state):
    """Copy the state of one tree that a prediction changes."""
    return (state.stop[rows], state.push[rows], state.struck[rows], state.velocities[rows],
            state.carried[rows])


@subroutine
def _put_back(rows, kept, state):
    state.stop[rows], state.push[rows], state.struck[rows] = kept[0], kept[1], kept[2]
    state.velocities[rows], state.carried[rows] = kept[3], kept[4]


@subroutine
def _energy(rows, model, state, scratch, dt, theta):
    """Sum the energy that contact may take from one tree [J], see `ContactResponse`."""
    total, v = 0.0, np.empty(3)
    for k in range(len(rows)):
        i = rows[k]
        body, bend, axis = model.body[i], state.bend[i], state.middle[i, 9:]
        _read(k, scratch.motion, _reach(i, model, state) * axis, dt, v)
        spin = dt * scratch.motion[k, :3]
        if theta < 1.0:
            v -= state.carried[i, :3]
            spin -= scratch.spin[k]
        along = (spin * axis).sum()
        total += body[MASS] * (v ** 2).sum() + body[ACROSS] * (spin ** 2).sum() + (
            body[ALONG] - body[ACROSS]) * along ** 2
        if model.joint[i] != _FREE:
            total += _IMPLICIT * model.swing[i, STIFFNESS] * (bend[0] ** 2 + bend[1] ** 2)
        if model.joint[i] == _SPRUNG:
            for d in range(2):
                stiffness = model.extra[i, d * EXTRA_STRIDE + EXTRA_STIFFNESS]
                if bend[2 + d] != 0.0:
                    total += _IMPLICIT * stiffness * bend[2 + d] ** 2
    return 0.5 * total


@subroutine
def _paths(entry, above):
    """List the entries on the paths from some entries to the root, ascending."""
    passed = np.zeros(len(above), np.bool_)
    for k in entry:
        while k >= 0 and not passed[k]:
            passed[k] = True
            k = above[k]
    return np.flatnonzero(passed)


@subroutine
def _arm(k, rows, model, state, point):
    """Compute the arm from the joint point of entry k to a point, at the middle of the step."""
    i = rows[k]
    return point - state.poses[i, :3] + _reach(i, model, state) * state.middle[i, 9:]


@subroutine
def _read(k, motion, arm, scale, out):
    """Write the velocity of a point of entry k, multiplied by a scale."""
    x, y, z = arm
    m = motion[k]
    out[0] = scale * (m[3] + m[1] * z - m[2] * y)
    out[1] = scale * (m[4] + m[2] * x - m[0] * z)
    out[2] = scale * (m[5] + m[0] * y - m[1] * x)


@subroutine
def _carried(k, rows, state, scratch, point, out):
    """Write the velocity of a point of entry k at the start of the step."""
    i = rows[k]
    out[:] = state.carried[i, :3] + np.cross(scratch.spin[k], point - state.poses[i, :3])


@subroutine
def _respond(path, rows, above, model, state, scratch, entry, points, response):
    """Compute the responses of all points of one tree to unit impulses at each, (n², 3, 3)."""
    motion, f = scratch.motion, scratch.factor
    count = len(entry)
    moved, arms = np.empty(3), np.empty((count, 3))
    for e in range(count):
        arms[e] = _arm(entry[e], rows, model, state, points[e])
    for k in path:
        for d in range(4):
            f[k, d, 7] = 0.0
        for c in range(6):
            scratch.inertia[k, 21 + c] = 0.0
    for e in range(count):
        x, y, z = arms[e]
        hits = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))  # moments, transposed: see `push`
        for axis in range(3):
            one = (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0,
                   1.0 if axis == 2 else 0.0)
            push = (hits[0][axis], hits[1][axis], hits[2][axis], one[0], one[1], one[2])
            passed = _descend(entry[e], rows, above, model, state, scratch, push)
            _ascend(path, rows, above, model, state, scratch)
            for g in range(count):
                _read(entry[g], motion, arms[g], 1.0, moved)
                for c in range(3):
                    response[g * count + e, c, axis] = moved[c]
            for k in passed:
                for d in range(4):
                    f[k, d, 7] = 0.0


@subroutine
def _ascend(path, rows, above, model, state, scratch):
    """Propagate the motion caused by impulses from the root to the tips of some paths."""
    motion = scratch.motion
    for k in path:
        i = rows[k]
        if model.joint[i] == _FREE:
            joints.solve_free(k, scratch.inertia, scratch.root, motion)
            continue
        v = passes.handed_on(k, above[k], rows, state.middle, motion)
        v = joints.take_swing(i, k, 1.0, v, model.swing, state.stop, state.middle, scratch.factor,
                              scratch.jump)
        if model.joint[i] == _SPRUNG:
            v = joints.take_extra(i, k, 1.0, v, model.extra, state.middle, scratch.factor,
                                  scratch.jump)
        (motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3], motion[k, 4],
         motion[k, 5]) = v


@subroutine
def _reach(i, model, state):
    """Return the distance of the centre of mass of row i from its joint point [m]."""
    return model.body[i, REACH] + state.bend[i, 3]


@subroutine
def _descend(k, rows, above, model, state, scratch, push):
    """Propagate an impulse at entry k down to the root; return the entries on the path."""
    path = [k]
    while True:
        i, up = rows[path[-1]], above[path[-1]]
        if model.joint[i] == _FREE:
            for c in range(6):
                scratch.inertia[path[-1], 21 + c] = push[c]
            break
        push = passes.pass_on(i, path[-1], model, state.stop, state.middle, scratch.factor, push)
        if up < 0:
            break
        x, y, z = passes.apart(state.middle, i, rows[up])
        push = shift_load(push, x, y, z)
        path.append(up)
    return path
