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

"""Impacts: what falls or flies in one piece breaks again where it hits."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.dust import motion_energy
from procphys_ros.physics.masonry import Breakage, FreeBodies
from procphys_ros.physics.world import axes_of, Contacts, State, World
from procphys_ros.scene import Settings
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.observer import Observer
from procphys_ros.simulation.rubble.bearing import Bearing
from procphys_ros.simulation.rubble.contact_loads import spread, Touches
from procphys_ros.simulation.rubble.falling_panes import FallingPanes
from procphys_ros.simulation.strikes.panes import Panes

CONTACT = 15e-3     # [s] that a blow lasts: edges crush and rubble gives way by v·T/2, 6 cm after
#                     a fall of 3 m; the elastic contact of two whole bricks would be shorter
_CHAIN = 0.3        # [m/s] change of speed down to which taking back follows chains of contacts
_LEAST_JUMP = 0.5   # [m/s] change of speed by contacts that is no blow: thrice what gravity gives
#                     in a step, so that what rests or is pushed about is never judged
_SCREEN = 0.5       # of its weakest bond's strength: forces below it cannot break a piece
_LEVER = 8.0 / 27.0  # of half of the length of a free bar: largest moment over force, where the
#                     bar is hit at its end; in the middle it is 1/4
_NODES = 60         # cells that a piece breaks into at most in one step
_PER_CELL = 5       # what a cell costs to judge, in units of ...
_WORK = 1000        # ... parts taken apart in one step, about 8 µs each; the rest follows
_COARSE = 8         # cells that a far piece breaks into at most in one step
_COARSER = 8        # how many times larger than near ones the smallest far pieces are
_BODIES = 240       # awake bodies that there should be: the more, the coarser pieces break
_LARGE = 70        # pieces that may be, however many bricks fly about: no storey falls in one


class _Blow(NamedTuple):
    """
    A blow on a piece.

    :ivar body: id.
    :ivar parts: what it carries, (P,).
    :ivar touches: contacts; None = not selected yet.
    :ivar rows: of the contacts, see `Impacts._touches`.
    """

    body: int
    parts: np.ndarray
    touches: Touches | None
    rows: np.ndarray


class Impacts:
    """
    Judges the blows of every step.

    The world lets pieces collide as rigid bodies. Where a blow is more than their bonds transmit,
    only that share of the impulse was real: the rest is taken back on both sides, the piece is
    split, and the parts collide on their own from the next step on. Momentum is kept: both sides
    get equal and opposite shares back.

    :param blueprint: parts and bonds of the scene.
    :param free: bonds of what flies about.
    :param settings: gravity, and from where on pieces stay whole.
    :param panes: of glass, which break in pieces that hit something.
    """

    def __init__(self, blueprint: Blueprint, free: FreeBodies, settings: Settings, panes: Panes):
        self._blueprint = blueprint
        self._free = free
        self._gravity = settings.gravity
        self._sharp = settings.culling.debris_distance
        self._observer: Observer | None = None
        self._log = panes.log
        self._panes = FallingPanes(blueprint, free, panes, CONTACT)

    def begin(self, world: World, debris: Debris, bearing: Bearing) -> None:
        """Start anew in a world that has just been built, with what still stands in it."""
        self._world = world
        self._bearing = bearing
        self._debris = debris
        self._panes.begin(world, debris)
        self._before = np.zeros((0, 6))
        self._start = np.zeros((0, 7))
        self._waiting: list[_Blow] = []

    def observe(self, observer: Observer) -> None:
        """Take note of who looks: what is far from there breaks coarsely, if so asked for."""
        self._observer = observer

    def _far(self, bodies: np.ndarray) -> np.ndarray:
        """Say which bodies break coarsely, because they are far from who looks, (K,) bool."""
        if self._observer is None or self._sharp == 0.0:
            return np.zeros(len(bodies), bool)
        world = self._world.bodies
        return self._observer.distance(world.poses[bodies, :3]) > (self._sharp
                                                                   + world.radius[bodies])

    def watch(self) -> None:
        """Note where everything is and how it moves just before a step of the world."""
        self._before = self._world.bodies.velocities.copy()
        self._start = self._world.bodies.poses.copy()

    def judge(self, time: float, time_step: float) -> bool:
        """
        Break what the contacts of the last step overloaded.

        :param time: of the simulation [s].
        :param time_step: [s].
        :returns: whether anything broke.
        """
        jump = self._jump(time_step)
        struck = self._struck(jump)
        if not (self._waiting or self._panes.waiting or struck.any()):
            return False
        share = np.ones(len(self._world.bodies.state))
        broken = self._break(struck, share)
        self._panes.judge(struck, jump, self._start, [result.bonds for _, result in broken])
        knocks = []
        if self._bearing.any_near:
            knocks = self._bearing.knocks(self._world.contacts(), struck)
        for knock in knocks:
            share[self._bearing.body(knock.part)] = knock.share
        if broken or knocks:
            self._give_back(self._world.contacts(), share, time_step)
            self._bearing.knock_out(knocks, time)
            for blow, result in broken:
                self._record(blow, result, time)
                if len(result.pieces) > 1:
                    self._debris.split(blow.body, result.pieces)
        return self._panes.shatter(time) or bool(broken or knocks)

    def _break(self, struck: np.ndarray, share: np.ndarray) -> list[tuple[_Blow, Breakage]]:
        """
        Judge the blows on pieces.

        :param struck: see `_struck`.
        :param share: of the impulses on each body that its bonds transmitted, by id, (B,),
            written in place.
        :returns: those that broke something, and what.
        """
        size, grain = self._debris.size, self._grain()
        awake = self._world.awake[self._world.awake < len(size)]
        room = max(_BODIES - len(self._world.awake),
                   _LARGE - int(np.count_nonzero(size[awake] >= grain)))
        if (room < 2 or np.max(size, initial=0) < 2.0 * grain) and not self._bearing.any_near:
            return []
        contacts = self._world.contacts()
        blows = [b for b in self._waiting if self._debris.parts_of(b.body) is b.parts]
        late = len(blows)
        known = {b.body for b in blows}
        blows += [b for b in self._blows(contacts, struck, grain) if b.body not in known]
        self._waiting = []
        broken = []
        work = 0
        far = self._far(np.array([b.body for b in blows], np.intp))
        for turn, (blow, cells) in enumerate(zip(blows, _cells(blows, room, grain))):
            cells = min(cells, _COARSE) if far[turn] else cells
            if cells < 2:
                continue
            touches = blow.touches or self._touches(blow.body, blow.rows, contacts)
            if work > _WORK:
                self._waiting.append(blow._replace(touches=touches))
                continue
            work += len(blow.parts) + _PER_CELL * cells
            result = self._free.strike(blow.parts, self._wrenches(blow, touches), cells)
            if len(result.bonds):
                broken.append((blow, result))
                if turn >= late:  # the impulse of a late blow is history
                    share[blow.body] = result.share
        return broken

    def _grain(self) -> float:
        """Give the mean size of the pieces if all that moves now broke into as many as may."""
        awake = self._world.awake
        awake = awake[awake < len(self._debris.size)]
        return max(float(self._debris.size[awake].sum()) / _BODIES, 1.0)

    def _wrenches(self, blow: _Blow, touches: Touches) -> np.ndarray:
        return spread(touches, self._debris.local_poses(blow.parts),
                      self._blueprint.size[blow.parts], self._blueprint.poses[blow.parts])

    def _jump(self, time_step: float) -> np.ndarray:
        """Give the change of velocity by contacts of all awake bodies, (K, 6)."""
        awake = self._world.awake
        before = np.zeros((len(awake), 6))
        known = awake < len(self._before)
        before[known] = self._before[awake[known]]
        before[:, 2] -= self._gravity * time_step
        return self._world.bodies.velocities[awake] - before

    def _struck(self, jump: np.ndarray) -> np.ndarray:
        """Mark the bodies whose motion contacts changed at once, by id, (B,) bool."""
        bodies, awake = self._world.bodies, self._world.awake
        felt = (np.sqrt((jump[:, :3] ** 2).sum(axis=1))
                + np.sqrt((jump[:, 3:] ** 2).sum(axis=1)) * bodies.radius[awake])
        struck = np.zeros(len(bodies.state), bool)
        struck[awake] = felt > _LEAST_JUMP
        return struck

    def _blows(self, contacts: Contacts, struck: np.ndarray, grain: float) -> Iterator[_Blow]:
        """
        List the blows that might break something, the hardest first.

        :param struck: bodies that were stopped or pushed; others only rest on each other.
        :param grain: parts of the smallest pieces that there is room for.
        """
        bodies, debris = self._world.bodies, self._debris
        count = len(bodies.state)
        side = np.concatenate([contacts.body_a, contacts.body_b])
        push = np.tile(np.sqrt((contacts.impulse ** 2).sum(axis=1)), 2)
        by_blow = struck[side] | struck[np.concatenate([contacts.body_b, contacts.body_a])]
        felt = np.bincount(side, push * by_blow, count)
        size = np.zeros(count, np.intp)
        size[:len(debris.size)] = debris.size[:count]
        chosen = np.flatnonzero((size >= 2.0 * grain) & (felt > _LEAST_JUMP * bodies.mass)
                                & (bodies.state == State.LOOSE))
        far = self._far(chosen)
        chosen = chosen[~far | (size[chosen] >= 2.0 * _COARSER * grain)]
        order = np.argsort(side, kind='stable')
        start = np.searchsorted(side[order], np.arange(count + 1))
        for body in chosen[np.argsort(-felt[chosen], kind='stable')].tolist():
            parts = debris.parts_of(body)
            least = min(self._free.weakest[parts].min(), self._free.weakest_bent[parts].min()
                        / (_LEVER * bodies.radius[body]))
            if felt[body] > CONTACT * _SCREEN * least:
                rows = order[start[body]:start[body + 1]]
                yield _Blow(body, parts, None, rows)

    def _touches(self, body: int, rows: np.ndarray, contacts: Contacts) -> Touches:
        """Select contacts of a body; those that have it second are listed behind all others."""
        first = rows < len(contacts)
        rows = rows % len(contacts)
        sign = np.where(first, 1.0, -1.0)[:, None]
        axes = axes_of(self._start[body, 3:])
        return Touches(
            (contacts.point[rows] - self._start[body, :3]) @ axes,
            (sign * contacts.normal[rows]) @ axes,
            (sign * contacts.impulse[rows] / CONTACT) @ axes,
            np.where(first, contacts.body_b[rows], contacts.body_a[rows]))

    def _give_back(self, contacts: Contacts, share: np.ndarray, time_step: float) -> None:
        """
        Undo the part of each impulse that the bonds of a side could not transmit.

        Contacts are where the bodies were at the start of the step, and so are their arms. Bodies
        that stood on what gives way now did not fall in this step, so gravity gives them no speed.
        """
        bodies = self._world.bodies
        kept = self._kept(contacts, share)
        rows = np.flatnonzero(kept < 1.0)
        back = (kept[rows] - 1.0)[:, None] * contacts.impulse[rows]
        ids, place = np.unique(np.concatenate([contacts.body_a[rows], contacts.body_b[rows]]),
                               return_inverse=True)
        impulse = np.concatenate([back, -back])
        arm = np.tile(contacts.point[rows], (2, 1)) - self._start[ids[place], :3]
        total = np.zeros((len(ids), 6))
        np.add.at(total, place, np.hstack([impulse, np.cross(arm, impulse)]))
        loose = bodies.state[ids] == State.LOOSE
        ids, total = ids[loose], total[loose]
        attitude = bodies.poses[ids, 3:]
        spin = rotation.rotate(rotation.conjugate(attitude), total[:, 3:]) / bodies.inertia[ids]
        change = np.hstack([total[:, :3] / bodies.mass[ids][:, None],
                            rotation.rotate(attitude, spin)])
        change[:, 2] += (1.0 - share[ids]) * self._gravity * time_step
        self._world.set_velocities(ids, self._no_faster(ids, bodies.velocities[ids] + change))

    def _no_faster(self, ids: np.ndarray, velocities: np.ndarray) -> np.ndarray:
        """
        Slow down what would have more energy than both before and after its contacts.

        A share of all impulses lies in between, but shares that differ from contact to contact,
        as where a brick is squeezed under a slab, could leave a spin of hundreds of rounds.
        """
        bodies = self._world.bodies
        energy, before, after = (
            motion_energy(bodies.mass[ids], bodies.inertia[ids], bodies.poses[ids, 3:], v)
            for v in (velocities, self._before[ids], bodies.velocities[ids]))
        most = np.maximum(np.maximum(before, after), 1e-12)
        return velocities * np.sqrt(np.minimum(most / np.maximum(energy, 1e-12), 1.0))[:, None]

    def _kept(self, contacts: Contacts, share: np.ndarray) -> np.ndarray:
        """
        Give the share of each impulse that stays, (C,).

        What is squeezed between a piece and the ground passes on a weaker push, too, or it would
        shoot out: the share of a piece holds for all contacts of the chain of bodies that it
        pressed on.
        """
        bodies = self._world.bodies
        a, b = contacts.body_a, contacts.body_b
        size = np.sqrt((contacts.impulse ** 2).sum(axis=1))
        loose = bodies.state == State.LOOSE
        while True:
            kept = np.minimum(share[a], share[b])
            before = share.copy()
            for body in (a, b):
                moved = loose[body] & ((1.0 - kept) * size > _CHAIN * bodies.mass[body])
                np.minimum.at(share, body[moved], kept[moved])
            if np.array_equal(share, before):
                return kept

    def _record(self, blow: _Blow, result: Breakage, time: float) -> None:
        source = self._blueprint
        pairs = source.bonds[result.bonds]
        part = pairs.max(axis=1)
        now = self._debris.poses_of(blow.body)[np.searchsorted(blow.parts, part)]
        turn = rotation.multiply(now[:, 3:], rotation.conjugate(source.poses[part, 3:]))
        arm = source.bond_frame[result.bonds, :3] - source.poses[part, :3]
        self._log.record(time, now[:, :3] + rotation.rotate(turn, arm), result.bonds, pairs,
                         Cause.IMPACT, result.load)


def _cells(blows: list[_Blow], room: int, grain: float) -> list[int]:
    """
    Say in how many cells each piece may break; below 2 it stays as it is.

    :param blows: the hardest first.
    :param room: for more bodies.
    :param grain: parts of the smallest pieces that there is room for in the long run.
    """
    total = sum(len(b.parts) for b in blows)
    cells = []
    for blow in blows:
        fair = int(np.ceil(room * len(blow.parts) / total))
        cells.append(min(max(fair, 2), room, _NODES, int(len(blow.parts) / grain)))
        room -= cells[-1] if cells[-1] > 1 else 0
    return cells
