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
Run a mixed scene for simulated minutes under random commands, good and bad, and look for rot.

Checks after every simulated second: every part that exists is finite, nothing lies below the
ground, bad commands are refused, nothing raises; at the end: memory did not grow from reset to
reset. Exit code 1 and the command history since the last reset when something is wrong.
Run: python bench/soak.py [--minutes 30] [--seed 1]
"""

import argparse
from collections import Counter, deque
import ctypes
import gc
from pathlib import Path
import resource
import sys
from time import perf_counter
import traceback

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.errors import ProcPhysError
from procphys_ros.geometry.rotation import rotate
from procphys_ros.physics.wind import Gust
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Demolition, Projectile
from procphys_ros.simulation import Simulation

_LANDING = 0.1    # [m] that a moving body may sink into the ground in a hard landing
_RESTING = 0.02   # [m] that a body at rest may
_SUNK = -0.03     # [m] centre of mass of a thin twig that carries nothing, pressed into the earth
_BENT = -0.3      # [m] centre of mass of a branch that bends down to the ground on its tree
_SLOW = 5.0       # [s] of wall time for one of simulated time that is worth a line
_GROWTH = 0.3     # [MB per reset] of memory that counts as a leak
_WARM_UP = 0.4    # share of the resets after which caches are full
_SCENE = {
    'scene': {'objects': ['cottage', 'wall', 'oak', 'pine', 'shrub']},
    'seed': 3,
    'wind': {'velocity': [6.0, 2.0, 0.0]},
    'cottage': {'grammar': 'cottage.wall', 'defines': ['storeys=1', 'width=5.0525',
                                                       'depth=4.1525']},
    'wall': {'grammar': 'garden_wall.wall', 'origin': [-6.0, -5.0, 0.0]},
    'oak': {'grammar': 'oak.lsys', 'count': 2, 'layout': 'row', 'spacing': 9.0,
            'origin': [0.0, 12.0, 0.0]},
    'pine': {'grammar': 'pine.lsys', 'origin': [11.0, 2.0, 0.0]},
    'shrub': {'grammar': 'shrub.lsys', 'count': 3, 'layout': 'row', 'spacing': 2.5,
              'origin': [-6.0, -3.0, 0.0]},
}


class Operator:
    """
    Someone who presses every button.

    :param simulation: what is commanded.
    :param rng: chooses.

    :ivar paused: whether the operator lets no time pass.
    """

    def __init__(self, simulation: Simulation, rng: np.random.Generator):
        self._simulation = simulation
        self._rng = rng
        self.paused = False
        self.resets = 0
        self._acts = (self.wind, self.calm, self.gust, self.impulse, self.wrench, self.clear,
                      self.blast, self.shoot, self.demolish, self.pause, self.bad, self.impulse,
                      self.shoot, self.gust, self.leaves)

    def act(self) -> str:
        """Do something, and say what."""
        chosen = self._acts[self._rng.integers(len(self._acts))]
        return f'{chosen.__name__} {chosen()}'

    def wind(self):
        """Change the wind, now and then to a hurricane."""
        speed = self._rng.choice([5.0, 15.0, 30.0, 60.0])
        velocity = self._rng.normal(size=3) * [speed, speed, 0.1 * speed]
        self._simulation.set_wind(velocity)
        self._simulation.set_wind_enabled(True)
        return velocity.tolist()

    def calm(self):
        """Switch the wind off or on."""
        enabled = bool(self._rng.integers(2))
        self._simulation.set_wind_enabled(enabled)
        return enabled

    def gust(self):
        """Send a gust."""
        gust = Gust(amplitude=self._rng.uniform(-20, 50), duration=self._rng.uniform(0.5, 6.0),
                    direction=[*self._rng.normal(size=2), 0.0])
        self._simulation.gust(gust)
        return gust

    def impulse(self):
        """Strike any part, standing, fallen or gone."""
        part = int(self._rng.integers(len(self._simulation.blueprint)))
        push = (self._rng.normal(size=3) * 10.0 ** self._rng.uniform(0, 3.5)).tolist()
        twist = self._rng.normal(size=3).tolist()
        self._simulation.apply_impulse(part, push, twist)
        return part, push, twist

    def wrench(self):
        """Push any part until told otherwise."""
        part = int(self._rng.integers(len(self._simulation.blueprint)))
        force = (self._rng.normal(size=3) * 10.0 ** self._rng.uniform(0, 3)).tolist()
        self._simulation.apply_wrench(part, force)
        return part, force

    def clear(self):
        """End all lasting forces."""
        return self._simulation.clear_wrenches()

    def blast(self):
        """Set off a charge."""
        place = [*self._rng.uniform(-10, 12, 2), self._rng.uniform(0, 3)]
        charge = 10.0 ** self._rng.uniform(-1, 1.3)
        self._simulation.explode(place, charge)
        return place, charge

    def shoot(self):
        """Throw a ball or a block at a random point."""
        ball = bool(self._rng.integers(2))
        size = self._rng.uniform(0.05, 0.8) if ball else self._rng.uniform(0.1, 1.0, 3).tolist()
        place = np.array([*self._rng.uniform(-18, 18, 2), self._rng.uniform(1.0, 6.0)])
        aim = np.array([*self._rng.uniform(-8, 10, 2), self._rng.uniform(0.3, 4.0)])
        way = aim - place
        velocity = way / np.linalg.norm(way) * self._rng.uniform(3, 120)
        missile = Projectile('sphere' if ball else 'box', size,
                             10.0 ** self._rng.uniform(-0.7, 3.3), place.tolist(),
                             velocity.tolist())
        self._simulation.launch(missile)
        return missile

    def demolish(self):
        """Blow charges in the walls, rarely: little stands after it."""
        if self._rng.uniform() > 0.3:
            return 'not now'
        return self._simulation.demolish(Demolition())

    def pause(self):
        """Pause or resume."""
        self.paused = not self.paused
        return self.paused

    def leaves(self):
        """Ask for the leaves, as a picture or a message does."""
        poses = self._simulation.leaf_poses()
        if not np.isfinite(poses).all():
            gone = ~np.isfinite(self._simulation.poses[:, 0])
            bad = ~np.isfinite(poses).all(axis=1)
            owner = self._simulation.blueprint.leaves.part[bad]
            if not gone[owner].all():
                raise FloatingPointError('a leaf of a part that exists is not finite')
        return len(poses)

    def bad(self):
        """Send a command that must be refused."""
        sayings = (
            lambda s: s.apply_impulse('nobody/3', (1, 0, 0)),
            lambda s: s.apply_impulse(10 ** 7, (1, 0, 0)),
            lambda s: s.apply_impulse(0, (np.nan, 0, 0)),
            lambda s: s.apply_wrench(0, (np.inf, 0, 0)),
            lambda s: s.set_wind((np.nan, 0, 0)),
            lambda s: s.set_wind((1e6, 0, 0)),
            lambda s: s.explode((0, 0, -1), 5.0),
            lambda s: s.explode((0, 0, 1), -5.0),
            lambda s: s.launch(Projectile(mass=-1.0)),
            lambda s: s.launch(Projectile(velocity=(1e4, 0, 0))),
            lambda s: s.gust(Gust(duration=-1.0)),
        )
        number = int(self._rng.integers(len(sayings)))
        try:
            sayings[number](self._simulation)
        except ProcPhysError:
            return f'{number} refused'
        raise AssertionError(f'bad command {number} was taken')


def faults(simulation: Simulation) -> tuple[list[str], list[float]]:
    """
    Check the state of a simulation.

    :returns: its faults; depth in the ground of the deepest part at rest and of the deepest that
        moves [m].
    """
    poses, found = simulation.poses, []
    there = np.isfinite(poses[:, 0])
    if not np.isfinite(poses[there]).all() or not np.isfinite(simulation.velocities[there]).all():
        found.append('a part that exists is not finite')
    carried = simulation.state.carrier >= 0
    low = there & (poses[:, 2] < np.where(carried, _SUNK, _BENT))
    for part in np.flatnonzero(low)[:3].tolist():
        found.append(f'{simulation.names.name(part)} is at {poses[part, 2]:.3f} m')
    loose = np.flatnonzero(there & carried)
    depth = -_lowest(simulation, loose)
    rests = (simulation.velocities[loose] == 0.0).all(axis=1)
    for i in np.flatnonzero(depth > np.where(rests, _RESTING, _LANDING))[:3].tolist():
        found.append(f'{simulation.names.name(int(loose[i]))} lies {depth[i]:.3f} m in the ground '
                     f'with velocity {np.round(simulation.velocities[loose[i]], 2).tolist()}')
    puffs = simulation.dust.positions
    if not np.isfinite(puffs).all():
        found.append('dust is not finite')
    return found, [depth[rests].max(initial=0.0), depth[~rests].max(initial=0.0)]


def _lowest(simulation: Simulation, parts: np.ndarray) -> np.ndarray:
    """Compute the height of the lowest point of parts [m]."""
    source, poses = simulation.blueprint, simulation.poses[parts]
    up = np.stack([rotate(poses[:, 3:], axis)[:, 2] for axis in np.eye(3)], axis=1)
    size = source.size[parts]
    box = 0.5 * (np.abs(up) * size).sum(axis=1)
    rod = 0.5 * np.abs(up[:, 2]) * np.maximum(size[:, 2] - size[:, 0], 0.0) + 0.5 * size[:, 0]
    ball = 0.5 * size[:, 0]
    shape = source.shape[parts]
    reach = np.where(shape == Shape.BOX, box, np.where(shape == Shape.CAPSULE, rod, ball))
    cut = source.hexahedra.among(parts)
    reach[cut.part] = poses[cut.part, 2] - cut.points(poses)[..., 2].min(axis=1)
    return poses[:, 2] - reach


def memory() -> float:
    """
    Measure the memory of the process [MB].

    Free memory is returned to the system first; otherwise the allocator would keep the peak of the
    largest collapse so far, in jumps of 40 MB.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def _growth(held: list[float]) -> float:
    """Fit the slope of memory over the resets after the warm-up [MB per reset]."""
    warm = held[int(_WARM_UP * len(held)):]
    return float(np.polyfit(np.arange(len(warm)), warm, 1)[0]) if len(warm) > 3 else 0.0


