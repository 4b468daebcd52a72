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


"""Striking: flying projectiles are swept before each step against what stands."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.loads import (
    Hits,
    sweep_box_boxes,
    sweep_box_capsules,
    sweep_boxes,
    sweep_capsules,
)
from procphys_ros.physics.world import State, World
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.standing.blows import Blows, CONTACT
from procphys_ros.simulation.strikes.panes import Panes
from procphys_ros.simulation.trees.grove import Grove

RESTITUTION = 0.25   # of hard bodies on masonry and wood that hold
_FRICTION = 0.6      # stone on brick, EN 1996-1-1 3.6.2 gives 0.4 for design, means lie higher
_ROLLING = 2.0 / 7.0  # share of its tangential momentum that a ball loses until it rolls
_SLOW = 0.3          # [m/s] closing speed below which a touch is left to the world's contacts
_JOINT = 0.01        # [m] mortar between parts that makes their faces one wall
_DENT = 0.015        # [m] parts touched within this depth take one blow together
_FLUSH = 1e-5        # [m] depth within which touches say together which way a wall faces
_ALIKE = 0.7         # least cosine between the normals of such touches
_MOST_HITS = 150     # in one step


@dataclass(frozen=True)
class Impact:
    """
    One blow of a projectile.

    :ivar time: of the step it happened in [s].
    :ivar projectile: its part.
    :ivar point: where it touched, world [m], (3,).
    :ivar parts: what it touched, (K,).
    :ivar torn: whether these came off (of trees: never, they bend first).
    :ivar lost: momentum that the projectile lost [N·s], (3,).
    :ivar carried: momentum that the struck parts took along [N·s], (3,).
    :ivar grounded: momentum that went through the wall to the ground [N·s], (3,).
    :ivar work: of fracture, taken from what moves [J].
    """

    time: float
    projectile: int
    point: np.ndarray
    parts: np.ndarray
    torn: bool
    lost: np.ndarray
    carried: np.ndarray
    grounded: np.ndarray
    work: float


@dataclass
class _Missile:
    """What flies: its part, body, shape and mass."""

    part: int
    body: int
    ball: bool
    size: np.ndarray
    mass: float


class Striking:
    """
    Decides, where a projectile meets something that stands, what comes out of it.

    Blows pass through the point of touch without turning the projectile: its spin changes only by
    the world's contacts.

    :param blueprint: all parts of the scene.
    :param grove: trees that stand.
    :param blows: on masonry.
    :param panes: of glass.

    :ivar impacts: every blow since the last reset, the ledger of momentum.
    """

    def __init__(self, blueprint: Blueprint, grove: Grove, blows: Blows, panes: Panes):
        self._blueprint = blueprint
        self._grove = grove
        self._closed_sizes = blueprint.size + _JOINT
        self._tree_sizes = blueprint.solid_size(grove.forest.parts)
        self._blows = blows
        self._panes = panes

    def begin(self, world: World, gravity: float) -> None:
        """Start anew, without projectiles, in a world that has just been built."""
        self._world = world
        self._gravity = gravity
        self._missiles: list[_Missile] = []
        self.impacts: list[Impact] = []

    def __len__(self) -> int:
        return len(self._missiles)

    def enter(self, part: int, body: int, ball: bool, size: np.ndarray, mass: float) -> None:
        """Watch over one more projectile."""
        self._missiles.append(_Missile(part, body, ball, size, mass))

    def touched(self, ball: bool, size: np.ndarray, pose: np.ndarray) -> int:
        """Give a part that stands where a projectile would start, -1 for none."""
        wall, tree = self._ahead(_Missile(-1, -1, ball, size, 0.0), pose, np.zeros(3))
        if len(wall):
            return int(wall.index[0])
        return int(self._grove.forest.parts[tree.index[0]]) if len(tree) else -1

    def advance(self, time: float, time_step: float) -> None:
        """
        Let everything that flies meet what stands on its way of the next step.

        :param time: [s].
        :param time_step: [s].
        """
        bodies = self._world.bodies
        for missile in self._missiles:
            speed = np.linalg.norm(bodies.velocities[missile.body, :3])
            if bodies.state[missile.body] == State.LOOSE and speed > _SLOW:
                self._fly(missile, time, time_step)

    def _fly(self, missile: _Missile, time: float, time_step: float) -> None:
        body = np.array([missile.body])
        pose = self._world.bodies.poses[missile.body].copy()
        velocity = self._world.bodies.velocities[missile.body].copy()
        left, has_struck = time_step, False
        passed: set[int] = set()
        for _ in range(_MOST_HITS):
            way = velocity[:3] * left
            found = self._next(missile, pose, way, velocity[:3], passed)
            if found is None:
                break
            hits, is_tree = found
            self._move(pose, velocity, hits.fraction[0] * left)
            left *= 1.0 - hits.fraction[0]
            before = velocity[:3].copy()
            if is_tree:
                passed.add(int(hits.index[0]))
                self._hit_tree(missile, hits, velocity, time)
                goes_on = before @ velocity[:3] > 0.0
            else:
                goes_on = self._hit_wall(missile, hits, way, velocity, time)
            left = left if goes_on else time_step
            has_struck = True
        if has_struck:
            # The world's step is a whole one: let it begin so much back on the same way.
            self._move(pose, velocity, left - time_step)
            self._world.set_poses(body, pose[None])
            self._world.set_velocities(body, velocity[None])

    def _move(self, pose: np.ndarray, velocity: np.ndarray, duration: float) -> None:
        """Move straight on, or back, with the energy of free flight."""
        pose[:3] += duration * velocity[:3]
        square = velocity[2] ** 2 - 2.0 * self._gravity * duration * velocity[2]
        velocity[2] = np.copysign(np.sqrt(max(square, 0.0)), velocity[2])

    def _ahead(self, missile: _Missile, pose: np.ndarray,
               way: np.ndarray) -> tuple[Hits, Hits]:
        """Sweep over standing masonry, and over standing trees."""
        forest, end = self._grove.forest, pose[:3] + way
        wall = (self._blueprint.poses, self._closed_sizes, self._blows.buildings.standing)
        trees = (forest.poses, self._tree_sizes, forest.active)
        if missile.ball:
            radius = 0.5 * float(missile.size[0])
            return (sweep_boxes(pose[:3], end, radius, *wall),
                    sweep_capsules(pose[:3], end, radius, *trees))
        return (sweep_box_boxes(pose[:3], end, pose[3:], missile.size, *wall),
                sweep_box_capsules(pose[:3], end, pose[3:], missile.size, *trees))

    def _next(self, missile: _Missile, pose: np.ndarray, way: np.ndarray, velocity: np.ndarray,
              passed: set[int]) -> tuple[Hits, bool] | None:
        """Find the next blow on a way: its touches, and whether it is on a tree."""
        wall, tree = self._ahead(missile, pose, way)
        wall = _take(wall, wall.normal @ velocity < -_SLOW)
        if len(tree):
            forest = self._grove.forest
            moving = forest.velocities[tree.index]
            arm = tree.point - forest.poses[tree.index, :3]
            slip = velocity - moving[:, :3] - np.cross(moving[:, 3:], arm)
            closes = np.einsum('ki,ki->k', tree.normal, slip) < -_SLOW
            fresh = ~np.isin(tree.index, list(passed))
            tree = _take(tree, closes & fresh)
        if len(tree) and (not len(wall) or tree.fraction[0] <= wall.fraction[0]):
            return _take(tree, np.arange(1)), True
        if not len(wall):
            return None
        depth = _depth(wall, way)
        together = (depth < _DENT) & (wall.normal @ wall.normal[0] > _ALIKE)
        glass = self._panes.are(wall.index)
        return _take(wall, together & (glass == glass[0])), False

    def _hit_tree(self, missile: _Missile, hits: Hits, velocity: np.ndarray,
                  time: float) -> None:
        forest, row = self._grove.forest, int(hits.index[0])
        point, normal = hits.point[0], hits.normal[0]
        moving = forest.velocities[row]
        slip = velocity[:3] - moving[:3] - np.cross(moving[3:], point - forest.poses[row, :3])
        yielding = 1.0 / missile.mass + 1.0 / forest.effective_mass(row, point, normal)
        impulse = (1.0 + RESTITUTION) * (normal @ slip) / yielding * normal  # on the tree
        forest.apply_impulse(row, point, impulse)
        velocity[:3] -= impulse / missile.mass
        self._note(time, missile, point, forest.parts[[row]], False, impulse, impulse, 0.0)

    def _hit_wall(self, missile: _Missile, hits: Hits, way: np.ndarray, velocity: np.ndarray,
                  time: float) -> bool:
        """Strike standing parts together; say whether they give way."""
        parts, flush = hits.index, _depth(hits, way) < _FLUSH
        point, normal = hits.point[flush].mean(axis=0), hits.normal[flush].mean(axis=0)
        normal /= np.linalg.norm(normal)
        before, closing = velocity[:3].copy(), float(-normal @ velocity[:3])
        direction = _line(before, normal, closing)
        cosine = float(-normal @ direction)
        glass = None
        if self._panes.are(parts[:1])[0]:
            parts = parts[:1]
            glass = self._panes.crack(int(parts[0]), point, float(missile.size.max()))
            mass, resistance = glass.mass, glass.resistance
        else:
            mass = float(self._blueprint.mass[parts].sum())
            resistance = self._blows.resistance(parts, direction)
        blow = (1.0 + RESTITUTION) * missile.mass * closing / cosine
        shared = closing / cosine / (1.0 / missile.mass + 1.0 / mass)
        push = self._blows.gives_way(resistance, blow, missile.mass + mass, shared / mass)
        if push is None:
            self._bounce(velocity, normal, closing)
            lost = missile.mass * (before - velocity[:3])
            self._blows.press(parts, np.tile(lost / len(parts), (len(parts), 1)))
            self._note(time, missile, point, parts, False, lost, np.zeros(3), 0.0)
            return False
        velocity[:3] -= (shared / missile.mass + shared / mass - push.speed) * direction
        lost = missile.mass * (before - velocity[:3])
        load = blow / max(resistance.momentum(CONTACT), 1e-9)
        if glass is not None:
            self._panes.shatter(glass, push.speed * direction, load, time)
        else:
            moving = np.zeros((len(parts), 6))
            moving[:, :3] = push.speed * direction
            self._blows.press_around(resistance.bonds, parts, push.wall * direction)
            self._blows.tear_out(parts, moving, Cause.IMPACT, load, time)
        self._note(time, missile, point, parts, True, lost, mass * push.speed * direction,
                   resistance.energy)
        return True

    @staticmethod
    def _bounce(velocity: np.ndarray, normal: np.ndarray, closing: float) -> None:
        """Throw back what meets a wall that holds; friction slows what slides along it."""
        along = velocity[:3] + closing * normal
        speed = float(np.linalg.norm(along))
        grip = min(_FRICTION * (1.0 + RESTITUTION) * closing, _ROLLING * speed)
        velocity[:3] = RESTITUTION * closing * normal
        if speed > 0.0:
            velocity[:3] += (1.0 - grip / speed) * along

    def _note(self, time: float, missile: _Missile, point: np.ndarray, parts: np.ndarray,
              torn: bool, lost: np.ndarray, carried: np.ndarray, work: float) -> None:
        self.impacts.append(Impact(time, missile.part, point, parts, torn, lost, carried,
                                   lost - carried, work))


def _line(velocity: np.ndarray, normal: np.ndarray, closing: float) -> np.ndarray:
    """Give the direction of a blow: that of the motion, within the cone of friction."""
    along = velocity + closing * normal
    slide = float(np.linalg.norm(along))
    if slide > _FRICTION * closing:
        along *= _FRICTION * closing / slide
    direction = along - closing * normal
    return direction / np.linalg.norm(direction)


def _depth(hits: Hits, way: np.ndarray) -> np.ndarray:
    """Give how far behind the first touch the others are [m], (K,)."""
    return (hits.fraction - hits.fraction[0]) * np.linalg.norm(way)


def _take(hits: Hits, rows: np.ndarray) -> Hits:
    return Hits(hits.index[rows], hits.fraction[rows], hits.point[rows], hits.normal[rows])
