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


"""Branch loads: contact loads of branches on standing walls."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.elementary import exp, expm1
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import contact_time
from procphys_ros.simulation import breaking, masonry
from procphys_ros.simulation.contact_pairs import TreeContacts
from procphys_ros.simulation.debris_loads import INTERVAL, SMOOTHING
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_HEAVY = 200.0    # [N] on one brick; smaller forces, such as of twigs in the wind, load no wall
_CHANGE = 0.02    # of the largest load: smaller changes need no new stresses
_LEAST = 1.0      # [N] below which a force is dropped
_LAYER = 'branches'


def break_out(model: Model, state: State, contacts: TreeContacts, dt: float) -> bool:
    """
    Break bricks out where branches strike harder than their bonds withstand.

    The branch receives the impulse that the bonds carried until they broke; after that only the
    bricks resist, which it meets at rest.

    :param contacts: of all trees in the step.
    :param dt: [s].
    :returns: whether any brick came out.
    """
    stops = contacts.speed / contacts.change  # the rest carries the pressing force
    mass = norm(contacts.impulse, axis=1) / contacts.change
    force = contacts.impulse * (stops / contact_time(mass) + (1.0 - stops) / dt)[:, None]
    parts, (pushes, impulses, masses) = _per_part(
        contacts.part, force, stops[:, None] * contacts.impulse,
        np.where(stops > 0.0, mass, 0.0)[:, None])
    broke = False
    for part, push, impulse, stopped in zip(parts, pushes, impulses, masses):
        size, momentum = float(norm(push)), float(norm(impulse))
        if size < _HEAVY or momentum == 0.0 or not state.standing[part]:
            continue
        blow = masonry.Strike(-impulse / momentum, size, float(stopped[0]), momentum)
        out = masonry.drive_out(state, np.array([part]), blow)
        if out is None:
            continue
        own = contacts.part == part
        share = contacts.impulse[own] * stops[own, None] * (out.passed_on / momentum)
        state.forest.push(contacts.row[own], contacts.point[own], share)
        masonry.apply_impulse_around(state, out.withstood.bonds, out.parts,
                                     out.passed_on * blow.direction, momentum / blow.mass)
        breaking.release(model, state, out.pieces, np.zeros((len(out.parts), 6)), Cause.IMPACT,
                         out.load)
        broke = True
    return broke


def update(model: Model, state: State, dt: float) -> None:
    """
    Apply the loads of branches to standing bricks; writes `state.branch_loads`, loads.

    A lasting force of a branch is a load that lasts as long. Its excess is a blow: a wall responds
    to the impulses within one period as to one, over any number of steps.
    """
    own, contacts = state.branch_loads, state.contacts
    if not (len(contacts) or len(own.parts)):
        return
    chosen, (total,) = _per_part(contacts.part, masonry.about_centres(
        state, contacts.part, contacts.point, contacts.impulse))
    if not len(chosen) and not len(own.parts):
        return
    before, standing = len(own.parts), state.standing
    both, place = np.unique(np.concatenate([own.parts, chosen]), return_inverse=True)
    mean, blow, now = np.zeros((3, len(both), 6))
    mean[place[:before]], blow[place[:before]] = own.mean, own.blow
    now[place[before:]] = -total / dt
    beyond = now - mean
    blow = exp(-masonry.WALL_RATE * dt) * blow + dt * beyond
    beats = masonry.WALL_RATE * norm(blow[:, :3], axis=1)
    struck = beats > np.maximum(_HEAVY, norm(mean[:, :3], axis=1))
    struck &= now.any(axis=1) & standing[both]
    if struck.any():
        speed = np.zeros(len(state.parts.owner))
        on_brick = contacts.part >= 0
        np.maximum.at(speed, contacts.part[on_brick], contacts.speed[on_brick])
        masonry.apply_impulses(state, both[struck], blow[struck], speed=speed[both[struck]])
    mean -= expm1(-dt / SMOOTHING) * beyond
    felt = (norm(mean[:, :3], axis=1) > _LEAST) | (beats > _LEAST)
    own.parts, own.mean, own.blow = both[felt], mean[felt], blow[felt]
    own.since += dt
    if own.since > INTERVAL - 1e-9 or not len(own.parts):
        own.since = 0.0
        _hand_over(state, standing)


def _hand_over(state: State, standing: np.ndarray) -> None:
    """Apply the lasting loads to the walls if they have changed."""
    own = state.branch_loads
    heavy = standing[own.parts] & (norm(own.mean[:, :3], axis=1) > _HEAVY)
    parts, mean = own.parts[heavy], own.mean[heavy]
    now, none = dict(zip(parts.tolist(), mean)), np.zeros(6)
    both = np.array(sorted(now.keys() | own.given.keys()), np.intp)
    change = [now.get(part, none) - own.given.get(part, none) for part in both.tolist()]
    if _largest(state, both, change) > _CHANGE * _largest(state, parts, mean):
        own.given = now
        state.loads.set_layer(_LAYER, parts, mean)


def _largest(state: State, parts: np.ndarray, wrenches: Sequence[np.ndarray]) -> float:
    """Return the largest force on a part, or moment over its reach [N]."""
    force, moment = np.split(np.reshape(wrenches, (-1, 6)), 2, axis=1)
    lever = state.solver.graph.reach[parts]
    return float(max(norm(force, axis=1).max(initial=0.0),
                     (norm(moment, axis=1) / lever).max(initial=0.0)))


def _per_part(parts: np.ndarray,
              *columns: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Sum up columns of contacts, (C, n) each, per brick."""
    on_brick = parts >= 0
    chosen, place = np.unique(parts[on_brick], return_inverse=True)
    sums = [np.zeros((len(chosen), column.shape[1])) for column in columns]
    for total, column in zip(sums, columns):
        np.add.at(total, place, column[on_brick])
    return chosen, sums
