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
Breaking: the one place that breaks bonds, tells of it, and lets go what comes loose.

Stages decide what breaks. Whoever has it, a wall, a tree or a rigid body: its bonds are cut and
recorded here, and its parts change their owner here; nobody else may.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND
from procphys_ros.geometry import rotation
from procphys_ros.physics.causes import Cause
from procphys_ros.simulation import contact_exclusions, fragments
from procphys_ros.simulation.events import NO_BOND
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_SUDDEN = 2.0  # dynamic factor of supports that vanish suddenly, see `StressSolver.cut`
_NONE = np.iinfo(np.intp).max  # above all numbers of pieces


class Shards(NamedTuple):
    """
    New parts that replace broken ones.

    :ivar parts: the broken ones, all standing or all of one body, (P,).
    :ivar load: load over strength of each, (P,).
    :ivar made: names and parts of new objects.
    :ivar velocities: of all new parts, world axes, (S, 6).
    """

    parts: np.ndarray
    load: np.ndarray
    made: list[tuple[str, Blueprint]]
    velocities: np.ndarray


def break_bonds(model: Model, state: State, rows: np.ndarray, cause: np.ndarray | Cause | None,
                load: np.ndarray, crack: np.ndarray | bool = False,
                told: np.ndarray | bool = True, dynamic_factor: float = _SUDDEN) -> None:
    """
    Break bonds and record their breakage.

    :param rows: of the blueprint, (K,).
    :param cause: of all, or of each, (K,); None = no record.
    :param load: load over strength, (K,).
    :param crack: bonds that crack only, and still transmit pressure and friction, (K,) bool.
    :param told: bonds to be recorded, (K,) bool: cracked ones were recorded before.
    :param dynamic_factor: of the bond forces of standing parts; see `StressSolver.cut`.
    """
    gone = rows[~np.broadcast_to(crack, len(rows))]
    part = model.blueprint.bonds[gone].max(axis=1)
    stands = gone[state.parts.owner[part] == Owner.STANDING]
    if len(stands):
        state.solver.cut(np.searchsorted(state.solver.graph.rows, stands), dynamic_factor)
    state.loose_bonds.graph.cut(gone)
    if cause is None:
        return
    told = np.broadcast_to(told, len(rows))
    cause, load, crack = (np.broadcast_to(column, len(rows))[told]
                          for column in (cause, load, crack))
    rows = rows[told]
    state.log.record(state.time, places(model, state, rows), rows, model.blueprint.bonds[rows],
                     cause, load, crack)


def places(model: Model, state: State, rows: np.ndarray) -> np.ndarray:
    """Return the positions of bonds, world [m], (K, 3)."""
    source, pairs = model.blueprint, model.blueprint.bonds[rows]
    part, out = pairs.max(axis=1), source.bond_frame[rows, :3].copy()
    owner = state.parts.owner[part]
    carried, grown = np.flatnonzero(owner == Owner.BODY), np.flatnonzero(owner == Owner.TREE)
    if len(carried):
        part = part[carried]
        pose = fragments.part_states(state, part)[0]
        turn = rotation.multiply(pose[:, 3:], rotation.conjugate(source.poses[part, 3:]))
        arm = source.bond_frame[rows[carried], :3] - source.poses[part, :3]
        out[carried] = pose[:, :3] + rotation.rotate(turn, arm)
    if len(grown):  # the joint is at the foot of the outer segment
        pairs = pairs[grown]
        row = np.where(pairs == GROUND, -1, state.parts.row[pairs]).max(axis=1)
        x, y, z, w = state.forest.poses[row, 3:].T
        axis = np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x),
                                1 - 2 * (x * x + y * y)])
        out[grown] = (state.forest.poses[row, :3]
                      - state.forest.half_lengths[row, None] * axis)
    return out


def break_holds(model: Model, state: State, holds: np.ndarray, load: np.ndarray,
                told: np.ndarray) -> None:
    """
    Release climbing plants from some of their anchors.

    :param holds: rows of `TreeModel.climbers`, (K,).
    :param load: load over strength, (K,).
    :param told: anchors to be recorded, (K,) bool.
    """
    climbers = model.trees.climbers
    state.climbers.holds[holds] = False
    state.forest.cut_anchors(climbers.row[holds], climbers.host_row[holds])
    holds = holds[told]
    pairs = np.column_stack([climbers.anchors.host, climbers.anchors.part])[holds]
    state.log.record(state.time, state.forest.poses[climbers.row[holds], :3],
                     np.full(len(pairs), NO_BOND), pairs, Cause.PULLED_OFF, load[told])


