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
Sleep: islands of bodies at rest, until the load on one of them changes.

Sleeping bodies are immovable and cost no time. They wake before a body hits them that could move
them, and when the contact forces on them change.
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.masonry.components import root_of
from procphys_ros.physics.rigid.solver import SLEEP_SPEED
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.extents import are_near, bounds

SLEEP_TIME = 0.5  # [s] at rest before bodies fall asleep (box2d's value)
_CHANGE = 0.1  # of the contact forces on a sleeping body: tolerated change
_NEAR = 0.02  # [m] gap at which engines create contacts, beyond the motion of one step

_AWAKE, _RESTING, _GONE, _DRIVEN = (int(state) for state in (
    BodyState.AWAKE, BodyState.RESTING, BodyState.GONE, BodyState.KINEMATIC))


def quiet_islands(bodies: BodyTable, awake: np.ndarray, table: np.ndarray,
                  time_step: float) -> np.ndarray:
    """
    Update the sleep clocks of awake bodies; list the bodies of islands that are all at rest.

    :param awake: ids, (K,).
    :param table: contacts of the last step as of `Engine.contacts`, (C, 13).
    :param time_step: [s].
    :returns: ids, ascending, (M,).
    """
    _keep_clocks(awake, bodies.poses, bodies.mark, bodies.inertia, bodies.mass, bodies.quiet,
                 time_step)
    return _quiet(awake, bodies.quiet, bodies.state, table)


@kernel
def _keep_clocks(awake, poses, mark, inertia, mass, quiet, time_step):
    """Update the time that bodies have stayed near their marks; jitter counts as rest."""
    most = 0.5 * SLEEP_SPEED * SLEEP_TIME  # distance of uniform acceleration to that speed
    for k in range(len(awake)):
        b = awake[k]
        quiet[b] += time_step
        if _way(mark[b], poses[b], inertia[b], mass[b]) > most:
            quiet[b], mark[b] = 0.0, poses[b]


@subroutine
def _way(start, now, inertia, mass):
    """Return the displacement of the centre plus that of a corner of the inertia box [m]."""
    x, y, z = now[0] - start[0], now[1] - start[1], now[2] - start[2]
    a, b, c, d = start[3], start[4], start[5], start[6]
    u = d * now[3] - now[6] * a - b * now[5] + c * now[4]  # half of the rotation, body axes
    v = d * now[4] - now[6] * b - c * now[3] + a * now[5]
    w = d * now[5] - now[6] * c - a * now[4] + b * now[3]
    turn = u * u * inertia[0] + v * v * inertia[1] + w * w * inertia[2]
    return np.sqrt(x * x + y * y + z * z) + 2.0 * np.sqrt(3.0 * turn / mass)


@subroutine
def _speed(velocity):
    return np.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1]
                   + velocity[2] * velocity[2])


@subroutine
def _spin(velocity):
    return np.sqrt(velocity[3] * velocity[3] + velocity[4] * velocity[4]
                   + velocity[5] * velocity[5])


@kernel
def _quiet(awake, quiet, state, table):
    parent = np.arange(len(state))
    _join(table, state, _AWAKE, parent)
    still = np.ones(len(state), np.bool_)
    for b in awake:
        if quiet[b] < SLEEP_TIME - 1e-9:
            still[root_of(parent, b)] = False
    found = np.zeros(len(awake), np.bool_)
    for k in range(len(awake)):
        found[k] = still[root_of(parent, awake[k])]
    return awake[found]


@subroutine
def _join(table, state, doing, parent):
    """Join bodies of a state that press on each other into islands."""
    for c in range(len(table)):
        a, b = int(table[c, 0]), int(table[c, 1])
        if table[c, 12] > 0.0 and state[a] == doing and state[b] == doing:
            a, b = root_of(parent, a), root_of(parent, b)
            parent[max(a, b)] = min(a, b)


def with_islands(rows: np.ndarray, ids: np.ndarray, bodies: BodyTable) -> np.ndarray:
    """
    Add to some bodies the sleeping bodies of their islands.

    :param rows: contacts with which bodies fell asleep, (E, 13).
    :param ids: (K,).
    :returns: ids, ascending, (M,).
    """
    if not (bodies.state[ids] == BodyState.RESTING).any():
        return ids
    return _with_islands(rows, ids, bodies.state)


