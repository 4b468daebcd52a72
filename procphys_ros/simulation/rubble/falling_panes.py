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

"""Falling panes: glass in pieces of walls breaks when these are stopped, or bend its frame."""

from collections.abc import Sequence

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.masonry import FreeBodies
from procphys_ros.physics.world import State, World
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.strikes.panes import Panes, PIECES

FEWEST = 2         # pieces along each side, where there is little room for more bodies
_SHARDS = 64       # awake shards that there should be: the more, the fewer does a pane break into
_BODIES = 300      # awake bodies up to which there may be more; beyond, other panes wait, cracked
_MOST = 4          # panes that fall out in one step: each time their piece is made anew
_NEAR = 0.02       # [m] from a pane, within which a contact of its piece is one on the glass
_JUST_OVER = 1.01  # load of a pane whose frame bends


class FallingPanes:
    """
    The panes in loose pieces, and those that fly about alone.

    A pane breaks when its edges are stopped harder across the glass than it bears in bending, when
    something hits it in one point, or when a bond of it or of its frame breaks. It falls to shards
    as soon as there is room for them, unless its piece has come to rest before.

    :param blueprint: parts and bonds of the scene.
    :param free: bonds of what flies about.
    :param panes: all there are.
    :param contact: time that a blow lasts [s].
    """

    def __init__(self, blueprint: Blueprint, free: FreeBodies, panes: Panes, contact: float):
        self._blueprint = blueprint
        self._free = free
        self._panes = panes
        self._parts = panes.parts
        self._contact = contact
        self._thin = np.argmin(blueprint.size[self._parts], axis=1)
        row = np.full(len(blueprint) + 1, -1)
        row[self._parts] = np.arange(len(self._parts))
        graph = free.graph
        ends = np.concatenate([np.column_stack([graph.first, graph.second]),
                               np.column_stack([graph.second, graph.first])])
        edge = row[ends[:, 0]] >= 0
        self._pane, self._frame = row[ends[edge, 0]], ends[edge, 1]

    def begin(self, world: World, debris: Debris) -> None:
        """Start anew in a world that has just been built."""
        self._world = world
        self._debris = debris
        self._load = np.zeros(len(self._parts))
        self._shards = np.zeros(0, np.intp)

    @property
    def waiting(self) -> bool:
        """Say whether any broken pane is still in one piece."""
        return bool(np.any(self._load > 1.0))

    def judge(self, struck: np.ndarray, jump: np.ndarray, start: np.ndarray,
              broken: Sequence[np.ndarray]) -> None:
        """
        Find out which panes the contacts of the last step broke.

        :param struck: bodies that contacts stopped or pushed, by id, (B,) bool.
        :param jump: change of velocity by contacts of the bodies `World.awake`, (K, 6).
        :param start: poses of the bodies at the contacts, by id, (B, 7).
        :param broken: bonds that broke in pieces, rows of the blueprint.
        """
        if not len(self._parts):
            return
        body = self._debris.carrier[self._parts]
        loose = (body >= 0) & (self._world.bodies.state[body] == State.LOOSE)
        if loose.any() and struck.any():
            rows = np.flatnonzero(loose & struck[body])
            stopped = jump[np.searchsorted(self._world.awake, body[rows])]
            self._feel(rows, self._bending(rows, start[body[rows]], stopped))
            self._feel(*self._poking(np.flatnonzero(loose), start, struck))
        if broken:
            bent = self._bent(np.concatenate(broken))
            self._feel(bent, np.full(len(bent), _JUST_OVER))
        self._load[~loose] = 0.0  # it stands, rests as it is, or is no more

    def shatter(self, time: float) -> bool:
        """
        Let broken panes fall out of their pieces as shards, as many as there is room for.

        :param time: of the simulation [s].
        :returns: whether any did.
        """
        rows = np.flatnonzero(self._load > 1.0)
        awake = self._world.awake
        self._shards = self._shards[np.isin(self._shards, awake)]
        room = max(_SHARDS - len(self._shards), 0)
        chosen = rows[:min(_MOST, max(room, _BODIES - len(awake)) // FEWEST ** 2)]
        if not len(chosen):
            return False
        pieces = min(max(int((room / len(rows)) ** 0.5), FEWEST), PIECES)
        carrier = self._debris.carrier[self._parts[chosen]]
        for body in np.unique(carrier).tolist():
            self._take_out(body, chosen[carrier == body], pieces, time)
        self._load[chosen] = 0.0
        return True

    def _feel(self, rows: np.ndarray, load: np.ndarray) -> None:
        np.maximum.at(self._load, rows, load)

    def _bending(self, rows: np.ndarray, body: np.ndarray, jump: np.ndarray) -> np.ndarray:
        """
        Compare how hard the edges of panes were stopped with what the glass bears, (K,).

        :param body: poses of their bodies, (K, 7).
        :param jump: change of velocity of these, (K, 6).
        """
        pose = rotation.compose(body, self._debris.local_poses(self._parts[rows]))
        change = jump[:, :3] + np.cross(jump[:, 3:], pose[:, :3] - body[:, :3])
        across = rotation.to_matrix(pose[:, 3:])[np.arange(len(rows)), :, self._thin[rows]]
        rate = np.abs(np.einsum('ki,ki->k', across, change)) / self._contact
        return rate / self._panes.deceleration(self._parts[rows])

    def _poking(self, rows: np.ndarray, start: np.ndarray,
                struck: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Compare contacts on panes with the force in one point that these bear.

        :param rows: loose panes, (K,).
        :param start, struck: see `judge`.
        :returns: row and load of each such contact.
        """
        contacts = self._world.contacts()
        blow = np.flatnonzero(struck[contacts.body_a] | struck[contacts.body_b])
        body = self._debris.carrier[self._parts[rows]]
        pairs = [np.nonzero(side[blow, None] == body)
                 for side in (contacts.body_a, contacts.body_b)]
        touch, k = (np.concatenate(column) for column in zip(*pairs))
        touch, rows = blow[touch], rows[k]
        parts = self._parts[rows]
        pose = rotation.compose(start[body[k]], self._debris.local_poses(parts))
        local = rotation.rotate(rotation.conjugate(pose[:, 3:]),
                                contacts.point[touch] - pose[:, :3])
        on = (np.abs(local) < 0.5 * self._blueprint.size[parts] + _NEAR).all(axis=1)
        force = np.linalg.norm(contacts.impulse[touch[on]], axis=1) / self._contact
        return rows[on], force / self._panes.point_force(parts[on])

    def _bent(self, bonds: np.ndarray) -> np.ndarray:
        """List the panes that broken bonds held, or whose frame they held."""
        torn = np.zeros(self._free.graph.count + 1, bool)
        torn[self._blueprint.bonds[bonds]] = True
        return self._pane[torn[self._frame] | torn[self._parts[self._pane]]]

    def _take_out(self, body: int, rows: np.ndarray, pieces: int, time: float) -> None:
        """Put shards in the place of some panes of a body; the rest of it goes on as it did."""
        debris, world = self._debris, self._world.bodies
        parts, members = self._parts[rows], debris.parts_of(body)
        poses = debris.poses_of(body)[np.searchsorted(members, parts)]
        velocities = np.tile(world.velocities[body], (len(parts), 1))
        velocities[:, :3] += np.cross(world.velocities[body, 3:],
                                      poses[:, :3] - world.poses[body, :3])
        for part, pose, load in zip(parts.tolist(), poses, self._load[rows].tolist()):
            self._part_from_frame(part, pose, members, load, time)
        rest = np.setdiff1d(members, parts)
        debris.split(body, self._free.pieces(rest) if len(rest) else [])
        for part, pose, velocity in zip(parts.tolist(), poses, velocities):
            bodies = self._panes.burst(part, pose, velocity, pieces)
            self._shards = np.concatenate([self._shards, bodies])

    def _part_from_frame(self, part: int, pose: np.ndarray, members: np.ndarray, load: float,
                         time: float) -> None:
        """Break the bonds that still hold a pane in its piece."""
        source, graph = self._blueprint, self._free.graph
        bonds = graph.boundary(np.array([part]))
        held = np.isin(graph.first[bonds], members) & np.isin(graph.second[bonds], members)
        graph.cut(bonds)
        rows = graph.rows[bonds[held]]
        turn = rotation.multiply(pose[3:], rotation.conjugate(source.poses[part, 3:]))
        arm = source.bond_frame[rows, :3] - source.poses[part, :3]
        self._panes.log.record(time, pose[:3] + rotation.rotate(turn, arm), rows,
                               source.bonds[rows], Cause.IMPACT, np.full(len(rows), load))
