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


"""State of the forest: flat arrays shared by the passes of the kernel."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.physics.trees import anchors, layout
from procphys_ros.physics.trees.spatial import FACTOR_WIDTH, WIDTH

# Columns of `ForestState.frame`: joint point [m], first and second bending axis, segment axis.
POINT, FIRST, SECOND, AXIS = 0, 3, 6, 9


class SegmentJoint(ArrayEnum):
    """Joint between a segment and its parent."""

    SWING = 0   # bends in two directions
    SPRUNG = 1  # bends, and twists or stretches
    FREE = 2    # none: root of a broken-off tree


class ForestModel(NamedTuple):
    """Constants, one row per segment; columns named in `layout`."""

    mount: np.ndarray   # (S, 7)
    body: np.ndarray    # (S, 8)
    swing: np.ndarray   # (S, 11)
    extra: np.ndarray   # (S, 6)
    joint: np.ndarray   # `SegmentJoint`, (S,); changes when a part is released


class ForestState(NamedTuple):
    """Variables, one row per segment; world axes."""

    bend: np.ndarray        # bends about the two axes, twist [rad], stretch [m], (S, 4)
    kept: np.ndarray        # bends that the joint would have without load [rad], and what its
    #                         yield moment has gained by them [N·m], (S, 3)
    stop: np.ndarray        # direction of a bend held at its limit, zero when free, (S, 2)
    frame: np.ndarray       # see the column names above, (S, 12)
    middle: np.ndarray      # the same, extrapolated to the middle of the next step, (S, 12)
    poses: np.ndarray       # centre of mass and attitude [m], (S, 7)
    velocities: np.ndarray  # linear of the centre of mass, angular [m/s], [rad/s], (S, 6)
    carried: np.ndarray     # the same at the end of the last step; the difference of velocities is
    #                         an impulse for the next step, (S, 6)
    wrenches: np.ndarray    # force and moment from the parent at the joint [N], [N·m], (S, 6)
    push: np.ndarray        # pending linear and angular impulse at the centre of mass, applied in
    #                         the next step [N·s], [N·m·s], (S, 6)
    struck: np.ndarray      # not 0: at root rows, when the tree has pending impulses; and, at all
    #                         rows, when any part of the tree was ever anchored, (S, 2)
    age: np.ndarray         # at root rows: steps taken in motion, (S, 1)
    anchor: np.ndarray      # columns named in `anchors`, (S, 8)


class Scratch(NamedTuple):
    """Workspace for one tree at a time, small enough to stay in the processor's cache."""

    inertia: np.ndarray  # `spatial` rows, (n, 27)
    factor: np.ndarray   # per degree of freedom, (n, 4, 8)
    motion: np.ndarray   # angular and linear velocity over the time, at the joint point, (n, 6)
    kick: np.ndarray     # velocity change by impulses, not over the time, (n, 6)
    jump: np.ndarray     # change of joint rates by impulses, (n, 4)
    blow: np.ndarray     # impulses that joints transmit, as `ForestState.wrenches`, (n, 6)
    spin: np.ndarray     # carried spin, rotated with the axis to the middle of the step, (n, 3)
    rate: np.ndarray     # mean joint rates over the step, (n, 4)
    before: np.ndarray   # bends, twist and stretch before the step, (n, 4)
    bound: np.ndarray    # rate at which a held bend just reaches its limit [rad/s], (n,)
    root: np.ndarray     # equations of a free root, (6, 7)


class TraversalPlan(NamedTuple):
    """Active rows, tree by tree, parents first."""

    row: np.ndarray    # (A,) int
    above: np.ndarray  # parent's index within its tree, -1 for a root, (A,) int
    start: np.ndarray  # first entry of each tree, and the end, (T + 1,) int
    root: np.ndarray   # first row of the tree of each row, active or not, (S,) int


def make_model(rows: layout.Rows) -> ForestModel:
    """Build the model, which shares the arrays of the layout."""
    locked = np.isinf(rows.extra[:, layout.EXTRA_STIFFNESS]) & np.isinf(
        rows.extra[:, layout.EXTRA_STRIDE + layout.EXTRA_STIFFNESS])
    joint = np.where(locked, SegmentJoint.SWING, SegmentJoint.SPRUNG).astype(np.uint8)
    return ForestModel(rows.mount, rows.body, rows.swing, rows.extra, joint)


def make_state(count: int) -> ForestState:
    """Allocate a state at rest; poses are placed later."""
    widths = 4, 3, 2, 12, 12, 7, 6, 6, 6, 6, 2, 1, anchors.WIDTH
    return ForestState(*(np.zeros((count, width)) for width in widths))


def make_scratch(plan: TraversalPlan) -> Scratch:
    """Allocate a workspace for the largest tree."""
    size = int(np.diff(plan.start).max(initial=1))
    return Scratch(inertia=np.zeros((size, WIDTH)), factor=np.zeros((size, 4, FACTOR_WIDTH)),
                   motion=np.zeros((size, 6)), kick=np.zeros((size, 6)), jump=np.zeros((size, 4)),
                   blow=np.zeros((size, 6)), spin=np.zeros((size, 3)), rate=np.zeros((size, 4)),
                   before=np.zeros((size, 4)), bound=np.zeros(size), root=np.zeros((6, 7)))


def make_plan(parent: np.ndarray, active: np.ndarray) -> TraversalPlan:
    """
    Gather the active rows by tree.

    :param parent: row of the parent, -1 for roots; parents come first, (S,).
    :param active: (S,) bool; the parent of an active row is active.
    """
    return TraversalPlan(*_gather(parent, active))


@kernel
def _gather(parent, active):
    root, count = np.arange(len(parent)), np.zeros(len(parent), np.int64)
    for i in range(len(parent)):
        if parent[i] >= 0:
            root[i] = root[parent[i]]
        count[root[i]] += active[i]
    roots = np.flatnonzero(count)
    start, place = np.zeros(len(roots) + 1, np.int64), np.empty(len(parent), np.int64)
    for t in range(len(roots)):
        start[t + 1] = start[t] + count[roots[t]]
        count[roots[t]] = start[t]  # from now on, entry of the next row of this tree
    row, above = np.empty(start[-1], np.int64), np.full(start[-1], -1)
    for i in range(len(parent)):
        if active[i]:
            place[i] = count[root[i]]
            row[place[i]] = i
            count[root[i]] += 1
            if parent[i] >= 0:
                above[place[i]] = place[parent[i]] - place[root[i]]
    return row, above, start, root
