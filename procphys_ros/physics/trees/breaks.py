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


"""Breaks: detection of overloaded joints."""

import math

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees.spatial import KERNEL

# Further columns of `layout.Rows.swing`, 0 where nothing was sawn: direction of the bends about
# the weakest axis, additional stiffness across it over that along it, least bend along it [rad].
WEAK_X, WEAK_Y, SIDE, FLOOR = range(7, 11)
# By columns of the capacities; the loads are a force [N], a torque [N·m], the bending stress
# M/Z [Pa] and the moment at the ground [N·m].
CAUSES = np.array([Cause.FORCE, Cause.TWIST, Cause.BENDING, Cause.UPROOTING])


@kernel(**KERNEL)
def find_overloads(rows, wrenches, frame, section, swing, stop, capacity, row_out, column_out,
                   load_out):
    """
    Find the overloaded rows; write row, column of the capacity exceeded most, and load.

    :param rows: rows to test.
    :param wrenches: force and moment at the joints [N], [N·m], (S, 6).
    :param frame: frames with the segment axis last, (S, 12).
    :param section: section modulus Z about the weakest axis [m³], (S,).
    :param swing: constants of the joints, see `layout`, (S, 11).
    :param stop: directions of bends that stops hold, (S, 2).
    :param capacity: break force [N], break torque [N·m], strength [Pa], root moment [N·m], (S, 4).
    :returns: number of overloaded rows.
    """
    found = 0
    for i in rows:
        f = wrenches[i]
        force = f[0] * f[0] + f[1] * f[1] + f[2] * f[2]
        twist = f[3] * frame[i, 9] + f[4] * frame[i, 10] + f[5] * frame[i, 11]
        bending = f[3] * f[3] + f[4] * f[4] + f[5] * f[5] - twist * twist
        if swing[i, SIDE] > 0.0:
            bending = _about_weakest(f, frame[i], swing[i], stop[i], bending)
        strong = capacity[i, 2] * section[i]
        if (force <= capacity[i, 0] ** 2 and abs(twist) <= capacity[i, 1]
                and bending <= strong * strong and bending <= capacity[i, 3] ** 2):
            continue  # comparing squares suffices for the many sound joints
        moment = math.sqrt(max(0.0, bending))
        loads = (math.sqrt(force), abs(twist), moment / section[i], moment)
        worst = 0.0
        for j in range(4):
            use = loads[j] / capacity[i, j]
            if use > worst:
                worst = use
                row_out[found] = i
                column_out[found] = j
                load_out[found] = loads[j]
        found += 1
    return found


@subroutine
def _about_weakest(f, frame, swing, stop, bending):
    """
    Compute the square of the moment about the weakest axis that would bend as much.

    What presses a cut shut is not borne by the wood that is left.
    """
    along = 0.0
    for c in range(3):
        along += f[3 + c] * (swing[WEAK_X] * frame[3 + c] + swing[WEAK_Y] * frame[6 + c])
    across = max(0.0, bending - along * along)
    if stop[0] * swing[WEAK_X] + stop[1] * swing[WEAK_Y] < 0.0:
        along = 0.0
    return along * along + across / (1.0 + swing[SIDE])


@kernel
def carried_rows(row, end, active, parents):
    """
    List the active rows of the subtree of a row, itself first.

    :param row: the row.
    :param end: one past the last row of its subtree when the tree was whole.
    :param active: (S,) bool.
    :param parents: rows of the parents, which come first, (S,).
    """
    carried = np.zeros(end - row, np.bool_)
    carried[0] = True
    for i in range(row + 1, end):
        parent = parents[i] - row
        carried[i - row] = active[i] and parent >= 0 and carried[parent]
    return row + np.flatnonzero(carried)


def weight_wrenches(mass: np.ndarray, places: np.ndarray, joints: np.ndarray, ends: np.ndarray,
                    gravity: np.ndarray) -> np.ndarray:
    """
    Compute force and moment of every joint under the weight of its subtree [N], [N·m], (S, 6).

    :param mass: of the rows in preorder [kg], (S,).
    :param places: centres of mass [m], (S, 3).
    :param joints: points of the joints [m], (S, 3).
    :param ends: one past the last row of each row's subtree, (S,).
    :param gravity: [m/s²], (3,).
    """
    sums = np.zeros((len(mass) + 1, 4))
    np.cumsum(mass[:, None] * np.column_stack([np.ones(len(mass)), places]), axis=0, out=sums[1:])
    carried = sums[ends] - sums[:-1]
    x, y, z = (carried[:, 1:] - carried[:, :1] * joints).T
    a, b, c = gravity
    moment = np.column_stack([y * c - z * b, z * a - x * c, x * b - y * a])
    return -np.column_stack([carried[:, :1] * gravity, moment])


def section_modulus(width: np.ndarray) -> np.ndarray:
    """Compute the section modulus Z = π·d³/32 of round sections of diameter d [m³]."""
    return np.pi / 32.0 * (width * width * width)
