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
Contact of trees with walls, debris, the ground and each other: impulses on both sides.

An impulse J does the work J·(v₀ + v₁)/2, v being the velocity at which what touches moves apart.
Contacts are solved for v₁ alone. A stiff twig that swings to and fro within a step may have a v₀
along J: friction that stops it at the end of the step then gives it energy. So may a bend that is
let go by an impulse, whose tree answers in another way than it was solved for. `too_much` bounds
this work by what undoing overlaps takes.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import exp, expm1
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.masonry.standing_loads import TOGETHER
from procphys_ros.physics.touch import islands, Partners, resolve, slips
from procphys_ros.physics.trees import ContactResponse
from procphys_ros.physics.world import BodyState
from procphys_ros.simulation import (
    breaking,
    contact_exclusions,
    contact_pairs,
    masonry,
    sawing,
    ties,
    trees,
)
from procphys_ros.simulation.blows import STILL
from procphys_ros.simulation.contact_pairs import Pairs, TreeContacts
from procphys_ros.simulation.fragments import WOOD_FRICTION
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_ROUNDING = 1e-5  # [J/kg] gain allowed per step
_SOLVED = 0.02    # relative accuracy of the solution of contacts
_HEAVY = 200.0    # [N] on one brick; smaller forces, such as of twigs in the wind, load no wall
_LEAST = 1.0      # [N] below which a force is dropped
_LAYER = 'branches'
_SLOP = 0.002    # [m] overlap that is left alone, so that resting contacts persist
_RECOVERY = 0.2  # share of a deeper overlap that is undone per step
_PUSH_OUT = 0.5  # [m/s] speed of this recovery at most
_WAKE = 0.3      # [m/s] change of speed that wakes a resting body
_SHOWN = 100.0   # effective mass at a contact over the mass of the tree, at most
_SURE = 0.01     # [m/s] slower points may have any effective mass
_LOOKS = 4       # predictions at most, while joint limits engage or release
_AGREES = 0.01   # error of a prediction, as a share of the fastest point
_SHARES = (0.5, 0.5, 0.5, 0.0)  # shares of impulses kept, in turn, while they do too much work


def too_much(partners: Partners, look: ContactResponse, free: np.ndarray, impulse: np.ndarray,
             normal: np.ndarray, out: np.ndarray, mass: np.ndarray, gain: float) -> np.ndarray:
    """
    Find the contacts of islands that gain energy.

    :param impulse: on the trees [N·s], (C, 3).
    :param normal: (C, 3).
    :param out: speed at which overlaps are undone [m/s], (C,).
    :param mass: of the trees at each contact [kg], (C,).
    :param gain: speed that weight gives in the step [m/s].
    :returns: (C,) bool.
    """
    share = look.old_share[:, None]
    mean = share * look.before + (1.0 - share) * look.velocity
    way = slips(partners._replace(motion=0.5 * (free + partners.motion)), mean)
    work = (impulse * way).sum(axis=1)
    if not (work > _ROUNDING * mass).any():
        return np.zeros(len(work), bool)
    island = islands(partners, look.place, len(look.velocity))
    total = np.bincount(island, work)
    lifted = np.bincount(island, np.maximum((impulse * normal).sum(axis=1), 0.0) * out)
    heaviest, fastest = np.zeros(len(total)), np.zeros(len(total))
    np.maximum.at(heaviest, island, mass)
    np.maximum.at(fastest, island, out)
    loose, row = np.unique(partners.body, return_index=True)
    loose, row = loose[loose >= 0], row[loose >= 0]
    inverse = partners.inverse_mass[loose]
    yields = inverse > 0.0
    np.add.at(heaviest, island[row[yields]], 1.0 / inverse[yields])
    allowed = np.minimum(lifted, heaviest * fastest * (0.5 * fastest + gain))
    slack = _ROUNDING * heaviest + _SOLVED * np.bincount(island, np.abs(work))
    return (total > allowed + slack)[island]


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


