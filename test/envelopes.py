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

"""Envelopes: six runs of a scene that differ by a nudge, laws for all of them, and quantiles."""

# What falls and breaks is chaotic. Another processor rounds differently, and runs that differ in
# the last bit of one number differ by decimetres a second later. So no test may hold a collapse to
# one outcome. It holds every run to laws, and a share of the runs to bounds that follow from the
# spread of many more runs.

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace
from typing import Any

from energy_ledger import EnergyLedger
from lowest_points import lowest
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from procphys_ros.blueprint import GROUND, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.wind import Gust
from procphys_ros.physics.world import BodyState
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Demolition, Explosion, Projectile
from procphys_ros.simulation import Simulation

RUNS = 6  # of which all keep a bound: as sharp as eleven of twelve, where a tenth or more break it
MOST = 0.9  # share of the runs: all six
FREE = 0.213  # [m] free fall in 12 steps of 1/60 s
_NUDGE = 1e-3  # [m], [m/s] of what is thrown and of charges; over itself, of gusts
_GRAVITY = 1e-6  # over itself: far less than between two places on earth
_EDDIES = 2  # fields of them: drawing another takes as long as many a run
_DOWN = 0.2  # [m] from where a part was built
_SUNK = -0.025  # [m] lowest centre of a part (PyBullet lets tonnes in by 21 mm); ...
_TWIG = -0.35  # [m] ... of wood, whose tips come down at up to 20 m/s: so far in a step
_DEEPEST = -0.03  # [m] lowest corner of a body that rests
_STEP = 1.0 / 60.0  # [s]
_GIVEN_BACK = 0.1  # of the energy that commands bring and a collapse sets free: by overlaps
_ROUNDING = 1e-3  # [J/kg] and a speed of 4.5 cm/s
_SLACK = 1.1  # of the bound of the energy ledger, as in `random_scenes`
_TOGETHER = 90  # bodies that are woken at a time

Figures = Mapping[str, Callable[[Simulation], float]]


def nudge(scene: Scene, rng: np.random.Generator) -> Simulation:
    """Set up a scene that differs from a given one by an immeasurably small amount."""
    settings = scene.settings
    cues = tuple(replace(cue, time=cue.time + rng.uniform(0.0, settings.time_step),
                         what=nudged(cue.what, rng)) for cue in settings.cues)
    other = copy(scene)
    other.settings = replace(settings, cues=cues,
                             gravity=settings.gravity * (1.0 + _GRAVITY * rng.normal()))
    return Simulation(other, seed=int(rng.integers(_EDDIES)))


def nudged(what: Any, rng: np.random.Generator) -> Any:
    """Change a command by a millimetre, a millimetre per second or a thousandth."""
    if isinstance(what, Projectile):
        place, velocity = (np.asarray(value, float) + _NUDGE * rng.uniform(-1.0, 1.0, 3)
                           for value in (what.position, what.velocity))
        return replace(what, position=place.tolist(), velocity=velocity.tolist())
    if isinstance(what, Explosion):
        place = np.asarray(what.position) + [*(_NUDGE * rng.uniform(-1.0, 1.0, 2)), 0.0]
        return replace(what, position=place.tolist())
    if isinstance(what, Demolition):
        radii = np.asarray(what.radii, float) * (1.0 + _NUDGE * rng.uniform(-1, 1, len(what)))
        return replace(what, radii=radii.tolist())
    if isinstance(what, Gust):
        return replace(what, amplitude=what.amplitude * (1.0 + _NUDGE * rng.uniform(-1.0, 1.0)))
    return what


