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


"""Glass: panes break by bending long before their frames let go, and into shards."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.elementary import exp, hypot, standard_normal
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.masonry import Resistance
from procphys_ros.physics.world import BodyState
from procphys_ros.simulation import breaking, fragments, spawned_parts
from procphys_ros.simulation.blows import Blows
from procphys_ros.simulation.breaking import Shards
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_STRENGTH = 45e6     # [Pa] of annealed float glass, EN 572-1
_MODULUS = 70e9      # [Pa] the same
_POISSON = 0.23      # the same
_POINT_STRESS = 1.3  # stress·thickness² over a force in the middle, spread over about a thickness
_POINT_SAG = 0.0116  # sag·stiffness/(force·edge²), square plate on supports (Timoshenko, table 23)
# Stress·thickness²/(pressure·edge²) in the middle of a plate on supports, over the ratio of its
# longer edge to this one (Roark, table 11.4, case 1a); an endless one has 0.75.
_RATIOS = np.array([1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 3.0, 4.0, 5.0])
_PLATE_STRESS = np.array([
    0.2874, 0.3762, 0.4530, 0.5172, 0.5688, 0.6102, 0.7134, 0.7410, 0.7476])
_REACH = 0.1         # [m] glass around the striking object that responds to a blow in time
_SPRING = 0.4        # [m/s] standard deviation of the springback speed of shards
_SPIN = 3.0          # [rad/s] the same of their spin
_PIECES = 4          # its square is about the number of shards of a pane
_MANY = 40           # panes broken at once, above which each breaks into fewer pieces
FEWEST = 2           # the same when the budget of bodies is nearly used up
_SHARE = 0.25        # of the bodies aimed at that may be shards: the more there are, the fewer
#                      does a pane break into
_MOST = 4            # panes that fall out in one step: their piece is made anew each time
_NEAR = 0.02         # [m] from a pane, within which a contact of its piece is on the glass
_JUST_OVER = 1.01    # load of a pane in a bent frame


@dataclass(frozen=True)
class CrackedPane:
    """
    A standing pane about to break.

    :ivar part: index.
    :ivar pieces: its shards.
    :ivar share: velocity of each shard over that of the struck glass, (S,).
    :ivar mass: of the glass that moves with the striking object [kg].
    :ivar resistance: of the pane against a blow at one point.
    """

    part: int
    pieces: Blueprint
    share: np.ndarray
    mass: float
    resistance: Resistance


def pressure(model: Model, parts: np.ndarray) -> np.ndarray:
    """Return the static pressure at which panes break [Pa], (K,)."""
    edge = model.glass.edge[parts]
    slenderness = edge / model.glass.thickness[parts]
    stress = np.interp(model.glass.length[parts] / edge, _RATIOS, _PLATE_STRESS)
    return _STRENGTH / (stress * (slenderness * slenderness))


def frequency(model: Model, parts: np.ndarray) -> np.ndarray:
    """
    Return the lowest angular frequency of panes, simply supported [rad/s], (K,).

    π²·(1/a² + 1/b²)·√(D/(ρ·h)) with the bending stiffness D (Leissa 1969, Vibration of Plates,
    4.1). Pane and contact are springs in series: the squares of their half periods add up to that
    of a blow.
    """
    thick, edge = model.glass.thickness[parts], model.glass.edge[parts]
    shape = edge / model.glass.length[parts]
    stiffness = _MODULUS * thick * thick * thick / (12.0 * (1.0 - _POISSON * _POISSON))
    return (1.0 + shape * shape) * (np.pi * np.pi) / (edge * edge) * np.sqrt(
        stiffness / (model.blueprint.density[parts] * thick))


def crack(model: Model, part: int, point: np.ndarray | None = None, size: float = 0.0,
          count: int = 1) -> CrackedPane:
    """
    Prepare a standing pane for breaking.

    :param part: index.
    :param point: of impact, world [m], (3,); None = everywhere.
    :param size: of the striking object there [m].
    :param count: number of panes that break together.
    """
    source = model.blueprint
    pieces = _PIECES if count < _MANY else _PIECES // 2
    parts = _cut_up(model, part, source.poses[part], pieces, point)
    share, mass = np.ones(len(parts)), float(parts.mass.sum())
    thin, edge = float(model.glass.thickness[part]), float(model.glass.edge[part])
    if point is not None:
        edge = min(edge, size + _REACH)
        mass = min(mass, float(source.density[part]) * thin * (edge * edge))
        distance = norm(parts.poses[:, :3] - point, axis=1)
        share = exp(-np.square(distance / (0.5 * size + _REACH)))
        share *= mass / float(product(parts.mass, share))
    force = float(_point_force(model, np.array([part]))[0])
    stiffness = _MODULUS * thin * thin * thin / (12.0 * (1.0 - _POISSON * _POISSON))
    energy = 0.5 * (force * force) * _POINT_SAG * (edge * edge) / stiffness
    return CrackedPane(part, parts, share, mass,
                       Resistance(np.zeros(0, np.intp), force, energy))


def shatter_standing(model: Model, state: State,
                     panes: Sequence[tuple[CrackedPane, np.ndarray, float]],
                     cause: Cause) -> None:
    """
    Replace standing panes by flying shards.

    :param panes: each with the velocity of the struck glass [m/s], (3,), and its load over
        strength.
    :param cause: of the breaks.
    """
    shards = []
    for pane, velocity, load in panes:
        moving = _spring_back(model, pane.part, pane.pieces)
        moving[:, :3] += pane.share[:, None] * velocity
        shards.append(Shards(np.array([pane.part]), np.array([load]),
                             [(_named(pane.part), pane.pieces)], moving))
    breaking.shatter(model, state, shards, cause)


def glazed(model: Model, state: State) -> np.ndarray:
    """List the awake bodies that carry panes, (K,) ids."""
    body = state.carrier[model.glass.parts]
    return np.unique(body[_are_loose(state, body)])


def _are_loose(state: State, body: np.ndarray) -> np.ndarray:
    return np.asarray((body >= 0) & (state.world.bodies.state[body] == BodyState.AWAKE))


def judge(model: Model, state: State, struck: np.ndarray, change: np.ndarray, made: Blows,
          poses: np.ndarray) -> None:
    """
    Find the panes in loose pieces that contacts break.

    A pane breaks when its edges are decelerated across the glass beyond its bending strength, or
    when it is struck at one point. Writes `state.glass.load`.

    :param struck: bodies that contacts stopped or pushed, by id, (B,) bool.
    :param change: of velocity by contacts, by id, (B, 6).
    :param made: blows, with all those on struck bodies with panes.
    :param poses: of all bodies when contacts were found, (B, 7).
    """
    own, body = state.glass, state.carrier[model.glass.parts]
    loose = _are_loose(state, body)
    rows = np.flatnonzero(loose & struck[body])
    if not loose.any():
        return
    np.maximum.at(own.load, rows, _bending(model, state, rows, body[rows], change[body[rows]],
                                           poses[body[rows]]))
    np.maximum.at(own.load, *_point_loads(model, state, np.flatnonzero(loose), struck, made,
                                          poses))


def crack_frames(model: Model, state: State, broken: Sequence[np.ndarray]) -> None:
    """
    Crack the panes of pieces whose bonds, or whose frames' bonds, broke.

    Writes `state.glass.load`.

    :param broken: bonds that broke in pieces, rows of the blueprint.
    """
    if broken and len(model.glass.parts):
        own = state.glass
        bent = np.searchsorted(model.glass.parts, in_bent_frames(model, np.concatenate(broken)))
        own.load[bent] = np.maximum(own.load[bent], _JUST_OVER)


def in_bent_frames(model: Model, bonds: np.ndarray) -> np.ndarray:
    """
    List the panes whose bonds or whose frames' bonds broke, (P,).

    :param bonds: broken ones, rows of the blueprint, (K,).
    """
    glass = model.glass
    torn = np.zeros(len(model.blueprint) + 1, bool)
    torn[model.blueprint.bonds[bonds]] = True
    return np.unique(glass.parts[glass.pane[torn[glass.frame]
                                            | torn[glass.parts[glass.pane]]]])


def shatter_loose(model: Model, state: State) -> bool:
    """
    Replace cracked panes of loose pieces by shards, within the budget of bodies.

    :returns: whether any shattered.
    """
    own = state.glass
    if not own.load.any():
        return False
    own.load[~_are_loose(state, state.carrier[model.glass.parts])] = 0.0  # stands, rests or gone
    rows = np.flatnonzero(own.load > 1.0)
    awake = state.world.awake
    own.shards = own.shards[np.isin(own.shards, awake)]
    aim = model.settings.debris_bodies
    room = max(int(_SHARE * aim) - len(own.shards), 0)
    chosen = rows[:min(_MOST, max(room, aim - len(awake)) // (FEWEST * FEWEST))]
    if not len(chosen):
        return False
    pieces = min(max(int(np.sqrt(room / len(rows))), FEWEST), _PIECES)
    parts = model.glass.parts[chosen]
    carrier = state.parts.body[parts]
    shards = []
    for body in np.unique(carrier).tolist():
        there = parts[carrier == body]
        made, moving = zip(*(_shards_of(model, state, part, pieces) for part in there.tolist()))
        shards.append(Shards(there, own.load[chosen[carrier == body]],
                             [(_named(part), shard) for part, shard in zip(there, made)],
                             np.concatenate(moving)))
    bodies = breaking.shatter(model, state, shards, Cause.IMPACT)
    own.shards = np.concatenate([own.shards, *bodies])
    own.load[chosen] = 0.0
    return True


def _point_force(model: Model, parts: np.ndarray) -> np.ndarray:
    """Return the point force that panes withstand [N], (K,)."""
    return _STRENGTH * np.square(model.glass.thickness[parts]) / _POINT_STRESS


def _cut_up(model: Model, part: int, pose: np.ndarray, pieces: int,
            point: np.ndarray | None = None) -> Blueprint:
    source, rng = model.blueprint, np.random.default_rng([model.seed, part])
    local = None if point is None else rotation.rotate(
        rotation.conjugate(pose[3:]), point - pose[:3])
    return spawned_parts.shards(
        source.size[part], float(source.density[part]), pose,
        source.textures[source.texture[part]], source.materials[source.material[part]],
        1 if pieces > FEWEST else 0, rng, local)


def _named(part: int) -> str:
    """Return the name of the object made of the shards of a pane."""
    return f'pane_{part}'


def _spring_back(model: Model, part: int, pieces: Blueprint) -> np.ndarray:
    """Draw the velocities of shards by springback, without net momentum, (S, 6)."""
    rng = np.random.default_rng([model.seed, part, 1])
    gained = standard_normal(rng, (len(pieces), 6)) * ([_SPRING] * 3 + [_SPIN] * 3)
    gained[:, :3] -= product(pieces.mass, gained[:, :3]) / pieces.mass.sum()
    return gained


def _bending(model: Model, state: State, rows: np.ndarray, body: np.ndarray, jump: np.ndarray,
             start: np.ndarray) -> np.ndarray:
    """
    Return the bending of panes with decelerated edges over their strength, (K,).

    :param rows: panes, (K,); body: ids of their bodies, (K,).
    :param jump: change of velocity of the bodies, (K, 6); start: their poses before, (K, 7).
    """
    parts = model.glass.parts[rows]
    pose = rotation.compose(start, state.parts.local[parts])
    change = jump[:, :3] + np.cross(jump[:, 3:], pose[:, :3] - start[:, :3])
    across = rotation.to_matrix(pose[:, 3:])[np.arange(len(rows)), :, model.glass.thin[rows]]
    rate = np.abs(np.einsum('ki,ki->k', across, change))
    rate /= hypot(contact_time(state.world.bodies.mass[body]), np.pi / frequency(model, parts))
    bearable = pressure(model, parts) / (model.blueprint.density[parts]
                                         * model.glass.thickness[parts])
    return rate / bearable


def _point_loads(model: Model, state: State, rows: np.ndarray, struck: np.ndarray,
                 made: Blows, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the contact forces on panes over their point strength.

    :param rows: loose panes, (K,).
    :param struck, made, start: see `judge`.
    :returns: row and load of each contact.
    """
    contacts = made.contacts
    body = state.carrier[model.glass.parts[rows]]
    glazed = np.zeros(len(struck), bool)
    glazed[body] = True
    one, other = contacts.body_a, contacts.body_b
    blow = np.flatnonzero((struck[one] | struck[other]) & (glazed[one] | glazed[other]))
    pairs = [np.nonzero(side[blow, None] == body) for side in (one, other)]
    touch, k = (np.concatenate(column) for column in zip(*pairs))
    touch, rows = blow[touch], rows[k]
    parts = model.glass.parts[rows]
    pose = rotation.compose(start[body[k]], state.parts.local[parts])
    local = rotation.rotate(rotation.conjugate(pose[:, 3:]),
                            contacts.point[touch] - pose[:, :3])
    on = (np.abs(local) < 0.5 * model.blueprint.size[parts] + _NEAR).all(axis=1)
    if not on.any():
        return rows[on], np.zeros(0)
    force = norm(contacts.impulse[touch[on]], axis=1)
    force /= made.duration[touch[on]]
    return rows[on], force / _point_force(model, parts[on])


def _shards_of(model: Model, state: State, part: int,
               pieces: int) -> tuple[Blueprint, np.ndarray]:
    """Cut up a pane carried by a body: shards, and their velocities, (S, 6)."""
    bodies, body = state.world.bodies, state.parts.body[part]
    pose = fragments.part_states(state, np.array([part]))[0][0]
    velocity = bodies.velocities[body].copy()
    velocity[:3] += np.cross(velocity[3:], pose[:3] - bodies.poses[body, :3])
    made = _cut_up(model, part, pose, pieces)
    moving = np.tile(velocity, (len(made), 1))
    moving[:, :3] += np.cross(velocity[3:], made.poses[:, :3] - pose[:3])
    return made, moving + _spring_back(model, part, made)
