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


"""Masonry: the response of standing parts to loads and blows, whatever causes them."""

from dataclasses import dataclass
from functools import partial
import math
from typing import cast

import numpy as np

from procphys_ros.geometry.linear import cross, norm, product
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.masonry import Failures, punched, Resistance, together
from procphys_ros.physics.masonry.components import groups
from procphys_ros.progress import staged
from procphys_ros.simulation import breaking, load_checks, wall_loads
from procphys_ros.simulation.model import Model, SETTLING
from procphys_ros.simulation.state import State

WALL_RATE = 100.0  # [1/s] angular frequency 2π/T of a storey-high half-brick wall, T about 60 ms:
# the load of a blow much shorter than T is the static force rate·impulse

NO_FORCE = 1e-6   # [N] keeps the load on parts without bonds finite
_ROUNDS = 60.0   # [1/s] rounds of failures under lasting loads: the speed of cracks (decision 39)
_PACE = 1200.0   # [1/s] iterations of the stress solver per simulated second, at least; ...
_ROUND = 6.0     # ... times as many where the budget allows: enough for some rounds in 1/60 s; ...
_WORK = 1e7      # [1/s] ... of parts times iterations under blows, and while joints open and
#                 close: real time at 0.1 µs each; linear problems, solved once, have no bound


@dataclass(frozen=True)
class Strike:
    """
    A blow to standing parts.

    :ivar direction: unit vector, world, (3,).
    :ivar force: if all bonds hold: momentum over `contact_time` [N].
    :ivar mass: of the striking body, which moves on with the released parts [kg].
    :ivar momentum: of the striking body, along the direction [N·s].
    """

    direction: np.ndarray
    force: float
    mass: float
    momentum: float


@dataclass(frozen=True)
class Exit:
    """
    The release of parts from a wall by a blow.

    :ivar pieces: the struck parts one by one, then the connected pieces pushed ahead of them.
    :ivar mass: of all of them [kg].
    :ivar withstood: resistance of the bonds around them.
    :ivar load: force of the blow over that resistance.
    :ivar speed: along the blow [m/s].
    :ivar passed_on: momentum that the breaking bonds transmit to the standing parts [N·s].
    """

    pieces: list[np.ndarray]
    mass: float
    withstood: Resistance
    load: float
    speed: float
    passed_on: float

    @property
    def parts(self) -> np.ndarray:
        """Return the released parts, in the order of the pieces, (P,)."""
        return np.concatenate(self.pieces)


def comes_out(pieces: list[np.ndarray], mass: float, withstood: Resistance,
              blow: Strike) -> Exit | None:
    """
    Return the release of parts under a blow; None if they hold.

    The force of the blow must exceed that of the bonds, and the energy of the combined motion must
    exceed their work of fracture, which it loses.

    :param mass: of the parts [kg].
    :param withstood: resistance of the bonds around them.
    """
    whole = blow.mass + mass
    left = np.square(blow.momentum / whole) - 2.0 * withstood.energy / whole
    if blow.force <= withstood.force or left <= 0.0:
        return None
    speed = math.sqrt(left)
    return Exit(pieces, mass, withstood, blow.force / max(withstood.force, NO_FORCE), speed,
                blow.momentum - whole * speed)


def drive_out(state: State, struck: np.ndarray, blow: Strike) -> Exit | None:
    """
    Return the release of struck parts, alone or with others ahead of them; None if all hold.

    A leaf is not supported by the one behind it where both can move (decision 48).

    :param struck: indices, (K,).
    """
    driven = blow.mass + float(state.parts.mass[struck].sum())
    found = _plug(state, struck, blow.force, blow.direction, blow.force / driven)
    if found is None:
        return None
    parts, withstood = found
    return comes_out(breaking.pieces_of(state, struck, parts),
                     float(state.parts.mass[parts].sum()), withstood, blow)


def _plug(state: State, struck: np.ndarray, force: float, direction: np.ndarray,
          acceleration: float) -> tuple[np.ndarray, Resistance] | None:
    """Return the parts driven out by one rigid body, struck ones first, and their resistance."""
    alone = np.zeros(len(struck), np.intp)
    found = punched(state.solver, alone, struck, np.array([force]), direction, acceleration)
    if not found:
        return None
    parts, withstood = together(found)
    return np.concatenate([struck, np.setdiff1d(parts, struck)]), withstood


