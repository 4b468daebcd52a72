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
Time 3,000 trees around a moving observer, with and without level of detail, in one run.

Prints building time, real-time factors, and the error of the culled run inside the view against
the full simulation; then a demolition far from the observer, with and without coarse debris. Run:
python bench/detail.py
"""

from time import perf_counter

import numpy as np

from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_SPECIES = ('oak', 'pine', 'birch', 'willow', 'palm')
_TREES = 3000
_SECONDS = 10  # simulated, of the observer's way
_ORBIT = 60.0  # [m] radius of the observer's way, at 10 m/s
_CULLING = {'distance': 80.0, 'frustum': True, 'far_interval': 4, 'far_distance': 20.0}
_SURE = 15.0  # [m] around the place looked at, where the culled run must be the full one


def stand(culling: dict) -> Simulation:
    """
    Plant 3,000 trees of five species, eight individuals of each.

    :param culling: settings of the level of detail, {} = none.
    """
    side = 10.0 * np.sqrt(_TREES / len(_SPECIES))
    parameters = {'scene': {'objects': list(_SPECIES)}, 'culling': culling,
                  'wind': {'velocity': [12.0, 0.0, 0.0], 'turbulence_intensity': 0.2}}
    for i, name in enumerate(_SPECIES):
        parameters[name] = {'grammar': f'{name}.lsys', 'count': _TREES // len(_SPECIES),
                            'spacing': 10.0, 'layout': 'scatter', 'variants': 8,
                            'origin': [(i % 3 - 1) * side, (i // 3 - 0.5) * side, 0.0]}
    return Simulation(Scene.from_parameters(parameters))


def look(simulation: Simulation, time: float) -> np.ndarray:
    """Put the observer on its way, looking at the middle, and give where it is [m], (3,)."""
    angle = 10.0 * time / _ORBIT
    place = np.array([_ORBIT * np.cos(angle), _ORBIT * np.sin(angle), 3.0])
    half = 0.5 * (angle + np.pi)
    simulation.set_observer(place, (0.0, 0.0, np.sin(half), np.cos(half)))
    return place


def fly(simulation: Simulation, seconds: int) -> list[float]:
    """Fly the observer, and measure the wall time of each simulated second [s]."""
    rate = round(1.0 / simulation.time_step)
    took = []
    for second in range(seconds):
        start = perf_counter()
        for k in range(rate):
            look(simulation, second + k / rate)
            simulation.step()
        took.append(perf_counter() - start)
    return took


def main() -> None:
    """Run both and print the comparison."""
    start = perf_counter()
    culled = stand(_CULLING)
    print(f'{_TREES} trees, {len(culled.blueprint)} segments, built in '
          f'{perf_counter() - start:.1f} s')
    full = stand({})
    for simulation in (culled, full):
        simulation.step(2)
    lean, whole = fly(culled, _SECONDS), fly(full, 2)
    for name, took in (('culled', lean), ('full', whole)):
        print(f'{name:7s} real-time factor {1.0 / np.median(took):5.2f} '
              f'(worst second {1.0 / max(took):5.2f})')
    print(f'ratio   {np.median(whole) / np.median(lean):.1f}')
    full.reset()
    culled.reset()
    for simulation in (culled, full):
        fly(simulation, 2)
    near = np.linalg.norm(full.blueprint.poses[:, :2], axis=1) < _SURE
    error = np.linalg.norm(culled.poses[near, :3] - full.poses[near, :3], axis=1)
    sway = np.linalg.norm(full.poses[near, :3] - full.blueprint.poses[near, :3], axis=1)
    print(f'within {_SURE:g} m of what is looked at, after 2 s: median error '
          f'{1e3 * np.median(error):.1f} mm, largest {1e3 * error.max():.0f} mm '
          f'of {1e3 * sway.max():.0f} mm of sway')


def demolition(distance: float) -> None:
    """Bring an office down 200 m from the observer, and print speed, pieces and heights."""
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['block'], 'cues': ['0.5 demolish']},
        'culling': {'debris_distance': distance},
        'block': {'grammar': 'office.wall', 'defines': ['bays=3', 'deep=2', 'storeys=2']}}))
    simulation.set_observer((0.0, -200.0, 2.0))
    start = perf_counter()
    simulation.step(480)
    factor = 8.0 / (perf_counter() - start)
    source = simulation.blueprint
    height = simulation.poses[source.kind == source.kinds.index('brick'), 2]
    bodies = len(simulation.state.bodies.members)
    print(f'demolition, debris_distance {distance:g} m: real-time factor {factor:.2f}, '
          f'{bodies} bodies, bricks at {np.nanmedian(height):.2f} m in the '
          f'median, {np.nanmax(height):.2f} m at most')


if __name__ == '__main__':
    main()
    for distance in (0.0, 50.0):
        demolition(distance)
