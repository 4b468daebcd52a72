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
Hash poses and break events of the shipped scenes, second by second, with all their cues.

Guards a change that must not alter what is simulated: record before it, compare after it. Hashes
hold for one set of library versions, so records are not kept in the repository.
Every scene runs in a process of its own.

    python bench/pose_hashes.py --record before.json
    python bench/pose_hashes.py --compare before.json
    python bench/pose_hashes.py demo garden --seconds 3
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
import hashlib
import json
from multiprocessing import get_context
from pathlib import Path
import sys

import numpy as np

_ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(_ROOT))  # the package beside this file, not one that is installed
from procphys_ros.scene import Scene  # noqa: E402
from procphys_ros.simulation import Simulation  # noqa: E402

_FOLDER = _ROOT / 'config'
SCENES = sorted(path.stem for path in _FOLDER.glob('*.yaml'))
_SHOWN = 12  # hexadecimal digits of a hash that are printed
_COLUMNS = ('time', 'bond', 'part_a', 'part_b', 'cause', 'load')


def digest(*columns: np.ndarray) -> str:
    """Hash the values of arrays; 0.0 and -0.0 are one value."""
    total = hashlib.sha256()
    for column in columns:
        total.update(np.ascontiguousarray(column + np.zeros(1, column.dtype)).tobytes())
    return total.hexdigest()


def summarise(simulation: Simulation) -> dict:
    """Hash the poses as they are, and all events so far; parts that are gone count as zeros."""
    gone = ~np.isfinite(simulation.poses).all(axis=1)
    poses = np.where(gone[:, None], 0.0, simulation.poses)
    events = simulation.events
    return {'parts': len(poses), 'gone': int(gone.sum()), 'broken': len(events),
            'loose': len(simulation.state.bodies.members),
            'poses': digest(poses), 'events': digest(*(events[name] for name in _COLUMNS))}


def run(name: str, seconds: int, threads: int) -> list[dict]:
    """Simulate a scene in a new process, and summarise it at the start and after each second."""
    with ProcessPoolExecutor(1, mp_context=get_context('spawn')) as pool:
        return pool.submit(simulate, name, seconds, threads).result()


def simulate(name: str, seconds: int, threads: int = 0) -> list[dict]:
    """Simulate a scene and return the rows of `run`."""
    scene = Scene.from_yaml(_FOLDER / f'{name}.yaml')
    scene.settings = replace(scene.settings, threads=threads)
    simulation = Simulation(scene)
    rate = round(1.0 / simulation.time_step)
    found = [summarise(simulation)]
    for _ in range(seconds):
        simulation.step(rate)
        found.append(summarise(simulation))
    simulation.close()
    return found


def difference(expected: list[dict], found: list[dict]) -> str:
    """Describe in which second two runs differ, and in what; '' = nowhere."""
    for second, (before, after) in enumerate(zip(expected, found)):
        differ = [f'{key} {str(before[key])[:_SHOWN]} -> {str(after[key])[:_SHOWN]}'
                  for key in after if before.get(key) != after[key]]
        if differ:
            return f'differs from second {second} on: {", ".join(differ)}'
    return '' if len(expected) >= len(found) else f'recorded for {len(expected) - 1} s only'


def report(name: str, found: list[dict], seconds: bool) -> None:
    """Print the last row of a scene, or all of them."""
    for second, row in enumerate(found):
        if seconds or second == len(found) - 1:
            print(f'{name:20s} {second:3d} s  parts {row["parts"]:6d}  gone {row["gone"]:5d}  '
                  f'broken {row["broken"]:6d}  poses {row["poses"][:_SHOWN]}  '
                  f'events {row["events"][:_SHOWN]}', flush=True)


def main() -> int:
    """Run what the command line asks for; exit status 1 when a comparison fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('scenes', nargs='*', metavar='scene', help=f'of {", ".join(SCENES)}')
    parser.add_argument('--seconds', type=int, default=10, help='simulated per scene')
    parser.add_argument('--threads', type=int, default=0, help='0 = one per core')
    parser.add_argument('--each', action='store_true', help='print every second')
    parser.add_argument('--record', type=Path, help='file to write all hashes to')
    parser.add_argument('--compare', type=Path, help='file of an earlier run')
    asked = parser.parse_args()
    for name in asked.scenes:
        if name not in SCENES:
            parser.error(f'there is no scene "{name}" (known: {", ".join(SCENES)})')
    expected = json.loads(asked.compare.read_text()) if asked.compare else None
    found, failed = {}, 0
    for name in asked.scenes or SCENES:
        found[name] = run(name, asked.seconds, asked.threads)
        report(name, found[name], asked.each)
        if expected is not None:
            told = difference(expected[name], found[name]) if name in expected else 'not recorded'
            failed += bool(told)
            print(f'{"":20s} {told or "same"}', flush=True)
        if asked.record:
            asked.record.write_text(json.dumps(found, indent=1) + '\n')
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
