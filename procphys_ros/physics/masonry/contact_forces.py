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


"""Contact loads: what presses on a body of many parts, put on its parts."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear_kernels import solve, transformed, transformed_back
from procphys_ros.geometry.rotation_kernels import matrix

_FLAT = 0.03    # [m] off the plane of contact: nearer parts share the pressure
_AROUND = 0.06  # [m] outside of the points of contact: likewise
_SAME = 0.9     # least cosine between the normals of contacts that count as one


class BodyContacts(NamedTuple):
    """
    Contacts of one body, in the frame of the body.

    :ivar points: [m], (C, 3).
    :ivar normals: towards the body, (C, 3).
    :ivar forces: on the body [N], (C, 3).
    :ivar other: ids of the other bodies, (C,).
    """

    points: np.ndarray
    normals: np.ndarray
    forces: np.ndarray
    other: np.ndarray


class PieceBlow(NamedTuple):
    """
    A blow to a piece.

    :ivar body: id.
    :ivar parts: of the body, (P,).
    :ivar contacts: of the body.
    :ivar energy: of the motion that they stop [J], see `blows.energies`; inf = they last.
    """

    body: int
    parts: np.ndarray
    contacts: BodyContacts
    energy: float


@kernel
def turned_back(poses, points, normals, forces):
    """
    Rotate vectors into the axes of bodies.

    :param poses: of the bodies, a row for each vector, (C, 7).
    :param points, normals, forces: world axes, (C, 3).
    :returns: these in the bodies' axes.
    """
    out = np.empty(points.shape), np.empty(points.shape), np.empty(points.shape)
    for c in range(len(points)):
        axes = matrix(poses[c, 3:])
        for k in range(3):
            out[0][c, k], out[1][c, k], out[2][c, k] = 0.0, 0.0, 0.0
            for i in range(3):
                out[0][c, k] += points[c, i] * axes[i, k]
                out[1][c, k] += normals[c, i] * axes[i, k]
                out[2][c, k] += forces[c, i] * axes[i, k]
    return out


def spread(contacts: BodyContacts, poses: np.ndarray, sizes: np.ndarray,
           rest: np.ndarray) -> np.ndarray:
    """
    Distribute contact forces over parts, in the frame of the blueprint.

    The outlines of bodies are merged boxes that touch at a few corners. Parts near the plane of
    such a contact share its force as the supports of a stiff footing: evenly, plus linearly for
    the moment. Where no part is near, the nearest takes all.

    :param contacts: of the body.
    :param poses: of the parts in the frame of the body, (P, 7).
    :param sizes: of the parts [m], (P, 3).
    :param rest: poses of the parts in the blueprint, (P, 7).
    :returns: force and moment at the parts' centres [N], [N·m], (P, 6).
    """
    return _spread(*contacts, poses, sizes, rest)


@kernel
def _spread(points, normals, forces, other, poses, sizes, rest):
    out = np.zeros((len(poses), 6))
    radius = np.empty(len(poses))
    for p in range(len(poses)):
        radius[p] = 0.5 * np.sqrt(sizes[p, 0] ** 2 + sizes[p, 1] ** 2 + sizes[p, 2] ** 2)
    done = np.zeros(len(points), np.bool_)
    for c in range(len(points)):
        if done[c]:
            continue
        if (normals[c] * normals[c]).sum() < _SAME:
            continue  # an engine finds no normal where two surfaces meet in the same point
        force = np.zeros(3)
        middle = np.zeros(3)
        weight = 0.0
        low = np.full(3, np.inf)
        high = np.full(3, -np.inf)
        for d in range(c, len(points)):
            if done[d] or other[d] != other[c]:
                continue
            if (normals[d] * normals[c]).sum() < _SAME:
                continue
            done[d] = True
            push = max((forces[d] * normals[d]).sum(), 0.0) + 1e-12
            weight += push
            for k in range(3):
                middle[k] += push * points[d, k]
                force[k] += forces[d, k]
                low[k] = min(low[k], points[d, k])
                high[k] = max(high[k], points[d, k])
        middle /= weight
        near = _near(low, high, poses, radius)
        if not len(near):
            near = np.array([_nearest(middle, poses, radius)])
        _press(near, middle, normals[c], force, low, high, poses, sizes, rest, out)
    return out


@subroutine
def _near(low, high, poses, radius):
    """List the parts with a bounding sphere near the points of contact."""
    found = np.empty(len(poses), np.int64)
    count = 0
    for p in range(len(poses)):
        reach = radius[p] + _AROUND
        if (low[0] - reach < poses[p, 0] < high[0] + reach
                and low[1] - reach < poses[p, 1] < high[1] + reach
                and low[2] - reach < poses[p, 2] < high[2] + reach):
            found[count] = p
            count += 1
    return found[:count]


@subroutine
def _nearest(point, poses, radius):
    best, least = 0, np.inf
    for p in range(len(poses)):
        gap = np.sqrt((point[0] - poses[p, 0]) ** 2 + (point[1] - poses[p, 1]) ** 2
                      + (point[2] - poses[p, 2]) ** 2) - radius[p]
        if gap < least:
            best, least = p, gap
    return best


@subroutine
def _against_plane(near, middle, normal, poses, sizes):
    """
    Measure the position of parts relative to a plane of contact.

    :returns: axes of each part as columns (K, 3, 3), its centre on the plane (K, 3), its height
        above the plane (K,), and its squared distance from the middle of the contact (K,).
    """
    count = len(near)
    spot = np.empty((count, 3))
    gap = np.empty(count)
    aside = np.empty(count)
    axes = np.empty((count, 3, 3))
    for n in range(count):
        p = near[n]
        axes[n] = matrix(poses[p, 3:])
        arm = middle - poses[p, :3]
        reach = 0.0
        aside[n] = 0.0
        for k in range(3):
            along = arm[0] * axes[n, 0, k] + arm[1] * axes[n, 1, k] + arm[2] * axes[n, 2, k]
            aside[n] += max(abs(along) - 0.5 * sizes[p, k], 0.0) ** 2
            reach += 0.5 * sizes[p, k] * abs(normal[0] * axes[n, 0, k] + normal[1] * axes[n, 1, k]
                                             + normal[2] * axes[n, 2, k])
        lift = -(arm * normal).sum()
        gap[n] = lift - reach
        spot[n] = poses[p, :3] - lift * normal
    return axes, spot, gap, aside


@subroutine
def _press(near, middle, normal, force, low, high, poses, sizes, rest, out):
    """Distribute one force over the parts near a plane."""
    count = len(near)
    axes, spot, gap, aside = _against_plane(near, middle, normal, poses, sizes)
    nearest = np.argmin(aside)
    chosen = np.zeros(count, np.bool_)
    for n in range(count):
        chosen[n] = abs(gap[n] - gap[nearest]) < _FLAT
        for k in range(3):
            chosen[n] &= low[k] - _AROUND < spot[n, k] < high[k] + _AROUND
    chosen[nearest] = True
    share = _footing(middle, normal, spot, chosen)
    for n in range(count):
        if not chosen[n] or share[n] <= 0.0:
            continue
        p = near[n]
        arm = transformed_back(axes[n], (middle if n == nearest else spot[n]) - poses[p, :3])
        for k in range(3):  # a merged outline may touch where no part is: act on its surface
            arm[k] = min(max(arm[k], -0.5 * sizes[p, k]), 0.5 * sizes[p, k])
        back = matrix(rest[p, 3:])
        push = share[n] * transformed(back, transformed_back(axes[n], force))
        arm = transformed(back, arm)
        out[p, :3] += push
        out[p, 3] += arm[1] * push[2] - arm[2] * push[1]
        out[p, 4] += arm[2] * push[0] - arm[0] * push[2]
        out[p, 5] += arm[0] * push[1] - arm[1] * push[0]


@subroutine
def _footing(middle, normal, spot, chosen):
    """Return the shares of a force on the supports of a stiff footing; their sum is one."""
    count = chosen.sum()
    mean = np.zeros(3)
    for p in range(len(spot)):
        if chosen[p]:
            mean += spot[p] / count
    spread_ = np.eye(3) * 1e-6 + np.outer(normal, normal)
    for p in range(len(spot)):
        if chosen[p]:
            spread_ += np.outer(spot[p] - mean, spot[p] - mean)
    tilt = solve(spread_, middle - mean)
    share = np.zeros(len(spot))
    total = 0.0
    for p in range(len(spot)):
        if chosen[p]:
            share[p] = max(1.0 / count + (tilt * (spot[p] - mean)).sum(), 0.0)
            total += share[p]
    return share / total