def weakest_plug(state: State, struck: np.ndarray, direction: np.ndarray,
                 speed: float) -> tuple[np.ndarray, Resistance]:
    """
    Return the weakest set of parts that comes out when struck parts are forced to move.

    :param struck: indices, (K,).
    :param direction: unit vector of the push, world, (3,).
    :param speed: of the pushing body [m/s].
    :returns: the struck parts, in their order, then the parts that go with them, and their
        resistance.
    """
    mass = float(state.parts.mass[struck].sum())
    return cast(tuple[np.ndarray, Resistance],  # no force is too small
                _plug(state, struck, np.inf, direction, speed / float(contact_time(mass))))


def strike(model: Model, state: State, part: int, linear: np.ndarray, angular: np.ndarray,
           point: np.ndarray) -> bool:
    """
    Apply an impulse to a standing part.

    The striking body is assumed to be as heavy as the part.

    :param part: index.
    :param linear: impulse [N·s], (3,), world.
    :param angular: [N·m·s], (3,), world.
    :param point: of application of the linear impulse [m], (3,), world.
    :returns: whether the part came out of its wall.
    """
    size = float(norm(linear))
    chosen = np.array([part])
    mass = float(state.parts.mass[part])
    turn = angular + cross(point - state.parts.poses[part, :3], linear)
    if size > 0.0:
        blow = Strike(linear / size, size / float(contact_time(mass)), 0.0, size)
        out = drive_out(state, chosen, blow)
        if out is not None:
            release(model, state, out, blow)
            state.world.apply_impulse(int(state.parts.body[part]), np.zeros(3), angular=turn)
            return True
    apply_impulses(state, chosen, np.concatenate([linear, turn])[None])
    return False


def release(model: Model, state: State, out: Exit, blow: Strike) -> None:
    """Release the parts that a blow drives out."""
    moving = np.zeros((len(out.parts), 6))
    moving[:, :3] = out.speed * blow.direction
    breaking.release(model, state, out.pieces, moving, Cause.IMPACT, out.load)


def apply_impulses(state: State, parts: np.ndarray, impulses: np.ndarray,
                   rate: float | np.ndarray = WALL_RATE,
                   speed: float | np.ndarray | None = None,
                   carried: bool = True) -> None:
    """
    Apply impulses to standing parts as blows, until they break no more bonds.

    :param parts: (K,) indices.
    :param impulses: at their centres of mass [N·s], world, (K, 3), or with angular impulses
        [N·m·s], (K, 6).
    :param rate: equivalent static force over impulse [1/s], of all or of each, (K, 1).
    :param speed: of the striking bodies, all or each [m/s], (K,); None = as heavy as the part.
    :param carried: whether released parts take the impulses along; those of waves are recorded in
        `state.blasts` instead.
    """
    wrenches = np.zeros((len(parts), 6))
    wrenches[:, :impulses.shape[1]] = rate * impulses
    state.loads.add_blow(parts, wrenches, speed if speed is not None else
                         norm(impulses[:, :3], axis=1) / state.parts.mass[parts],
                         impulses[:, :3] if carried else 0.0)


def about_centres(state: State, parts: np.ndarray, points: np.ndarray,
                  pushes: np.ndarray) -> np.ndarray:
    """
    Return forces or impulses at points of standing parts as wrenches about their centres.

    A post is bent by what strikes its head, and not by what strikes its foot.

    :param parts: (K,) indices.
    :param points: where they act [m], world, (K, 3).
    :param pushes: world, (K, 3).
    :returns: these, and their moments, (K, 6).
    """
    arms = points - state.parts.poses[parts, :3]
    return np.hstack([pushes, cross(arms, pushes)])


def apply_impulse_around(state: State, bonds: np.ndarray, parts: np.ndarray,
                         impulse: np.ndarray, speed: float) -> None:
    """
    Apply the impulse of breaking bonds to the neighbours of released parts.

    Earlier blows to these parts have reached the neighbours by then, too.

    :param bonds: around the parts, rows of the graph, (B,).
    :param parts: released ones, (K,).
    :param impulse: on all neighbours together [N·s], world, (3,).
    :param speed: of the striking body [m/s].
    """
    graph = state.solver.graph
    near = np.concatenate([graph.first[bonds], graph.second[bonds]])
    near = np.setdiff1d(near[near < graph.count], parts)
    if len(near):
        impulse = impulse + state.loads.take_blows(parts)
        speed = max(speed, state.loads.striking_speed(parts))
        apply_impulses(state, near, np.tile(impulse / len(near), (len(near), 1)), speed=speed)