@kernel
def _with_islands(rows, ids, state):
    parent = np.arange(len(state))
    _join(rows, state, _RESTING, parent)
    wakes = np.zeros(len(state), np.bool_)
    for b in ids:
        wakes[root_of(parent, b)] = True
    found = np.zeros(len(state), np.bool_)
    for b in range(len(state)):
        found[b] = state[b] == _RESTING and wakes[root_of(parent, b)]
    for b in ids:
        found[b] = True
    return np.flatnonzero(found)


def join(rows: np.ndarray, table: np.ndarray, ids: np.ndarray, bodies: BodyTable) -> np.ndarray:
    """
    Store the contacts with which bodies fall asleep.

    :param rows: stored so far, as of `Engine.contacts`, (E, 13).
    :param table: contacts of the last step, (C, 13).
    :param ids: bodies that fall asleep, (K,).
    """
    falls = np.zeros(len(bodies.state), bool)
    falls[ids] = True
    old = ~falls[rows[:, :2].astype(np.intp)].any(axis=1)
    new = falls[table[:, :2].astype(np.intp)].any(axis=1) & (table[:, 12] > 0.0)
    return np.concatenate([rows[old], table[new]])


def without_sleepers(rows: np.ndarray, bodies: BodyTable) -> np.ndarray:
    """Drop the contacts without sleeping bodies, (E, 13)."""
    sleeps = (bodies.state[rows[:, :2].astype(np.intp)] == BodyState.RESTING).any(axis=1)
    return rows if sleeps.all() else rows[sleeps]


def sleepers_on(rows: np.ndarray, ids: np.ndarray, bodies: BodyTable) -> np.ndarray:
    """List the sleeping bodies that touched some bodies when they fell asleep, (M,)."""
    chosen = np.zeros(len(bodies.state), bool)
    chosen[ids] = True
    pairs = rows[:, :2].astype(np.intp)
    found = np.unique(pairs[chosen[pairs][:, ::-1]])
    return found[bodies.state[found] == BodyState.RESTING]


def disturbed(bodies: BodyTable, rows: np.ndarray, table: np.ndarray,
              gravity: np.ndarray) -> np.ndarray:
    """
    List the sleeping bodies whose load from awake bodies has changed since they fell asleep.

    A body wakes when more than a tenth of the contact forces on it, weight included, changes or
    moves.

    :param rows: contacts with which bodies fell asleep, (E, 13).
    :param table: contacts of the last step, (C, 13).
    :param gravity: [m/s²], (3,).
    """
    if not len(rows):
        return np.zeros(0, np.intp)
    return _disturbed(rows, table, bodies.state, bodies.velocities, bodies.poses, bodies.mass,
                      bodies.radius, float(norm(gravity)))


@kernel
def _disturbed(rows, table, state, velocities, poses, mass, radius, gravity):
    change, pressed = np.zeros((len(state), 6)), mass * gravity
    for e in range(len(rows)):
        _add(rows[e], -1.0, state, velocities, poses, change, pressed)
    weight = np.empty(0)
    for c in range(len(table)):
        _add(table[c], 1.0, state, velocities, poses, change, weight)
    found = np.zeros(len(state), np.bool_)
    for b in range(len(state)):
        if state[b] == _RESTING:
            most = _CHANGE * pressed[b]
            found[b] = _speed(change[b]) > most or _spin(change[b]) > most * radius[b]
    return np.flatnonzero(found)


@subroutine
def _add(row, sign, state, velocities, poses, change, pressed):
    """Add a contact force on sleeping bodies, if the other body is awake, removed or driven."""
    size = np.sqrt(row[9] * row[9] + row[10] * row[10] + row[11] * row[11])
    for side in range(2):
        own, other = int(row[side]), int(row[1 - side])
        if state[own] != _RESTING:
            continue
        if len(pressed):
            pressed[own] += size
        doing = state[other]
        if not (doing in (_AWAKE, _GONE) or doing == _DRIVEN and velocities[other].any()):
            continue
        s = sign if side == 0 else -sign
        x, y, z = s * row[9], s * row[10], s * row[11]
        i, j, k = row[2] - poses[own, 0], row[3] - poses[own, 1], row[4] - poses[own, 2]
        change[own, 0] += x
        change[own, 1] += y
        change[own, 2] += z
        change[own, 3] += j * z - k * y
        change[own, 4] += k * x - i * z
        change[own, 5] += i * y - j * x


