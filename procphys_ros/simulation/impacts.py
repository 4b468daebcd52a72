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

"""Impacts: break what contacts overload, at once or for long, while the engine moves bodies."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from procphys_ros.blueprint import Law
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import FACES, TEETH
from procphys_ros.physics.masonry import Breakage
from procphys_ros.physics.masonry.contact_forces import (
    BodyContacts,
    PieceBlow,
    spread,
    turned_back,
)
from procphys_ros.physics.world import BodyState, Contacts
from procphys_ros.physics.world.returned_impulses import Begun, give_back, group_bodies
from procphys_ros.simulation import breaking, contact_exclusions, fragments, glass, yielding
from procphys_ros.simulation.blows import (
    Blows,
    change_by_contacts,
    energies,
    LEAST_JUMP,
    measure,
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
_WORK = 1000        # ... parts broken at once, about 8 µs each; the rest follows, but is
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
    awake = state.world.awake[state.world.awake < len(known.size)]
    large = awake[(known.size[awake] >= 2.0 * grain) & ~struck[awake]
                  & (state.world.bodies.radius[awake] > _LONG)]
    chosen = np.union1d(large, _pressed(model, state, awake, dt))
    weakest = state.loose_bonds.weakest  # inf in bodies of mechanisms, which have no bonds
    chosen = chosen[np.array([np.isfinite(weakest[known.members[body]]).any()
                              for body in chosen.tolist()], bool)]
    waits = {blow.body for blow in own.waiting}
    samples, due = {}, []
    felt = _contacts_of(state.world.contacts(), dt, own.poses, chosen)[0] if len(chosen) else []
    for body, contacts in zip(chosen.tolist(), felt):
        parts, before = own.borne.get(body, (None, ()))
        if parts is not known.members[body]:
            parts, before = known.members[body], ()
        samples[body] = parts, (*before, contacts)[-_SAMPLES:]
        if len(samples[body][1]) == _SAMPLES and body not in waits:
            due.append(PieceBlow(body, parts, _mean(samples.pop(body)[1]), np.inf))
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


def _contacts_of(contacts: Contacts, duration: float | np.ndarray, poses: np.ndarray,
                 chosen: np.ndarray) -> tuple[list[BodyContacts], np.ndarray, np.ndarray]:
    """
    List the contact forces on each of some bodies, in its own frame.

    :param duration: impulse over force [s], of all or of each, (C,).
    :param poses: of all bodies when the contacts were found, (B, 7).
    :param chosen: ids, (K,).
    :returns: the contacts of each; their rows among those that have the body as the first, and
        then as the second, (R,); and where the rows of each body start, (K + 1,).
    """
    twice = contacts.both_ways()
    index = np.full(len(poses), -1)
    index[chosen] = np.arange(len(chosen))
    owner = index[twice.body_a]
    rows = np.argsort(owner, kind='stable')[np.count_nonzero(owner < 0):]
    ends = np.searchsorted(owner[rows], np.arange(len(chosen) + 1))
    frame = poses[twice.body_a[rows]]
    last = np.tile(np.broadcast_to(duration, len(contacts)), 2)[rows]
    columns = (*turned_back(frame, twice.point[rows] - frame[:, :3], twice.normal[rows],
                            twice.impulse[rows] / last[:, None]), twice.body_b[rows])
    return [BodyContacts(*(c[low:high] for c in columns))
            for low, high in pairwise(ends)], rows, ends


def _mean(samples: tuple[BodyContacts, ...]) -> BodyContacts:
    """Return contacts with the mean of the forces of all samples."""
    points, normals, forces, other = (np.concatenate(column) for column in zip(*samples))
    return BodyContacts(points, normals, forces / len(samples), other)


def step(model: Model, state: State, dt: float) -> None:
    """
    Break pieces that lasting contacts overload, or whose blows wait, and cracked panes.

    Writes bodies and their bonds.
    """
    rubble = state.rubble
    rubble.unsampled += dt
    if rubble.unsampled >= _INTERVAL - 1e-9 and len(state.world.awake):
        rubble.unsampled = 0.0
        begun = Begun(rubble.poses, rubble.velocities)
        struck = struck_bodies(state.world, change_by_contacts(state.world, *begun, dt))
        rubble.waiting += overloading(model, state, struck, _grain(model, state), dt)
    blows = [b for b in rubble.waiting if state.bodies.parts_of(b.body) is b.parts]
    broken, rubble.waiting = _break(model, state, blows)
    _split(model, state, broken)
    glass.crack_frames(model, state, [result.bonds for _, result in broken])
    if glass.shatter_loose(model, state) or broken:
        fragments.write_poses(model, state, dt)


def judge(model: Model, state: State, others: Sequence[Callable[[], object]], rows: np.ndarray,
          poses: np.ndarray, velocities: np.ndarray, duration: float) -> None:
    """
    Break what the contacts found by one query of the engine overload, standing or loose.

    The engine lets bodies collide as rigid ones. Where a blow exceeds the strength of bonds, only
    the transmitted share of its impulse was real: the rest is removed on both sides, what breaks
    is released or split, and its parts collide on their own from the next query on. Momentum is
    kept: both sides get equal and opposite shares back. Writes `rows`, bodies, parts, bonds and
    loads, and the cracks of panes.

    :param others: wait for parallel work that reads standing parts.
    :param rows, poses, velocities, duration: see `Looked`.
    """
    begun, fall = Begun(poses, velocities), -float(state.world.gravity[2]) * duration
    change = change_by_contacts(state.world, *begun, duration)
    struck = struck_bodies(state.world, change)
    if not struck.any():
        return
    pairs, bodies = rows[:, :2].astype(np.intp), state.world.bodies
    standing, hits = yielding.hit(state, pairs, struck)
    felt = pairs[struck[pairs].any(axis=1)]
    weak = felt[_may_split(model, state)[felt]]
    loose = np.where(bodies.state == BodyState.AWAKE, bodies.mass, 0.0)
    strikers = pairs[hits][standing[hits] < 0]
    near, group = _connected(pairs, np.concatenate([strikers, weak]), loose > 0.0)
    if not len(near):
        return
    contacts, share = Contacts.of(rows[near], duration), np.ones(len(struck))
    made, found = partial(measure, contacts, change, poses, loose, fall, duration), []
    if hits.any():
        for ended in others:
            ended()
        found = yielding.exits(state, made(FACES), velocities, np.flatnonzero(hits[near]),
                               standing[near], group, share)
    broken = _struck_pieces(model, state, struck, change, made(TEETH), poses) if len(weak) else []
    share[[blow.body for blow, _ in broken]] = [result.share for _, result in broken]
    if found or broken:
        rows[near, 9:] = give_back(state.world, contacts, begun, duration, share) / duration
        yielding.release(model, state, found)
        _split(model, state, broken)
        _join_step(state, [*(out.parts for out, _ in found), *(blow.parts for blow, _ in broken)])


def _connected(pairs: np.ndarray, chosen: np.ndarray,
               moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Find the contacts of some bodies, and of all that are connected with these by contacts.

    :param pairs: bodies of each contact, (C, 2).
    :param chosen: ids, (K,).
    :param moving: bodies that move freely, by id, (B,) bool.
    :returns: rows of the contacts, and the groups of bodies, see `group_bodies`.
    """
    group = group_bodies(pairs[:, 0], pairs[:, 1], moving)
    among = np.zeros(len(group), bool)
    among[group[chosen]] = True
    return np.flatnonzero((among[group[pairs]] & moving[pairs]).any(axis=1)), group