def is_stable(state: State) -> bool:
    """Return whether the stresses have converged and break no more bonds."""
    return not len(state.solver.graph) or state.fracture.stable


@staged('settling stresses')
def settle(model: Model, state: State) -> list[str]:
    """
    Solve the stresses under weight alone, with the mortar set.

    :returns: warnings about objects that crack or collapse under it.
    """
    pieces, rounds = _advance(model, state, SETTLING)
    loose = np.concatenate([np.zeros(0, np.intp), *pieces])
    _let_go(model, state, pieces)
    return load_checks.describe_failures(model.blueprint, model.objects, rounds,
                                         state.solver.graph.rows, loose, load_checks.burden(state))


def solve_stresses(model: Model, state: State, dt: float) -> None:
    """
    Spend a step's share of work on the stresses, without judging them yet.

    Writes stresses and `state.iterations`, and only reads loads: it may run beside the engine.
    """
    state.iterations = 0
    if is_stable(state):
        return
    solver, most = state.solver, _iterations(state, dt)
    before = solver.spent
    if state.loads.struck:
        state.fracture.prepare_blow(most, state.loads.largest_blow)
    else:
        state.fracture.prepare(most)
    state.iterations = max(most - (solver.spent - before), 1)


def judge_stresses(model: Model, state: State, dt: float) -> None:
    """
    Break overloaded bonds, and go on solving within the iterations left in the step.

    Writes bonds and stresses of standing parts, and releases unsupported ones.
    """
    if is_stable(state) or not state.iterations or state.time + 0.5 * dt < state.next_round:
        return
    struck = state.loads.struck
    pieces, rounds = _advance(model, state, state.iterations, max(round(_ROUNDS * dt), 1))
    if not all(failures.runs_on and not struck for failures in rounds):
        state.next_round = state.time + 1.0 / _ROUNDS
    broke = any(failures.broken.any() for failures in rounds)
    _let_go(model, state, pieces)
    if is_stable(state):
        state.loads.thrown[:] = 0.0  # of blows that threw nothing over
        state.loads.end_blows()
    elif rounds:
        state.loads.take_more(broke)


