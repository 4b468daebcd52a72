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


"""Modes: fundamental frequencies of branches, which convert damping ratios to dampers."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear_kernels import dot
from procphys_ros.physics.trees.layout import (
    ACROSS,
    ALONG,
    EXTRA_STIFFNESS,
    EXTRA_STRIDE,
    MASS,
    REACH,
    Rows,
    STIFFNESS,
)

_ITERATIONS = 6  # inverse iteration gains (ω1/ω2)² ≈ 1/39 per turn on a uniform cantilever


def damping_rate(rows: Rows, ratio: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """
    Compute β = 2ζ/ω1 so that dampers c = β·k damp the first mode of each branch with ratio ζ.

    A branch is an axis with all its subtrees, clamped at its base. All joints of an axis share the
    axis's frequency; ζ is given per joint.

    :param rows: the forest.
    :param ratio: damping ratio ζ, (S,); NaN where a damper is given.
    :param frame: rest frames as of the kernel, (S, 12).
    :returns: [s], (S,).
    """
    bases = np.unique(rows.axis)
    omega = np.empty(len(rows.part))
    omega[bases] = _fundamental(bases, rows.end, rows.parent, rows.body, rows.swing, rows.extra,
                                frame)
    return 2.0 * np.nan_to_num(ratio) / omega[rows.axis]


@kernel
def _fundamental(bases, end, parent, body, swing, extra, frame):
    """Find the lowest angular frequency [rad/s] of the branch that starts at each base row."""
    count = len(parent)
    load = np.empty((count, 6))
    motion = np.empty((count, 6))
    omega = np.empty(len(bases))
    for b in range(len(bases)):
        first, last = bases[b], end[bases[b]]
        for i in range(first, last):  # initial motion across the base, oblique to both axes
            for j in range(3):
                motion[i, j] = 0.0
                motion[i, 3 + j] = frame[first, 3 + j] + 0.7 * frame[first, 6 + j]
        square = 0.0
        for _ in range(_ITERATIONS):
            scale = _weigh(first, last, body, frame, motion, load)
            for i in range(first, last):
                for j in range(6):
                    load[i, j] *= scale
            square = _deflect(first, last, parent, body, swing, extra, frame, load, motion)
        omega[b] = np.sqrt(square)
    return omega


@subroutine
def _weigh(first, last, body, frame, motion, load):
    """Convert motions at the centres of mass to inertial loads; return 1/|motion|."""
    size = 0.0
    for i in range(first, last):
        spin = 0.0
        for j in range(3):
            spin += motion[i, j] * frame[i, 9 + j]
        for j in range(3):
            load[i, j] = (body[i, ACROSS] * motion[i, j]
                          + (body[i, ALONG] - body[i, ACROSS]) * spin * frame[i, 9 + j])
            load[i, 3 + j] = body[i, MASS] * motion[i, 3 + j]
            size += load[i, j] * motion[i, j] + load[i, 3 + j] * motion[i, 3 + j]
    return 1.0 / np.sqrt(size)


@subroutine
def _deflect(first, last, parent, body, swing, extra, frame, load, motion):
    """
    Bend the branch under the loads; return the Rayleigh quotient of the new motion.

    Written out by components: assigned slices and `np.cross` would double the compile time.
    """
    reaction = np.zeros((last - first, 6))
    for i in range(last - 1, first - 1, -1):
        k = i - first
        x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
        reach = body[i, REACH]
        _add_wrench(reaction[k], load[i], reach * x, reach * y, reach * z)
        if i > first:
            p = parent[i]
            _add_wrench(reaction[p - first], reaction[k], frame[i, 0] - frame[p, 0],
                        frame[i, 1] - frame[p, 1], frame[i, 2] - frame[p, 2])
    work = 0.0
    energy = 0.0
    anchor = np.zeros((last - first, 6))
    for i in range(first, last):
        k = i - first
        if i > first:
            p = parent[i]
            _carry(anchor[p - first], anchor[k], frame[i, 0] - frame[p, 0],
                   frame[i, 1] - frame[p, 1], frame[i, 2] - frame[p, 2])
        turning, pushing = reaction[k, :3], reaction[k, 3:]
        for start in (3, 6):
            axis = frame[i, start:start + 3]
            _add_along(anchor[k, :3], axis, dot(axis, turning) / swing[i, STIFFNESS])
        axis = frame[i, 9:12]
        _add_along(anchor[k, :3], axis, dot(axis, turning) / extra[i, EXTRA_STIFFNESS])
        _add_along(anchor[k, 3:], axis,
                   dot(axis, pushing) / extra[i, EXTRA_STRIDE + EXTRA_STIFFNESS])
        reach = body[i, REACH]
        _carry(anchor[k], motion[i], reach * axis[0], reach * axis[1], reach * axis[2])
        spin = dot(motion[i, :3], axis)
        work += dot(load[i], motion[i])
        energy += (body[i, MASS] * dot(motion[i, 3:], motion[i, 3:])
                   + body[i, ACROSS] * dot(motion[i, :3], motion[i, :3])
                   + (body[i, ALONG] - body[i, ACROSS]) * spin ** 2)
    return work / energy


@subroutine
def _add_wrench(total, wrench, x, y, z):
    """Add a wrench (moment, force) that acts at an arm (x, y, z)."""
    fx, fy, fz = wrench[3], wrench[4], wrench[5]
    total[0] += wrench[0] + (y * fz - z * fy)
    total[1] += wrench[1] + (z * fx - x * fz)
    total[2] += wrench[2] + (x * fy - y * fx)
    total[3] += fx
    total[4] += fy
    total[5] += fz


@subroutine
def _carry(motion, there, x, y, z):
    """Write the motion (rotation, translation) of a rigid body at an arm (x, y, z)."""
    wx, wy, wz = motion[0], motion[1], motion[2]
    there[0], there[1], there[2] = wx, wy, wz
    there[3] = motion[3] + (wy * z - wz * y)
    there[4] = motion[4] + (wz * x - wx * z)
    there[5] = motion[5] + (wx * y - wy * x)


@subroutine
def _add_along(vector, axis, size):
    for j in range(3):
        vector[j] += axis[j] * size