def break_joints(model: Model, state: State, rows: np.ndarray, causes: np.ndarray) -> None:
    """
    Record joints of mechanisms that the engine has broken, and remove them from the world.

    :param rows: of `Blueprint.joints`, (K,).
    :param causes: (K,).
    """
    joints, own = model.blueprint.joints, state.mechanisms
    pairs, ids = joints.parts[rows], own.joint[rows]
    engine = state.world.joints.of(ids)
    place = rotation.compose(state.world.poses(engine.first), engine.frame)
    state.world.part(ids)
    own.joint[rows] = -1
    contact_exclusions.add_parted(state, pairs[(pairs != GROUND).all(axis=1)])
    state.log.record(state.time, place[:, :3], np.full(len(rows), NO_BOND), pairs, causes,
                     np.ones(len(rows)))


def break_ties(model: Model, state: State, rows: np.ndarray, points: np.ndarray,
               loads: np.ndarray) -> None:
    """
    Record ropes to branches that have broken, and forget them.

    :param rows: of `Blueprint.joints`, (K,).
    :param points: where [m], (K, 3).
    :param loads: over their strengths, (K,).
    """
    state.mechanisms.joint[rows] = -1
    state.log.record(state.time, points, np.full(len(rows), NO_BOND),
                     model.blueprint.joints.parts[rows], np.full(len(rows), Cause.FORCE), loads)


def cut_out(model: Model, state: State, parts: np.ndarray, cause: Cause | None,
            load: float | np.ndarray, piece: np.ndarray | None = None) -> None:
    """
    Break the bonds of standing parts; the parts are not released yet.

    :param parts: (K,) indices.
    :param cause: see `break_bonds`.
    :param load: load over strength, of all or of each piece; between two, that of the first.
    :param piece: number of the piece of each part; bonds within a piece stay, (K,); None = each
        part is a piece.
    """
    graph = state.solver.graph
    bonds = graph.neighbours(parts)
    bonds = bonds[graph.alive[bonds]]
    loads = np.full(len(bonds), load if np.ndim(load) == 0 else 0.0)
    if piece is not None:
        owner = np.full(graph.count + 1, _NONE, np.intp)
        owner[parts] = piece
        one, other = owner[graph.first[bonds]], owner[graph.second[bonds]]
        ends = one != other
        if np.ndim(load):
            loads[ends] = np.asarray(load)[np.minimum(one, other)[ends]]
        bonds, loads = bonds[ends], loads[ends]
    break_bonds(model, state, graph.rows[bonds], cause, loads, told=~graph.has_cracked(bonds))


def release(model: Model, state: State, pieces: Sequence[np.ndarray],
            velocities: np.ndarray | None = None, cause: Cause | None = None,
            load: float | np.ndarray = 1.0) -> list[int]:
    """
    Release pieces of walls, trees and bodies: each becomes one rigid body.

    Momentum and angular momentum of the parts are kept. The former bodies of the pieces are
    removed.

    :param pieces: parts of each piece; the parts of one piece have the same owner.
    :param velocities: of the parts in the order of the pieces, world axes, (P, 6); None = their
        present ones.
    :param cause: of cutting the bonds that still hold standing pieces; None = they are cut and
        recorded already.
    :param load: load over strength of bonds cut here, of all or of each piece.
    :returns: the body of each piece.
    """
    if not len(pieces):
        return []
    parts, columns = np.concatenate(pieces), state.parts
    start = np.cumsum([0, *(len(piece) for piece in pieces)])
    stood, carried = columns.owner[parts] == Owner.STANDING, columns.owner[parts] == Owner.BODY
    if cause is not None:
        own = np.repeat(np.arange(len(pieces)), np.diff(start))
        cut_out(model, state, parts[stood], cause, load, own[stood])
    if stood.any():
        state.loose_bonds.take_over(state.solver.graph, parts[stood])
    poses, moving = columns.poses[parts], columns.velocities[parts]
    former = columns.body[parts]
    if carried.any():
        poses[carried], moving[carried] = fragments.part_states(state, parts[carried])
        _end_bodies(state, former[carried])
    moving = moving if velocities is None else velocities
    single = (np.diff(start) == 1) & stood[start[:-1]]
    rows = start[:-1][single]
    state.world.thaw(former[rows], moving[rows])
    fragments.adopt(state, parts[rows], former[rows])
    out = np.empty(len(pieces), np.intp)
    out[single] = former[rows]
    out[~single] = fragments.make_bodies(model, state, [
        (parts[start[i]:start[i + 1]], poses[start[i]:start[i + 1]],
         moving[start[i]:start[i + 1]]) for i in np.flatnonzero(~single).tolist()])
    replaced = np.flatnonzero(np.repeat(~single, np.diff(start)) & (former >= 0))
    state.world.replace(former[replaced], columns.body[parts[replaced]])
    return out.tolist()


