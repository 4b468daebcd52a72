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
Springs between rigid bodies, packed for the numerical kernels.

A link is a row of 18 numbers: the arm from the first body's reference point to the patch, the arm
from the second's, and the upper triangles (xx xy xz yy yz zz) of the 3x3 stiffness against
displacement and against rotation, all in world axes. With q = (u, φ) of a body, its material point
at the patch moves by u + φ × arm, so every link couples two rows of 6 unknowns.

Where friction slides, displacement along the patch is coupled to rotation about its normal: a
vector p along the patch, force per turn, and the normal n, packed as a row of 6 (`add_couplings`).
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear_kernels import inverse

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def build(first: np.ndarray, second: np.ndarray, centroid: np.ndarray, centre: np.ndarray,
          axes: np.ndarray, spring: np.ndarray) -> np.ndarray:
    """
    Pack springs into links.

    :param first, second: bodies, N is the ground, (M,).
    :param centroid: of the patches [m], (M, 3).
    :param centre: reference points of the bodies [m], (N, 3).
    :param axes: bond frames, (M, 3, 3).
    :param spring: along and about the frame's axes [N/m, N·m/rad], (M, 6).
    :returns: (M, 18).
    """
    packed = np.empty((len(first), 18))
    for column, body in ((0, first), (3, second)):
        on_ground = body == len(centre)
        arm = centroid - centre[np.where(on_ground, 0, body)]
        packed[:, column:column + 3] = np.where(on_ground[:, None], 0.0, arm)
    for column, part in ((6, spring[:, :3]), (12, spring[:, 3:])):
        for place, (i, k) in enumerate(_UPPER):
            packed[:, column + place] = turned(axes, part, i, k)
    return packed


def turned(axes: np.ndarray, diagonal: np.ndarray, i: int, k: int) -> np.ndarray:
    """
    Return an element of diagonal matrices rotated into world axes, R·D·Rᵀ.

    Ten times faster than `einsum`, which has no fast path for three factors.

    :param axes: R, (M, 3, 3).
    :param diagonal: of D, (M, 3).
    :returns: row i, column k of each, (M,).
    """
    terms = [axes[:, i, j] * diagonal[:, j] * axes[:, k, j] for j in range(3)]
    return terms[0] + terms[1] + terms[2]


