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
Record which overloads of kernels simulations call from Python: `compilation/overloads.json`.

Run `python bench/overloads.py` after kernels or their arguments have changed; `python -m
procphys_ros.warm` compiles what the list names. With `--check` the scenes run for a fifth of the
time, and what the list lacks is printed.
"""

from collections.abc import Callable, Iterator
import json
import sys
from typing import Any

from numba.core import event
import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation.cache import KernelCache
from procphys_ros.compilation.overloads import GROUPS, SHIPPED
from procphys_ros.compilation.signatures import to_text
from procphys_ros.errors import CommandError
from procphys_ros.files.resources import shared_folder
from procphys_ros.messages import MarkerStyle, pose_array, SceneMarkers, stamp
from procphys_ros.physics.world import JointKind, World
from procphys_ros.recording.marker_state import find_markers
from procphys_ros.scene import Scene
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

_CONFIG = shared_folder() / 'config'
# Scenes beside the demo, and how many steps of each.
_CHECKED = 0.2  # share of the steps
_SCENES = {'figure_1.yaml': 240, 'tree_on_house.yaml': 240, 'felled_by_wind.yaml': 200,
           'palms_in_a_gust.yaml': 120, 'vehicle_on_wall.yaml': 150}


# Rules with contexts, trees that are culled, and shelter, which no shipped scene has.
_CULLED: dict[str, Any] = {
    'scene': {'objects': ['sapling']}, 'wind': {'velocity': [20.0, 0.0, 0.0], 'shelter': True},
    'culling': {'distance': 60.0, 'sleeping': True, 'far_distance': 10.0, 'far_interval': 2},
    'sapling': {'count': 9, 'spacing': 0.6, 'grammar_text': """
axiom: Width(0.05) Density(700) Modulus(8e9) DampingRatio(0.05) Preload(0.5) F(1) A B F(1) Leaf(1)
derivation length: 2
production:
A < B -> F(0.5)
A > F -> F(0.5)
"""}}
# A wall of so poor mortar that its joints crack in the wind, open and close.
_CRACKED: dict[str, Any] = {
    'scene': {'objects': ['wall']}, 'wind': {'velocity': [0.0, 18.0, 0.0]},
    'wall': {'grammar_text': """
building wall
  footprint: (0, 0) (2, 0)
  facades: brickwork
  storey_height: 1.5
