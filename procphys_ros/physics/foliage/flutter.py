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
Flutter: the motion of leaves about their petioles, as a function of wind and time.

A leaf blade twists and nods at its natural frequencies: leaf flutter is torsional galloping of the
blade on its petiole (Tadrist et al. 2015, J. Fluids and Structures 56:1), and beyond its onset
it hardly grows with the wind (Tadrist et al. 2018, J. R. Soc. Interface 15:20180010). The mean
drag rotates the blade downwind, so that it is streamlined in strong wind (Vogel 1989, J. Exp.
Botany 40:941).
"""

import math

import numpy as np

from procphys_ros.blueprint import Leaves
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.compilation import threads as pool
from procphys_ros.elementary import exp, functions, normal_of
from procphys_ros.physics.air import CALM

# Frequency of a blade of one size. With petioles proportional to blades of one thickness,
# stiffness scales with size³ and inertia with size⁴, so the frequency with size^-1/2; leaves of a
# span of 6 cm flutter at a few cycles per second.
_SIZE, _FREQUENCY = 0.06, 5.0  # [m], [Hz]
_SPREAD = 0.2  # of the logarithm of the frequency, from leaf to leaf
# Bending over twisting frequency, √(EI/GJ · J_twist/J_bend): petioles have EI/GJ of about 4.3
# (Louf et al. 2018, Scientific Reports 8), a blade as wide as long J_twist/J_bend of 1/4.
_NOD_RATIO = math.sqrt(4.3 / 4.0)
_NOD_SPREAD = 0.2
_ONSET = 8.0  # speed over frequency and size at which flutter has 63 % of its full amplitude
_TWIST, _NOD = 0.45, 0.15  # [rad] full amplitudes: our choice, without published statistics
_TURN_MOST = 0.9  # largest drag over restoring moment: below 1, or a blade facing the wind flips
_MODES = 3  # nodding about x, about y, twisting about z


class Flutter:
    """
    Motion of every leaf about its petiole, without a state, computed on demand.

    :param leaves: at rest.
    :param seed: of frequencies and phases.

    :ivar frequency: of twisting, (L,) [Hz].
    """

    def __init__(self, leaves: Leaves, seed: int):
        rng = np.random.default_rng(seed)
        count = len(leaves)
        size = np.maximum(leaves.size, 1e-3)
        self._rest = np.ascontiguousarray(leaves.pose, float)
        # A row per leaf: leaves that join a scene later do not change those before them.
        draws = rng.random((count, 4 + _MODES))
        normal = normal_of(draws[:, :4])
        self.frequency = _FREQUENCY * np.sqrt(_SIZE / size) * exp(_SPREAD * normal[:, 0])
        nod = _NOD_RATIO * exp(_NOD_SPREAD * normal[:, 1:3])
        ratio = np.column_stack([nod, np.ones(count)])
        self._rate = 2.0 * np.pi * self.frequency[:, None] * ratio
        self._phase = 2.0 * np.pi * draws[:, 4:]
        self._onset = _ONSET * self.frequency * size

    def poses(self, carrier: np.ndarray, frames: np.ndarray, air: np.ndarray,
              time: float, threads: int = 1) -> np.ndarray:
        """
        Compute the pose of every leaf in the frame of its part; without wind, the rest pose.

        The petiole is fixed; the blade rotates downwind and flutters about it.

        :param carrier: row of `frames` and `air` of each leaf's part, (L,) int.
        :param frames: poses of the parts that carry leaves, world, (C, 7).
        :param air: velocity of the air relative to these parts [m/s], world, (C, 3).
        :param time: [s].
        :param threads: number of threads.
        :returns: petiole poses, z along the leaf, (L, 7).
        """
        out = np.empty_like(self._rest)

        def work(_: int, first: int, last: int) -> None:
            some = slice(first, last)
            _flutter(carrier[some], frames, air, time, self._rest[some], self._rate[some],
                     self._phase[some], self._onset[some], out[some])
        pool.run(work, pool.even_ranges(len(out), threads))
        return out


def carried(carrier: np.ndarray, frames: np.ndarray, local: np.ndarray,
            threads: int = 1) -> np.ndarray:
    """
    Transform poses from the frames of their parts to the world.

    :param carrier: row of `frames` of each pose's part, (L,) int.
    :param frames: poses of the parts, world, (C, 7).
    :param local: poses in the frames of their parts, (L, 7).
    :param threads: number of threads.
    :returns: poses, world, (L, 7).
    """
    out = np.empty_like(local)

    def work(_: int, first: int, last: int) -> None:
        _carry(carrier[first:last], frames, local[first:last], out[first:last])
    pool.run(work, pool.even_ranges(len(out), threads))
    return out


@kernel(nogil=True)
def _carry(carrier, frames, local, out):
    for i in range(len(local)):
        c = carrier[i]
        q = (frames[c, 3], frames[c, 4], frames[c, 5], frames[c, 6])
        place = _into(-q[0], -q[1], -q[2], q[3], local[i, 0], local[i, 1], local[i, 2])
        for j in range(3):
            out[i, j] = frames[c, j] + place[j]
        turn = _times(q, (local[i, 3], local[i, 4], local[i, 5], local[i, 6]))
        for j in range(4):
            out[i, 3 + j] = turn[j]


@kernel(nogil=True)
def _flutter(carrier, frames, air, time, rest, rate, phase, onset, out):
    for i in range(len(rest)):
        c = carrier[i]
        for j in range(7):
            out[i, j] = rest[i, j]
        speed = math.sqrt(air[c, 0] ** 2 + air[c, 1] ** 2 + air[c, 2] ** 2)
        if not speed > 0.0:
            continue
        q = (rest[i, 3], rest[i, 4], rest[i, 5], rest[i, 6])
        flow = _into(frames[c, 3], frames[c, 4], frames[c, 5], frames[c, 6],
                     air[c, 0] / speed, air[c, 1] / speed, air[c, 2] / speed)
        q = _times(_downwind(q, flow, speed), q)
        share = 1.0 - functions.exp(-(speed / onset[i]) ** 2)
        half = 0.5 * share * _NOD
        x = half * functions.sin(rate[i, 0] * time + phase[i, 0])
        y = half * functions.sin(rate[i, 1] * time + phase[i, 1])
        z = 0.5 * share * _TWIST * functions.sin(rate[i, 2] * time + phase[i, 2])
        w = 1.0 / math.sqrt(1.0 + x * x + y * y + z * z)
        q = _times(q, (w * x, w * y, w * z, w))
        for j in range(4):
            out[i, 3 + j] = q[j]


@subroutine(inline='always')
def _downwind(q, flow, speed):
    """
    Return the rotation from the leaf's rest axis to the balance of drag and petiole.

    A petiole with a restoring moment k·sin(angle) to its axis n and a drag moment C·k·sin(angle)
    to the flow direction u are in balance along n + C·u.
    """
    x, y, z, w = q
    nx, ny, nz = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    square = (speed / CALM) ** 2
    push = _TURN_MOST * square / (1.0 + square)
    dx, dy, dz = nx + push * flow[0], ny + push * flow[1], nz + push * flow[2]
    tx, ty, tz = ny * dz - nz * dy, nz * dx - nx * dz, nx * dy - ny * dx
    tw = nx * dx + ny * dy + nz * dz + math.sqrt(dx * dx + dy * dy + dz * dz)
    scale = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz + tw * tw)
    return tx * scale, ty * scale, tz * scale, tw * scale


@subroutine(inline='always')
def _into(x, y, z, w, a, b, c):
    """Rotate a vector by the inverse of a quaternion: from the world into a part's frame."""
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return (a + w * tx + ty * z - tz * y, b + w * ty + tz * x - tx * z,
            c + w * tz + tx * y - ty * x)


@subroutine(inline='always')
def _times(a, b):
    """Multiply quaternions: rotation by b first, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz)
