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

"""Impacts: break loose pieces again where contacts overload their bonds, at once or for long."""

from collections.abc import Iterator
from functools import cache, partial
from itertools import pairwise
from typing import cast

import numpy as np

from procphys_ros.blueprint import Law
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import Breakage
from procphys_ros.physics.masonry.contact_forces import (
    BodyContacts,
    PieceBlow,
    spread,
    turned_back,
)
from procphys_ros.physics.world import BodyState
from procphys_ros.physics.world.returned_impulses import Begun, give_back
from procphys_ros.simulation import breaking, contact_exclusions, fragments, glass
from procphys_ros.simulation.blows import (
    Blows,
    blows_of,
    change_by_contacts,
    energies,
    LEAST_JUMP,
    struck_bodies,
)
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
_SCREEN = 0.5       # of the strength of its weakest bond: smaller forces cannot break a piece
_LEVER = 8.0 / 27.0  # of half the length of a free bar: largest moment over force, with the force
#                     at its end; in the middle it is 1/4
_NODES = 60         # cells per broken piece and step, at most
_PER_CELL = 5       # cost of judging a cell, in units of ...
_WORK = 1000        # ... parts broken in one step, about 8 µs each; the rest follows, but is
#                    stopped fully before it breaks, so lumps do not wait
_COARSE = 8         # cells per broken distant piece and step, at most
_COARSER = 8        # size of the smallest distant pieces over that of near ones
_LARGE = 70        # pieces allowed, however many bricks are flying: no storey falls in one piece
_LUMP = 10.0       # of the mean size of pieces: larger ones, 24 at most, break into such lumps
#                    at once and beyond any budget, ...
_HUGE = 24.0       # ... and those above this, 10 at most, as finely as possible: a few large cells
#                    are too stiff to show the damage by a blow on one of their corners


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


def step(model: Model, state: State, dt: float) -> None:
    """
    Break the pieces that the contacts of the engine's step overloaded.

    The engine lets pieces collide as rigid bodies. Where a blow exceeds the strength of their
    bonds, only the transmitted share of the impulse was real: the rest is removed on both sides,
    the piece is split, and the parts collide on their own from the next step on. Momentum is kept:
    both sides get equal and opposite shares back. Writes bodies and their bonds.
    """
    if not (len(state.world.awake) or state.rubble.waiting or glass.is_waiting(state)):
        return
    begun, fall = Begun(state.rubble.poses, state.rubble.velocities), model.gravity * dt
    change = change_by_contacts(state.world, *begun, fall)
    struck = struck_bodies(state.world, change)
    state.rubble.waiting += overloading(model, state, struck, _grain(model, state), dt)
    if not (state.rubble.waiting or glass.is_waiting(state) or struck.any()):
        return
    share = np.ones(len(struck))
    grain, room = _grain(model, state), _room(model, state)
    splits = (len(state.rubble.waiting) > 0 or np.max(state.bodies.size, initial=0)
              >= 2.0 * (grain if room >= 2 else _LUMP * grain))
    broken = []
    made = cache(partial(blows_of, model, state, change))  # expensive: milliseconds
    if splits:
        broken = _break(model, state, struck, made(), grain, room, share)
    glass.judge(model, state, struck, change, made, [result.bonds for _, result in broken])
    if broken:
        state.world.keep_impulses(give_back(state.world, state.world.contacts(), begun, fall,
                                            share, change))
        bonds, causes, loads = (np.concatenate(column) for column in zip(*(
            (result.bonds, _causes(model, blow, result.bonds), result.load)
            for blow, result in broken)))
        breaking.break_bonds(model, state, bonds, causes, loads)
        for _, result in broken:
            contact_exclusions.add_split(state, result.pieces)
        breaking.release(model, state, [piece for _, result in broken if len(result.pieces) > 1
                                        for piece in result.pieces])
        for _, result in broken:
            fragments.hang(model, state, result.bonds)
    if glass.shatter_loose(model, state) or broken:
        fragments.write_poses(model, state, dt)