def _struck_pieces(model: Model, state: State, struck: np.ndarray, change: np.ndarray, made: Blows,
                   poses: np.ndarray) -> list[tuple[PieceBlow, Breakage]]:
    """
    List the pieces that blows break, which are still whole, and crack panes.

    See `glass.judge`.
    """
    broken, waiting = _break(model, state, _blows(model, state, made, struck, poses))
    state.rubble.waiting += waiting
    glass.judge(model, state, struck, change, made, poses)
    glass.crack_frames(model, state, [result.bonds for _, result in broken])
    return broken


def _may_split(model: Model, state: State) -> np.ndarray:
    """Mark bodies that are large enough to be broken, or have panes, by id, (B,) bool."""
    grain, size = _grain(model, state), state.bodies.size
    out = np.zeros(len(state.world.bodies.state), bool)
    out[:len(size)] = (size >= 2.0 * (grain if _room(model, state) >= 2 else _LUMP * grain)
                       )[:len(out)]
    out[glass.glazed(model, state)] = True
    return out


def _split(model: Model, state: State, broken: list[tuple[PieceBlow, Breakage]]) -> None:
    """Break bonds in pieces, and make bodies of the remains."""
    if not broken:
        return
    bonds, causes, loads = (np.concatenate(column) for column in zip(*(
        (result.bonds, _causes(model, blow, result.bonds), result.load)
        for blow, result in broken)))
    breaking.break_bonds(model, state, bonds, causes, loads)
    known = len(state.excluded)
    for _, result in broken:
        contact_exclusions.add_split(state, result.pieces)
    breaking.release(model, state, [piece for _, result in broken if len(result.pieces) > 1
                                    for piece in result.pieces])
    if len(state.excluded) > known:
        contact_exclusions.update(model, state)
    for _, result in broken:
        fragments.hang(model, state, result.bonds)


def _join_step(state: State, pieces: list[np.ndarray]) -> None:
    """Record the present motion of new bodies as that before the engine's step."""
    rubble, bodies = state.rubble, state.world.bodies
    fresh = np.unique(state.parts.body[np.concatenate(pieces)])
    for name in ('poses', 'velocities'):
        column, kept = getattr(bodies, name), getattr(rubble, name)
        kept = np.concatenate([kept, column[len(kept):]])
        kept[fresh] = column[fresh]
        setattr(rubble, name, kept)