class Watch:
    """
    Steps a simulation and holds it to laws; they end it with an `AssertionError`.

    Poses and velocities are numbers, or nothing for what is gone; nothing goes below the ground.
    Energy falls but for what commands and wind bring: with trees and wind as `EnergyLedger` has
    it, and else of all parts together. What projectiles lose, walls and ground get.

    :param simulation: at its start.
    :param sunk: lowest centre of a part that is not of wood [m].
    """

    def __init__(self, simulation: Simulation, sunk: float = _SUNK):
        self.simulation, self._sunk = simulation, sunk
        self.rest = 0.0  # [s] from when on nothing moves that is loose
        wind = simulation.scene.settings.wind.velocity
        bends = len(simulation.state.forest) or any(wind) or any(
            isinstance(cue.what, Gust) for cue in simulation.scene.settings.cues)
        self._ledger = EnergyLedger(simulation, np.zeros(0)) if bends else None
        self._brought, self._energies, self._thrown = 0.0, [energy(simulation)], 0
        self._mass = simulation.blueprint.mass.sum()

    def run(self, seconds: float) -> Simulation:
        """Step for some time, and check every step."""
        for _ in range(round(seconds / self.simulation.time_step)):
            self.step()
        return self.simulation

    def step(self) -> None:
        """Make one step, and look at what it did."""
        simulation = self.simulation
        simulation.step()
        if simulation.awake_bodies:
            self.rest = simulation.time
        poses = simulation.poses
        here = np.isfinite(poses).all(axis=1)
        assert np.isfinite(simulation.velocities).all(), self._at('a velocity is not finite')
        assert (here | np.isnan(poses).all(axis=1)).all(), self._at('a pose is not finite')
        assert (here == simulation.exists).all(), self._at('what is gone has a pose')
        wood = simulation.blueprint.shape == Shape.CAPSULE
        over = (poses[:, 2] - np.where(wood, _TWIG, self._sunk))[here].min(initial=np.inf)
        assert over > 0.0, self._at(f'a part is {-over:.3f} m deeper in the ground than allowed')
        self._note_missiles()
        if self._ledger is None:
            self._note_energy()
        else:
            self._note_ledger(self._ledger)

    def check_rest(self) -> None:
        """Look at what has been left: the books, what stands, and what lies about."""
        simulation, books = self.simulation, self.simulation.ledger
        np.testing.assert_allclose(books.carried + books.grounded, books.lost, rtol=1e-9,
                                   atol=1e-9 * self._mass)
        assert not len(hanging(simulation)), self._at('a part stands on nothing')
        bodies = simulation.state.world.bodies
        for body in np.flatnonzero(bodies.state == BodyState.RESTING).tolist():
            low = lowest(simulation.state.world.pieces(body), bodies.poses[body])
            assert low > _DEEPEST, self._at(f'body {body} rests {-low:.3f} m in the ground')
        sunk = sinking(simulation).max(initial=0.0)
        assert sunk < 0.5 * FREE, self._at(f'a piece floats: it comes down by {sunk:.3f} m')

    def _note_missiles(self) -> None:
        """Book what was launched in this step."""
        missiles = self.simulation.state.missiles
        for missile in missiles[self._thrown:]:
            speed = float(np.linalg.norm(self.simulation.velocities[missile.part, :3]))
            height = float(self.simulation.poses[missile.part, 2])
            gravity = self.simulation.scene.settings.gravity
            self._brought += missile.mass * (0.5 * speed ** 2 + gravity * height)
            if self._ledger is not None:
                self._ledger.launched(missile.part, missile.mass, speed)
        self._thrown = len(missiles)

    def _note_energy(self) -> None:
        energies = self._energies
        brought = self._brought + self.simulation.ledger.released
        energies.append(energy(self.simulation) - brought)
        most = _GIVEN_BACK * (brought + max(energies) - min(energies)) + _ROUNDING * self._mass
        back = energies[-1] - min(energies)
        assert back < most, self._at(f'energy rises by {back:.1f} J, at most {most:.1f} J may be '
                                     'given back')

    def _note_ledger(self, ledger: EnergyLedger) -> None:
        ledger.note()
        moving = float(ledger.kinetic().sum())
        most = _SLACK * float(ledger.bound().sum()) + _ROUNDING * self._mass
        most += self.simulation.ledger.released
        assert moving < most, self._at(f'kinetic energy {moving:.1f} J, bound {most:.1f} J')

    def _at(self, what: str) -> str:
        return f'at {self.simulation.time:.2f} s: {what}'


class Envelope:
    """
    Figures of runs of a scene, each of which keeps the laws of `Watch`.

    :param start: sets a run up, from a random generator.
    :param seconds: of each run [s].
    :param figures: more to measure at the end of each run, by name.
    :param runs: how many.
    :param seed: of all nudges.
    :param sunk: see `Watch`.
    :ivar values: of each run by the names of the figures, and of these: `down` parts that lie
        further than 0.2 m from where they were built or are gone, `broken` bonds, `rest` [s] from
        when on nothing moves, `awake` bodies at the end, parts of the `largest` piece.
    """

    def __init__(self, start: Callable[[np.random.Generator], Simulation], seconds: float,
                 figures: Figures | None = None, runs: int = RUNS, seed: int = 0,
                 sunk: float = _SUNK):
        self.values: dict[str, list[float]] = {}
        for run in range(runs):
            watch = Watch(start(np.random.default_rng([seed, run])), sunk)
            simulation = watch.run(seconds)
            watch.check_rest()
            found = {'rest': watch.rest, **{name: figure(simulation) for name, figure in {
                **_FIGURES, **(figures or {})}.items()}}
            for name, value in found.items():
                self.values.setdefault(name, []).append(float(value))
            simulation.close()

    def bound(self, name: str, low: float = -np.inf, high: float = np.inf, share: float = MOST
              ) -> None:
        """
        Hold a share of the runs to bounds.

        :param name: of the figure.
        :param low, high: both allowed.
        :param share: of the runs, at least.
        """
        values = np.sort(self.values[name])
        inside = np.mean((values >= low) & (values <= high))
        assert inside >= share, (f'{name}: {inside:.0%} of the runs within {low:g} to {high:g}, '
                                 f'{share:.0%} are due: {np.round(values, 4).tolist()}')

    def __str__(self) -> str:
        """List minimum, median and maximum of each figure."""
        return '\n'.join(f'{name}: {np.min(v):.4g} {np.median(v):.4g} {np.max(v):.4g}'
                         for name, v in self.values.items())


