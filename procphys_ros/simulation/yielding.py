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

"""Yielding: standing parts that give way to what hits them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import ALIKE
from procphys_ros.physics.masonry import punched
from procphys_ros.simulation import breaking, masonry
from procphys_ros.simulation.blows import Blows
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State
from procphys_ros.simulation.wall_loads import part_of_body

_FAINT = 1e-9  # [N·s] keeps directions finite


class Pushes(NamedTuple):
    """
    Blows on standing parts in about the same direction at the same time.

    :ivar direction: unit vector, world, (3,).
    :ivar striker: number of the striking body in each contact, from 0, (K,).
    :ivar part: struck part, (K,).
    :ivar force: mean over its contact time, along the direction [N], (K,).
    :ivar impulse: along the direction [N·s], (K,).
    :ivar energy: dissipated by all contacts of these bodies, and of those behind them [J].
    :ivar speed: of the fastest point of these, at most [m/s].
    """

    direction: np.ndarray
    striker: np.ndarray
    part: np.ndarray
    force: np.ndarray
    impulse: np.ndarray
    energy: float
    speed: float


def hit(state: State, pairs: np.ndarray, struck: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Find the contacts in which what stands is struck.

    :param pairs: bodies of each contact, (C, 2).
    :param struck: bodies whose motion contacts changed abruptly, by id, (B,) bool.
    :returns: the standing part of each body of each contact, -1 for others, (C, 2), and a mask of
        these contacts, (C,).
    """
    standing = part_of_body(state)[pairs]
    return standing, (standing >= 0).any(axis=1) & struck[pairs].any(axis=1)


def exits(state: State, made: Blows, velocities: np.ndarray, hits: np.ndarray,
          standing: np.ndarray, group: np.ndarray, share: np.ndarray
          ) -> list[tuple[masonry.Exit, masonry.Strike]]:
    """
    List what blows drive out of what stands, and the blow of each.

    The engine treats standing parts as immovable. Where they give way, bodies get back the excess
    of their impulse, and meet the released parts, at rest until then, in the next query.

    :param made: contacts, with all those of the bodies that strike.
    :param velocities: of all bodies before, (B, 6).
    :param hits: contacts in which standing parts are struck, (K,) rows.
    :param standing: standing part of each body of a contact, -1 for others, (C, 2).
    :param group: number of the group of each body, see `group_bodies`, (B,).
    :param share: of the impulses that each body took, by id, (B,); written where parts give way.
    """
    found, leaves = [], np.zeros(len(state.parts.owner), bool)
    speed = norm(velocities[:, :3], axis=1)
    speed += norm(velocities[:, 3:], axis=1) * state.world.bodies.radius[:len(speed)]
    for pushes in _alike(made, speed, hits, standing, group):
        for out, blow in _exits(state, pushes):
            if not leaves[out.parts].any():  # else the next query judges the rest
                found.append((out, blow))
                leaves[out.parts] = True
                share[state.parts.body[out.parts]] = out.passed_on / blow.momentum
    return found


def _alike(made: Blows, speed: np.ndarray, hits: np.ndarray, standing: np.ndarray,
           group: np.ndarray) -> Iterator[Pushes]:
    """
    Group blows by direction: bodies that push the same way do so together.

    :param speed: of the fastest point of each body [m/s], (B,).
    :param hits: contacts with standing parts, (K,).
    :param standing: standing part of each body of a contact, -1 for others, (C, 2).
    :param group: number of the group of each body, see `group_bodies`, (B,).
    """
    contacts, first = made.contacts, standing[hits, 0] >= 0
    part = standing[hits].max(axis=1)
    impulse = np.where(first, 1.0, -1.0)[:, None] * contacts.impulse[hits]
    striker = np.where(first, contacts.body_b[hits], contacts.body_a[hits])
    bodies, place = np.unique(striker, return_inverse=True)
    total = np.zeros((len(bodies), 3))
    np.add.at(total, place, impulse)
    size = norm(total, axis=1)
    left = size > _FAINT
    while left.any():
        hardest = int(np.argmax(np.where(left, size, 0.0)))
        alike = left & (product(total, total[hardest]) >= ALIKE * size * size[hardest])
        left &= ~alike
        direction = total[alike].sum(axis=0)
        direction /= norm(direction)
        own = alike[place]
        along = product(impulse[own], direction)
        row = hits[own]
        behind = np.isin(group, group[bodies[alike]])
        taken = made.energy[behind[contacts.body_a] | behind[contacts.body_b]].sum()
        yield Pushes(direction, place[own], part[own], along / made.duration[row], along,
                     float(taken), float(speed[behind].max()))


def _exits(state: State, pushes: Pushes) -> Iterator[tuple[masonry.Exit, masonry.Strike]]:
    """List the releases by blows: parts with less strength in force and energy than the blow."""
    _, striker = np.unique(pushes.striker, return_inverse=True)
    force = np.maximum(np.bincount(striker, pushes.force), 0.0)
    momentum = float(pushes.impulse.sum())
    if not force.any() or min(momentum, pushes.energy, pushes.speed) <= 0.0:
        return
    # The mass that has this energy, too, but what strikes is no faster than it was.
    stopped = max(0.5 * momentum * momentum / pushes.energy, momentum / pushes.speed)
    mass = stopped + state.parts.mass[np.unique(pushes.part)].sum()
    for own in punched(state.solver, striker, pushes.part, force, pushes.direction,
                       float(force.sum() / mass)):
        rows = np.isin(pushes.part, own.parts)
        push, impulse = float(pushes.force[rows].sum()), float(pushes.impulse[rows].sum())
        if impulse <= 0.0:
            continue
        blow = masonry.Strike(pushes.direction, push, stopped * impulse / momentum, impulse)
        out = masonry.comes_out([own.parts], float(state.parts.mass[own.parts].sum()),
                                own.withstood, blow)
        if out is not None:
            yield out, blow


def release(model: Model, state: State,
            found: list[tuple[masonry.Exit, masonry.Strike]]) -> None:
    """Release parts from rest, and apply the reaction of their bonds to the neighbours."""
    if not found:
        return
    for out, blow in found:
        masonry.apply_impulse_around(state, out.withstood.bonds, out.parts,
                                     out.passed_on * blow.direction,
                                     blow.momentum / blow.mass)
    pieces = [piece for out, _ in found for piece in out.pieces]
    breaking.release(model, state, pieces, np.zeros((sum(map(len, pieces)), 6)), Cause.IMPACT,
                     np.array([out.load for out, _ in found]))
