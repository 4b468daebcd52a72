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

"""The world in which everything that is loose collides, falls and comes to rest."""

from collections.abc import Sequence

import numpy as np

from procphys_ros import rotation
from procphys_ros.physics.world import settling
from procphys_ros.physics.world.bodies import State
from procphys_ros.physics.world.contacts import Contacts
from procphys_ros.physics.world.population import Population
from procphys_ros.physics.world.registry import FRICTION, GRAVITY
from procphys_ros.physics.world.teeth import press

_DEPTH = 0.02  # [m] under the ground from which a body is put back to where it touched it
_SUNK = 0.01  # [m] under the ground from which a body that comes to rest is lifted out of it
_OVERLAP = 1e-3  # [m] left when a body is put back: boxes that only touch have no contact
_NEAR = 0.02  # [m] gap at which Bullet makes contacts, beyond the way of one step
_FAST = 0.5  # way in one step, as a share of a body's least extent, above which it is swept
_SWEEP = 0.45  # radius of the swept sphere as a share of the least extent


class World(Population):
    """
    Bodies in time; several worlds may live side by side.

    :param gravity: [m/s²], (3,).
    :param friction: of the ground (as between two bodies that have this value).
    """

    def __init__(self, gravity: Sequence[float] = GRAVITY, friction: float = FRICTION):
        super().__init__(gravity, friction)
        self._time_step = 1.0 / 60.0
        self._contacts: Contacts | None = None
        self._lifts = np.zeros((0, 13))
        self._bites = np.zeros((0, 13))
        self._places = np.zeros((0, 3))
        self._since_check = 0.0

    def contacts(self) -> Contacts:
        """Give the contacts of the last step; ask before bodies are changed."""
        if self._contacts is None:
            moving = self._bodies.state >= State.LOOSE
            table = self._engine.contacts() if moving.any() else np.zeros((0, 13))
            table = np.concatenate([table, self._bites])
            self._contacts = Contacts.of(table, self._time_step)
        return self._contacts

    def lifts(self) -> Contacts:
        """Give what the ground did in the last step to bodies that were put back onto it."""
        return Contacts.of(self._lifts, self._time_step)

    def step(self, time_step: float) -> None:
        """
        Let time pass: set free what is about to be hit, move and collide, bring to rest.

        :param time_step: [s].
        """
        self._time_step = time_step
        self._contacts = None
        self._free_what_is_hit(time_step)
        self._sweep_what_is_fast(time_step)
        self._places = self._bodies.poses[:, :3].copy()
        self._courses.start(time_step)
        if (self._bodies.state >= State.LOOSE).any():  # what stands costs even while it sleeps
            self._engine.step(time_step)
        self._courses.finish()
        self._read()
        self._lift_to_ground(time_step)
        self._press_teeth(time_step)
        self._settle(time_step)

    def wrench(self, body: int) -> np.ndarray:
        """
        Give the mean force and moment that contacts had on a body in the last step.

        The engine finds contacts before it moves bodies, so their arms reach from there.

        :returns: force [N], moment about its centre of mass [N·m], world axes, (6,).
        """
        if body >= len(self._places):  # it has joined since
            return np.zeros(6)
        point, impulse = (np.concatenate(columns) for columns in
                          zip(self.contacts().on(body)[1:], self.lifts().on(body)[1:]))
        arm = point - self._places[body]
        return np.concatenate([impulse.sum(axis=0),
                               np.cross(arm, impulse).sum(axis=0)]) / self._time_step

    def _free_what_is_hit(self, time_step: float) -> None:
        bodies = self._bodies
        resting = np.flatnonzero(bodies.state == State.RESTING)
        moving = np.flatnonzero(bodies.state >= State.LOOSE)
        if not len(resting) or not len(moving):
            return
        moving = moving[(bodies.stay[moving] < settling.TREMBLE_TIME)
                        & (settling.rim_speed(bodies, moving) > settling.WAKE_SPEED)]
        if not len(moving):
            return
        bounds = self._engine.bounds(moving.tolist())
        pairs = settling.about_to_be_hit(bodies, resting, moving, bounds, time_step)
        reach = settling.rim_speed(bodies, pairs[:, 1]) * time_step + _NEAR
        hit: set[int] = set()
        for (body, mover), far in zip(pairs.tolist(), reach.tolist()):
            if body not in hit and self._engine.near(body, mover, far):
                hit.add(body)
        self.thaw(np.array(sorted(hit), np.intp))

    def _sweep_what_is_fast(self, time_step: float) -> None:
        """
        Sweep plain bodies that move so far in a step that they could pass through a thin one.

        Slower ones are not swept: Bullet ends a swept move where the other body *was*, so that a
        body behind a moving one cannot catch up with it.
        """
        bodies, awake = self._bodies, self.awake
        way = np.sqrt((bodies.velocities[awake, :3] ** 2).sum(axis=1)) * time_step
        least = bodies.least[awake]
        fast = (least > 0.0) & (way > _FAST * least)
        for body in awake[fast != bodies.swept[awake]].tolist():
            bodies.swept[body] = not bodies.swept[body]
            self._engine.set_sweep(
                body, float(_SWEEP * bodies.least[body]) if bodies.swept[body] else 0.0)

    def _read(self) -> None:
        awake = self.awake
        if len(awake):
            poses, velocities = self._engine.read(awake.tolist())
            self._bodies.poses[awake] = poses
            self._bodies.velocities[awake] = velocities

    def _lift_to_ground(self, time_step: float) -> None:
        """
        Put bodies that ran deep into the ground back to where they touched it.

        They get the speed they had there, from the energy of the fall between, and of the spin
        when an edge ran in; the next step's contact does the rest. Without this a fast body would
        stay in the ground for a while, and what is squeezed from above for good.
        What it loses of its speed by that is told by `lifts`.
        """
        self._lifts = np.zeros((0, 13))
        bodies, awake = self._bodies, self.awake
        height, radius = bodies.poses[awake, 2], bodies.radius[awake]
        spin = np.sqrt((bodies.velocities[awake, 3:] ** 2).sum(axis=1))
        down = self._places[awake, 2] - height + spin * radius * time_step
        deep = (height < 0.0) | ((height < radius) & (down > _DEPTH))
        if not deep.any():
            return
        chosen = awake[deep]
        depth = np.array([-self._pieces[body].lowest(bodies.poses[body])
                          for body in chosen.tolist()])
        chosen, depth = chosen[depth > _DEPTH], depth[depth > _DEPTH]
        if not len(chosen):
            return
        poses, velocities = bodies.poses[chosen], bodies.velocities[chosen]
        before = velocities[:, 2].copy()
        poses[:, 2] += depth - _OVERLAP
        self._pay(chosen, velocities, depth)
        self.set_poses(chosen, poses)
        self.set_velocities(chosen, velocities)
        force = bodies.mass[chosen] * (velocities[:, 2] - before) / time_step
        self._lifts = np.zeros((len(chosen), 13))
        self._lifts[:, 0], self._lifts[:, 1] = chosen, self.ground
        self._lifts[:, 2:4], self._lifts[:, 7] = poses[:, :2], 1.0
        self._lifts[:, 11], self._lifts[:, 12] = force, force

    def _pay(self, ids: np.ndarray, velocities: np.ndarray, height: np.ndarray) -> None:
        """Take what lifts bodies so high [m] from their fall, then from their spin, in place."""
        bodies = self._bodies
        owed = 2.0 * np.abs(self._gravity[2]) * height
        fall = np.minimum(velocities[:, 2], 0.0) ** 2
        velocities[:, 2] = np.where(velocities[:, 2] > 0.0, velocities[:, 2],
                                    -np.sqrt(np.maximum(fall - owed, 0.0)))
        turn = rotation.rotate(rotation.conjugate(bodies.poses[ids, 3:]), velocities[:, 3:])
        spin = (bodies.inertia[ids] * turn ** 2).sum(axis=1) / bodies.mass[ids]
        left = np.maximum(spin - np.maximum(owed - fall, 0.0), 0.0)
        velocities[:, 3:] *= np.sqrt(left / np.maximum(spin, 1e-12))[:, None]

    def _press_teeth(self, time_step: float) -> None:
        """Let the ground meet the corners that stick out of the shapes of bodies."""
        bodies, awake = self._bodies, self.awake
        chosen = awake[bodies.toothed[awake] & (bodies.poses[awake, 2] < bodies.radius[awake])]
        self._bites = np.zeros((0, 13))
        if not len(chosen):
            return
        teeth = [self._pieces[body].teeth for body in chosen.tolist()]
        start = np.cumsum([0, *(len(points) for points in teeth)])
        poses, velocities = bodies.poses[chosen], bodies.velocities[chosen]
        self._bites = press(start, np.concatenate(teeth), poses, velocities, bodies.mass[chosen],
                            bodies.inertia[chosen], FRICTION, time_step)
        if not len(self._bites):
            return
        moved = np.unique(self._bites[:, 0].astype(np.intp))
        self._bites[:, 0] = chosen[self._bites[:, 0].astype(np.intp)]
        self._bites[:, 1] = self.ground
        self.set_poses(chosen[moved], poses[moved])
        self.set_velocities(chosen[moved], velocities[moved])

    def _settle(self, time_step: float) -> None:
        bodies = self._bodies
        candidates = settling.count_quiet(bodies, self.awake, time_step)
        self._since_check += time_step
        if self._since_check > settling.CHECK_INTERVAL - 1e-9:
            self._since_check = 0.0
            if len(candidates):
                contacts = self.contacts().both_ways()
                rests = settling.at_rest(bodies, candidates, contacts)
                self._take_out(rests)
                self._supports.add(bodies, contacts, rests)
                self._hold(rests, State.RESTING)
        self.thaw(self._supports.lost(bodies))

    def _take_out(self, ids: np.ndarray) -> None:
        """Lift bodies that come to rest out of the ground; what lies on them settles anew."""
        low = np.array([self._pieces[body].lowest(self._bodies.poses[body])
                        for body in ids.tolist()])
        ids, depth = ids[low < -_SUNK], -low[low < -_SUNK]
        poses = self._bodies.poses[ids]
        poses[:, 2] += depth - _OVERLAP
        self.set_poses(ids, poses)
        self.thaw(self._supports.carried_by(ids))
