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

"""Settling: put loose bodies to rest, and wake resting ones that lost their support."""

import numpy as np

from procphys_ros import rotation
from procphys_ros.compilation import kernel
from procphys_ros.elementary import functions
from procphys_ros.linear import norm
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.contacts import Contacts

REST_SPEED = 0.15  # [m/s], slower than this in the mean at the centre of mass counts as quiet
REST_SPIN = 0.6  # [rad/s]
REST_RIM = 0.3  # [m/s], and spin times radius: large bodies must turn more slowly
STARTING = 1.5  # times its mean speed: what is faster now starts to slide or to topple, ...
START_WAY = 0.005  # [m], once it has come so far; what starts from rest is at 2 at first
JITTER_SPEED = 1.0  # [m/s] that the contact solver may leave a body that hardly moves: under
JITTER_SPIN = 6.0  # [rad/s] a block of 40 t, bricks give way and are pushed back in every step
JITTER_WAY = 0.01  # [m]
REST_TIME = 0.5  # [s], how long a body is quiet before it comes to rest
CHECK_INTERVAL = 0.1  # [s] between looks at the quiet bodies: reading contacts is expensive
STAY_REACH = 0.02  # [m], a body whose farthest point keeps within this stays where it is
STAY_TIME = 1.0  # [s], how long a body stays, though it trembles, before it comes to rest
STILL_SPEED = 0.005  # [m/s] at the rim of a body that has stayed for `STAY_TIME`: it is held, by
#                      friction at its sides where not from below. What is out of balance by more
#                      than `_STANCE` is faster by then
STUCK_TIME = 3.0  # [s], a body that stays for so long is held by more than the check sees
CREEP_TIME = 2.0  # [s], a body that is quiet for so long, ...
CREEP_SPEED = 0.05  # [m/s] ... whose rim is slower in the mean, and which gets no faster, is
#                     squeezed: what slides or falls does not keep its speed
TREMBLE_TIME = 0.1  # [s], a body that stays for so long trembles and hits nothing; one that was
#                     thawed counts as such until it leaves, or wedged heaps wake each other
JAMMED = 0.007  # [m] of overlap with another from which a body does not rest at once: one that
#                 rests gives way to nothing, and what is squeezed into it stays so
STIRRED = 3  # times that a body is kept from rest for this, or sets others free
SUPPORT_SHIFT = 0.01  # [m], move of a support that sets free what rests on it
SPARE = 0.1  # share of its contacts, or of their forces, that a body may lose before
_TOUCH = 2e-3  # [m], gap below which a contact counts as touching
_STANCE = 0.001  # [m], how far the centre of mass may lie outside what carries it
_BESIDE = -0.5  # least upward part of the normal of a contact that can hold a body up
_BELOW = 0.1  # least upward part of the normal of a contact that carries a body