def press_walls(model: Model, state: State, dt: float) -> None:
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
    mean -= expm1(-dt / TOGETHER) * beyond
    felt = (norm(mean[:, :3], axis=1) > _LEAST) | (beats > _LEAST)
    own.parts, own.mean, own.blow = both[felt], mean[felt], blow[felt]
    own.since += dt
    if own.since > TOGETHER - 1e-9 or not len(own.parts):
        own.since = 0.0
        heavy = standing[own.parts] & (norm(own.mean[:, :3], axis=1) > _HEAVY)
        state.loads.follow(_LAYER, own.parts[heavy], own.mean[heavy])


def _per_part(parts: np.ndarray,
              *columns: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Sum up columns of contacts, (C, n) each, per brick."""
    on_brick = parts >= 0
    chosen, place = np.unique(parts[on_brick], return_inverse=True)
    sums = [np.zeros((len(chosen), column.shape[1])) for column in columns]
    for total, column in zip(sums, columns):
        np.add.at(total, place, column[on_brick])
    return chosen, sums


def step(model: Model, state: State, dt: float) -> None:
    """
    Find and apply the contact impulses of trees in the next step.

    Contacts are solved before the step of the trees, with their effective masses there. Trees and
    bodies get equal and opposite impulses, so momentum is kept exactly. Branches of one tree pass
    through each other, also when they have come off, until they are apart
    (`contact_exclusions`), and so do those of different standing trees unless the scene enables
    their contact. Writes `state.contacts`, the momentum of trees and bodies, and loads on walls.
    """
    ties.renew(model, state)
    state.contacts = _solve_all(model, state, dt)
    press_walls(model, state, dt)


def _solve_all(model: Model, state: State, dt: float) -> TreeContacts:
    """Solve for the contact impulses, and apply them."""
    if not state.forest.active.any():
        return TreeContacts()
    gives_way = True
    while gives_way:  # each pass leaves fewer candidates
        pairs, ropes = _find(model, state, dt), ties.find(model, state, dt)
        if not len(pairs.row) and not len(ropes.joint):
            return TreeContacts()
        contacts, change, bodies = _solve(model, state, pairs.and_more(ropes.pairs), ropes, dt)
        gives_way = _give_way(model, state, contacts, dt)
    pushed = contacts.impulse.any(axis=1)
    contacts = TreeContacts(*(column[pushed] for column in vars(contacts).values()))
    _apply(state, contacts, change, bodies)
    ties.pull(model, state, contacts, -0.5)
    return contacts


def _find(model: Model, state: State, dt: float) -> Pairs:
    around = contact_pairs.Surroundings(
        state.world, model.masonry.bricks, state.standing, state.parts.body,
        model.trees.beside, model.trees.slack,
        contact_pairs.pair_keys(np.concatenate([
            contact_exclusions.colliders(state, state.excluded), sawing.blades(state)])),
        model.terrain, model.trees.crowns)
    return contact_pairs.find(state.forest, state.trees.sizes, around, state.tree_bounds,
                              trees.movers(state), dt)


def find_inside(model: Model, state: State, depth: float) -> np.ndarray:
    """
    Find the rows of the forest that are inside walls or bodies, beyond the overlap as drawn.

    :param depth: smallest overlap that counts [m].
    """
    state.tree_bounds = contact_pairs.TreeBounds()
    pairs = _find(model, state, 0.0)
    return pairs.row[(pairs.gap < -depth) & ((pairs.part >= 0) | (pairs.body >= 0))]


def _apply(state: State, contacts: TreeContacts, change: np.ndarray, bodies: np.ndarray) -> None:
    forest, world = state.forest, state.world
    forest.push(contacts.row, contacts.point, contacts.impulse)
    both = contacts.other >= 0
    forest.push(contacts.other[both], contacts.point[both], -contacts.impulse[both])
    moved = change.any(axis=1) & (world.bodies.state[bodies] == BodyState.AWAKE)
    if moved.any():
        world.set_velocities(bodies[moved],
                             world.bodies.velocities[bodies[moved]] + change[moved])


def _give_way(model: Model, state: State, contacts: TreeContacts, dt: float) -> bool:
    """Release bodies and bricks that the contacts would move; return whether any was."""
    bodies = state.world.bodies
    hit = contacts.body >= 0
    ids, place = np.unique(contacts.body[hit], return_inverse=True)
    total = np.zeros((len(ids), 3))
    np.add.at(total, place, contacts.impulse[hit])
    woken = ids[(bodies.state[ids] == BodyState.RESTING)
                & ((total * total).sum(axis=1) > np.square(_WAKE * bodies.mass[ids]))]
    state.world.thaw(woken)
    broke = break_out(model, state, contacts, dt)
    return broke or len(woken) > 0


def _solve(model: Model, state: State, pairs: Pairs, ropes: ties.Ties,
           dt: float) -> tuple[TreeContacts, np.ndarray, np.ndarray]:
    """
    Solve for the impulses of all contacts.

    :param ropes: the last of the pairs.
    :returns: contacts, changes of the velocities of bodies (B, 6), and their ids.
    """
    both = np.flatnonzero(pairs.other >= 0)
    rows = np.concatenate([pairs.row, pairs.other[both]])
    points = np.concatenate([pairs.point, pairs.point[both]])
    order = np.argsort(state.forest.roots(rows), kind='stable')
    place = np.empty(len(rows), np.intp)
    place[order] = np.arange(len(rows))
    end, other = place[:len(pairs.row)], np.full(len(pairs.row), -1, np.intp)
    other[both] = place[len(pairs.row):]
    partners, bodies = _partners(model, state, pairs, end, other, dt)
    rope = np.full(len(end), -1, np.intp)
    last = slice(len(end) - len(ropes.joint), None)
    rope[last], partners.arm[last] = ropes.joint, ropes.arm
    air = None if state.trees.still else state.trees.air
    problem = _Problem(pairs, partners, partners.motion.copy(), np.zeros((len(end), 3)),
                       np.where(rope < 0, WOOD_FRICTION, 0.0), _tree_mass(state, pairs),
                       partial(_look_ahead, model, state, rows[order], points[order], dt, air,
                               both, order))
    old = state.world.bodies.velocities[bodies]
    least, out = _least_speed(pairs.gap, pairs.normal, partners, problem.look.before,
                              problem.look.old_share, old, dt)
    least[last] += ropes.turned
    free = problem.look.velocity.copy()
    for _ in range(_LOOKS):
        problem.resolve(least)
        if not problem.look.held.any() or problem.agrees():
            break
    problem.limit_work(least, out, model.gravity * dt)
    slowed, stopped = _closing(problem.impulse, partners, problem.look.before, old,
                               problem.look.velocity - free, partners.motion - problem.free)
    return (TreeContacts(pairs.row, pairs.other, pairs.body, pairs.part, pairs.point,
                         problem.impulse, slowed, stopped, rope),
            partners.motion - problem.free, bodies)


def _look_ahead(model: Model, state: State, rows: np.ndarray, points: np.ndarray, dt: float,
                air: np.ndarray | None, both: np.ndarray, order: np.ndarray,
                impulse: np.ndarray, ends: np.ndarray | slice) -> ContactResponse:
    """
    Predict the step with impulses of the contacts, (C, 3); one of two trees acts on both.

    :param ends: of contacts, in order; all those on the predicted trees.
    """
    signed = np.concatenate([impulse, -impulse[both]])[order][ends] if impulse.any() else None
    return state.forest.predict_response(rows[ends], points[ends], dt, air, signed, model.threads)


class _Problem:
    """
    Contacts of one step, and their impulses during the solution.

    :param free: velocities of the bodies without contact, (B, 6).
    :param impulse: on the trees [N·s], (C, 3).
    :param friction: coefficients, (C,).
    :param mass: of the heavier tree of each contact [kg], (C,).
    :param look_ahead: predicts the motion of the trees with impulses.
    :ivar look: its last prediction; the velocities are those with the impulses.
    """

    def __init__(self, pairs: Pairs, partners: Partners, free: np.ndarray, impulse: np.ndarray,
                 friction: np.ndarray, mass: np.ndarray,
                 look_ahead: Callable[[np.ndarray, np.ndarray | slice], ContactResponse]):
        self._pairs, self._partners, self.free = pairs, partners, free
        self.impulse, self._friction, self._mass = impulse, friction, mass
        self._look_ahead = look_ahead
        self.look = look_ahead(impulse, slice(None))

    def resolve(self, least: np.ndarray) -> None:
        """Change the impulses so that contacts reach at least their normal velocities, (C,)."""
        mass = _most_mass(self._mass, self._pairs.normal, self.look.velocity, self.look.energy,
                          self._partners.end, self._partners.other)
        resolve(self._pairs.normal, least, mass, self._friction, self._partners,
                self.look.velocity, self.look.first, self.look.place, self.look.count,
                self.look.response, self.impulse)

    def agrees(self) -> bool:
        """Predict the motion again; return whether it agrees with the one solved for."""
        foreseen = self.look.velocity
        self._look_again(self.look.held)
        return bool(np.abs(self.look.velocity - foreseen).max()
                    < _AGREES * np.abs(foreseen).max())

    def _look_again(self, ends: np.ndarray) -> None:
        """Predict the motion of some trees again, (E,) bool; the others keep their response."""
        if ends.any():
            self.look = self.look.renewed(ends, self._look_ahead(self.impulse, ends))

    def limit_work(self, least: np.ndarray, out: np.ndarray, gain: float) -> None:
        """
        Remove friction, then impulses, from contacts that would create energy.

        :param out: speed at which overlaps are undone [m/s], (C,).
        :param gain: speed that weight gives in the step [m/s].
        """
        wrong = self._gives(out, gain)
        if wrong.any():
            self._friction[wrong] = 0.0
            self.resolve(least)
            self._look_again(self.look.held)
        for share in _SHARES:
            wrong = self._gives(out, gain)
            if not wrong.any():
                break
            self.impulse[wrong] *= share
            hit = np.unique(self._partners.body[wrong & (self._partners.body >= 0)])
            motion, free = self._partners.motion, self.free
            motion[hit] = free[hit] + share * (motion[hit] - free[hit])
            touched = np.concatenate([self._partners.end[wrong], self._partners.other[wrong]])
            tree = self.look.tree
            self._look_again(np.isin(tree, tree[touched[touched >= 0]]))

    def _gives(self, out: np.ndarray, gain: float) -> np.ndarray:
        return too_much(self._partners, self.look, self.free, self.impulse,
                        self._pairs.normal, out, self._mass, gain)


@kernel
def _most_mass(tree_mass, normal, velocity, energy, end, other):
    """
    Return the largest effective mass of each contact [kg], (C,).

    The effective mass of a point that moves at v is at most 2·E / v², or its tree would need more
    energy E than it has. Linearised in the middle of a step, a pole that tumbles onto its tip may
    show any effective mass.
    """
    limit = _SHOWN * tree_mass
    for c in range(len(limit)):
        for side, e in ((1.0, end[c]), (-1.0, other[c])):
            if e < 0:
                continue
            speed = side * (velocity[e] * normal[c]).sum()
            if speed < -_SURE:
                limit[c] = min(limit[c], 2.0 * energy[e] / speed ** 2)
        limit[c] = max(limit[c], 1e-12)
    return limit


def _tree_mass(state: State, pairs: Pairs) -> np.ndarray:
    """Return the mass of the heavier tree of each contact [kg], (C,)."""
    mass = state.forest.masses(pairs.row)
    both = np.flatnonzero(pairs.other >= 0)
    mass[both] = np.maximum(mass[both], state.forest.masses(pairs.other[both]))
    return mass


def _partners(model: Model, state: State, pairs: Pairs, end: np.ndarray, other: np.ndarray,
              dt: float) -> tuple[Partners, np.ndarray]:
    bodies = state.world.bodies
    ids = np.unique(pairs.body[(pairs.body >= 0) & (pairs.part < 0)])
    index = np.full(len(bodies.state) + 1, -1)
    index[ids] = np.arange(len(ids))
    loose = bodies.state[ids] == BodyState.AWAKE
    axes = rotation.to_matrix(bodies.poses[ids, 3:])
    spin = np.where(loose[:, None], 1.0 / bodies.inertia[ids], 0.0)
    motion = bodies.velocities[ids].copy()
    motion[loose, :3] += state.world.gravity * dt
    body = np.where(pairs.part < 0, index[pairs.body], -1)
    arm = pairs.point - bodies.poses[np.maximum(pairs.body, 0), :3]
    return Partners(end, other, body, arm, np.where(loose, 1.0 / bodies.mass[ids], 0.0),
                    np.einsum('bij,bj,bkj->bik', axes, spin, axes), motion), ids


@kernel
def _closing(impulse, partners, before, old, change, bodies):
    """
    Return the changes of closing speed by contacts, and the speeds stopped by them [m/s].

    :param impulse: of each contact, on the tree [N·s], (C, 3).
    :param before, old: velocities at the beginning of the step, see `_least_speed`.
    :param change: of the velocities of points by all contacts, (E, 3), and of `bodies`, (B, 6).
    :returns: see `TreeContacts`, (C,) each.
    """
    changed, stopped = np.full(len(impulse), STILL), np.zeros(len(impulse))
    for c in range(len(impulse)):
        size = np.sqrt((impulse[c] ** 2).sum())
        if size == 0.0:
            continue
        end, other, b = partners.end[c], partners.other[c], partners.body[c]
        came, way = before[end].copy(), change[end].copy()
        if other >= 0:
            came -= before[other]
            way -= change[other]
        if b >= 0:
            came -= old[b, :3] + np.cross(old[b, 3:], partners.arm[c])
            way -= bodies[b, :3] + np.cross(bodies[b, 3:], partners.arm[c])
        changed[c] = max((way * impulse[c]).sum() / size, STILL)
        stopped[c] = min(max(-(came * impulse[c]).sum() / size, 0.0), changed[c])
    return changed, stopped


@kernel
def _least_speed(gap, normal, partners, before, old_share, old, dt):
    """
    Return the normal velocity that each contact needs at the end of the step [m/s], (C,).

    A gap may close, but not more. The old velocity of trees uses up part of it: in this step, and
    half a step of the new one in the next, which may go by the mean of both whatever this one
    does. Deep overlaps open. An impulse J does the work J·(v₀ + v₁)/2, v being the velocity of
    opening: so a stiff twig that swings away from its contact first, v₀ > 0, may come back as
    fast. Stopped, v₁ = 0, it would throw a body off, or gain energy from the ground.

    :param before, old_share: as in the `ContactResponse` of the trees, (E, 3) and (E,).
    :param old: velocities of the bodies at the beginning of the step, (B, 6).
    :returns: this velocity, and the part of it that undoes an overlap, not below 0.
    """
    least, out = np.empty(len(gap)), np.empty(len(gap))
    for c in range(len(gap)):
        end, other, b = partners.end[c], partners.other[c], partners.body[c]
        way = before[end] - before[other] if other >= 0 else before[end]
        room = gap[c] + dt * min(old_share[end] * (way * normal[c]).sum(), 0.0)
        out[c] = min(max(_RECOVERY * (-room - _SLOP) / dt, 0.0), _PUSH_OUT)
        least[c] = -room / ((1.5 - old_share[end]) * dt) if room > 0.0 else out[c]
        if b >= 0:
            way = way - (old[b, :3] + np.cross(old[b, 3:], partners.arm[c]))
        opening = (way * normal[c]).sum()
        if old_share[end] > 0.0 and opening > 0.0:
            least[c] = min(least[c], 2.0 * out[c] - opening)
    return least, out
