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


"""Kernels of cracked joints, see `joints`: constitutive laws, tangents and motions."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.masonry.links import alongside

_TWIST = 0.27   # radius of friction against twist over the diagonal of the patch: that of a square
#                 which slides as a whole, 0.3826 of its side
_TURNED = 0.5   # cosine between the directions of friction before and after an overshooting step
SOFTER = 0.1    # factor on a share after a well-predicted step
# Factors on the pace of a bound that turns back, and of one that goes on: cycles of a turn and up
# to three steps on do not last.
_BACK, _ON = 0.5, 1.25
_LEAST_PACE = 1e-3  # from which 31 steps on lead to the whole: no bound is left behind for good


@subroutine(inline='always')
def _edge(x0, y0, x1, y1, out):
    """Add the contribution of one polygon edge to area, first and second moments."""
    c = x0 * y1 - x1 * y0
    out[0] += 0.5 * c
    out[1] += (x0 + x1) * c / 6.0
    out[2] += (y0 + y1) * c / 6.0
    out[3] += (x0 * x0 + x0 * x1 + x1 * x1) * c / 12.0
    out[4] += (y0 * y0 + y0 * y1 + y1 * y1) * c / 12.0
    out[5] += (x0 * y1 + 2.0 * x0 * y0 + 2.0 * x1 * y1 + x1 * y0) * c / 24.0


@subroutine
def pressed_moments(length, width, gap, tilt_x, tilt_y, out):
    """
    Integrate 1, x, y, x², y², xy over the part of a rectangle where gap + tilt_x·y - tilt_y·x < 0.

    :param length, width: sides along x and y [m].
    :param out: (6,).
    """
    out[:] = 0.0
    a, b = 0.5 * length, 0.5 * width
    x, y = -a, -b
    w = gap + tilt_x * y - tilt_y * x
    first = True
    start_x, start_y, last_x, last_y = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        to_x = a if k < 2 else -a
        to_y = b if k == 1 or k == 2 else -b
        to_w = gap + tilt_x * to_y - tilt_y * to_x
        for part in range(2):
            if part == 0:
                if not w < 0.0:
                    continue
                px, py = x, y
            else:
                if (w < 0.0) == (to_w < 0.0):
                    continue
                share = w / (w - to_w)
                px, py = x + share * (to_x - x), y + share * (to_y - y)
            if first:
                start_x, start_y = px, py
                first = False
            else:
                _edge(last_x, last_y, px, py, out)
            last_x, last_y = px, py
        x, y, w = to_x, to_y, to_w
    if not first:
        _edge(last_x, last_y, start_x, start_y, out)


@subroutine
def _deltas(m, first, second, centroid, centre, axes, q, out):
    """Write the displacement of second relative to first at the centroid, bond frame, (6,)."""
    i, j = first[m], second[m]
    world = np.zeros(6)
    for body, sign in ((i, -1.0), (j, 1.0)):
        if body == len(centre):
            continue
        x, y, z = (centroid[m, 0] - centre[body, 0], centroid[m, 1] - centre[body, 1],
                   centroid[m, 2] - centre[body, 2])
        a, b, c = q[body, 3], q[body, 4], q[body, 5]
        world[0] += sign * (q[body, 0] + b * z - c * y)
        world[1] += sign * (q[body, 1] + c * x - a * z)
        world[2] += sign * (q[body, 2] + a * y - b * x)
        world[3] += sign * a
        world[4] += sign * b
        world[5] += sign * c
    for c in range(3):
        out[c] = (world[0] * axes[m, 0, c] + world[1] * axes[m, 1, c] + world[2] * axes[m, 2, c])
        out[3 + c] = (world[3] * axes[m, 0, c] + world[4] * axes[m, 1, c]
                      + world[5] * axes[m, 2, c])


@subroutine(inline='always')
def _radius(extent):
    """Return the effective radius of friction against twist [m]."""
    return _TWIST * np.sqrt(extent[0] ** 2 + extent[1] ** 2)


@subroutine
def _friction(m, d, shear, extent, place, bound, slip, out):
    """
    Write the friction at its point of action: Tx, Ty, Mz, and its share of the elastic force.

    Twist enters strength and stiffness by the same radius, so that friction has an energy.

    :param shear: k_s·A [N/m].
    :param out: forces (3,), then friction over elastic force, 1 when sticking.
    """
    x, y = place[m, 0], place[m, 1]
    radius = _radius(extent[m])
    turn = d[5] - slip[m, 2]
    out[0] = shear * (d[0] - d[5] * y - (slip[m, 0] - slip[m, 2] * y))
    out[1] = shear * (d[1] + d[5] * x - (slip[m, 1] + slip[m, 2] * x))
    out[2] = shear * radius ** 2 * turn
    size = np.sqrt(out[0] ** 2 + out[1] ** 2 + (out[2] / radius) ** 2)
    out[3] = 1.0
    if size > bound[m]:
        out[3] = bound[m] / size
        out[0] *= out[3]
        out[1] *= out[3]
        out[2] *= out[3]


@kernel
def _normal(m, d, stiffness, extent, moments, out):
    """Write the normal force and the bending moments about the centroid: Fz, Mx, My."""
    pressed_moments(extent[m, 0], extent[m, 1], d[2], d[3], d[4], moments)
    s, sx, sy, sxx, syy, sxy = moments
    out[0] = stiffness * (d[2] * s + d[3] * sy - d[4] * sx)
    out[1] = stiffness * (d[2] * sy + d[3] * syy - d[4] * sxy)
    out[2] = -stiffness * (d[2] * sx + d[3] * sxy - d[4] * sxx)


@subroutine
def _scatter(m, first, second, arm_first, arm_second, force, sign, out):
    """Add a wrench of the second part on the first to both, world axes."""
    for body, arm, s in ((first[m], arm_first, sign), (second[m], arm_second, -sign)):
        out[body, 0] += s * force[0]
        out[body, 1] += s * force[1]
        out[body, 2] += s * force[2]
        out[body, 3] += s * (force[3] + arm[1] * force[2] - arm[2] * force[1])
        out[body, 4] += s * (force[4] + arm[2] * force[0] - arm[0] * force[2])
        out[body, 5] += s * (force[5] + arm[0] * force[1] - arm[1] * force[0])


@subroutine
def _model(m, links, coupling, bias, first, second, q, moved, force):
    """Write the relative motion at the link's point and the force of its tangent, world axes."""
    i, j = first[m], second[m]
    for c in range(3):
        k, n = (c + 1) % 3, (c + 2) % 3
        moved[c] = (q[j, c] + q[j, 3 + k] * links[m, 3 + n] - q[j, 3 + n] * links[m, 3 + k]
                    - q[i, c] - q[i, 3 + k] * links[m, n] + q[i, 3 + n] * links[m, k])
        moved[3 + c] = q[j, 3 + c] - q[i, 3 + c]
    for part in range(2):
        s, k = 3 * part, 6 + 6 * part
        x, y, z = moved[s], moved[s + 1], moved[s + 2]
        force[s] = links[m, k] * x + links[m, k + 1] * y + links[m, k + 2] * z
        force[s + 1] = links[m, k + 1] * x + links[m, k + 3] * y + links[m, k + 4] * z
        force[s + 2] = links[m, k + 2] * x + links[m, k + 4] * y + links[m, k + 5] * z
    turn = alongside(coupling, m, 3, moved, 3)
    slide = alongside(coupling, m, 0, moved, 0)
    for c in range(3):
        force[c] += coupling[m, c] * turn + bias[m, c]
        force[3 + c] += coupling[m, 3 + c] * slide + bias[m, 3 + c]