class Supports:
    """
    Who rests on whom: one row per contact that a resting body had when it came to rest.

    :ivar support: id of the body that carries, (E,) int.
    :ivar resting: id of the body that is carried, (E,) int.
    :ivar local: contact point in the axes of the support [m], (E, 3).
    :ivar point: contact point in the world when it was recorded [m], (E, 3).
    :ivar normal: of the contact, towards the carried body, (E, 3).
    :ivar share: of the weight of the carried body that went this way, (E,).
    :ivar load: share of the sizes of all forces that carried it, (E,).
    :ivar gone: whether the support has moved away since, (E,) bool.
    """

    def __init__(self) -> None:
        self.support = np.zeros(0, np.intp)
        self.resting = np.zeros(0, np.intp)
        self.local = np.zeros((0, 3))
        self.point = np.zeros((0, 3))
        self.normal = np.zeros((0, 3))
        self.share = np.zeros(0)
        self.load = np.zeros(0)
        self.gone = np.zeros(0, bool)

    def add(self, bodies: BodyTable, contacts: Contacts, rests: np.ndarray) -> None:
        """Record what carries the bodies that come to rest now, (K,) ids."""
        chosen = np.zeros(len(bodies.state), bool)
        chosen[rests] = True
        keep = chosen[contacts.body_a] & (contacts.normal[:, 2] > _BESIDE) & _touching(contacts)
        support, resting = contacts.body_b[keep], contacts.body_a[keep]
        point, count = contacts.point[keep], len(bodies.state)
        frame = bodies.poses[support]
        upward = np.maximum(contacts.impulse[:, 2], 0.0)
        borne = np.bincount(contacts.body_a, upward, count)[resting]
        size = norm(contacts.impulse[keep], axis=1) + 1e-12
        self._append(
            support=support, resting=resting, point=point, normal=contacts.normal[keep],
            local=rotation.rotate(rotation.conjugate(frame[:, 3:]), point - frame[:, :3]),
            share=upward[keep] / np.maximum(borne, 1e-12),
            load=size / np.bincount(resting, size, count)[resting],
            gone=np.zeros(len(support), bool))

    def _append(self, **rows: np.ndarray) -> None:
        for name, values in rows.items():
            setattr(self, name, np.concatenate([getattr(self, name), values]))

    def drop(self, state: np.ndarray) -> None:
        """Forget what no longer rests."""
        keep = state[self.resting] == BodyState.RESTING
        if not keep.all():
            for name, column in vars(self).items():
                setattr(self, name, column[keep])

    def carried_by(self, support: np.ndarray) -> np.ndarray:
        """List the bodies that rest on any of the given ids."""
        carries = np.zeros(max(self.support.max(initial=0), support.max(initial=0)) + 1, bool)
        carries[support] = True
        return np.unique(self.resting[carries[self.support]])

    def lost(self, bodies: BodyTable) -> np.ndarray:
        """
        List the bodies whose supports have moved away: for most, any one of them.

        What still stands on the others, and bore little on those that moved, rests on: light
        pieces that lie beside a heavy one, or that it squeezes, do not hold it up.
        """
        state = bodies.state[self.support]
        row = np.flatnonzero((state != BodyState.RESTING) & (state != BodyState.FIXED)
                             & (state != BodyState.GROUND) & ~self.gone)
        if not len(row):
            return row
        frame = bodies.poses[self.support[row]]
        now = frame[:, :3] + rotation.rotate(frame[:, 3:], self.local[row])
        moved = row[np.square(now - self.point[row]).sum(axis=1) > SUPPORT_SHIFT * SUPPORT_SHIFT]
        if not len(moved):
            return moved
        self.gone[moved] = True
        count, ids = len(bodies.state), np.unique(self.resting[moved])
        loose = bodies.state[self.support] != BodyState.GROUND
        bare = (np.bincount(self.resting, self.gone, count)[ids]
                > SPARE * np.bincount(self.resting, loose, count)[ids])
        lost = bare & (np.bincount(self.resting, self.gone * self.load, count)[ids] > SPARE)
        lost[bare & ~lost] = ~self._carry(bodies, ids[bare & ~lost])
        self.gone[np.isin(self.resting, ids[lost])] = False  # found again until they are free
        return ids[lost]

    def _carry(self, bodies: BodyTable, ids: np.ndarray) -> np.ndarray:
        """Return which bodies stand on the supports that they have left, (K,) bool."""
        index = np.full(len(bodies.state), -1)
        index[ids] = np.arange(len(ids))
        carried = np.where(self.gone, -1, index[self.resting])
        row = np.argsort(carried, kind='stable')[np.count_nonzero(carried < 0):]
        start = np.searchsorted(carried[row], np.arange(len(ids) + 1))
        return _stands(start, self.point[row], self.normal[row], bodies.poses[ids, :2])


def count_quiet(bodies: BodyTable, awake: np.ndarray, time_step: float) -> np.ndarray:
    """
    Keep the clocks of the loose bodies, and choose those that may have come to rest.

    A body is quiet while it is slow, by the way it makes: velocities tremble where heavy bodies
    lie on light ones. Pieces wedged into each other never are quiet; they count when they stay in
    one place, trembling or not.

    :returns: ids, (K,).
    """
    calm, stays = _keep_clocks(awake, time_step, bodies.poses, bodies.velocities, bodies.radius,
                               bodies.quiet, bodies.mark, bodies.stay, bodies.anchor)
    calm[calm] = ~_is_starting(bodies, awake[calm])
    return awake[calm | stays]


