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
Compare the engines of rigid bodies: what they cost, and how near they are to theory.

Each row is an experiment. The engines run it in turns of ten steps, so what else the machine does
hits all alike: compare figures within a row. Beside a figure stands the bound that theory or the
project sets; a figure out of bounds has a `!`. Times are processor time of all threads, or wall
time where they say so, and means over all steps, also those in which everything sleeps. Without
names all rows run but those that take minutes: heaps of 4,000 and all rubble.
Run: python bench/contact_engines.py [name or pattern ...] [--engines bullet native]
[--time-step 1/30 1/60 1/120 1/240] [--runs 12] [--threads 1] [--json FILE]
"""

import argparse
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from fractions import Fraction
from functools import partial
import json
from pathlib import Path
from time import perf_counter, process_time
from typing import NamedTuple

import numpy as np
from overlap import deepest_overlap, solid_corners
from scipy.integrate import quad

from procphys_ros.blueprint import box_inertia, Hexahedra, Shape
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import solids
from procphys_ros.physics.terrain import Terrain
from procphys_ros.physics.world import BodyState, installed_engines, rigid_sum, World
from procphys_ros.physics.world.rolling import ROLLING
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Demolition
from procphys_ros.simulation import Simulation

G = 9.81
BRICK, BRICK_MASS = np.array([0.215, 0.1025, 0.065]), 2.6
_TURN = 10  # steps of one engine before the next has its turn
_NUDGE = 1e-6  # of gravity over itself, and at random across: what tells chaotic runs apart
_ALLOWED = 5.0  # [mm] overlap at rest
_LONGEST = 40.0  # [s] of a run of rubble, which ends 10 s after its last joint has broken
HOUSES = sorted(path.stem for path in (shared_folder() / 'grammars').glob('*.wall'))


class Figure(NamedTuple):
    """What was measured, and the bounds that it should keep."""

    name: str
    value: float
    low: float = -np.inf
    high: float = np.inf

    @property
    def bound(self) -> str:
        """Describe the bounds."""
        if self.low == self.high:
            return f'{self.low:g}'
        if np.isfinite(self.low) and np.isfinite(self.high):
            return f'{self.low:g} to {self.high:g}'
        if np.isfinite(self.high):
            return f'<= {self.high:g}'
        return f'>= {self.low:g}' if np.isfinite(self.low) else ''


def close_to(name: str, value: float, wanted: float, share: float = 0.01) -> Figure:
    """Compare with theory: the value over it."""
    return Figure(name, value / wanted, 1.0 - share, 1.0 + share)


@dataclass
class Trial:
    """
    One run of a row with one engine.

    :ivar run: which of the nudged runs; 0 = as described.
    :ivar cpu: processor time of each step [s].
    :ivar wall: wall time of each step [s].
    """

    engine: str
    time_step: float = 1.0 / 60.0
    run: int = 0
    threads: int = 1
    cpu: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)
    close: list[Callable[[], None]] = field(default_factory=list)

    def nudge(self) -> np.ndarray:
        """Draw the perturbation of gravity, over its size, (3,)."""
        return _NUDGE * np.random.default_rng(self.run).normal(size=3) * min(self.run, 1)

    def world(self, gravity: tuple[float, float, float] = (0.0, 0.0, -G), **settings) -> World:
        """Make an empty world."""
        pull = np.array(gravity) + np.linalg.norm(gravity) * self.nudge()
        world = World(pull.tolist(), engine=self.engine, **settings)
        self.close.append(world.close)
        return world

    def simulation(self, house: str) -> Simulation:
        """Set up a building that is shipped."""
        scene = Scene.from_parameters({
            'scene': {'objects': [house]}, house: {'grammar': f'{house}.wall'}})
        scene.settings = replace(scene.settings, threads=self.threads,
                                 gravity=G * (1.0 + float(self.nudge()[2])))
        simulation = Simulation(scene, self.time_step, engine=self.engine)
        self.close.append(simulation.close)
        return simulation

    def steps(self, what: World | Simulation, seconds: float) -> Iterator[float]:
        """Step for some time; yield the time after each step [s]."""
        advance = (partial(what.step, self.time_step) if isinstance(what, World)
                   else what.step)
        for step in range(round(seconds / self.time_step)):
            start, wall = process_time(), perf_counter()
            advance()
            self.cpu.append(process_time() - start)
            self.wall.append(perf_counter() - wall)
            yield (step + 1) * self.time_step

    def cost(self, first: float, last: float) -> float:
        """Compute the median processor time of a step between two times [ms]."""
        own = slice(round(first / self.time_step), round(last / self.time_step))
        return 1e3 * float(np.median(self.cpu[own]))


Run = Generator[float, None, list[Figure]]  # rows yield after each step


def boxes(world: World, places: np.ndarray, sizes: np.ndarray = BRICK,
          mass: np.ndarray | float = BRICK_MASS, turns: np.ndarray | None = None,
          fixed: tuple[int, ...] = (), friction: float = 0.6) -> np.ndarray:
    """Add loose boxes, some of them fixed; return their ids."""
    places = np.asarray(places, float)
    count = len(places)
    turns = np.broadcast_to([0.0, 0.0, 0.0, 1.0] if turns is None else turns, (count, 4))
    ids = world.add_bricks(np.column_stack([places, turns]), np.broadcast_to(sizes, (count, 3)),
                           np.broadcast_to(mass, count), friction)
    world.thaw(np.delete(ids, list(fixed)))
    return ids


def ball(world: World, size: float, mass: float, place: list[float], speed: float = 0.0,
         **contact: float) -> int:
    """Add a ball that flies along x."""
    return world.add_projectile(Shape.CAPSULE, np.full(3, size), mass,
                                np.array([*place, 0.0, 0.0, 0.0, 1.0]),
                                np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), **contact)


def moved(world: World, ids: np.ndarray, before: np.ndarray) -> float:
    """Compute the largest displacement of the centre of any body [mm]."""
    return 1e3 * float(np.abs(world.poses(ids)[:, :3] - before[:, :3]).max())


def heap(count: int, trial: Trial) -> Run:
    """Drop bricks, turned at random, as a block of twenty layers."""
    rng, side = np.random.default_rng(0), int(np.ceil(np.sqrt(count / 20)))
    row = np.arange(count)
    grid = np.column_stack([row % side, row // side % side, row // side ** 2])
    turns = rng.normal(size=(count, 4))
    world = trial.world()
    places = grid * [0.28, 0.28, 0.22] + [0, 0, 0.3] + rng.uniform(-0.02, 0.02, (count, 3))
    ids = boxes(world, places, turns=turns / np.linalg.norm(turns, axis=1, keepdims=True))
    speed, last = 0.0, 0.0
    for time in trial.steps(world, 20.0):
        yield time
        last = time if len(world.awake) else last
        if time < 4.0 + 0.5 * trial.time_step:
            speed = float(np.sqrt((world.velocities(ids)[:, :3] ** 2).sum(axis=1).mean()))
        elif last < time:
            break
    return [Figure('ms per step, falling', trial.cost(0.0, 0.2)),
            Figure('ms per step, landing', trial.cost(0.2, 1.2)),
            Figure('ms per step, settled (3 to 4 s)', trial.cost(3.0, 4.0)),
            Figure('rms speed at 4 s [mm/s]', 1e3 * speed),
            Figure('time until all sleep [s]', last),
            Figure('awake at the end', len(world.awake), high=0),
            Figure('deepest overlap at the end [mm]', 1e3 * deepest_overlap(world), high=_ALLOWED),
            Figure('height (95 %) [m]', float(np.percentile(world.poses(ids)[:, 2], 95)))]


def slab(bricks: int, trial: Trial) -> Run:
    """Lay slabs on 49 posts of loose bricks."""
    found = []
    for tons in (3, 10, 40):
        world, top = trial.world(), BRICK[2] * bricks
        places = [(0.5 * i, 0.5 * j, BRICK[2] * (k + 0.5))
                  for i in range(7) for j in range(7) for k in range(bricks)]
        boxes(world, places)
        last = boxes(world, [(1.5, 1.5, top + 0.1)], [4.0, 4.0, 0.2], 1e3 * tons)
        yield from trial.steps(world, 5.0)
        found.append(Figure(f'{tons} t sinks [mm]', 1e3 * (top + 0.1 - world.poses(last)[0, 2]),
                            -1.0, 20.0))
    return found


def corbel(trial: Trial) -> Run:
    """Lay each brick over the one below by L / 2n, times a share, on one that is fixed."""
    found = []
    for count, share in ((4, 0.95), (8, 0.95), (4, 1.03), (8, 1.03)):
        steps = share * BRICK[0] / (2 * np.arange(1, count + 1))
        places = [(-steps[:n].sum(), 0.0, BRICK[2] * (count - n + 0.5)) for n in range(count + 1)]
        world = trial.world(friction=0.7)
        ids = boxes(world, places, fixed=(count,), friction=0.7)
        before = world.poses(ids)
        yield from trial.steps(world, 5.0)
        bound = {'high': 1.0} if share < 1.0 else {'low': 20.0}
        found.append(Figure(f'{count} at {share} of the limit moves [mm]',
                            moved(world, ids, before), **bound))
    return found


def column(trial: Trial) -> Run:
    """Pile up 30 bricks."""
    world = trial.world()
    ids = boxes(world, [(0.0, 0.0, BRICK[2] * (k + 0.5)) for k in range(30)])
    before = world.poses(ids)
    yield from trial.steps(world, 10.0)
    return [Figure('moves in 10 s [mm]', moved(world, ids, before), high=1.0)]


def arch(trial: Trial) -> Run:
    """Put 24 voussoirs together as a half ring of t/R = 0.13; from 0.107 on it stands (Heyman)."""
    count, radius, thick = 24, 2.0, 0.26
    angle = np.pi * np.arange(count + 1) / count
    ring = np.stack([np.sin(angle), np.zeros(count + 1), np.cos(angle)], axis=1)
    corners = np.empty((count, 8, 3))
    for c in range(8):
        side = ring[1:] if c & 1 else ring[:-1]
        corners[:, c] = (radius + (0.5 if c & 4 else -0.5) * thick) * side
        corners[:, c, 1] = 0.2 if c & 2 else -0.2
    # From up the ring turns to +x: local x along it, local z outwards.
    corners = corners[..., [2, 1, 0]] * [-1.0, 1.0, 1.0] + [0.0, 0.0, 1.0]
    made = solids(corners)
    world = trial.world(friction=0.7)
    boxes(world, [(-radius, 0.0, 0.5), (radius, 0.0, 0.5)], [0.6, 0.6, 1.0], 900.0, fixed=(0, 1),
          friction=0.7)
    mass = 2000.0 * made.volume
    ids = world.add_bricks(made.poses, made.size, mass, 0.7, inertia=2000.0 * made.inertia,
                           hexahedra=Hexahedra(np.arange(count, dtype=np.int32), made.corners))
    world.thaw(ids)
    yield from trial.steps(world, 10.0)
    return [Figure('moves in 10 s [mm]', moved(world, ids, made.poses), high=0.01 * 1e3 * thick)]


def cards(trial: Trial) -> Run:
    """Lean cards of 2 mm by 20 degrees against each other: two pairs, a floor, one pair."""
    length, thick, lean = 0.1, 0.002, np.radians(20.0)
    up = 0.5 * (length * np.cos(lean) + thick * np.sin(lean))
    out = 0.5 * (length * np.sin(lean) + thick * np.cos(lean))
    apart, floor = 2.0 * length * np.sin(lean) + 0.004, 2.0 * up
    pairs = [(-0.5 * apart, 0.0), (0.5 * apart, 0.0), (0.0, floor + thick)]
    places = [(x + side * out, 0.0, z + up) for x, z in pairs for side in (-1.0, 1.0)]
    turns = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]),
                                     np.tile([lean, -lean], len(pairs)))
    flat = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array([0.5 * np.pi]))
    world = trial.world()
    ids = boxes(world, [*places, (0.0, 0.0, floor + 0.5 * thick)], [thick, 0.06, length], 0.012,
                np.concatenate([turns, flat]))
    before = world.poses(ids)
    yield from trial.steps(world, 5.0)
    return [Figure('moves in 5 s [mm]', moved(world, ids, before), high=1.0)]


def dominoes(trial: Trial) -> Run:
    """Push the first of 40 stones about its lower edge, at once and when all have come to rest."""
    count, high, deep, pitch, spin = 40, 0.24, 0.05, 0.13, 4.0
    found = []
    for name, wait in (('at once', 0.0), ('after rest', 3.0)):
        world = trial.world()
        ids = boxes(world, [(pitch * n, 0.0, 0.5 * high) for n in range(count)],
                    [deep, 0.12, high])
        yield from trial.steps(world, wait)
        world.thaw(ids[:1], np.array([[0.5 * high * spin, 0, 0.5 * deep * spin, 0, spin, 0]]))
        fell = np.full(count, np.nan)
        for time in trial.steps(world, 5.0):
            yield time
            upright = 1.0 - 2.0 * np.square(world.poses(ids)[:, 3:5]).sum(axis=1)
            fell[np.isnan(fell) & (upright < 0.95)] = time
        found += [Figure(f'pushed {name}, fall', np.isfinite(fell).sum(), count, count),
                  Figure(f'pushed {name}, speed / sqrt(gh)', 20 * pitch / (fell[30] - fell[10])
                         / np.sqrt(G * high))]
    return found


def slope(trial: Trial) -> Run:
    """Lay a brick on a slope for 2 s, a hundredth less steep than friction holds, and steeper."""
    friction, found = 0.7, []
    for share in (0.99, 1.01):
        angle = np.arctan(share * friction)
        world = trial.world((G * np.sin(angle), 0.0, -G * np.cos(angle)), friction=friction)
        ids = boxes(world, [(0.0, 0.0, 0.5 * BRICK[2])], friction=friction)
        yield from trial.steps(world, 2.0)
        way = float(world.poses(ids)[0, 0])
        wanted = 2.0 * G * (np.sin(angle) - friction * np.cos(angle))
        found.append(Figure('1 % below friction moves [mm]', 1e3 * way, -0.1, 0.1) if share < 1.0
                     else close_to('1 % above friction, way / theory', way, wanted))
    return found


def slide(origin: float, trial: Trial) -> Run:
    """Slide a brick at 3 m/s, at a distance from the origin [m]."""
    world = trial.world(friction=0.7)
    ids = boxes(world, [(origin, origin, 0.5 * BRICK[2])], friction=0.7)
    world.set_velocities(ids, np.array([[3.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    yield from trial.steps(world, 1.5)
    return [close_to('way / (v²/2μg)', world.poses(ids)[0, 0] - origin, 9.0 / (2 * 0.7 * G))]


def shove(trial: Trial) -> Run:
    """Slide a brick at 0.77 m/s into one that rests: they go on together at half of that."""
    world = trial.world(friction=0.7)
    rests = boxes(world, [(0.0, 0.0, 0.5 * BRICK[2])], friction=0.7)
    yield from trial.steps(world, 3.0)
    start = float(world.poses(rests)[0, 0])
    boxes(world, [(-BRICK[0] - 1e-3, 0.0, 0.5 * BRICK[2])], friction=0.7)
    world.set_velocities(rests + 1, np.array([[0.779, 0.0, 0.0, 0.0, 0.0, 0.0]]))  # 1 mm before
    yield from trial.steps(world, 1.0)
    return [close_to('way of the one at rest / theory', world.poses(rests)[0, 0] - start,
                     0.385 ** 2 / (2 * 0.7 * G), 0.1)]


def bounce(trial: Trial) -> Run:
    """Drop a ball by 1 m; restitution 0.75."""
    world = trial.world()
    one, top, rises = ball(world, 0.2, 1.0, [0.0, 0.0, 1.1], restitution=0.75 ** 2), 0.0, False
    for time in trial.steps(world, 1.2):
        yield time
        rises |= world.velocities([one])[0, 2] > 0.0
        top = max(top, rises * (world.poses([one])[0, 2] - 0.1))
    return [close_to('height / theory', top, 0.75 ** 2)]


def rocking(trial: Trial) -> Run:
    """Release a tilted block: time to first impact, and amplitude after it (Housner 1963)."""
    half, tilt, turned = np.array([0.1, 0.5]), 0.1, []
    radius, edge = np.hypot(*half), np.arctan2(*half)
    world = trial.world(friction=0.9)
    ids = boxes(world, [(half[0] - radius * np.sin(edge - tilt), 0, radius * np.cos(edge - tilt))],
                [0.2, 0.4, 1.0], 50.0, np.array([[0, np.sin(0.5 * tilt), 0, np.cos(0.5 * tilt)]]),
                friction=0.9)
    for time in trial.steps(world, 1.2):
        yield time
        turned.append(2.0 * np.arctan2(*world.poses(ids)[0, [4, 6]]))
    squared, kept = 0.75 * G / radius, (1.0 - 1.5 * np.sin(edge) ** 2) ** 2
    start = np.cos(edge - tilt)
    quarter = quad(lambda s: 2.0 * s / np.sqrt(2.0 * squared * (
        start - np.cos(edge - tilt + s * s))), 0.0, np.sqrt(tilt))[0]
    amplitude = edge - np.arccos(np.cos(edge) + kept * (start - np.cos(edge)))
    after = max(int(np.argmax(np.array(turned) < 0.0)), 1)
    before = turned[after - 1]
    # Up to the impact it turns at the speed that it had in the step before.
    speed = (turned[max(after - 2, 0)] - before) / trial.time_step
    impact = trial.time_step * after + before / speed if min(turned) < 0.0 else np.nan
    return [close_to('time to the first impact / theory', impact, quarter),
            close_to('amplitude after it / theory', -min(turned), amplitude)]


def roll(trial: Trial) -> Run:
    """Roll a ball down a height field that rises by 1 in 5."""
    cells, edge, radius, angle = 40, 0.25, 0.25, np.arctan(0.2)
    heights = np.repeat(0.2 * edge * np.arange(cells, 0.0, -1.0)[:, None], cells, axis=1)
    world = trial.world(terrain=Terrain(heights, np.array([0.0, -0.5 * edge * cells]), edge))
    start = np.array([1.0, 0.1, heights[4, 0] + radius / np.cos(angle)])
    one = ball(world, 2.0 * radius, 50.0, start.tolist(), restitution=0.0)
    yield from trial.steps(world, 2.0)
    way = world.poses([one])[0, :3] - start
    normal = np.array([np.sin(angle), 0.0, np.cos(angle)])
    # The torque of rolling resistance is that of the contact force at a lever.
    pull, lever = G * np.sin(angle), ROLLING / radius
    for _ in range(20):
        held = np.hypot(G * np.cos(angle), G * np.sin(angle) - pull)
        pull = 5.0 / 7.0 * (G * np.sin(angle) - lever * held)
    return [close_to('way / theory', np.linalg.norm(way), 2.0 * pull),
            Figure('aside [mm]', 1e3 * way[1], -5.0, 5.0),
            Figure('above the surface [mm]', 1e3 * (way * normal).sum(), -1.0, 1.0)]


def spin(trial: Trial) -> Run:
    """Spin a T-handle about its middle axis without gravity (Dzhanibekov), for 20 s."""
    sizes = np.array([[0.05, 0.05, 0.3], [0.2, 0.05, 0.05]])
    poses = np.array([[0.0, 0.0, 5.0, 0, 0, 0, 1.0], [0.125, 0.0, 5.0, 0, 0, 0, 1.0]])
    mass = np.array([5.0, 3.3])
    total = rigid_sum(mass, box_inertia(mass, sizes), poses)
    world = trial.world((0.0, 0.0, 0.0))
    turn = np.full(3, 0.01)
    turn[np.argsort(total.inertia)[1]] = 10.0
    one = [world.add_fragment(np.full(2, Shape.BOX), sizes, total.local_poses, total.mass,
                              total.inertia, total.pose, np.concatenate([
                                  np.zeros(3), rotation.rotate(total.pose[3:], turn)]))]

    def books() -> tuple[float, np.ndarray]:
        attitude, inertia = world.poses(one)[0, 3:], world.bodies.inertia[one[0]]
        own = rotation.rotate(rotation.conjugate(attitude), world.velocities(one)[0, 3:])
        return 0.5 * (inertia * own ** 2).sum(), rotation.rotate(attitude, inertia * own)
    energy, momentum = books()
    yield from trial.steps(world, 20.0)
    left, swept = books()
    return [close_to('energy kept', left, energy),
            Figure('angular momentum lost', np.linalg.norm(swept - momentum)
                   / np.linalg.norm(momentum), high=0.01)]


def strike(trial: Trial) -> Run:
    """Shoot 20 kg at 20 m/s into 100 bricks that rest: bricks and ground get its momentum."""
    rng, world = np.random.default_rng(1), trial.world()
    ids = boxes(world, [(0.25 * (n % 5), 0.15 * (n // 5 % 5), 0.1 + 0.12 * (n // 25)) for n in
                        range(100)] + rng.uniform(0.0, 0.02, (100, 3)))
    yield from trial.steps(world, 5.0)
    one, ground = ball(world, 0.25, 20.0, [-0.6, 0.3, 0.15], 20.0), 0.0
    everything = np.append(ids, one)
    for time in trial.steps(world, 0.5):
        ground += sum(table.on(world.ground)[2][:, 0].sum() for table in
                      (world.contacts(),))
        yield time
    has = world.bodies.mass[everything] * world.velocities(everything)[:, 0]
    return [close_to('momentum kept', has.sum() + ground, 400.0),
            Figure('of it with the ground', ground / 400.0)]


def plank(trial: Trial) -> Run:
    """Lower a weight on a resting plank, 11 times what tips it about its support."""
    world = trial.world()
    boxes(world, [(0.0, 0.0, 0.15)], [0.6, 0.3, 0.3], 100.0, fixed=(0,))
    ids = boxes(world, [(0.0, 0.0, 0.325)], [2.0, 0.2, 0.05], 10.0)
    yield from trial.steps(world, 3.0)
    boxes(world, [(0.9, 0.0, 0.35 + 0.05 + 1e-4)], [0.1, 0.1, 0.1], 11.0 * 10.0 * 0.3 / 0.6)
    most = 0.0
    for time in trial.steps(world, 2.0):
        yield time
        most = max(most, 2.0 * abs(np.arcsin(world.poses(ids)[0, 4])))
    return [Figure('tilts [degrees]', np.degrees(most), low=10.0)]


def rubble(house: str, whole: bool, trial: Trial) -> Run:
    """Demolish a building at its foot, or with a charge in all of it; wait 10 s after the end."""
    simulation = trial.simulation(house)
    points = simulation.blueprint.poses[:, :3]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reach = 1.01 * float(np.linalg.norm(points - middle, axis=1).max())
    simulation.demolish(Demolition([0.0], middle.tolist(), [reach]) if whole else None)
    last, broken = 0.0, 0
    for time in trial.steps(simulation, _LONGEST):
        yield time
        last, broken = time if simulation.bonds_broken > broken else last, simulation.bonds_broken
        if time > last + 10.0:
            break
    world = simulation.state.world
    speed = np.linalg.norm(world.velocities(world.awake)[:, :3], axis=1)
    loose = np.flatnonzero(np.isin(world.bodies.state, (BodyState.RESTING, BodyState.AWAKE)))
    low = solid_corners(world, loose)[0][..., 2].min(axis=1)
    return [Figure('pieces', len(loose)), Figure('last joint breaks at [s]', last),
            Figure('awake', len(speed), high=0),
            Figure('of these faster than 0.5 m/s', (speed > 0.5).sum()),
            Figure('deepest overlap of what rests [mm]', 1e3 * deepest_overlap(world, False),
                   high=_ALLOWED),
            Figure('deepest overlap of all [mm]', 1e3 * deepest_overlap(world)),
            Figure('boxes and hexahedra below the ground', (low < -1e-3 * _ALLOWED).sum(), high=0),
            Figure('processor time [s]', sum(trial.cpu))]


SMALL: dict[str, Callable[[Trial], Run]] = {
    'corbel': corbel, 'column': column, 'arch': arch, 'cards': cards, 'dominoes': dominoes,
    'slope': slope, 'slide': partial(slide, 0.0), 'slide_90_km': partial(slide, 9e4),
    'shove': shove, 'bounce': bounce, 'rocking': rocking, 'roll': roll, 'spin': spin,
    'strike': strike, 'plank': plank, **{f'slab_on_{n}': partial(slab, n) for n in (2, 4, 8)}}
CHAOTIC: dict[str, Callable[[Trial], Run]] = {
    **{f'heap_{n}': partial(heap, n) for n in (1000, 4000)},
    **{f'rubble_{house}_{how}': partial(rubble, house, how == 'blasted')
       for house in HOUSES for how in ('demolished', 'blasted')}}
ROWS = {**SMALL, **CHAOTIC}


def compare(row: Callable[[Trial], Run], trials: list[Trial]) -> list[list[Figure]]:
    """Run a row in turns; return the figures of each trial."""
    found: list[list[Figure]] = [[] for _ in trials]
    going = {n: row(trial) for n, trial in enumerate(trials)}
    while going:
        for n, run in list(going.items()):
            try:
                for _ in range(_TURN):
                    next(run)
            except StopIteration as end:
                trial = trials[n]
                found[n] = [*end.value, Figure('all: ms per step', 1e3 * np.mean(trial.cpu)),
                            Figure('all: ms per step, wall', 1e3 * np.mean(trial.wall))]
                for close in trial.close:
                    close()
                del going[n]
    return found


def text(figures: list[Figure]) -> str:
    """Write the values of some runs, with a mark where one is out of bounds."""
    values = np.array([figure.value for figure in figures], float)
    shown = f'{np.median(values):.4g}'
    if len(values) > 1:
        shown += f' ({values.min():.4g} to {values.max():.4g})'
    return shown + ' !' * (not all(f.low <= f.value <= f.high for f in figures))


def report(name: str, options: argparse.Namespace) -> list[dict]:
    """Run a row, print its table, and give its figures."""
    print(f'\n| {name} | 1/step [Hz] | bound | {" | ".join(options.engines)} |\n'
          f'|{"---|" * (3 + len(options.engines))}', flush=True)
    tables = []
    for step in options.time_step:
        runs = [compare(ROWS[name], [Trial(engine, step, run, options.threads)
                                     for engine in options.engines])
                for run in range(options.runs if name in CHAOTIC else 1)]
        for n, first in enumerate(runs[0][0]):
            cells = [[run[e][n] for run in runs] for e in range(len(options.engines))]
            print(f'| {first.name} | {1.0 / step:.4g} | {first.bound} | '
                  f'{" | ".join(map(text, cells))} |', flush=True)
            tables.append({'row': name, 'figure': first.name, 'time_step': step,
                           'bound': first.bound, 'values': {
                               engine: [float(figure.value) for figure in cell]
                               for engine, cell in zip(options.engines, cells)}})
    return tables


def chosen(patterns: list[str]) -> list[str]:
    """List the rows that patterns name; without any, those that take no minutes."""
    if not patterns:
        return [*SMALL, 'heap_1000']
    return [name for name in ROWS if any(fnmatch(name, pattern) for pattern in patterns)]


def seconds(word: str) -> float:
    """Read a time step, such as 1/120."""
    try:
        value = float(Fraction(word))
    except ZeroDivisionError:
        value = 0.0
    if not 1e-4 <= value <= 0.1:
        raise argparse.ArgumentTypeError(f'{word} s is not from 1/10000 to 1/10 s')
    return value


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('rows', nargs='*', help=f'names or patterns of rows: {", ".join(ROWS)}')
    parser.add_argument('--engines', nargs='+', choices=installed_engines(),
                        default=installed_engines())
    parser.add_argument('--time-step', nargs='+', type=seconds, default=[1.0 / 60.0],
                        help='[s], such as 1/120')
    parser.add_argument('--runs', type=int, default=1, help='nudged runs of heaps and rubble')
    parser.add_argument('--threads', type=int, default=1)
    parser.add_argument('--json', type=Path, help='write all figures there')
    options = parser.parse_args()
    names = chosen(options.rows)
    if not names:
        parser.error(f'no row is named {" ".join(options.rows)}; rows: {", ".join(ROWS)}')
    for engine in options.engines:  # load what is compiled
        warm = [partial(heap, 40), *[ROWS[f'rubble_garden_wall_{how}'] for how in (
            'demolished', 'blasted') if any(name.startswith('rubble') for name in names)]]
        for row in warm:
            compare(row, [Trial(engine)])
    tables = []
    for name in names:
        tables += report(name, options)
        if options.json:
            options.json.write_text(json.dumps(tables, indent=1) + '\n')


if __name__ == '__main__':
    main()