def _far(model: Model, state: State, bodies: np.ndarray) -> np.ndarray:
    """Mark the bodies that break coarsely, being far from the observer, (K,) bool."""
    sharp = model.settings.culling.debris_distance
    if state.observer is None or sharp == 0.0:
        return np.zeros(len(bodies), bool)
    table = state.world.bodies
    return state.observer.distance(table.poses[bodies, :3]) > sharp + table.radius[bodies]


def _break(model: Model, state: State, blows: list[PieceBlow]
           ) -> tuple[list[tuple[PieceBlow, Breakage]], list[PieceBlow]]:
    """
    Judge blows on pieces; nothing is broken yet.

    :returns: the blows that break bonds, with their breakage, and those that are judged later.
    """
    if not blows:
        return [], []
    grain, room = _grain(model, state), _room(model, state)
    far = _far(model, state, np.array([b.body for b in blows], np.intp))
    chosen, wanted, work, waiting = [], [], 0, []
    for blow, cells, distant in zip(blows, _cells(blows, room, grain), far.tolist()):
        cells = min(cells, _COARSE) if distant else cells
        if cells < 2:
            continue
        if work > _WORK and len(blow.parts) < _LUMP * grain:
            waiting.append(blow)
            continue
        work += len(blow.parts) + _PER_CELL * cells
        chosen.append(blow)
        wanted.append(cells)
    if not chosen:
        return [], waiting
    results = state.loose_bonds.strike_all(
        [blow.parts for blow in chosen],
        np.concatenate([_wrenches(model, state, blow) for blow in chosen]), wanted,
        [blow.energy for blow in chosen])
    return [(blow, result) for blow, result in zip(chosen, results)
            if len(result.bonds)], waiting


def _wrenches(model: Model, state: State, blow: PieceBlow) -> np.ndarray:
    """Distribute a blow over the parts of its body, in the frame of the blueprint, (P, 6)."""
    parts = blow.parts
    return spread(blow.contacts, state.parts.local[parts], state.parts.size[parts],
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
           poses: np.ndarray) -> list[PieceBlow]:
    """
    List the blows that might break a piece, the hardest first.

    :param struck: bodies that were stopped or pushed; others only rest on each other.
    :param poses: of all bodies when the contacts were found, (B, 7).
    """
    contacts, grain = made.contacts, _grain(model, state)
    bodies, known, bonds = state.world.bodies, state.bodies, state.loose_bonds
    count = len(bodies.state)
    side = np.concatenate([contacts.body_a, contacts.body_b])
    push = np.tile(np.sqrt((contacts.impulse * contacts.impulse).sum(axis=1)), 2)
    push *= np.tile(struck[contacts.body_a] | struck[contacts.body_b], 2)
    given = np.bincount(side, push, count)
    force = np.bincount(side, push / np.tile(made.duration, 2), count)
    size = np.zeros(count, np.intp)
    size[:len(known.size)] = known.size[:count]
    chosen = np.flatnonzero((size >= 2.0 * grain) & (given > LEAST_JUMP * bodies.mass)
                            & (bodies.state == BodyState.AWAKE))
    far = _far(model, state, chosen)
    chosen = chosen[~far | (size[chosen] >= 2.0 * _COARSER * grain)]
    chosen = chosen[~np.isin(chosen, [blow.body for blow in state.rubble.waiting])]
    if not len(chosen):
        return []
    chosen = chosen[np.argsort(-given[chosen], kind='stable')]
    parts = [known.parts_of(body) for body in chosen.tolist()]
    every, begin = np.concatenate(parts), np.cumsum([0, *(len(own) for own in parts)])[:-1]
    least = np.minimum(np.minimum.reduceat(bonds.weakest[every], begin),
                       np.minimum.reduceat(bonds.weakest_bent[every], begin)
                       / (_LEVER * bodies.radius[chosen]))
    hard = np.flatnonzero(force[chosen] > _SCREEN * least)
    if not len(hard):
        return []
    felt, stopped = _felt(made, poses, chosen[hard])
    return [PieceBlow(int(chosen[n]), parts[n], own, energy)
            for n, own, energy in zip(hard.tolist(), felt, stopped)]


def _felt(made: Blows, poses: np.ndarray,
          chosen: np.ndarray) -> tuple[list[BodyContacts], list[float]]:
    """Return the contacts of bodies, (K,) ids, and the energies of the motion they stop [J]."""
    contacts = made.contacts
    felt, rows, ends = _contacts_of(contacts, made.duration, poses, chosen)
    energy = np.concatenate([made.energy, made.energy[:, ::-1]])[rows]
    other = np.concatenate([contacts.body_b, contacts.body_a])[rows]
    return felt, energies(energy, other, ends).tolist()


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