@subroutine
def _turned(m, axes, local, world):
    """Rotate a force and a moment from the bond frame into world axes."""
    for r in range(3):
        world[r] = (axes[m, r, 0] * local[0] + axes[m, r, 1] * local[1] + axes[m, r, 2] * local[2])
        world[3 + r] = (axes[m, r, 0] * local[3] + axes[m, r, 1] * local[4]
                        + axes[m, r, 2] * local[5])


@subroutine
def _mix(moments, share, extent):
    """Blend the moments of the pressed part with the whole rectangle; return the centroid."""
    area = extent[0] * extent[1]
    for c in range(6):
        moments[c] *= 1.0 - share
    moments[0] += share * area
    moments[3] += share * area * extent[0] ** 2 / 12.0
    moments[4] += share * area * extent[1] ** 2 / 12.0
    return moments[1] / moments[0], moments[2] / moments[0]


@subroutine
def _sliding(shear, share, secant, friction, radius, away, out):
    """
    Write the tangent of friction along x and y and about z, 3 x 3, at the link's point.

    Radial return in x, y and radius times twist: a sliding joint is soft only along its slide.

    :param secant: share of the secant stiffness along the slide, see `_steady`.
    :param away: point where friction acts, from the link's point [m].
    """
    slides = shear * max(friction[3], share)
    size = np.sqrt(friction[0] ** 2 + friction[1] ** 2 + (friction[2] / radius) ** 2)
    free = (1.0 - max(share, secant)) / size ** 2 if friction[3] < 1.0 and size > 0.0 else 0.0
    way = (friction[0], friction[1], friction[2] / radius)
    scale = (1.0, 1.0, radius)
    for r in range(3):
        for c in range(3):
            out[r, c] = slides * scale[r] * scale[c] * ((1.0 if r == c else 0.0)
                                                        - free * way[r] * way[c])
    x, y = -away[1], away[0]  # displacement of the friction point per turn about the link's point
    along = out[0, 0] * x + out[0, 1] * y, out[1, 0] * x + out[1, 1] * y
    out[2, 2] += 2.0 * (x * out[0, 2] + y * out[1, 2]) + x * along[0] + y * along[1]
    for r in range(2):
        out[r, 2] += along[r]
        out[2, r] = out[r, 2]