def struck(bodies: BodyTable, rows: np.ndarray, time_step: float) -> np.ndarray:
    """
    List the sleeping bodies that an impact in this step may move.

    They wake *before* the step, so that the contact solver distributes the momentum; so do the
    bodies that they may be driven against.

    :param rows: contacts with which bodies fell asleep, (E, 13).
    :param time_step: [s].
    """
    moving = np.flatnonzero(bodies.state >= BodyState.AWAKE)
    speed = rim_speed(bodies, moving)
    sleeps = bodies.state == BodyState.RESTING
    woken = np.zeros(len(sleeps), bool)
    while len(moving) and sleeps.any():
        hit, by = _hits(bodies, np.flatnonzero(sleeps), moving, speed, time_step)
        fastest = np.full(len(sleeps), -np.inf)
        np.maximum.at(fastest, hit, speed[by])
        moving = with_islands(rows, np.unique(hit), bodies)
        speed = np.maximum(fastest[moving], speed[by].max(initial=0.0))
        woken[moving], sleeps[moving] = True, False
    return np.flatnonzero(woken)


def _hits(bodies: BodyTable, sleeping: np.ndarray, moving: np.ndarray, speed: np.ndarray,
          time_step: float) -> tuple[np.ndarray, np.ndarray]:
    """
    List the sleeping bodies that moving ones may reach in this step and hit hard enough.

    Bounds of branches are mostly empty, so each pair is tested piece by piece.

    :param moving: ids, (K,).
    :param speed: upper bound of the speed of their points [m/s], (K,).
    :returns: sleeping bodies, and rows of moving ones, (P,).
    """
    reach = speed * time_step + _NEAR
    box = bounds(bodies, moving)
    mass = np.where(bodies.state[moving] == BodyState.KINEMATIC, np.inf, bodies.mass[moving])
    order = np.argsort(box[:, 0] - reach, kind='stable')
    room = reach[order, None]
    pairs = _reached(box[order, :3] - room, box[order, 3:] + room, speed[order], mass[order],
                     bodies.bounds[sleeping], bodies.mass[sleeping])
    hit, by = sleeping[pairs[:, 0]], order[pairs[:, 1]]
    near = are_near(bodies, np.column_stack([hit, moving[by]]), reach[by])
    return hit[near], by[near]


def rim_speed(bodies: BodyTable, ids: np.ndarray) -> np.ndarray:
    """Compute an upper bound of the speed of any point of a body [m/s], (K,)."""
    return _rim_speed(ids, bodies.velocities, bodies.radius)


@kernel
def _rim_speed(ids, velocities, radius):
    out = np.empty(len(ids))
    for k in range(len(ids)):
        v = velocities[ids[k]]
        out[k] = (np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
                  + np.sqrt(v[3] ** 2 + v[4] ** 2 + v[5] ** 2) * radius[ids[k]])
    return out


@kernel
def _reached(low, high, speed, mass, bounds, sleeping_mass):
    """List pairs of sleeping boxes and moving ones, sorted by least x, that reach them."""
    pairs = np.empty((64, 2), np.int64)
    found = 0
    width = 0.0
    for m in range(len(low)):
        width = max(width, high[m, 0] - low[m, 0])
    for r in range(len(bounds)):
        first = np.searchsorted(low[:, 0], bounds[r, 0] - width)
        for m in range(first, len(low)):
            if low[m, 0] > bounds[r, 3]:
                break
            if (high[m, 0] >= bounds[r, 0]
                    and low[m, 1] <= bounds[r, 4] and high[m, 1] >= bounds[r, 1]
                    and low[m, 2] <= bounds[r, 5] and high[m, 2] >= bounds[r, 2]
                    and speed[m] > SLEEP_SPEED * (1.0 + sleeping_mass[r] / mass[m])):
                if found == len(pairs):
                    more = np.empty((2 * found, 2), np.int64)
                    more[:found] = pairs
                    pairs = more
                pairs[found, 0], pairs[found, 1] = r, m
                found += 1
    return pairs[:found]
