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

"""Random scenes of arches and climbers, on hills, that objects join and leave; and saved ones."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from random_grammars import draw as draw_samples
from random_scenes import build

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.wallgrammar import WallGrammar

_SPACING = 12.0  # [m] between two objects in a row
_FASTEST = 150.0  # [m/s] that nothing reaches here: a ball flies at 40, air at 50, falls give 15
_TALLEST = 5.0  # [m]
_ARCHES = ('round', 'segmental(0.35)', 'pointed')
_ROOFS = ('none', 'flat', 'gable(35)', 'hip(30)')


def faults(seed: int, steps: int = 40) -> Iterator[str]:
    """
    Simulate one random scene twice from its middle; tell what went wrong.

    :param seed: of all that is random.
    :param steps: of 1/60 s.
    """
    rng = np.random.default_rng([seed, 15])
    engine = str(rng.choice(['bullet', 'native']))
    scene = _scene(rng, engine)
    simulation = Simulation(scene, seed=seed)
    simulation.set_wind((0.0, rng.uniform(0.0, 30.0), 0.0))
    told = f'seed {seed}, {engine}, {[placed.name for placed in scene.objects]}'
    for step in range(steps // 2):
        _act(simulation, rng)
        simulation.step()
        yield from (f'{told}, step {step}: {what}' for what in _look(simulation))
    saved, acts = simulation.save(), int(rng.integers(2 ** 31))
    ends = []
    for _ in range(2):
        again = np.random.default_rng(acts)
        for step in range(steps // 2, steps):
            _act(simulation, again)
            simulation.step()
            yield from (f'{told}, step {step}: {what}' for what in _look(simulation))
        ends.append((simulation.poses.copy(), simulation.velocities.copy()))
        simulation.restore(saved)
    if not all(np.array_equal(a, b, equal_nan=True) for a, b in zip(*ends)):
        yield f'{told}: what goes on from a saved state is not the same'
    simulation.close()


def _look(simulation: Simulation) -> Iterator[str]:
    """Yield faults: values that are not finite, poses of removed parts, and runaway bodies."""
    here = simulation.exists
    if not np.isfinite(simulation.poses[here]).all():
        yield 'a pose is not finite'
    if np.isfinite(simulation.poses[~here]).any():
        yield 'what is gone has a pose'
    if not np.isfinite(simulation.velocities).all():
        yield 'a velocity is not finite'
    elif (speed := np.linalg.norm(simulation.velocities[:, :3], axis=1)).max(initial=0) > _FASTEST:
        part = int(speed.argmax())
        yield f'{simulation.names.name(part)} moves at {speed[part]:.0f} m/s'


def _scene(rng: np.random.Generator, engine: str) -> Scene:
    """Stand two objects in a row, some on hills, one on another or up against it."""
    values: dict[str, Any] = {'scene': {'objects': []}, 'engine': engine}
    if rng.integers(2):
        values['terrain'] = {'noise': rng.uniform(0.5, 6.0), 'wavelength': rng.uniform(10, 60),
                             'extent': 140.0, 'seed': int(rng.integers(100))}
    scene = Scene.from_parameters(values)
    for i, kind in enumerate(rng.choice(len(_OBJECTS), 2)):
        x = _SPACING * (i - 0.5)
        carrier = scene.add(_OBJECTS[kind](rng), (x, 0.0, 0.0), name=f'object_{i}')
        if _OBJECTS[kind] is _arch and rng.integers(2):
            scene.add(WallGrammar.parse(_block(rng)).build(), (x + 0.3, 0.0, 0.0),
                      name=f'load_{i}', on=carrier.name)
        if _OBJECTS[kind] is not _tree and rng.integers(2):
            scene.add(_climber(rng), (x + 0.6, -0.05, 0.0), name=f'climber_{i}')
    return scene


def _act(simulation: Simulation, rng: np.random.Generator) -> None:
    """Do one of what users do, or nothing; what is refused has to change nothing."""
    act = int(rng.integers(16))
    objects = [placed for placed in simulation.objects
               if simulation.exists[placed.first:placed.first + placed.count].any()]
    chosen = objects[rng.integers(len(objects))]
    part = chosen.first + int(rng.integers(chosen.count))
    place = (rng.uniform(-20, 20), rng.uniform(-3, 3), rng.uniform(0.5, _TALLEST))
    try:
        if act == 0:
            simulation.add(_OBJECTS[rng.integers(len(_OBJECTS))](rng),
                           (place[0], 10.0 + place[1], 0.0), name=simulation.free_name('late'))
        elif act == 1 and len(objects) > 1:
            simulation.remove(chosen.name)
        elif act == 2:
            speed = rng.uniform(0.0, 20.0)
            mass = float(simulation.blueprint.mass[part])
            simulation.apply_impulse(part, speed * mass * rng.uniform(-0.6, 0.6, 3))
        elif act == 3:
            simulation.launch(Projectile(
                'sphere', rng.uniform(0.1, 1.0), rng.uniform(1.0, 500.0),
                (place[0], -8.0, 6.0 + place[2]), (0.0, rng.uniform(1.0, 40.0), -5.0)))
        elif act == 4:
            simulation.explode(place, rng.uniform(0.1, 3.0))
        elif act == 5:
            simulation.gust()
    except (CommandError, SceneError):
        pass  # there is no such part any more, or something stands in that place


def _tree(rng: np.random.Generator) -> Blueprint:
    """Grow one of the trees of `random_grammars`; another when its rates leave their ranges."""
    while True:
        found = build(draw_samples(int(rng.integers(2 ** 31)), 1, 0)[0][0])
        if found is not None and np.abs(found.poses[:, :3]).max() < _TALLEST:
            return found


def _laid(rng: np.random.Generator) -> Blueprint:
    """Build one of the walls and huts of `random_grammars`."""
    return build(draw_samples(int(rng.integers(2 ** 31)), 0, 1)[0][0])


_STONE = """
material stone {{ density: 2000 tension: {tension:.4g} cohesion: {cohesion:.4g}
  friction: {friction:.3g} modulus: {modulus:.4g} compression: 20e6 }}