layout running { unit: 0.215 0.1025 0.065  joint: 0.01  material: brick }
panel brickwork: running
material brick { tension: 500  cohesion: 500 }
"""}}

# Both on a hillside, where the wall has footings.
_HILL: dict[str, Any] = {
    'scene': {'objects': ['wall', 'sapling']}, 'wind': {'velocity': [0.0, 8.0, 0.0]},
    'terrain': {'noise': 3.0, 'wavelength': 12.0, 'extent': 24.0},
    'wall': _CRACKED['wall'],
    'sapling': {'origin': [3.0, 0.0, 0.0],
                'grammar_text': _CULLED['sapling']['grammar_text']}}

# What only our own engine calls.
_NATIVE: dict[str, Any] = {'scene': {'objects': ['wall']}, 'engine': 'native',
                           'wall': _CRACKED['wall']}


def publish(simulation: Simulation) -> list[bytes]:
    """Write poses and markers, these twice, as for a new and for an old subscriber."""
    markers = SceneMarkers(simulation.blueprint, simulation.objects, 'world',
                           MarkerStyle(40_000, '', ''))
    written = []
    pose_array(simulation.poses, stamp(simulation.time), 'world')
    for write in (markers.whole, markers.changes):
        leaves = simulation.leaf_poses() if markers.shows_leaf_poses else None
        data = write(simulation.poses, stamp(simulation.time), leaves, simulation.dust)
        if data is not None:
            written.append(bytes(data))
    return written


def show(simulation: Simulation) -> None:
    """Write all messages, read them as a recorder does, and look as a sensor does."""
    for data in publish(simulation):
        find_markers(data)
    simulation.scan(LidarSettings(rows=4, columns=8))


def stand(name: str) -> Simulation:
    """Load a scene and publish its first poses."""
    simulation = start(name)
    publish(simulation)
    return simulation


def start(name: str) -> Simulation:
    """Load a scene and make its first step."""
    simulation = Simulation(Scene.from_yaml(_CONFIG / name))
    simulation.step()
    return simulation


def damage(simulation: Simulation) -> None:
    """Do to a scene what commands can do."""
    blueprint = simulation.blueprint
    low = int(np.argmin(blueprint.poses[:, 2]))
    x, y, z = blueprint.poses[len(blueprint) // 2, :3]
    simulation.set_observer((x - 30.0, y, 2.0))
    simulation.set_wind((8.0, 2.0, 0.0))
    simulation.gust()
    simulation.apply_impulse(low, (50.0, 0.0, 0.0))
    simulation.apply_wrench(len(blueprint) - 1, (20.0, 0.0, 0.0))
    simulation.explode((x + 1.0, y, z), 5.0)
    simulation.launch(Projectile('sphere', (0.5,), 60.0, (x - 10.0, y, z + 1.0), (25.0, 0.0, 0.0)))
    simulation.step(40)
    if simulation.scene.settings.intruder is not None:
        simulation.place_intruder((x, y, z, 0.0, 0.0, 0.0, 1.0))
    try:
        simulation.demolish()
    except CommandError:
        pass  # nothing stands that could be
    simulation.step(40)
    show(simulation)


def exercise(share: float) -> Iterator[None]:
    """Run that share of all scenes; yield after the demo's first poses and markers, and last."""
    demo = start('demo.yaml')
    yield
    publish(demo)
    yield
    culled = Simulation(Scene.from_parameters(_CULLED))
    culled.set_observer((-8.0, 0.0, 1.0))
    culled.step(20)
    cracked = Simulation(Scene.from_parameters(_CRACKED))
    cracked.step(60)
    cracked.apply_impulse(len(cracked.blueprint) // 2, (0.0, 2.0, 0.0))
    cracked.step(60)
    hill = Simulation(Scene.from_parameters(_HILL))
    hill.step()
    hill.launch(Projectile('sphere', (0.4,), 60.0, (-3.0, 1.0, 4.0), (10.0, -1.0, 0.0)))
    hill.step(30)
    hill.demolish()
    hill.step(30)
    show(hill)
    simulations = [stand(name) for name in _SCENES]
    demo.step(int(200 * share))
    damage(demo)
    for simulation, steps in zip(simulations, _SCENES.values()):
        simulation.step(int(steps * share))
        damage(simulation)
    strike_twice(Simulation(Scene.from_parameters(_NATIVE)))
    hang()
    yield


def strike_twice(simulation: Simulation) -> None:
    """Knock bricks out of a wall, and hit them again where they lie."""
    for height in (1.0, 0.4):
        simulation.launch(Projectile('sphere', (0.4,), 60.0, (1.0, -2.0, height),
                                     (0.0, 10.0, 0.0)))
        simulation.step(100)


def hang() -> None:
    """Hang a block by a joint."""
    world = World(engine='native')
    place = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0])
    body = np.array([world.add_body(Shape.BOX, np.full(3, 0.2), 1.0, place)])
    world.join(JointKind.BALL, body, np.array([World.ground]), place)
    world.step(1.0 / 60.0)


class Recorder(event.Listener):
    """
    Notes which overloads Python calls, whether they are compiled or come from the cache.

    :ivar rows: module, name and types of the arguments of each, in the order of first use.
    """

    def __init__(self) -> None:
        self._seen: dict[str, list] = {}
        self._compiling = 0  # callees are looked up while their callers are compiled
        load = KernelCache.load_overload

        def note(cache: KernelCache, sig: Any, target_context: Any) -> Any:
            if not self._compiling:
                self._note(cache._function, sig)
            return load(cache, sig, target_context)

        KernelCache.load_overload = note  # type: ignore[method-assign]
        event.register('numba:compile', self)

    @property
    def rows(self) -> list[list]:
        """List what was seen so far."""
        return list(self._seen.values())

    def on_start(self, event: Any) -> None:
        """Go one level of callees down."""
        self._compiling += 1

    def on_end(self, event: Any) -> None:
        """Come back up."""
        self._compiling -= 1

    def _note(self, function: Callable, sig: Any) -> None:
        row = [function.__module__, function.__qualname__, [to_text(kind) for kind in sig]]
        self._seen.setdefault(json.dumps(row), row)


def write(*groups: list[list]) -> None:
    """Write the list, a line each."""
    texts = ['"{}": [\n{}\n]'.format(name, ',\n'.join(map(json.dumps, group)))
             for name, group in zip(GROUPS, groups)]
    SHIPPED.write_text('{{{}}}\n'.format(',\n'.join(texts)), 'utf-8')
    counts = ', '.join(f'{len(group)} for {name}' for name, group in zip(GROUPS, groups))
    print(f'{SHIPPED}: {counts}')


def main() -> int:
    """Record all, or check a fifth of it."""
    recorder = Recorder()
    if sys.argv[1:] != ['--check']:
        first, second, _ = [len(recorder.rows) for _ in exercise(1.0)]
        rows = recorder.rows
        write(rows[:first], rows[first:second], rows[second:])
        return 0
    known = json.loads(SHIPPED.read_text('utf-8'))
    for _ in exercise(_CHECKED):
        pass
    listed = [row for group in GROUPS for row in known[group]]
    missing = [row for row in recorder.rows if row not in listed]
    print(*missing, sep='\n')
    return 1 if missing else 0


if __name__ == '__main__':
    sys.exit(main())
