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

"""Cutting: saw cuts through the joints of trees, walls and loose pieces."""

import numpy as np

from procphys_ros.blueprint import GROUND
from procphys_ros.errors import CommandError
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees.sections import hinge
from procphys_ros.scene.strikes import Cut
from procphys_ros.simulation import breaking, contact_exclusions, fragments, trees
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

WEDGE = 0.025  # [m] thickness of a felling wedge


def cut(model: Model, state: State, command: Cut) -> int:
    """
    Cut joints, without a jerk; what they held comes down by itself. Return their number.

    Writes bonds, the forest and bodies.

    :raises CommandError: when the target does not exist, or there is no joint to cut.
    """
    grown = state.growing.plants.get(command.target)  # with what has grown since
    parts = state.names.indices([command.target]) if grown is None else grown.all_parts()
    parts = parts[state.parts.owner[parts] != Owner.GONE]
    if not len(parts):
        raise CommandError(f'{command.target} exists no more')
    plane = np.array(command.normal, float)
    if len(parts) > 1 and not plane.any():
        raise CommandError(f'{command.target} is an object: a cut through it takes a plane, '
                           'cut.point and cut.normal')
    rows = (_across(model, state, parts, np.array(command.point, float), plane, command.reach)
            if plane.any() else bonds_of(model, state, parts))
    if not len(rows):
        raise CommandError(f'nothing holds {command.target}' if not plane.any() else
                           f'there is no joint of {command.target} in the plane of the cut')
    if command.hinge > 0.0:
        _leave_hinges(model, state, rows, command)
    else:
        part(model, state, rows)
    return len(rows)


def _leave_hinges(model: Model, state: State, rows: np.ndarray, command: Cut) -> None:
    """Cut bonds of trees but for a strip of wood each, and drive wedges into the cuts."""
    child = model.blueprint.bonds[rows].max(axis=1)
    if (state.parts.owner[child] != Owner.TREE).any():
        raise CommandError(f'{command.target} is not held by wood alone; cut.hinge is for trees')
    width = model.blueprint.bond_extent[rows, 0]
    if command.hinge >= width.min():
        raise CommandError(f'cut.hinge is {command.hinge:g} m, {command.target} is '
                           f'{width.min():.3g} m thick there; it must be less')
    segment, way = state.parts.row[child], np.array(command.towards, float)
    ways = np.broadcast_to(way / norm(way), (len(rows), 3))
    state.forest.begin_cuts(segment, ways)
    state.forest.saw(segment, hinge(command.hinge / width))
    state.wedges.update(zip(child.tolist(), (WEDGE / width).tolist()))
    if state.trees.lod is not None:
        state.trees.lod.wake(state.trees.lod.of_rows(state.forest, segment))


def bonds_of(model: Model, state: State, part: np.ndarray) -> np.ndarray:
    """List the bonds that hold a part: of a segment of a tree, the one at its foot."""
    if state.parts.owner[part[0]] == Owner.TREE:
        row = state.parts.row[part]
        bonds = state.forest.bonds[row]
        return bonds[~state.forest.is_free(row)]
    return _bonds(model, state, part)


def _bonds(model: Model, state: State, parts: np.ndarray) -> np.ndarray:
    """List the unbroken bonds of parts, rows of the blueprint, ascending, (K,)."""
    own = np.zeros(len(state.parts) + 1, bool)  # the last row is the ground's
    own[parts] = True
    pairs = model.blueprint.bonds
    return np.flatnonzero(own[pairs].any(axis=1) & state.loose_bonds.graph.alive)


def _across(model: Model, state: State, parts: np.ndarray, point: np.ndarray, normal: np.ndarray,
            reach: float) -> np.ndarray:
    """
    List the bonds of parts whose ends lie on both sides of a plane.

    :param point: on the plane, world [m], (3,).
    :param reach: of the blade from that point [m].
    """
    rows = _bonds(model, state, parts)
    pairs, places = model.blueprint.bonds[rows], breaking.places(model, state, rows)
    centres = np.concatenate([state.parts.poses[:, :3], np.zeros((1, 3))])
    ends = [np.where(side[:, None] == GROUND, 2.0 * places - centres[other], centres[side])
            for side, other in (pairs.T, pairs[:, ::-1].T)]
    above = [product(end - point, normal) > 0.0 for end in ends]
    return rows[(above[0] != above[1]) & (norm(places - point, axis=1) <= reach)]


def part(model: Model, state: State, rows: np.ndarray) -> None:
    """Break bonds, and let go what they held of trees and loose pieces."""
    part = model.blueprint.bonds[rows].max(axis=1)
    owner = state.parts.owner[part]
    bodies = np.unique(state.parts.body[part[owner == Owner.BODY]])
    pairs = model.blueprint.bonds[rows[owner == Owner.TREE]]
    feet = np.where(pairs == GROUND, -1, state.parts.row[pairs]).max(axis=1, initial=-1)
    feet = np.sort(feet)[::-1]  # tips first
    breaking.break_bonds(model, state, rows, Cause.CUT, np.zeros(len(rows)), dynamic_factor=1.0)
    if len(feet):
        if state.trees.lod is not None:
            state.trees.lod.wake(state.trees.lod.of_rows(state.forest, feet))
        trees.let_fall(model, state, feet.tolist())
    pieces = []
    for body in bodies.tolist():
        left = state.loose_bonds.pieces(state.bodies.members[body])
        if len(left) > 1:
            contact_exclusions.add_split(state, left)
            pieces += left
    breaking.release(model, state, pieces)
    contact_exclusions.update(model, state)
    fragments.write_poses(model, state, 0.0)