@kernel
def _keep_clocks(awake, time_step, poses, velocities, radius, quiet, mark, stay, anchor):
    """Keep the clocks; say which bodies have been quiet, and which have stayed, long enough."""
    calm, stays = np.zeros(len(awake), np.bool_), np.zeros(len(awake), np.bool_)
    for k in range(len(awake)):
        b = awake[k]
        v = velocities[b]
        quiet[b] += time_step
        way, turn = _way(mark[b], poses[b])
        if not (v[0] ** 2 + v[1] ** 2 + v[2] ** 2 < JITTER_SPEED ** 2
                and v[3] ** 2 + v[4] ** 2 + v[5] ** 2 < JITTER_SPIN ** 2
                and way < REST_SPEED * quiet[b] + JITTER_WAY and turn < REST_SPIN * quiet[b]
                and turn * radius[b] < REST_RIM * quiet[b] + JITTER_WAY):
            quiet[b] = 0.0
            mark[b] = poses[b]
        calm[k] = quiet[b] > REST_TIME - 1e-9
        way, turn = _way(anchor[b], poses[b])
        stay[b] += time_step
        if not way + turn * radius[b] < STAY_REACH:
            stay[b] = 0.0
            anchor[b] = poses[b]
        stays[k] = stay[b] > STAY_TIME - 1e-9
    return calm, stays


@kernel
def _way(start, now):
    """Give how far a body has come [m] and by how much it has turned [rad]."""
    way = same = 0.0
    for c in range(3):
        way += (now[c] - start[c]) ** 2
    for c in range(3, 7):
        same += now[c] * start[c]
    return np.sqrt(way), 2.0 * functions.acos(min(abs(same), 1.0))


def _is_starting(bodies: BodyTable, ids: np.ndarray) -> np.ndarray:
    """Return which quiet bodies get faster: the slow start of a slide or a fall, (K,) bool."""
    pose, mark, velocity = bodies.poses[ids], bodies.mark[ids], bodies.velocities[ids]
    _, turn = _moved(mark, pose)
    way = np.concatenate([pose[:, :3] - mark[:, :3], (turn * bodies.radius[ids])[:, None]], axis=1)
    rate = np.concatenate([velocity[:, :3], (norm(velocity[:, 3:], axis=1)
                                             * bodies.radius[ids])[:, None]], axis=1)
    size = np.maximum(norm(way, axis=1), 1e-12)
    now = (rate * way).sum(axis=1) / size
    return (size > START_WAY) & (now > STARTING * size / bodies.quiet[ids])


@kernel
def _moved(start, now):
    """Give how far bodies have come [m] and by how much they have turned [rad], (K,) each."""
    way, turn = np.empty(len(now)), np.empty(len(now))
    for k in range(len(now)):
        way[k], turn[k] = _way(start[k], now[k])
    return way, turn