def _far(model: Model, state: State, bodies: np.ndarray) -> np.ndarray:
    """Mark the bodies that break coarsely, being far from the observer, (K,) bool."""
    sharp = model.settings.culling.debris_distance
    if state.observer is None or sharp == 0.0:
        return np.zeros(len(bodies), bool)
    table = state.world.bodies
    return state.observer.distance(table.poses[bodies, :3]) > sharp + table.radius[bodies]


def _break(model: Model, state: State, struck: np.ndarray, made: Blows, grain: float, room: int,
           share: np.ndarray) -> list[tuple[PieceBlow, Breakage]]:
    """
    Judge the blows on pieces.

    :param struck: see `_struck`.
    :param made: blows of the last step.
    :param grain: see `_grain`.
    :param room: see `_room`.
    :param share: of the impulses on each body that its bonds transmitted, by id, (B,), written in
        place.
    :returns: the blows that broke bonds, with their breakage.
    """
    blows = [b for b in state.rubble.waiting if state.bodies.parts_of(b.body) is b.parts]
    late = len(blows)
    known = {b.body for b in blows}
    blows += [b for b in _blows(model, state, made, struck, grain)
              if b.body not in known]
    state.rubble.waiting = []
    if not blows:
        return []
    far = _far(model, state, np.array([b.body for b in blows], np.intp))
    chosen, wanted, work = [], [], 0
    for turn, cells in enumerate(_cells(blows, room, grain)):
        cells = min(cells, _COARSE) if far[turn] else cells
        if cells < 2:
            continue
        if work > _WORK and len(blows[turn].parts) < _LUMP * grain:
            state.rubble.waiting += _with_contacts(state, [blows[turn]], made)
            continue
        work += len(blows[turn].parts) + _PER_CELL * cells
        chosen.append(turn)
        wanted.append(cells)
    if not chosen:
        return []
    judged = _with_contacts(state, [blows[turn] for turn in chosen], made)
    results = state.loose_bonds.strike_all(
        [blow.parts for blow in judged],
        np.concatenate([_wrenches(model, state, blow) for blow in judged]), wanted,
        [blow.energy for blow in judged])
    for turn, blow, result in zip(chosen, judged, results):
        if len(result.bonds) and turn >= late:  # the impulse of a late blow was applied before
            share[blow.body] = result.share
    return [(blow, result) for blow, result in zip(judged, results) if len(result.bonds)]


def _wrenches(model: Model, state: State, blow: PieceBlow) -> np.ndarray:
    """Distribute a blow over the parts of its body, in the frame of the blueprint, (P, 6)."""
    parts, contacts = blow.parts, cast(BodyContacts, blow.contacts)
    return spread(contacts, state.parts.local[parts], state.parts.size[parts],
                  model.blueprint.poses[parts])


def _room(model: Model, state: State) -> int:
    """Return the number of bodies that may be added to the awake ones."""
    size, awake = state.bodies.size, state.world.awake
    large = size[awake[awake < len(size)]] >= _grain(model, state)
    return max(model.settings.debris_bodies - len(awake),
               _LARGE - int(np.count_nonzero(large)))


def _grain(model: Model, state: State) -> float:
    """Return the mean size of the pieces when all moving ones are broken within the budget."""
    awake = state.world.awake
    awake = awake[awake < len(state.bodies.size)]
    return max(float(state.bodies.size[awake].sum()) / model.settings.debris_bodies, 1.0)


