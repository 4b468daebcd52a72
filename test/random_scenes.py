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

"""Scenes of random grammars: built, blown at, struck, and watched for what cannot be."""

from collections.abc import Iterator, Sequence

from energy_ledger import EnergyLedger
import numpy as np
from random_grammars import Event, Sample

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import GrammarError
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.wallgrammar import WallGrammar

STEPS = 60
_ROOM = 10.0   # [m] between objects, beside what each reaches
# Rounding, and what contacts give to undo overlaps: a share of the bound, and 4.5 cm/s.
# A ball is stopped by a wall in a blow of its own before the world moves on (2 ms in one step).
_SLACK = {'lsys': 1.02, 'wall': 1.1, 'house': 1.1}
_LEAST = 1e-3  # [J/kg]


def build(sample: Sample) -> Blueprint | None:
    """
    Derive one grammar; None when it is refused in plain words, for what only derivation shows.

    That is a value which rates drive out of its range, a lintel on too narrow a pier, or what a
    house has no room for.
    """
    language = LSystem if sample.language == 'lsys' else WallGrammar
    grammar = language.parse(sample.text)
    try:
        return grammar.build(seed=sample.seed)
    except GrammarError as error:
        told = 'Rate' in str(error) or 'bears only' in str(error)
        if told or sample.language == 'house' and error.line:
            return None
        raise


def faults(samples: Sequence[Sample], wind: float, steps: int = STEPS,
           engine: str = 'auto') -> Iterator[str]:
    """
    Simulate grammars side by side; tell what went wrong, object by object.

    :param samples: grammars with what hits them.
    :param wind: mean speed at 10 m, across the row [m/s].
    :param steps: of 1/60 s.
    :param engine: of rigid bodies.
    """
    built = [(build(sample), sample) for sample in samples]
    samples = [sample for blueprint, sample in built if blueprint is not None]
    blueprints = [blueprint for blueprint, _ in built if blueprint is not None]
    if not samples:
        return
    reach = [float(np.abs(b.poses[:, :3]).max() + b.size.max()) for b in blueprints]
    places = np.cumsum(2.0 * np.array(reach) + _ROOM) - np.array(reach)
    borders = places[:-1] + reach[:-1] + 0.5 * _ROOM
    scene = Scene(Settings(engine=engine))
    for i, (blueprint, x) in enumerate(zip(blueprints, places)):
        scene.add(blueprint, (x, 0.0, 0.0), 0.0, f'object_{i}')
    simulation = Simulation(scene, seed=samples[0].seed)
    simulation.set_wind((0.0, wind, 0.0))
    ledger = EnergyLedger(simulation, borders)
    mass = np.array([b.mass.sum() for b in blueprints])
    slack = np.array([_SLACK[sample.language] for sample in samples])
    for i, (sample, blueprint, x) in enumerate(zip(samples, blueprints, places)):
        _throw(simulation, ledger, sample.event, blueprint, x, reach[i])
    bad: set[int] = set()
    for step in range(steps):
        for i, sample in enumerate(samples):
            if sample.event.impulse_step == step:
                _strike(simulation, ledger, sample.event, scene.objects[i])
        simulation.step()
        ledger.note()
        for i, what in _look(simulation, ledger, slack, mass):
            if i not in bad:
                yield f'step {step}, wind {wind:g}: {what}\n{samples[i]}\n{samples[i].text}'
            bad.add(i)
    simulation.close()


def _look(simulation: Simulation, ledger: EnergyLedger, slack: np.ndarray, mass: np.ndarray
          ) -> Iterator[tuple[int, str]]:
    for i, placed in enumerate(simulation.scene.objects):
        rows = slice(placed.first, placed.first + placed.count)
        poses = simulation.poses[rows]
        if not np.isfinite(simulation.velocities[rows]).all() or (
                ~np.isfinite(poses).all(axis=1) & ~np.isnan(poses).all(axis=1)).any():
            yield i, 'a pose or a velocity is not finite'
    kinetic, bound = ledger.kinetic(), ledger.bound()
    allowed = slack * np.maximum(bound, 0.0) + _LEAST * mass
    for i in np.flatnonzero(~(kinetic <= allowed)):
        yield int(i), f'kinetic energy {kinetic[i]:.6g} J, bound {bound[i]:.6g} J'


def _throw(simulation: Simulation, ledger: EnergyLedger, event: Event, blueprint: Blueprint,
           x: float, reach: float) -> None:
    """Throw a ball along the wind at one object."""
    if not event.ball:
        return
    height = max(event.height * float(blueprint.poses[:, 2].max()), 0.0) + event.diameter
    mass = event.ball * np.pi / 6.0 * event.diameter ** 3
    part = simulation.launch(Projectile(
        'sphere', event.diameter, mass, (x, -reach - event.diameter, height),
        (0.0, event.ball_speed, 0.0)))
    ledger.launched(part, mass, event.ball_speed)


def _strike(simulation: Simulation, ledger: EnergyLedger, event: Event, placed) -> None:
    """Hit one part of an object."""
    part = placed.first + int(event.part * placed.count)
    if not np.isfinite(simulation.poses[part, 0]):
        return
    turn = 2.0 * np.pi * event.direction
    way = np.array([np.cos(turn), np.sin(turn), event.direction])
    impulse = event.speed * simulation.blueprint.mass[part] * way / np.linalg.norm(way)
    ledger.struck(part, float(np.linalg.norm(impulse)))
    simulation.apply_impulse(part, impulse)