@subroutine
def _pack(axes, block, link):
    """Write a symmetric matrix of the bond frame as upper triangle in world axes."""
    k = 0
    for r in range(3):
        for c in range(r, 3):
            total = 0.0
            for g in range(3):
                for h in range(3):
                    total += axes[r, g] * block[g, h] * axes[c, h]
            link[k] = total
            k += 1


@subroutine
def _tangent(m, axes, extent, normal, shear, share, secant, friction, middle, place, moments,
             links, coupling, scratch):
    """Write the tangent stiffness of a joint; return its least share of the whole stiffness."""
    block, turn, slides = scratch
    block[:] = 0.0
    turn[:] = 0.0
    x, y = middle[m, 0], middle[m, 1]
    away = place[m, 0] - x, place[m, 1] - y
    _sliding(shear, share, secant, friction, _radius(extent[m]), away, slides)
    for r in range(2):
        for c in range(2):
            block[r, c] = slides[r, c]
    for c in range(3):
        coupling[m, c] = axes[m, c, 0] * slides[0, 2] + axes[m, c, 1] * slides[1, 2]
        coupling[m, 3 + c] = axes[m, c, 2]
    block[2, 2] = normal * moments[0]
    turn[0, 0] = normal * (moments[4] - moments[0] * y * y)
    turn[1, 1] = normal * (moments[3] - moments[0] * x * x)
    turn[0, 1] = turn[1, 0] = -normal * (moments[5] - moments[0] * x * y)
    turn[2, 2] = slides[2, 2]
    _pack(axes[m], block, links[m, 6:12])
    _pack(axes[m], turn, links[m, 12:18])
    whole = normal * extent[m, 0] * extent[m, 1] / 12.0
    return min(turn[0, 0] / (whole * extent[m, 1] ** 2), turn[1, 1] / (whole * extent[m, 0] ** 2),
               max(friction[3], share))


@subroutine
def _steady(m, friction, radius, way, secant):
    """
    Set the stiffness along the slide of a joint whose friction has reversed to its secant.

    A sliding joint is free to move along its slide, and a step that overshoots drives it back by
    as much, for ever. The secant, bound over elastic slip, is the stiffness of the parabola that
    touches the energy of friction from above, which no step can overshoot (iteratively reweighted
    least squares: Huber & Ronchetti 2009, Robust Statistics, 7.8).

    :param way: direction of friction after the last step, unit vectors, updated, (M, 3).
    :param secant: share of the secant stiffness along the slide, (M,), changed in place.
    """
    size = np.sqrt(friction[0] ** 2 + friction[1] ** 2 + (friction[2] / radius) ** 2)
    if friction[3] == 1.0 or size == 0.0:
        return
    u, v, w = friction[0] / size, friction[1] / size, friction[2] / (radius * size)
    if u * way[m, 0] + v * way[m, 1] + w * way[m, 2] < _TURNED:
        secant[m] = 1.0
    else:
        secant[m] *= SOFTER
    way[m, 0], way[m, 1], way[m, 2] = u, v, w


@kernel
def _follow(m, target, bound, pace):
    """
    Let the bound of friction of a joint follow the pressure.

    Joints that press the less the more they rub would jump from one pressure to another for ever:
    a bound that turns back goes ever smaller shares of the way (as each weight in resilient
    backpropagation: Riedmiller & Braun 1993, IEEE Int. Conf. Neural Networks).

    :param target: bound at the present pressure [N].
    """
    change, share = target - bound[m], abs(pace[m])
    share = min((_BACK if change * pace[m] < 0.0 else _ON) * share, 1.0)
    share = max(share, _LEAST_PACE)
    bound[m] += share * change
    pace[m] = np.copysign(share, change)