def incidence(count: int, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    List the bonds of every part.

    :returns: start (N + 1,) and bond (K,) int32, the bonds of part i in ascending order.
    """
    part = np.concatenate([first, second])
    bond = np.tile(np.arange(len(first), dtype=np.int32), 2)
    real = part < count
    part, bond = part[real], bond[real]
    order = np.lexsort((bond, part))
    start = np.concatenate([[0], np.cumsum(np.bincount(part, minlength=count))])
    return start.astype(np.int64), bond[order]


@subroutine
def _pull(link, m, q, i, j):
    """Return the force and moment of j on i at the patch, world axes."""
    d, e, f = q[i, 3], q[i, 4], q[i, 5]
    a, b, c = q[j, 3], q[j, 4], q[j, 5]
    x = (q[j, 0] + b * link[m, 5] - c * link[m, 4]) - (q[i, 0] + e * link[m, 2] - f * link[m, 1])
    y = (q[j, 1] + c * link[m, 3] - a * link[m, 5]) - (q[i, 1] + f * link[m, 0] - d * link[m, 2])
    z = (q[j, 2] + a * link[m, 4] - b * link[m, 3]) - (q[i, 2] + d * link[m, 1] - e * link[m, 0])
    a -= d
    b -= e
    c -= f
    return (link[m, 6] * x + link[m, 7] * y + link[m, 8] * z,
            link[m, 7] * x + link[m, 9] * y + link[m, 10] * z,
            link[m, 8] * x + link[m, 10] * y + link[m, 11] * z,
            link[m, 12] * a + link[m, 13] * b + link[m, 14] * c,
            link[m, 13] * a + link[m, 15] * b + link[m, 16] * c,
            link[m, 14] * a + link[m, 16] * b + link[m, 17] * c)


@kernel
def add_pulls(bonds, links, first, second, q, out, sign):
    """
    Add sign times the forces of the listed links under the displacements q to the bodies.

    sign = -1 adds K·q.

    :param bonds: rows of links, (K,).
    :param q: displacements and rotations [m, rad], (N + 1, 6).
    :param out: forces and moments at the reference points [N, N·m], (N + 1, 6), changed in place.
    """
    for k in range(len(bonds)):
        m = np.uint64(bonds[k])   # unsigned: avoids the test for negative indices
        i = np.uint64(first[m])
        j = np.uint64(second[m])
        x, y, z, a, b, c = _pull(links, m, q, i, j)
        x, y, z, a, b, c = sign * x, sign * y, sign * z, sign * a, sign * b, sign * c
        out[i, 0] += x
        out[i, 1] += y
        out[i, 2] += z
        out[i, 3] += a + links[m, 1] * z - links[m, 2] * y
        out[i, 4] += b + links[m, 2] * x - links[m, 0] * z
        out[i, 5] += c + links[m, 0] * y - links[m, 1] * x
        out[j, 0] -= x
        out[j, 1] -= y
        out[j, 2] -= z
        out[j, 3] -= a + links[m, 4] * z - links[m, 5] * y
        out[j, 4] -= b + links[m, 5] * x - links[m, 3] * z
        out[j, 5] -= c + links[m, 3] * y - links[m, 4] * x


@subroutine(inline='always')
def alongside(vectors, m, c, other, k):
    """Return the dot product of vectors[m, c:c + 3] and other[k:k + 3]."""
    return (vectors[m, c] * other[k] + vectors[m, c + 1] * other[k + 1]
            + vectors[m, c + 2] * other[k + 2])


@kernel
def add_couplings(bonds, links, coupling, first, second, q, out, sign):
    """
    Add sign times the coupling forces of the listed links to the bodies, see `add_pulls`.

    :param coupling: force along the patch per turn about its normal [N/rad], and this normal,
        (M, 6).
    """
    for m in bonds:
        i, j = first[m], second[m]
        turn = (alongside(coupling, m, 3, q[j], 3) - alongside(coupling, m, 3, q[i], 3))
        slide = 0.0
        for c in range(3):
            k, n = (c + 1) % 3, (c + 2) % 3
            slide += coupling[m, c] * (
                q[j, c] + q[j, 3 + k] * links[m, 3 + n] - q[j, 3 + n] * links[m, 3 + k]
                - q[i, c] - q[i, 3 + k] * links[m, n] + q[i, 3 + n] * links[m, k])
        force = (sign * turn * coupling[m, 0], sign * turn * coupling[m, 1],
                 sign * turn * coupling[m, 2])
        for body, arm, s in ((i, links[m, 0:3], 1.0), (j, links[m, 3:6], -1.0)):
            moment = cross(arm, force)
            for c in range(3):
                out[body, c] += s * force[c]
                out[body, 3 + c] += s * (moment[c] + sign * slide * coupling[m, 3 + c])


@kernel
def pulls(bonds, links, axes, first, second, q, out):
    """Write force and moment of second on first, in the bond frame, per listed bond."""
    for k in range(len(bonds)):
        m = np.uint64(bonds[k])
        w = _pull(links, m, q, np.uint64(first[m]), np.uint64(second[m]))
        for c in range(3):
            out[k, c] = w[0] * axes[m, 0, c] + w[1] * axes[m, 1, c] + w[2] * axes[m, 2, c]
            out[k, 3 + c] = w[3] * axes[m, 0, c] + w[4] * axes[m, 1, c] + w[5] * axes[m, 2, c]


@subroutine(inline='always')
def cross(a, b):
    """Return the cross product of the first three numbers of two sequences."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@subroutine
def add_stiffness(block, link, arm):
    """
    Add the stiffness of a link against the motion of a body, about a point of that body.

    :param block: (6, 6).
    :param arm: from the point to the patch [m], world axes, a tuple of three.
    """
    against = ((link[6], link[7], link[8]), (link[7], link[9], link[10]),
               (link[8], link[10], link[11]))
    twist = ((link[12], link[13], link[14]), (link[13], link[15], link[16]),
             (link[14], link[16], link[17]))
    turned = (cross(arm, against[0]), cross(arm, against[1]), cross(arm, against[2]))
    for c in range(3):
        moment = cross(arm, (turned[0][c], turned[1][c], turned[2][c]))
        for r in range(3):
            block[r, c] += against[r][c]
            block[r, 3 + c] += turned[r][c]
            block[3 + c, r] += turned[r][c]
            block[3 + r, 3 + c] += moment[r] + twist[r][c]


@kernel(nogil=True)
def diagonal_inverses(parts, start, incident, alive, links, first, out):
    """
    Invert the 6x6 diagonal blocks of K of the listed parts into out, (N, 6, 6).

    Parts without a living bond get zeros and so do not move.
    """
    for k in range(len(parts)):
        i = parts[k]
        block = np.zeros((6, 6))
        held = False
        for n in range(start[i], start[i + 1]):
            m = incident[n]
            if alive[m]:
                held = True
                a = 0 if first[m] == i else 3
                add_stiffness(block, links[m], (links[m, a], links[m, a + 1], links[m, a + 2]))
        if held:
            out[i] = inverse(block)
        else:
            out[i] = 0.0
