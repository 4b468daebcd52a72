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


"""Sustained loads: break loose pieces that lasting contact forces overload."""

from itertools import pairwise

import numpy as np

from procphys_ros.simulation.contact_forces import BodyContacts, PieceBlow, turned_back
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_INTERVAL = 0.05  # [s] between samples of contacts: reading them is expensive
_LONG = 1.5       # [m] radius of pieces that may break so: a piece that rests on its middle bears
#                   3·ρ·g·l²/h, some 60 kPa per metre for l = h, and mortar 0.1 MPa and more
_PRESSED = 1e5    # [N] sum of normal forces on a piece of any size, from below and above, from
#                   which on it is judged: 5 t go through it
_BORNE = 10.0     # of its own weight, likewise: less is little more than its weight
_SHARE = 0.1      # of the weight of all moving bodies, likewise: few pieces can carry that much
_SAMPLES = 5      # in a lasting mean: 0.25 s are some periods of a storey-high wall, and single
#                   steps of the engine are noisy


def overloading(model: Model, state: State, struck: np.ndarray, grain: float,
                dt: float) -> list[PieceBlow]:
    """
    List the pieces that lasting contact forces, from below and above, might break.

    A piece that a heap decelerates gradually was never hit, but may rest on a few points, and a
    storey may come to rest on a few bricks. The mean of the contact forces on a piece is a blow
    that lasts, and absorbs none of the motion: it is in balance with the weight and the inertia of
    the moving parts.

    Writes `state.rubble.borne`.

    :param struck: bodies whose blows are judged separately, by id, (B,) bool.
    :param grain: number of parts of the smallest pieces within the budget.
    """
    own, known = state.rubble, state.bodies
    own.unsampled += dt
    if own.unsampled < _INTERVAL - 1e-9:
        return []
    own.unsampled = 0.0
    awake = state.world.awake[state.world.awake < len(known.size)]
    large = awake[(known.size[awake] >= 2.0 * grain) & ~struck[awake]
                  & (state.world.bodies.radius[awake] > _LONG)]
    chosen = np.union1d(large, _pressed(model, state, awake, dt))
    waits = {blow.body for blow in own.waiting}
    samples, due = {}, []
    for body, contacts in zip(chosen.tolist(), _contacts_of(state, chosen, dt)):
        parts, before = own.borne.get(body, (None, ()))
        if parts is not known.members[body]:
            parts, before = known.members[body], ()
        samples[body] = parts, (*before, contacts)[-_SAMPLES:]
        if len(samples[body][1]) == _SAMPLES and body not in waits:
            due.append(PieceBlow(body, parts, _mean(samples.pop(body)[1]), np.inf,
                                 np.zeros(0, int)))
    own.borne = samples
    return due


def _pressed(model: Model, state: State, awake: np.ndarray, dt: float) -> np.ndarray:
    """
    List the pieces that carry far more than their own weight, however small they are.

    A heavily loaded piece jitters, and counts as struck in most steps: that must not delay it.
    """
    weight = state.world.bodies.mass[awake] * model.gravity
    if 2.0 * weight.sum() < _PRESSED:
        return awake[:0]  # the moving bodies are too light
    contacts, several = state.world.contacts(), state.bodies.size[awake] > 1
    force = np.zeros(len(state.world.bodies.state))
    for side in (contacts.body_a, contacts.body_b):
        force += np.bincount(side, np.abs(contacts.normal_impulse) / dt, len(force))
    least = max(_PRESSED, _SHARE * weight.sum())
    bears = force[awake] > np.maximum(_BORNE * weight, least)
    return awake[several & bears]


def _contacts_of(state: State, chosen: np.ndarray, dt: float) -> list[BodyContacts]:
    """Return the contact forces of the last step on each of some bodies, in its own frame."""
    if not len(chosen):
        return []
    contacts, start = state.world.contacts().both_ways(), state.rubble.poses
    index = np.full(len(start), -1)
    index[chosen] = np.arange(len(chosen))
    owner = index[contacts.body_a]
    rows = np.argsort(owner, kind='stable')[np.count_nonzero(owner < 0):]
    ends = np.searchsorted(owner[rows], np.arange(len(chosen) + 1))
    frame = start[contacts.body_a[rows]]
    columns = (*turned_back(frame, contacts.point[rows] - frame[:, :3], contacts.normal[rows],
                            contacts.impulse[rows] / dt), contacts.body_b[rows])
    return [BodyContacts(*(c[low:high] for c in columns)) for low, high in pairwise(ends)]


def _mean(samples: tuple[BodyContacts, ...]) -> BodyContacts:
    """Return contacts with the mean of the forces of all samples."""
    points, normals, forces, other = (np.concatenate(column) for column in zip(*samples))
    return BodyContacts(points, normals, forces / len(samples), other)