@subroutine
def _lag(friction, radius, bound, target):
    """Return how far friction is from that with the bound at the present pressure [N]."""
    elastic = np.sqrt(friction[0] ** 2 + friction[1] ** 2 + (friction[2] / radius) ** 2)
    if friction[3] < 1.0:
        elastic = bound / friction[3] if bound > 0.0 else np.inf
    return abs(min(elastic, bound) - min(elastic, target))


@subroutine
def _tie(m, first, second, centroid, centre, axes, middle, links):
    """Write the arms from the parts to the centroid of the pressed part."""
    for c in range(3):
        at = centroid[m, c] + axes[m, c, 0] * middle[m, 0] + axes[m, c, 1] * middle[m, 1]
        links[m, c] = at - centre[first[m], c] if first[m] < len(centre) else 0.0
        links[m, 3 + c] = at - centre[second[m], c] if second[m] < len(centre) else 0.0


@kernel(nogil=True)
def linearise(rows, first, second, centroid, centre, axes, extent, normal, shear, friction, slip,
              middle, place, bound, pace, bias, links, coupling, grip, q, residual, shares, way,
              secant, renew):
    """
    Linearise joints about the displacements: update tangents, biases and forces.

    :param normal, shear: stiffness of the whole patch, k·A [N/m], (M,).
    :param middle: centroid of the pressed part, where the link is, updated [m], (M, 2).
    :param place, bound: point and bound of friction [m], (M, 2), [N], (M,).
    :param bias, links, coupling: updated.
    :param residual: receives the difference between old model and true force, (N + 1, 6).
    :param shares: least share of the whole stiffness in tangents, (M,).
    :param pace: share of a change that the bound makes, with the sign of the last change, (M,).
    :param way, secant: see `_steady`; updated after a step, where `renew` is False.
    :param renew: whether points and bounds of friction follow the pressure.
    :returns: largest force by which friction lacks or exceeds that at the present pressure [N].
    """
    d, moments = np.empty((2, 6))
    n, t = np.empty(3), np.empty(4)
    local, world, force, moved = np.empty((4, 6))
    scratch = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    lag = 0.0
    for m in rows:
        _model(m, links, coupling, bias, first, second, q, moved, force)
        _scatter(m, first, second, links[m, 0:3], links[m, 3:6], force, -1.0, residual)
        _deltas(m, first, second, centroid, centre, axes, q, d)
        stiffness = normal[m] / (extent[m, 0] * extent[m, 1])
        _normal(m, d, stiffness, extent, moments, n)
        x, y = _mix(moments, shares[m], extent[m])
        middle[m, 0], middle[m, 1] = x, y
        if renew:
            target = friction[m] * max(-n[0], 0.0)
            _follow(m, target, bound, pace)
            place[m, 0], place[m, 1] = x, y
        _friction(m, d, shear[m], extent, place, bound, slip, t)
        if renew:
            lag = max(lag, _lag(t, _radius(extent[m]), bound[m], target))
        else:
            _steady(m, t, _radius(extent[m]), way, secant)
        local[0], local[1], local[2] = t[0], t[1], n[0]
        local[3], local[4] = n[1] - y * n[0], n[2] + x * n[0]
        local[5] = t[2] + (place[m, 0] - x) * t[1] - (place[m, 1] - y) * t[0]
        _turned(m, axes, local, world)
        _tie(m, first, second, centroid, centre, axes, middle, links)
        _scatter(m, first, second, links[m, 0:3], links[m, 3:6], world, 1.0, residual)
        grip[m] = _tangent(m, axes, extent, stiffness, shear[m], shares[m], secant[m], t, middle,
                           place, moments, links, coupling, scratch)
        bias[m] = 0.0
        _model(m, links, coupling, bias, first, second, q, moved, force)
        for c in range(6):
            bias[m, c] = world[c] - force[c]
    return lag


