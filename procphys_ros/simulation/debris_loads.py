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


"""Debris loads: what rigid bodies press on standing masonry."""

import numpy as np

from procphys_ros.elementary import exp, expm1
from procphys_ros.physics.touch import overlaps
from procphys_ros.physics.world import Contacts
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

SMOOTHING = 0.1  # [s] over which impulses of moving bodies count as a steady load: about two
#                   periods of a storey-high wall, which averages shorter ones
INTERVAL = 0.1   # [s] between updates of resting loads
_CHANGE = 0.05    # of the largest load: smaller changes need no new stresses, ...
_LEAST = 100.0    # [N] ... nor do those far below the strength of a brick's joints, some kN
_ROOM = 0.1       # [m] around bodies, more than they move in a contact
LAYER = 'debris'


def update(model: Model, state: State, dt: float) -> None:
    """
    Record the impulses of moving debris, and update its loads at intervals.

    Writes `state.rubble` and loads.
    """
    own = state.rubble
    if not ((state.bodies.members or own.given.any()) and state.standing.any()):
        return
    own.moving *= exp(-dt / SMOOTHING)
    if may_touch(model, state):
        share = -expm1(-dt / SMOOTHING) / dt
        _press(state, state.world.contacts(), share, own.moving)
    own.since += dt
    if own.since < INTERVAL - 1e-9:
        return
    own.since = 0.0
    total = own.moving + _resting(state)
    largest = np.abs(total[:, :3]).max(initial=0.0)
    change = np.abs(total[:, :3] - own.given[:, :3]).max(initial=0.0)
    quiet = not len(state.world.awake) and np.abs(own.moving).max() < 1.0
    if change > (1.0 if quiet else max(_CHANGE * largest, _LEAST)):
        own.given = total
        parts = np.flatnonzero(total.any(axis=1))
        state.loads.set_layer(LAYER, parts, total[parts])


def may_touch(model: Model, state: State) -> bool:
    """
    Return whether any moving body may touch masonry; reading contacts is expensive.

    Computed once per step, after bodies have moved.
    """
    own = state.rubble
    if own.touches[0] != state.steps:
        own.touches = state.steps, _is_near(model, state)
    return own.touches[1]


def _is_near(model: Model, state: State) -> bool:
    bodies, awake = state.world.bodies, state.world.awake
    place, room = bodies.poses[awake, :3], bodies.radius[awake, None] + _ROOM
    bounds = np.hstack([place - room, place + room])
    return len(overlaps(bounds, model.masonry.bricks.reach)[0]) > 0


def part_of_body(state: State) -> np.ndarray:
    """Return the standing part of each body, -1 for all others, (B,)."""
    standing = np.flatnonzero(state.parts.owner == Owner.STANDING)
    out = np.full(len(state.world.bodies.state), -1, np.intp)
    out[state.parts.body[standing]] = standing
    return out


def _press(state: State, contacts: Contacts, rate: float, out: np.ndarray) -> None:
    """Add impulses on standing parts, times a rate [1/s], to forces and moments, (N, 6)."""
    standing = part_of_body(state)
    side = standing[contacts.body_a]
    part = np.maximum(side, standing[contacts.body_b])
    rows = np.flatnonzero(part >= 0)
    sign = np.where(side[rows] >= 0, rate, -rate)
    force = sign[:, None] * contacts.impulse[rows]
    arm = contacts.point[rows] - state.parts.poses[part[rows], :3]
    np.add.at(out, part[rows], np.hstack([force, np.cross(arm, force)]))


def _resting(state: State) -> np.ndarray:
    """Return the loads of resting bodies on standing parts, (N, 6)."""
    out = np.zeros_like(state.rubble.given)
    _press(state, state.world.asleep, 1.0, out)
    return out