layout laid {{ bond: {bond} unit: {unit:.2f} 0.205 0.3 joint: {joint:.2f} material: stone }}
"""


def _stone(rng: np.random.Generator) -> str:
    joint = float(rng.choice([0.0, 0.01]))
    return _STONE.format(
        joint=joint, unit=2 * 0.205 + joint,
        tension=rng.choice([0.0, 1e4, 1e5, 1e6]), cohesion=rng.choice([0.0, 2e4, 2e5, 1e6]),
        friction=rng.uniform(0.3, 0.9), modulus=10.0 ** rng.uniform(8.5, 10.5),
        bond=rng.choice(['running', 'english', 'flemish']))


def _arch(rng: np.random.Generator) -> Blueprint:
    """Build piers with an arch between them, thick or as thin as its layout."""
    span, pier, spring = rng.uniform(0.8, 2.5), rng.uniform(0.95, 1.3), rng.uniform(0.4, 1.5)
    text = f"""building b(span = {span:.3f}, pier = {pier:.3f}, spring = {spring:.3f})
  footprint: (0, 0) (span + 2 * pier, 0)
  facades: front
  storey_height: spring + span + 1.35
rule front -> split(x) {{ pier: wall | span: bay | pier: wall }}
rule bay -> split(y) {{ spring: opening | span + 0.95: arch | ~1: wall }}
{_stone(rng)}
panel wall: laid
panel opening: none
panel arch: arch({rng.choice(_ARCHES)}, {rng.integers(1, 3)}, stone)
"""
    return WallGrammar.parse(text).build(seed=int(rng.integers(100)))


def _house(rng: np.random.Generator) -> Blueprint:
    """Build a small house with a roof and openings under lintels."""
    text = f"""building b(length = {rng.uniform(2.9, 3.6):.3f})
  footprint: (0, 0) (length, 0) (length, 2.4) (0, 2.4)
  facades: front
  storey_height: {rng.uniform(1.8, 2.2):.3f}
  roof: {rng.choice(_ROOFS)}
rule front -> split(x) {{ ~1: wall | 0.8: opening | ~1: wall }}
rule opening -> split(y) {{ 1.2: {rng.choice(['door', 'window'])} | 0.2: lintel | ~1: wall }}
{_stone(rng)}
panel wall: laid
panel door: boards(oak)
panel window: glazing(timber, glass)
panel lintel: beam(concrete)
"""
    return WallGrammar.parse(text).build(seed=int(rng.integers(100)))


def _block(rng: np.random.Generator) -> str:
    """Write a low wall that stands on something."""
    return f"""building b()
  footprint: (0, 0) (0.9, 0)
  facades: front
  storey_height: {rng.uniform(0.2, 0.8):.2f}
rule front -> wall
{_stone(rng)}
panel wall: laid
"""


def _climber(rng: np.random.Generator) -> Blueprint:
    """Grow a stem that clings, with some that fork off."""
    sides = ''.join(f'[ +({rng.uniform(-60, 60):.0f}) F(0.2) F(0.2) ] '
                    for _ in range(rng.integers(1, 4)))
    return LSystem.parse(
        f'axiom: Density(900) Modulus({10.0 ** rng.uniform(8, 10):.4g}) Strength(3e7) '
        f'DampingRatio(0.1) Cling({10.0 ** rng.uniform(0, 3):.4g}) !(0.012) '
        f'F(0.2) {sides}F(0.2) {sides}F(0.2)').build(seed=int(rng.integers(100)))


_OBJECTS: tuple[Callable[[np.random.Generator], Blueprint], ...] = (_tree, _laid, _arch, _house)


@pytest.mark.parametrize('seed', [1, 10])  # with either engine
def test_random_changes_leave_everything_finite_and_repeatable(seed):
    """Let 40 steps pass in a scene that changes, half of them twice from a saved state."""
    found = list(faults(seed))
    assert not found, '\n'.join(found)