def at_rest(bodies: BodyTable, quiet: np.ndarray,
            contacts: Contacts) -> tuple[np.ndarray, np.ndarray]:
    """
    Choose the quiet bodies that can stand where they are, and those to set free with them.

    A body stands when its centre of mass lies over the polygon of what it touches; a slab that
    starts to topple is slow, too, but does not. What is clamped may stand beside that polygon: it
    counts when it has stayed where it is, see `STILL_SPEED` and `STUCK_TIME`, or creeps, see
    `CREEP_SPEED`.

    :param quiet: ids from `count_quiet`, (K,).
    :param contacts: of the last step, each listed both ways.
    :returns: ids that come to rest, (R,), and that are jammed, resting ones among them, (J,).
    """
    index = np.full(len(bodies.state), -1)
    index[quiet] = np.arange(len(quiet))
    candidate = index[contacts.body_a]
    keep = (candidate >= 0) & _touching(contacts)
    order = np.argsort(candidate[keep], kind='stable')
    row = np.flatnonzero(keep)[order]
    start = np.searchsorted(candidate[row], np.arange(len(quiet) + 1))
    stands = _stands(start, contacts.point[row], contacts.normal[row],
                     bodies.poses[quiet, :2])
    velocity = bodies.velocities[quiet]
    rim = (norm(velocity[:, :3], axis=1)
           + norm(velocity[:, 3:], axis=1) * bodies.radius[quiet])
    known = (rim < STILL_SPEED) | (bodies.stirred[quiet] > 0)  # these could rest before
    held = np.where(known, STAY_TIME, STUCK_TIME)
    held = (bodies.stay[quiet] > held) | _is_creeping(bodies, quiet, rim)
    rests = quiet[stands | (held & (np.diff(start) > 0))]
    jammed = _jammed(bodies, rests, contacts)
    bodies.stirred[jammed] = np.minimum(bodies.stirred[jammed] + 1, STIRRED)
    return np.setdiff1d(rests, jammed), jammed


def _jammed(bodies: BodyTable, rests: np.ndarray, contacts: Contacts) -> np.ndarray:
    """List loose bodies that would be left deep in others, which stand, rest or come to rest."""
    still = (bodies.state == BodyState.FIXED) | (bodies.state == BodyState.RESTING)
    still[rests] = True
    pairs = np.column_stack([contacts.body_a, contacts.body_b])[contacts.distance < -JAMMED]
    pairs = pairs[still[pairs].all(axis=1)]
    loose = bodies.state[pairs] != BodyState.FIXED
    again = (loose & (bodies.stirred[pairs] < STIRRED)).any(axis=1)
    return np.unique(pairs[again][loose[again]])


def _is_creeping(bodies: BodyTable, ids: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """
    Return which bodies have been too slow for too long to slide or to fall, (K,) bool.

    Turns count with the farthest corner of a box of the same inertia: what is long and rolls about
    its axis, as a stem does that leans on an edge, moves no rim by that.
    """
    mark, pose = bodies.mark[ids], bodies.poses[ids]
    way, turn = _moved(mark, pose)
    axis = rotation.multiply(rotation.conjugate(mark[:, 3:]), pose[:, 3:])[:, :3]
    axis /= np.maximum(norm(axis, axis=1), 1e-12)[:, None]
    reach = np.sqrt((3.0 * bodies.inertia[ids] * (axis * axis)).sum(axis=1) / bodies.mass[ids])
    turned = turn * np.minimum(reach, bodies.radius[ids])
    creeps = ((bodies.quiet[ids] > CREEP_TIME) & (rim < REST_RIM)
              & (way + turned < CREEP_SPEED * bodies.quiet[ids]))
    creeps[creeps] = ~_is_starting(bodies, ids[creeps])
    return creeps


def _touching(contacts: Contacts) -> np.ndarray:
    return (contacts.distance < _TOUCH) | (contacts.normal_impulse > 0.0)


@kernel
def _stands(start, points, normals, centre):
    """
    Tell for each body whether no half plane through its centre is free of contacts.

    Each contact is widened to a small square, so that bodies balanced on a line or
    on a point as exactly as rounding allows count as standing.
    """
    result = np.zeros(len(centre), np.bool_)
    for k in range(len(centre)):
        count = start[k + 1] - start[k]
        angles = np.empty(4 * count)
        carried = False
        for i in range(count):
            j = start[k] + i
            carried |= normals[j, 2] > _BELOW
            for corner in range(4):
                dx = points[j, 0] - centre[k, 0] + _STANCE * (2 * (corner & 1) - 1)
                dy = points[j, 1] - centre[k, 1] + _STANCE * (2 * (corner >> 1) - 1)
                angles[4 * i + corner] = functions.atan2(dy, dx)
        if carried:
            angles.sort()
            widest = angles[0] + 2.0 * np.pi - angles[-1]
            for i in range(1, len(angles)):
                widest = max(widest, angles[i] - angles[i - 1])
            result[k] = widest <= np.pi
    return result