def _blows(model: Model, state: State, made: Blows, struck: np.ndarray,
           grain: float) -> Iterator[PieceBlow]:
    """
    List the blows that might break a piece, the hardest first.

    :param made: blows of the last step.
    :param struck: bodies that were stopped or pushed; others only rest on each other.
    :param grain: number of parts of the smallest pieces within the budget.
    """
    contacts = made.contacts
    bodies, known, bonds = state.world.bodies, state.bodies, state.loose_bonds
    count = len(bodies.state)
    side = np.concatenate([contacts.body_a, contacts.body_b])
    push = np.tile(np.sqrt((contacts.impulse * contacts.impulse).sum(axis=1)), 2)
    by_blow = struck[side] | struck[np.concatenate([contacts.body_b, contacts.body_a])]
    felt = np.bincount(side, push * by_blow, count)
    rows = np.flatnonzero(by_blow[:len(contacts)])
    pair = np.concatenate([rows, rows + len(contacts)])
    duration = made.duration[rows]
    force = np.bincount(side[pair], push[pair] / np.tile(duration, 2), count)
    size = np.zeros(count, np.intp)
    size[:len(known.size)] = known.size[:count]
    chosen = np.flatnonzero((size >= 2.0 * grain) & (felt > LEAST_JUMP * bodies.mass)
                            & (bodies.state == BodyState.AWAKE))
    far = _far(model, state, chosen)
    chosen = chosen[~far | (size[chosen] >= 2.0 * _COARSER * grain)]
    order = np.argsort(side, kind='stable')
    start = np.searchsorted(side[order], np.arange(count + 1))
    if not len(chosen):
        return
    chosen = chosen[np.argsort(-felt[chosen], kind='stable')]
    parts = [known.parts_of(body) for body in chosen.tolist()]
    every, begin = np.concatenate(parts), np.cumsum([0, *(len(own) for own in parts)])[:-1]
    least = np.minimum(np.minimum.reduceat(bonds.weakest[every], begin),
                       np.minimum.reduceat(bonds.weakest_bent[every], begin)
                       / (_LEVER * bodies.radius[chosen]))
    for n in np.flatnonzero(force[chosen] > _SCREEN * least).tolist():
        body = int(chosen[n])
        yield PieceBlow(body, parts[n], None, 0.0, order[start[body]:start[body + 1]])


def _with_contacts(state: State, blows: list[PieceBlow], made: Blows) -> list[PieceBlow]:
    """
    Select the contacts of the blows that have none yet, all at once.

    Contacts with the body as the second are listed after all others.
    """
    fresh = [n for n, blow in enumerate(blows) if blow.contacts is None]
    if not fresh:
        return blows
    contacts = made.contacts
    ends = np.cumsum([0, *(len(blows[n].rows) for n in fresh)])
    rows = np.concatenate([blows[n].rows for n in fresh])
    body = np.repeat([blows[n].body for n in fresh], np.diff(ends))
    first = rows < len(contacts)
    rows = rows % len(contacts)
    sign = np.where(first, 1.0, -1.0)[:, None]
    start = state.rubble.poses[body]
    columns = (*turned_back(start, contacts.point[rows] - start[:, :3],
                            sign * contacts.normal[rows],
                            sign * contacts.impulse[rows] / made.duration[rows][:, None]),
               np.where(first, contacts.body_b[rows], contacts.body_a[rows]))
    energy = np.where(first[:, None], made.energy[rows], made.energy[rows, ::-1])
    stopped = energies(energy, columns[-1], ends)
    out = list(blows)
    for n, low, high, own in zip(fresh, ends, ends[1:], stopped.tolist()):
        out[n] = blows[n]._replace(contacts=BodyContacts(*(c[low:high] for c in columns)),
                                   energy=own)
    return out


def _causes(model: Model, blow: PieceBlow, bonds: np.ndarray) -> np.ndarray:
    """Return the causes of broken bonds: tension where a resting piece bends under its weight."""
    if np.isfinite(blow.energy):
        return np.full(len(bonds), Cause.IMPACT)
    wood = model.blueprint.bond_law[bonds] == Law.HINGE
    return np.where(wood, Cause.BENDING, Cause.TENSION)


def _cells(blows: list[PieceBlow], room: int, grain: float) -> list[int]:
    """
    Return the number of cells of each piece; below 2 it is not broken.

    Small pieces under lasting forces are heavily loaded, see `overloading`: they break
    beyond the budget.

    :param blows: the hardest first.
    :param room: for more bodies.
    :param grain: number of parts of the smallest pieces within the budget in the long run.
    """
    total = sum(len(b.parts) for b in blows)
    cells = []
    for blow in blows:
        lasts = blow.energy == np.inf
        if lasts and len(blow.parts) < 2.0 * grain:
            cells.append(min(len(blow.parts), _NODES))
            continue
        fair = int(np.ceil(room * len(blow.parts) / total))
        grains = len(blow.parts) / grain
        fitting = min(max(fair, 2), room, int(grains))
        least = int(grains if grains >= _HUGE else grains / _LUMP)
        cells.append(min(max(fitting, least), _NODES))
        room = max(room - cells[-1], 0) if cells[-1] > 1 else room
    return cells