def energy(simulation: Simulation) -> float:
    """Compute the kinetic and potential energy of all parts that exist [J]."""
    plan, poses, speed = simulation.blueprint, simulation.poses, simulation.velocities
    spin = np.einsum('nij,ni->nj', rotation.to_matrix(poses[:, 3:]), speed[:, 3:])
    gravity = simulation.scene.settings.gravity
    found = plan.mass * (gravity * poses[:, 2] + 0.5 * (speed[:, :3] ** 2).sum(axis=1))
    found += 0.5 * (plan.inertia * spin ** 2).sum(axis=1)
    return float(found[np.isfinite(poses[:, 0])].sum())


def down(simulation: Simulation) -> np.ndarray:
    """Mark the parts that have come down or are gone, (N,) bool."""
    moved = simulation.poses[:, :3] - simulation.blueprint.poses[:, :3]
    return ~(np.linalg.norm(moved, axis=1) <= _DOWN)


def hanging(simulation: Simulation) -> np.ndarray:
    """List the standing parts that no chain of bonds, whole or cracked, joins to the ground."""
    plan, graph = simulation.blueprint, simulation.state.solver.graph
    whole = np.setdiff1d(np.arange(len(plan.bonds)), simulation.events['bond'])
    whole = np.union1d(whole, graph.rows[graph.cracked & graph.alive])  # which press and rub
    pairs = np.where(plan.bonds[whole] == GROUND, len(plan), plan.bonds[whole])
    links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(plan) + 1,) * 2)
    island = connected_components(links)[1]
    standing = np.flatnonzero(simulation.state.standing)
    return standing[island[standing] != island[len(plan)]]


def sinking(simulation: Simulation) -> np.ndarray:
    """
    Wake resting bodies, neighbours together; return how far each comes down within 0.2 s [m].

    A piece that floats falls freely; one that leans on an unstable one only begins to tip. As many
    are woken at a time as have their contacts solved as finely as when the last came to rest:
    waking all at once would show how coarse the solution for all is. All rests again then.
    """
    bodies = simulation.state.world.bodies
    resting = np.flatnonzero(bodies.state == BodyState.RESTING)
    if not len(resting):
        return np.zeros(0)
    resting = resting[np.argsort(bodies.poses[resting, 0], kind='stable')]
    saved, ways = simulation.save(), []
    for group in np.array_split(resting, -(-len(resting) // _TOGETHER)):
        simulation.restore(saved)
        world = simulation.state.world
        before = world.poses(group)[:, 2].copy()
        world.thaw(group)
        for _ in range(12):
            world.step(_STEP)
        ways.append(before - world.poses(group)[:, 2])
    simulation.restore(saved)
    return np.concatenate(ways)


def heap(simulation: Simulation, parts: np.ndarray) -> tuple[float, float]:
    """Compute the median height of parts over its start, and their share near their plan."""
    now, before = simulation.poses[parts, :3], simulation.blueprint.poses[parts, :3]
    there = np.isfinite(now[:, 0])
    low, high = before[:, :2].min(axis=0) - 4.0, before[:, :2].max(axis=0) + 4.0
    inside = np.all((now[there, :2] > low) & (now[there, :2] < high), axis=1)
    return np.median(now[there, 2]) / np.median(before[there, 2]), inside.mean()


def largest(simulation: Simulation) -> int:
    """Count the parts of the largest loose piece."""
    return int(simulation.state.bodies.size.max(initial=0))


_FIGURES: Figures = {
    'down': lambda simulation: np.count_nonzero(down(simulation)),
    'broken': lambda simulation: simulation.bonds_broken,
    'awake': lambda simulation: simulation.awake_bodies, 'largest': largest}