@kernel(nogil=True)
def power(rows, label, first, second, centroid, centre, axes, extent, normal, shear, slip, place,
          bound, bias, links, coupling, base, step, reach, out):
    """
    Compute the power of the true forces along a step minus that of the model, by island.

    :param label: island of each row, (K,).
    :param base, step: displacements and their change, (N + 1, 6).
    :param reach: completed share of the step, (I,).
    :param out: power [J], (I,), written.
    """
    d, e, moments = np.empty((3, 6))
    n, t = np.empty(3), np.empty(4)
    moved, rate, force, start = np.empty((4, 6))
    out[:] = 0.0
    for k in range(len(rows)):
        m = rows[k]
        part = reach[label[k]]
        _deltas(m, first, second, centroid, centre, axes, base, d)
        _deltas(m, first, second, centroid, centre, axes, step, e)
        for c in range(6):
            d[c] += part * e[c]
        _normal(m, d, normal[m] / (extent[m, 0] * extent[m, 1]), extent, moments, n)
        _friction(m, d, shear[m], extent, place, bound, slip, t)
        x, y = place[m, 0], place[m, 1]
        out[label[k]] += (t[0] * (e[0] - e[5] * y) + t[1] * (e[1] + e[5] * x) + t[2] * e[5]
                          + n[0] * e[2] + n[1] * e[3] + n[2] * e[4])
        _model(m, links, coupling, bias, first, second, base, moved, start)
        _model(m, links, coupling, bias, first, second, step, rate, force)
        for c in range(6):
            out[label[k]] -= (start[c] + part * (force[c] - bias[m, c])) * rate[c]


@subroutine(inline='always')
def _span(along_x, along_y, extent):
    """Return the length of a patch in a direction along it [m]."""
    x, y = abs(along_x), abs(along_y)
    return (x * extent[0] + y * extent[1]) / max(np.sqrt(x ** 2 + y ** 2), 1e-30)


@kernel
def motions(rows, first, second, centroid, centre, axes, extent, q, gap, slid, span):
    """
    Write the opening of joints at their widest corner, and their slip [m], (K,) each.

    :param span: receives the length of the patch, across the hinge where the opening exceeds
        the slip, else along the slip [m], (K,).
    """
    d = np.empty(6)
    for k in range(len(rows)):
        m = rows[k]
        _deltas(m, first, second, centroid, centre, axes, q, d)
        gap[k] = d[2] + 0.5 * (abs(d[3]) * extent[m, 1] + abs(d[4]) * extent[m, 0])
        slid[k] = np.sqrt(d[0] ** 2 + d[1] ** 2) + abs(d[5]) * 0.5 * extent[m].max()
        span[k] = (_span(d[4], d[3], extent[m]) if gap[k] > slid[k]
                   else _span(d[0], d[1], extent[m]))


@kernel
def settle(rows, first, second, centroid, centre, axes, extent, shear, slip, place, bound, q):
    """Make the slip of sliding joints permanent; the elastic part of friction stays."""
    d, t = np.empty(6), np.empty(4)
    for m in rows:
        _deltas(m, first, second, centroid, centre, axes, q, d)
        _friction(m, d, shear[m], extent, place, bound, slip, t)
        if t[3] < 1.0:
            x, y = place[m, 0], place[m, 1]
            slip[m, 2] = d[5] - t[2] / (shear[m] * _radius(extent[m]) ** 2)
            slip[m, 0] = d[0] - d[5] * y - t[0] / shear[m] + slip[m, 2] * y
            slip[m, 1] = d[1] + d[5] * x - t[1] / shear[m] - slip[m, 2] * x


@kernel
def add_forces(rows, first, second, bias, links, coupling, q, out, sign):
    """Add sign times the forces of joints, by their tangents and biases, to the parts."""
    moved, force = np.empty((2, 6))
    for m in rows:
        _model(m, links, coupling, bias, first, second, q, moved, force)
        _scatter(m, first, second, links[m, 0:3], links[m, 3:6], force, sign, out)


@kernel
def wrenches(rows, first, second, axes, middle, bias, links, coupling, q, out):
    """Write force and moment of second on first about the centroid, bond frame."""
    moved, force = np.empty((2, 6))
    for k in range(len(rows)):
        m = rows[k]
        _model(m, links, coupling, bias, first, second, q, moved, force)
        for c in range(3):
            out[k, c] = out[k, 3 + c] = 0.0
            for r in range(3):
                out[k, c] += axes[m, r, c] * force[r]
                out[k, 3 + c] += axes[m, r, c] * force[3 + r]
        x, y = middle[m, 0], middle[m, 1]
        out[k, 3] += y * out[k, 2]
        out[k, 4] -= x * out[k, 2]
        out[k, 5] += x * out[k, 1] - y * out[k, 0]