def _end_bodies(state: State, bodies: np.ndarray) -> None:
    """Let bodies carry nothing any more, (K,) ids; the world has them still."""
    for body in dict.fromkeys(bodies.tolist()):
        state.parts.body[state.bodies.members.pop(body)] = -1
        state.bodies.size[body] = 0
    state.bodies.carried = None


def pieces_of(state: State, struck: np.ndarray, plug: np.ndarray) -> list[np.ndarray]:
    """
    Divide parts to be knocked out: struck parts singly, parts pushed ahead of them in pieces.

    :param struck: (K,) indices.
    :param plug: the struck parts, then those pushed ahead, (P,).
    """
    behind = plug[len(struck):]
    if not len(behind):
        return [*struck[:, None]]
    state.loose_bonds.take_over(state.solver.graph, behind)
    return [*struck[:, None], *state.loose_bonds.pieces(behind)]


def destroy(model: Model, state: State, parts: np.ndarray, cause: Cause | None,
            load: float | np.ndarray) -> None:
    """
    Remove standing parts, or parts carried by bodies, from the scene for good.

    Remains of bodies keep their motion.

    :param parts: (K,) indices.
    :param cause: of breaking their bonds; None = no record.
    :param load: load over strength, of all or of each.
    """
    owner, load = state.parts.owner[parts], np.broadcast_to(load, len(parts))
    stood = owner == Owner.STANDING
    if stood.any():
        cut_out(model, state, parts[stood], cause, load[stood], np.arange(np.count_nonzero(stood)))
        state.world.remove(state.parts.body[parts[stood]])
    loads = np.full(len(state.parts), np.nan)
    loads[parts] = load
    for body in np.unique(state.parts.body[parts[owner == Owner.BODY]]).tolist():
        members = state.bodies.members[body]
        lost = ~np.isnan(loads[members])
        for part in members[lost].tolist() if cause is not None else []:
            _break_out(model, state, part, members, cause, loads[part])
        rest = members[~lost]
        if len(rest):
            release(model, state, state.loose_bonds.pieces(rest))
        else:
            _end_bodies(state, np.array([body]))
            state.world.remove(np.array([body]))
    _vanish(state, parts)


def _break_out(model: Model, state: State, part: int, members: np.ndarray, cause: Cause | None,
               load: float) -> None:
    """Break the bonds that still hold a part to the others of its body, `members`."""
    graph = state.loose_bonds.graph
    bonds = graph.boundary(np.array([part]))
    held = np.isin(graph.first[bonds], members) & np.isin(graph.second[bonds], members)
    rows = graph.rows[bonds[held]]
    break_bonds(model, state, rows, cause, np.full(len(rows), load))


def _vanish(state: State, parts: np.ndarray) -> None:
    """
    Mark parts without a body as gone; they keep their poses.

    Lasting forces on them end.
    """
    state.parts.owner[parts] = Owner.GONE
    state.parts.body[parts] = -1
    state.parts.velocities[parts] = 0.0
    for part in state.wrenches.keys() & set(parts.tolist()):
        del state.wrenches[part]


def fell(state: State, parts: np.ndarray) -> None:
    """Remove whole trees from the scene for good, given all their segments, (K,) indices."""
    rows = state.parts.row[parts]
    for root in rows[state.forest.parents[rows] < 0].tolist():
        state.forest.detach(root)
    _vanish(state, parts)


def wither(state: State, parts: np.ndarray) -> None:
    """Remove segments of standing trees for good, with all that they carry, (K,) indices."""
    for row in np.sort(state.parts.row[parts]).tolist():
        if state.forest.active[row]:
            state.forest.detach(row)
    _vanish(state, parts)


def shatter(model: Model, state: State, broken: Sequence[Shards],
            cause: Cause) -> list[np.ndarray]:
    """
    Replace broken parts by flying ones.

    :returns: the bodies of the new parts, (S,) each.
    """
    firsts = iter(state.append(model, [(made, name) for own in broken for name, made in own.made]))
    out = []
    for own in broken:
        destroy(model, state, own.parts, cause, own.load)
        ends = np.cumsum([0, *(len(made) for _, made in own.made)])
        out.append(np.concatenate([
            _fly(state, next(firsts), made, own.velocities[low:high])
            for (_, made), low, high in zip(own.made, ends, ends[1:])]))
    return out


def _fly(state: State, first: int, made: Blueprint, velocities: np.ndarray) -> np.ndarray:
    """Make parts, from `first` on, single flying bodies; return their ids."""
    bodies = state.world.add_bricks(made.poses, made.size, made.mass, hexahedra=made.hexahedra,
                                    inertia=made.inertia)
    state.world.thaw(bodies, velocities)
    fragments.adopt(state, np.arange(first, first + len(made)), bodies)
    return bodies
