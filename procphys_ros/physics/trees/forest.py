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


"""Forest: the trees of a scene as articulated bodies that sway, collide and break."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, norm, product
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.gravity import GRAVITY
from procphys_ros.physics.trees import (
    anchors,
    breaks,
    contact_response,
    growing,
    modes,
    parallel,
    passes,
    pose,
    sections,
    state,
    subset,
)
from procphys_ros.physics.trees.anchors import Anchors
from procphys_ros.physics.trees.breaks import FLOOR, SIDE, WEAK_X, WEAK_Y
from procphys_ros.physics.trees.buckling import buckling_shares
from procphys_ros.physics.trees.layout import (
    ACROSS,
    ALONG,
    arrange,
    DAMPING,
    EXTRA_PRELOAD,
    EXTRA_STIFFNESS,
    EXTRA_STRIDE,
    HARDENING,
    LEAF_FLOW,
    LENGTH,
    MASS,
    PRELOAD_X,
    PRELOAD_Y,
    set_damping,
    STIFFNESS,
    YIELD,
)

_SAGGED, _LEANT = 1e-12, 1e-6  # [rad], [m] change of joints at which trees are in equilibrium
_TIME_STEP = 1.0 / 60.0  # [s], for effective masses before the first step
_INERTIA = [MASS, ACROSS, ALONG]
_CUTS = [WEAK_X, WEAK_Y, FLOOR]
_SPRINGS = [STIFFNESS, DAMPING, HARDENING, PRELOAD_X, PRELOAD_Y]


class Forest:
    """
    Hinged parts of a blueprint, moved by an O(n) articulated kernel.

    Rows are the segments in depth-first preorder: parents come first, every subtree is a range.
    A tree at rest is preloaded against its weight and stays exactly as authored, except for
    joints with less preload: they have sagged before the first step. Poses
    are those at the end of the last step; velocities are those carried into the next one.

    :ivar parts: part index of each row, (S,).
    :ivar bonds: bond index of each row's joint, (S,).
    :ivar parents: parent of each row, -1 for roots, (S,).
    :ivar ends: one past the last row of each row's subtree, (S,).
    :ivar active: rows that the kernel moves, (S,) bool.
    :ivar poses: centre of mass and attitude xyzw [m], (S, 7), world; constant for inactive rows.
    :ivar velocities: linear of the centre of mass and angular [m/s], [rad/s], (S, 6), world.
    :ivar bends: joint coordinates: bends about the two axes, twist [rad], stretch [m], (S, 4).
    :ivar joint_wrenches: force and moment that the parent exerts on the segment at the joint in
        its last step [N], [N·m], (S, 6), world; NaN before its first step, 0 without a joint.
    :ivar snow: mass of snow and ice on each segment, where its own is [kg], (S,).
    """

    _model: state.ForestModel
    _state: state.ForestState
    _plan: state.TraversalPlan
    _scratches: list[state.Scratch]
    _stepped: np.ndarray | None

    def __init__(self, blueprint: Blueprint, gravity: Sequence[float] = (0.0, 0.0, -GRAVITY),
                 air_density: float = AIR_DENSITY, climbers: Anchors | None = None) -> None:
        """
        Arrange the trees and balance their weight.

        :param blueprint: other parts than trees are left out.
        :param gravity: [m/s²], (3,).
        :param air_density: [kg/m³]; 0 for a vacuum.
        :param climbers: anchors of climbing plants; None = none.
        :raises SceneError: when the hinges do not form trees.
        """
        rows = arrange(blueprint, air_density)
        self.parts, self.bonds, self.ends = rows.part, rows.bond, rows.end
        self._gravity = self._felt = np.asarray(gravity, float)
        self._rooted = rows.parent.copy()
        self._model = state.make_model(rows)
        self._joints = self._model.joint.copy()
        self._foliage = self._model.body[:, LEAF_FLOW].copy()
        self._bare = self._model.body[:, _INERTIA]
        self.snow = np.zeros(len(rows.part))
        self._left = np.ones((len(rows.part), 3))
        self._state = state.make_state(len(rows.part))
        self._still = np.zeros((len(rows.part), 3))
        hinges = blueprint.hinges
        self._section = breaks.section_modulus(rows.width)
        self._capacity = np.column_stack([hinges.break_force, hinges.break_torque,
                                          hinges.strength, hinges.root_moment])[rows.hinge]
        self._rest = [np.zeros_like(column) for column in (self._state.bend, self._state.kept)]
        self._anchors = np.zeros_like(self._state.anchor)
        self.reset()
        anchored = self._load_anchors(climbers or Anchors.none())
        ratio = hinges.damping_ratio[rows.hinge]
        set_damping(rows, modes.damping_rate(rows, ratio, self._state.frame))
        passes.balance(self._plan, self._model, self._state, self._scratches[0], self._gravity,
                       _TIME_STEP)
        share = hinges.preload[rows.hinge][:, None]
        self._model.swing[:, [PRELOAD_X, PRELOAD_Y]] *= share
        self._model.extra[:, [EXTRA_PRELOAD, EXTRA_STRIDE + EXTRA_PRELOAD]] *= share
        if (share < 1.0).any():
            self.lean(np.arange(len(self._plan.start) - 1), None, goal=_SAGGED)
            self._rest = [self._state.bend.copy(), self._state.kept.copy()]
            self.reset()
        self._anchors = anchored
        self._anchors[:, anchors.TARGET:anchors.FORCE] = self.poses[:, :3]
        anchors.place(self._state, self._anchors, self._rooted)
        self._rest_height = product(self.poses[:, :3], self._gravity)

    def __len__(self) -> int:
        return len(self.parts)

    @property
    def model(self) -> state.ForestModel:
        """Constants of all rows, read-only; columns are named in `layout`."""
        return self._model

    @property
    def poses(self) -> np.ndarray:
        return self._state.poses

    @property
    def velocities(self) -> np.ndarray:
        return self._state.velocities

    @property
    def has_sagged(self) -> bool:
        """Return whether weight bends any joint before the first step."""
        return bool(self._rest[0].any())

    @property
    def bends(self) -> np.ndarray:
        return self._state.bend

    @property
    def joint_wrenches(self) -> np.ndarray:
        return self._state.wrenches

    def reset(self) -> None:
        """Reset to the rest pose without damage, bit for bit as first built."""
        for column in self._state:
            column[:] = 0.0
        self._state.wrenches[:] = np.nan
        self._state.bend[:], self._state.kept[:] = self._rest
        anchors.place(self._state, self._anchors, self._rooted)
        self._model.joint[:] = self._joints
        self._model.body[:, LEAF_FLOW] = self._foliage
        self._model.body[:, _INERTIA], self.snow[:] = self._bare, 0.0
        self.parents = self._rooted.copy()
        self.active = np.ones(len(self.parts), bool)
        self._wind = self._still
        self._time_step = _TIME_STEP
        self._stepped = None
        self._disturbed = np.zeros(len(self.parts), bool)
        self._replan()
        pose.place_all(self._plan, self._model, self._state)

    def step(self, dt: float, wind: np.ndarray | None = None, threads: int = 1) -> None:
        """
        Advance all active rows.

        :param dt: time step [s].
        :param wind: air velocity at the centres of mass [m/s], (S, 3), world; None = still air.
        :param threads: largest number of threads; results do not depend on it, to the last bit.
        :raises ValueError: when the wind has another shape.
        """
        trees = np.arange(len(self.plan.start) - 1)
        self.step_some(trees, np.ones(len(trees)), dt, wind, threads)
        self._stepped = None

    def set_felt_gravity(self, gravity: np.ndarray) -> None:
        """Set gravity less the acceleration of the ground, for the next steps [m/s²], (3,)."""
        self._felt = np.asarray(gravity, float)

    def lean(self, trees: np.ndarray, wind: np.ndarray | None, threads: int = 1,
             goal: float = _LEANT) -> None:
        """
        Set trees to their static equilibrium in a steady wind, at any load of their joints.

        :param trees: indices of the trees in `plan`, (K,).
        :param wind: as for `step`; read at the rows of these trees only.
        :param threads: as for `step`.
        :param goal: tolerance of the joints [rad] or [m].
        """
        self._breathe(self._time_step, wind)
        parallel.lean(self._plan, trees, self._model, self._state, self._scratches, self._wind,
                      self._gravity, goal, threads)

    def step_some(self, trees: np.ndarray, steps: np.ndarray, dt: float,
                  wind: np.ndarray | None = None, threads: int = 1) -> None:
        """
        Advance some trees, at a cost proportional to their size; the others do not move.

        :param trees: indices of the trees in `plan`, (K,).
        :param steps: number of time steps that each takes in one, (K,).
        :param dt: time step [s].
        :param wind: as for `step`; read at the rows of these trees only.
        :param threads: as for `step`.
        """
        self._stepped = self.rows_of(trees)
        self._breathe(dt, wind)
        parallel.step(self._plan, trees, steps * self._time_step, self._model, self._state,
                      self._scratches, self._wind, self._felt, threads)

    def rows_of(self, trees: np.ndarray) -> np.ndarray:
        """List the rows of some trees of `plan`, tree by tree."""
        return subset.rows_of(self.plan, trees)

    def adopt(self, other: 'Forest', rows: np.ndarray | None = None) -> None:
        """
        Copy state and constants of another forest whose segments are all here.

        :param rows: of its rows here, (S',); None = the first ones.
        """
        rows = np.arange(len(other)) if rows is None else rows
        columns = ((*f._state, *f._model, f._section, f._capacity, f._foliage, f.active,
                    f._disturbed, f._bare, f.snow, f._left) for f in (self, other))
        for mine, theirs in zip(*columns):
            mine[rows] = theirs
        self.parents[rows[(other.parents < 0)]] = -1
        self._time_step, self._stale, self._felt = other._time_step, True, other._felt

    @property
    def constants(self) -> np.ndarray:
        """Constants of all rows that growth changes, columns named in `growing`, (S, 33)."""
        model, body = self._model, self._model.body.copy()
        body[:, _INERTIA] = self._bare
        swing, section = model.swing, self._section
        if (self._left != 1.0).any():
            swing, section = swing.copy(), section / self._left[:, 1]
            swing[:, _SPRINGS] /= self._left[:, :1]
            swing[:, YIELD] /= self._left[:, 1]
            swing[:, [*_CUTS, SIDE]] = 0.0
        return np.hstack([model.mount, body, swing, model.extra, section[:, None]])

    def change(self, rows: np.ndarray, constants: np.ndarray, leaves: np.ndarray) -> None:
        """
        Change constants of rooted trees; bends stay.

        Mass that is added is at rest: momenta stay, too. Mass that is lost takes its own along.

        :param rows: active rows, (K,).
        :param constants: new ones, as in `constants`, (K, 33).
        :param leaves: share of their leaf area left, 0 to 1, (K,).
        """
        before, cuts = self._model.body[rows][:, _INERTIA], self._model.swing[rows][:, _CUTS]
        for column, block in zip(self._model, growing.BLOCKS):
            column[rows] = constants[:, block]
        self._bare[rows] = self._model.body[rows][:, _INERTIA]
        self._bear(rows, before)
        self._section[rows] = constants[:, growing.SECTION]
        self._model.swing[rows[:, None], _CUTS] = cuts
        self._leave(rows, self._left[rows])
        self._foliage[rows] = self._model.body[rows, LEAF_FLOW]
        self.keep_leaves(rows, leaves)
        trees = np.unique(np.searchsorted(self.plan.start, self._entry[rows], side='right') - 1)
        pose.shift(self._plan, trees, self._model, self._state, np.empty(12))

    def begin_cuts(self, rows: np.ndarray, ways: np.ndarray) -> None:
        """
        Begin cuts into joints of segments, in the place of those that they have.

        :param rows: of the segments, (K,).
        :param ways: the cuts go, (K, 3), world; they shut as far as they are now.
        """
        frame = self._state.frame[rows]
        about = cross(frame[:, state.AXIS:], ways)
        weakest = np.column_stack([(about * frame[:, start:start + 3]).sum(axis=1)
                                   for start in (state.FIRST, state.SECOND)])
        weakest /= np.maximum(norm(weakest, axis=1), 1e-12)[:, None]
        floor = (weakest * self._state.bend[rows, :2]).sum(axis=1)
        self._model.swing[rows[:, None], _CUTS] = np.column_stack([weakest, floor])

    def saw(self, rows: np.ndarray, section: sections.Section) -> None:
        """
        Reduce the joints of segments to what is left of them; what they hold sags.

        :param rows: of the segments, with cuts that have begun, (K,).
        :param section: of their joints, whatever was left of them before.
        """
        left, now = self._left[rows], np.column_stack(section)
        self._leave(rows, now / left)
        self._left[rows] = now
        self._disturbed[rows] = True

    def is_cut(self, rows: np.ndarray) -> np.ndarray:
        """Mark the segments with cuts into their joints, (K,) bool."""
        return (self._left[rows] != 1.0).any(axis=1)

    def wedge(self, rows: np.ndarray, angles: np.ndarray) -> None:
        """
        Drive the cuts in joints further open.

        :param rows: of the segments, (K,).
        :param angles: by which they can shut less far [rad], (K,).
        """
        self._model.swing[rows, FLOOR] += angles
        self._disturbed[rows] = True

    def _leave(self, rows: np.ndarray, factor: np.ndarray) -> None:
        """
        Multiply what joints bear.

        :param factor: of stiffness, strength and the ratio of sides of their sections, (K, 3).
        """
        cut = (factor != 1.0).any(axis=1)
        rows, factor, swing = rows[cut], factor[cut], self._model.swing
        swing[rows[:, None], _SPRINGS] *= factor[:, :1]
        swing[rows, YIELD] *= factor[:, 1]
        self._section[rows] *= factor[:, 1]
        swing[rows, SIDE] = np.square(factor[:, 2]) * (1.0 + swing[rows, SIDE]) - 1.0

    def carry_snow(self, rows: np.ndarray, mass: np.ndarray) -> None:
        """
        Set the snow and ice on segments; what is added is at rest, what is lost moves on.

        :param rows: of the segments, (K,).
        :param mass: on each [kg], (K,).
        """
        before = self._model.body[rows][:, _INERTIA]
        self.snow[rows] = mass
        self._bear(rows, before)

    def _bear(self, rows: np.ndarray, before: np.ndarray) -> None:
        """Set what segments weigh with their snow, and slow down those that were lighter."""
        bare = self._bare[rows]
        now = bare * (1.0 + self.snow[rows] / bare[:, 0])[:, None]
        self._model.body[rows[:, None], _INERTIA] = now
        slower = np.minimum(before[:, :2] / now[:, :2], 1.0)
        for column in (self._state.velocities, self._state.carried):
            column[rows] *= np.repeat(slower, 3, axis=1)

    def balanced(self, constants: np.ndarray) -> np.ndarray:
        """
        Change all constants, reset, and return the full preloads at rest, (S, 4).

        :param constants: new ones, as in `constants`; their preloads are ignored, (S, 33).
        """
        constants = constants.copy()
        constants[:, growing.PRELOADS] = 0.0
        for column, block in zip(self._model, growing.BLOCKS):
            column[:] = constants[:, block]
        for column in self._state:
            column[:] = 0.0
        pose.place_all(self._plan, self._model, self._state)
        passes.balance(self._plan, self._model, self._state, self._scratches[0], self._gravity,
                       _TIME_STEP)
        return self.constants[:, growing.PRELOADS]

    def rest_frames(self) -> np.ndarray:
        """Compute the frames of all joints of whole trees at rest [m], world, (S, 7)."""
        frames, up = self._model.mount.copy(), self._rooted
        depth = np.zeros(len(up), np.intp)
        while (up >= 0).any():
            depth += up >= 0
            up = np.where(up >= 0, self._rooted[up], -1)
        for level in range(1, int(depth.max(initial=0)) + 1):
            rows = np.flatnonzero(depth == level)
            frames[rows] = rotation.compose(frames[self._rooted[rows]], frames[rows])
        return frames

    def follow(self, rows: np.ndarray) -> None:
        """Move new segments with those that they grow from, (K,)."""
        now, left = self._state, rows[self.parents[rows] >= 0]
        while len(left):  # parents first
            waits = np.isin(self.parents[left], left)
            ready, left = left[~waits], left[waits]
            up = self.parents[ready]
            arm, spin = now.poses[ready, :3] - now.poses[up, :3], now.velocities[up, 3:]
            now.velocities[ready, :3] = now.velocities[up, :3] + cross(spin, arm)
            now.velocities[ready, 3:] = spin
            now.carried[ready] = now.velocities[ready]

    def hold(self, trees: np.ndarray) -> None:
        """Stop some trees of `plan` at their present bends, and drop pending impulses."""
        subset.hold(self.rows_of(trees), self._state)

    def kinetic(self, trees: np.ndarray) -> np.ndarray:
        """Compute the kinetic energy per mass of some trees of `plan` [J/kg], (K,)."""
        return subset.kinetic(self.plan, trees, self._model.body, self._state)

    @property
    def section(self) -> np.ndarray:
        """Section modulus of every joint about its weakest axis [m³], (S,)."""
        return self._section

    @property
    def half_lengths(self) -> np.ndarray:
        """Half the length of every segment [m], (S,)."""
        return 0.5 * self._model.body[:, LENGTH]

    def take_disturbed(self) -> np.ndarray:
        """List and clear the rows that got an impulse or lost a branch since the last call."""
        rows = np.flatnonzero(self._disturbed)
        self._disturbed[rows] = False
        return rows

    def overloaded(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """
        Find the joints that the last step loaded beyond their strength.

        :returns: rows, `causes.Cause`, loads ([N], [N·m] or [Pa] by cause) and bond indices.
        """
        if self._stale:
            self._replan()
        row, column, load = self._found
        judged = self._plan.row if self._stepped is None else self._stepped
        count = breaks.find_overloads(judged, self._state.wrenches, self._state.frame,
                                      self._section, self._model.swing, self._state.stop,
                                      self._capacity, row, column, load)
        rows = row[:count].copy()
        return rows, breaks.CAUSES[column[:count]], load[:count].copy(), self.bonds[rows]

    def overloaded_by_weight(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """
        Find the joints overloaded by the weight of their subtrees, at the present poses.

        Anchored rows of climbing plants, and those below them, are left out.

        :returns: rows, `causes.Cause`, and loads over capacities of the joints.
        """
        now = self._state
        wrenches = breaks.weight_wrenches(self._model.body[:, MASS], now.poses[:, :3],
                                          now.frame[:, :3], self.ends, self._gravity)
        held = np.concatenate([[0], np.cumsum(now.anchor[:, anchors.STIFFNESS] > 0.0)])
        rows = np.flatnonzero(self.active & (held[self.ends] == held[:-1]))
        row, column, load = (np.empty(len(self.parts), of) for of in (np.int64, np.int64, float))
        count = breaks.find_overloads(rows, wrenches, now.frame, self._section, self._model.swing,
                                      now.stop, self._capacity, row, column, load)
        row, column = row[:count], column[:count]
        return row, breaks.CAUSES[column], load[:count] / self._capacity[row, column]

    def buckling(self) -> tuple[np.ndarray, np.ndarray]:
        """
        Find the share of its weight at which each tree of `plan` buckles at its present pose.

        :returns: root rows, and shares; inf for trees that lean on anchors, (K,) each.
        """
        now = self._state
        roots = np.flatnonzero(self.active & (self.parents < 0) & ~self.is_free(slice(None)))
        shares = buckling_shares(
            roots, self.ends, self.parents, np.ascontiguousarray(self._model.swing[:, STIFFNESS]),
            np.ascontiguousarray(self._model.body[:, MASS]),
            np.ascontiguousarray(now.poses[:, 2]), np.ascontiguousarray(now.frame[:, 2]),
            float(-self._gravity[2]))
        held = np.concatenate([[0], np.cumsum(now.anchor[:, anchors.STIFFNESS] > 0.0)])
        return roots, np.where(held[self.ends[roots]] > held[roots], np.inf, shares)

    def subtree(self, row: int) -> np.ndarray:
        """List the active rows of the subtree of a row, itself first."""
        return breaks.carried_rows(int(row), int(self.ends[row]), self.active, self.parents)

    def detach(self, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """
        Remove a subtree from the articulation; its rows become inactive and cost no time.

        :param row: root row of the subtree.
        :returns: rows, poses (K, 7) and velocities (K, 6) as they are now.
        """
        rows = self.subtree(row)
        self._shed_snow(rows)
        taken = rows, self.poses[rows].copy(), self.velocities[rows].copy()
        self._disturb(self.parents[row])
        self.active[rows] = False
        self._state.wrenches[rows] = 0.0
        self._state.anchor[rows, anchors.STIFFNESS] = 0.0
        self._stale = True
        return taken

    def release(self, row: int) -> None:
        """
        Cut a joint: the subtree continues as a tree with a free root, with its momentum.

        :param row: root row of the subtree.
        """
        self._shed_snow(self.subtree(row))
        self._disturb(self.parents[row])
        self._model.joint[row] = state.SegmentJoint.FREE
        self.parents[row] = -1
        self._state.stop[row] = 0.0
        self._state.wrenches[row] = 0.0
        self._stale = True

    def _shed_snow(self, rows: np.ndarray) -> None:
        if self.snow[rows].any():
            self.carry_snow(rows, np.zeros(len(rows)))

    def keep_leaves(self, rows: np.ndarray, share: np.ndarray) -> None:
        """
        Reduce the leaves of segments to a share of the initial ones, and their drag.

        :param rows: of the segments, (K,).
        :param share: remaining share of their leaf area, 0 to 1, (K,).
        """
        self._model.body[rows, LEAF_FLOW] = share * self._foliage[rows]

    def apply_impulse(self, row: int, point: Sequence[float] | np.ndarray | None = None,
                      linear: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
                      angular: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)) -> None:
        """
        Apply an impulse to a segment; the next step distributes it exactly over the tree.

        :param row: the segment.
        :param point: point of the linear impulse [m], (3,), world; None = centre of mass.
        :param linear: [N·s], (3,), world.
        :param angular: [N·m·s], (3,), world.
        """
        body, axis = self._model.body[row], self._state.frame[row, state.AXIS:]
        turn = np.asarray(angular, float)
        if point is not None:
            arm = np.asarray(point, float) - self.poses[row, :3]
            turn = turn + cross(arm, np.asarray(linear))
        spin = product(axis, turn)
        self.velocities[row, :3] += np.asarray(linear, float) / body[MASS]
        self.velocities[row, 3:] += (turn - spin * axis) / body[ACROSS] + spin * axis / body[ALONG]
        self._disturb(row)

    @property
    def anchors(self) -> np.ndarray:
        """Anchors of all rows, columns named in `anchors`; `rest_anchors` are those at rest."""
        return self._state.anchor

    @property
    def rest_anchors(self) -> np.ndarray:
        return self._anchors

    def cut_anchors(self, rows: np.ndarray, hosts: np.ndarray) -> None:
        """
        Release segments, and remove their load from their hosts.

        :param rows: of the segments, (K,).
        :param hosts: rows of the host trees, -1 for walls, (K,).
        """
        anchors.cut(self._state.anchor, self._anchors, rows, hosts)
        self._disturbed[rows] = True

    def push(self, rows: np.ndarray, points: np.ndarray, impulses: np.ndarray) -> None:
        """
        Apply impulses in the next step, exactly, also to very light segments.

        Unlike with `apply_impulse`, velocities are unchanged until then, so that drag does not
        act on the speed that a twig would have if it took up the impulse alone.

        :param rows: the segments, (K,).
        :param points: points of action [m], (K, 3), world.
        :param impulses: [N·s], (K, 3), world.
        """
        subset.push(rows, np.ascontiguousarray(points), np.ascontiguousarray(impulses),
                    self.plan.root, self._state)

    def roots(self, rows: np.ndarray) -> np.ndarray:
        """Return the root rows of the trees of active rows, (K,)."""
        return self.plan.root[rows]

    def masses(self, rows: np.ndarray) -> np.ndarray:
        """Compute the masses of the trees of active rows [kg], (K,)."""
        return subset.masses(self.plan, self._entry[rows], self._model.body)

    @property
    def plan(self) -> state.TraversalPlan:
        """Active rows tree by tree, read-only."""
        if self._stale:
            self._replan()
        return self._plan

    @property
    def free_roots(self) -> np.ndarray:
        """Root rows of the released trees that are still active, ascending."""
        return np.flatnonzero(self.active & (self._model.joint == state.SegmentJoint.FREE))

    def is_free(self, roots: np.ndarray | slice) -> np.ndarray:
        """Mark the root rows of released trees, (K,) bool."""
        return self._model.joint[roots] == state.SegmentJoint.FREE

    def predict_response(self, rows: np.ndarray, points: np.ndarray, dt: float,
                         wind: np.ndarray | None = None, impulses: np.ndarray | None = None,
                         threads: int = 1) -> contact_response.ContactResponse:
        """
        Predict the motion of points in the next step, and its response to impulses.

        :param rows: active rows, (E,).
        :param points: on them [m], (E, 3), world.
        :param dt: of the next step [s].
        :param wind: of the next step, as for `step`.
        :param impulses: at the points, as if they had been pushed [N·s], (E, 3).
        :param threads: as for `step`.
        """
        plan = self.plan
        wind = self._still if wind is None else np.ascontiguousarray(wind, float)
        impulses = np.zeros((0, 3)) if impulses is None else np.ascontiguousarray(impulses, float)
        return contact_response.predict_response(
            plan, self._entry[rows], np.ascontiguousarray(points), impulses, self._model,
            self._state, self._scratches, wind, self._felt, float(dt), threads)

    def energy(self) -> float:
        """Compute the mechanical energy of the active rows above that of the rest pose [J]."""
        moving = self.active
        bend, (swing, extra) = self._state.bend[moving], (self._model.swing[moving],
                                                          self._model.extra[moving])
        body, v = self._model.body[moving], self.velocities[moving]
        spin = np.einsum('ij,ij->i', v[:, 3:], self._state.frame[moving, state.AXIS:])
        moves, turns = ((w * w).sum(axis=1) for w in (v[:, :3], v[:, 3:]))
        kinetic = body[:, MASS] * moves + body[:, ACROSS] * turns
        kinetic += (body[:, ALONG] - body[:, ACROSS]) * (spin * spin)
        height = product(self.poses[moving, :3], self._gravity) - self._rest_height[moving]
        anchored = anchors.energy(self._state.anchor[moving], self.poses[moving, :3])
        elastic = swing[:, STIFFNESS] * (bend[:, :2] * bend[:, :2]).sum(axis=1)
        kept = swing[:, [STIFFNESS]] * self._state.kept[moving, :2]
        elastic += (kept * self._state.kept[moving, :2]).sum(axis=1)
        across = swing[:, WEAK_X] * bend[:, 1] - swing[:, WEAK_Y] * bend[:, 0]
        elastic += swing[:, STIFFNESS] * swing[:, SIDE] * (across * across)
        preload = ((swing[:, [PRELOAD_X, PRELOAD_Y]] + kept) * bend[:, :2]).sum(axis=1)
        for j, c in ((2, 0), (3, EXTRA_STRIDE)):
            sprung = np.isfinite(extra[:, c + EXTRA_STIFFNESS])
            q = np.where(sprung, bend[:, j], 0.0)
            elastic += np.where(sprung, extra[:, c + EXTRA_STIFFNESS], 0.0) * (q * q)
            preload += extra[:, c + EXTRA_PRELOAD] * q
        held = self._model.joint[moving] != state.SegmentJoint.FREE
        return float((0.5 * kinetic - body[:, MASS] * height + anchored).sum()
                     + (0.5 * elastic - preload)[held].sum())

    def _load_anchors(self, climbers: Anchors) -> np.ndarray:
        """Apply the rest loads of anchors; return the anchors with their springs, (S, 8)."""
        mass = self._model.body[:, MASS]
        made = anchors.make(climbers, self.parts, self._rooted, mass, self._gravity)
        self._anchors[:, anchors.FORCE:] = made[:, anchors.FORCE:]
        anchors.place(self._state, self._anchors, self._rooted)
        return made

    def _breathe(self, dt: float, wind: np.ndarray | None) -> None:
        """Set time step and wind of the next step."""
        if self._stale:
            self._replan()
        self._time_step = float(dt)
        self._wind = self._still if wind is None else np.ascontiguousarray(wind, float)
        if self._wind.shape != self._still.shape:
            raise ValueError(f'wind is {self._wind.shape}, but must be {self._still.shape}')

    def _disturb(self, row: int) -> None:
        if row >= 0:
            self._disturbed[row] = True

    def _replan(self) -> None:
        self._plan = state.make_plan(self.parents, self.active)
        self._scratches = [state.make_scratch(self._plan)]
        count = len(self._plan.row)
        self._entry = np.full(len(self.parts), -1, np.int64)
        self._entry[self._plan.row] = np.arange(count)
        self._found = (np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count))
        self._stale = False