def soak(minutes: float, seed: int) -> int:
    """Run, print a summary, and give the exit code."""
    rng = np.random.default_rng(seed)
    simulation = Simulation(Scene.from_parameters(_SCENE))
    operator, count, refused = Operator(simulation, rng), Counter(), Counter()
    history: deque[str] = deque(maxlen=400)
    held, problems, broken, deepest = [], [], 0, np.zeros(2)
    start, simulated, slowest, next_reset = perf_counter(), 0.0, (0.0, ''), 45.0
    while simulated < 60.0 * minutes and len(problems) < 5:
        simulated += 1.0
        try:
            for _ in range(int(rng.integers(0, 3))):
                state = rng.bit_generator.state['state']['state']
                try:
                    history.append(f'{simulation.time:8.3f} {operator.act()}')
                except ProcPhysError as error:
                    history.append(f'{simulation.time:8.3f} refused: {error}')
                    refused[type(error).__name__] += 1
                count[history[-1][9:].split()[0]] += 1
            begun = perf_counter()
            if not operator.paused or simulated % 5 == 0:
                simulation.step(60)
            took = perf_counter() - begun
            slowest = max(slowest, (took, ' / '.join(list(history)[-6:])))
            if took > _SLOW:
                print(f'{simulated:6.0f} s: took {took:.1f} s, {simulation.awake_bodies} bodies '
                      'move; ' + ', '.join(f'{name} {share:.1f}' for name, share
                                           in simulation.timings.items() if share > 0.5))
            wrong, depths = faults(simulation)
            deepest = np.maximum(deepest, depths)
        except Exception:  # noqa: B902 - whatever it is, it is what the soak looks for
            wrong = [traceback.format_exc(), f'generator {state}']
        if wrong:
            problems.append(f'seed {seed}, second {simulated:.0f}, time {simulation.time:.3f}: '
                            + '; '.join(wrong))
            print(problems[-1], *history, sep='\n  ', flush=True)
            next_reset = simulated
        if simulated >= next_reset:
            broken += simulation.bonds_broken
            simulation.reset()
            operator.paused = False
            held.append(memory())
            history.clear()
            next_reset = simulated + float(rng.uniform(20.0, 70.0))
            print(f'{simulated:6.0f} s: {held[-1]:.0f} MB, {broken} bonds broken so far, '
                  f'{perf_counter() - start:.0f} s of work, deepest {deepest[0]:.3f} m at rest, '
                  f'{deepest[1]:.3f} m in motion', flush=True)
    growth = _growth(held)
    print(f'{simulated / 60.0:.1f} simulated minutes in {perf_counter() - start:.0f} s '
          f'(slowest second {slowest[0]:.2f} s), {len(held)} resets, {broken} bonds broken')
    print(f'before the slowest second: {slowest[1]}')
    print(f'deepest in the ground: {deepest[0]:.3f} m at rest, {deepest[1]:.3f} m in motion')
    print(f'commands {dict(count)}; refused {dict(refused)}')
    print(f'memory {held[0] if held else 0:.0f} MB after the first reset, '
          f'{held[-1] if held else 0:.0f} MB after the last, {growth:+.3f} MB per reset')
    if growth > _GROWTH:
        problems.append(f'memory grows by {growth:.2f} MB per reset')
    print(f'{len(problems)} problems', *(p.splitlines()[0] for p in problems), sep='\n  ')
    simulation.close()
    return 1 if problems else 0


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=30.0)
    parser.add_argument('--seed', type=int, default=1)
    chosen = parser.parse_args()
    sys.exit(soak(chosen.minutes, chosen.seed))