def _iterations(state: State, dt: float) -> int:
    """Return the largest number of iterations in a step."""
    each = max(round(_PACE * dt), 1)
    most = round(_ROUND * each)
    if state.loads.struck or state.solver.curved:
        most = min(most, round(_WORK * dt) // max(state.solver.working, 1))
    return max(most, each)


def _advance(model: Model, state: State, iterations: int,
             most: int | None = None) -> tuple[list[np.ndarray], list[Failures]]:
    """
    Iterate the stresses; return the unsupported pieces, and the failures.

    :param most: rounds of failures under lasting loads; None = until no bond fails.
    """
    if is_stable(state):
        return [], []
    if state.loads.struck:
        rounds = _withstand(model, state, iterations)
    else:
        passes = len(state.loads.layer(wall_loads.DEBRIS_LAYER)[0]) > 0
        rounds = state.fracture.advance(iterations, most,
                                        partial(_ride_out, model, state) if passes else None)
    standing = state.standing[:model.masonry.graph.count]
    loose = standing & ~state.solver.supported
    pieces = groups(state.solver.labels, loose) if loose.any() else []
    if not rounds:
        return pieces, rounds
    mortar = state.solver.graph.mortar
    # Dry joints are always cracked: record them only when they are gone.
    dry = (mortar.tension == 0.0) & (mortar.cohesion == 0.0)
    told = [np.where(dry[r.bond], r.broken, ~r.had_cracked) for r in rounds]
    bond, cause, load, broken = (
        np.concatenate([getattr(r, name)[own] for r, own in zip(rounds, told)])
        for name in ('bond', 'cause', 'utilisation', 'broken'))
    breaking.break_bonds(model, state, state.solver.graph.rows[bond], cause, load, ~broken)
    return pieces, rounds


def _withstand(model: Model, state: State, iterations: int) -> list[Failures]:
    """Iterate the stresses under blows; return the failures, and end blows that are over."""
    loads = state.loads
    rounds, over = state.fracture.withstand(iterations, loads.largest_blow,
                                            partial(_ride_out, model, state), loads.cracked)
    if over:
        loads.end_blows()
    return rounds


def _ride_out(model: Model, state: State, mechanisms: list[np.ndarray]) -> np.ndarray:
    """
    Take loads that pass off the mechanisms that rock under them; return the parts of all others.

    Static forces are those on a wall that vibrates elastically, or that debris keeps up. A
    mechanism moves instead. Overturned parts get the speed of their motion, and become no faster
    than the striking body.

    :param mechanisms: connected parts that move, each (K,).
    """
    over = [moved for moved in mechanisms if not _rocks(model, state, moved)]
    overturned = np.concatenate([np.zeros(0, np.intp), *over])
    if len(over) < len(mechanisms):
        state.loads.relieve(np.setdiff1d(np.concatenate(mechanisms), overturned))
        state.loads.press(state.solver)
    return overturned


def _rocks(model: Model, state: State, moved: np.ndarray) -> bool:
    """
    Return whether a mechanism rocks under loads that pass, which is what debris does from now on.

    The impulses that do work on its motion give it energy, and it overturns if this exceeds the
    energy at which its centre stands over its edge (Housner 1963). The force on the ground moves
    nothing. On shaken ground nobody can tell beforehand: mechanisms rock as loose bodies.

    :param moved: its parts, (K,).
    """
    pressed, given = wall_loads.passing(state, moved)
    if not state.loads.struck and not len(pressed):
        return False
    mass, motion = state.parts.mass[moved], state.solver.motion(moved)
    way = motion[:, :3]
    inertia = max(float(product(mass, np.square(way)).sum()), 1e-12)
    blows = max(float((state.loads.impulses_on(moved) * way).sum()), 0.0)
    others = float((state.blasts.momentum[moved] * way).sum()
                   + (given * way[np.isin(moved, pressed)]).sum())
    energy = 0.5 * np.square(max(blows + others, 0.0)) / inertia
    if state.shaking.acts or energy > _barrier(model.gravity, mass, motion):
        velocity = product(mass, way) * blows / inertia / mass.sum()
        fastest = state.loads.striking_speed(moved)
        velocity *= min(1.0, fastest / max(float(norm(velocity)), 1e-12))
        state.loads.thrown[moved] = velocity
        return False
    wall_loads.let_rock(state, pressed, given)
    return True


def _barrier(gravity: float, mass: np.ndarray, motion: np.ndarray) -> float:
    """
    Return the energy at which parts that rock begin to fall [J].

    Their centres rise with the motion q and sink with its square, as they go round the edges about
    which they turn: A·q - B·q², which is A²/(4·B) at its highest (m·g·b²/(2·h) for a block of
    mass m whose centre is h above and b beside its edge, Housner 1963).

    :param gravity: [m/s²].
    :param motion: displacements and rotations to the first order, (K, 6).
    """
    rise = gravity * float(product(mass, motion[:, 2]))
    sink = -0.5 * gravity * float(product(mass, cross(motion[:, 3:], motion[:, :3])[:, 2]))
    if rise <= 0.0:
        return 0.0
    return rise * rise / (4.0 * sink) if sink > 0.0 else math.inf


def _let_go(model: Model, state: State, pieces: list[np.ndarray]) -> None:
    """Release unsupported pieces, with the velocity that blows or a blast wave gave them."""
    if pieces and state.loads.struck:
        loads = state.loads
        thrown = np.flatnonzero(state.standing[:len(loads.thrown)] & loads.thrown.any(axis=1))
        mass = state.parts.mass
        leaves = np.intersect1d(thrown, np.concatenate(pieces))
        # Released parts take their share of the blows along.
        loads.scale_blows(thrown, 1.0 - mass[leaves].sum() / max(mass[thrown].sum(), 1e-9))
    for parts in pieces:
        state.parts.velocities[parts, :3] = state.loads.thrown[parts]
        state.loads.thrown[parts] = 0.0
        state.ledger.come_off(product(state.parts.mass[parts], state.parts.velocities[parts, :3]))
        own = state.blasts.momentum[parts]
        if own.any():
            state.parts.velocities[parts, :3] += own / state.parts.mass[parts][:, None]
            state.ledger.blown = state.ledger.blown + own.sum(axis=0)
            state.blasts.momentum[parts] = 0.0
    breaking.release(model, state, pieces)
