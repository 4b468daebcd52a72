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

"""Formats: choose an exporter by file name, and check its requirements before simulating."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from procphys_ros.errors import ExportError
from procphys_ros.export.content import Content, Report
from procphys_ros.files.output_files import obstacle
from procphys_ros.scene import Scene
from procphys_ros.schema import short
from procphys_ros.simulation import Simulation

_USD = ('usd', 'write_usd')
# Suffix: module and function in it. Imported late: USD requires an optional package.
_WRITERS = {'.usda': _USD, '.usdc': _USD, '.xml': ('mjcf', 'write_mjcf'),
            '.urdf': ('urdf', 'write_urdf'), '.sdf': ('sdf', 'write_sdf'),
            '.glb': ('gltf', 'write_gltf')}
SUFFIXES = tuple(_WRITERS)
_ANIMATED = ('.usda', '.usdc')
_LONGEST = 3600.0  # [s] of simulated time
_FASTEST = 240.0   # [1/s]

Writer = Callable[[Content, Path, Report], None]


def _silent(done: float, whole: float) -> None:
    pass


def export(source: Scene | Simulation, path: str | Path, time: float = 0.0,
           report: Report = _silent) -> None:
    """
    Write a scene, or a simulation in its present state, in the format of the file's suffix.

    :param source: a scene, which is simulated from rest, or a simulation, which is only read.
    :param path: file that ends in one of `SUFFIXES`.
    :param time: simulated time of a scene before the export [s].
    :param report: called with the amount done and the total, first of simulation, then of writing.
    :raises ExportError: if the file cannot be written, a package is missing, or the time is out
        of range.
    """
    target = Path(path)
    write = _writer(target)
    if isinstance(source, Simulation):
        if time != 0.0:
            raise ExportError('a simulation is exported at its own time; leave the time out')
        content = Content.of(source)
    else:
        _check_scene(source)
        _check('time', time, 0.0, _LONGEST, 's')
        content = Content.at(source, time, report)
    _guarded(target, lambda: write(content, target, report))


def export_animation(scene: Scene, path: str | Path, start: float, end: float,
                     fps: float = 30.0, report: Report = _silent) -> None:
    """
    Simulate a scene from rest and write its motion, as USD time samples.

    :param scene: to simulate.
    :param path: file that ends in .usda or .usdc.
    :param start: first written moment [s].
    :param end: last written moment [s].
    :param fps: moments per second.
    :param report: called with the simulated and the total time [s].
    :raises ExportError: as by `export`, and if the file is not USD.
    """
    target = Path(path)
    if target.suffix.lower() not in _ANIMATED and target.suffix.lower() in SUFFIXES:
        raise ExportError(f'"{target}": an animation is written as {" or ".join(_ANIMATED)}')
    _writer(target)
    _check_scene(scene)
    _check('first moment', start, 0.0, _LONGEST, 's')
    _check('last moment', end, start, _LONGEST, 's')
    _check('fps', fps, 0.1, _FASTEST, '1/s')
    from procphys_ros.export.usd_animation import write_animation

    _guarded(target, lambda: write_animation(scene, target, start, end, fps, report))


def check_target(path: str | Path) -> None:
    """
    Validate the path of an output file, before simulation.

    :raises ExportError: if its suffix is unknown, its package missing, or it is not writable.
    """
    _writer(Path(path))


def _writer(path: Path) -> Writer:
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise ExportError(f'"{path}": the suffix "{path.suffix}" names no format; use one of '
                          f'{", ".join(SUFFIXES)}')
    if reason := obstacle(path):
        raise ExportError(f'"{path}" cannot be written: {reason}')
    module, function = _WRITERS[suffix]
    try:
        return getattr(import_module(f'procphys_ros.export.{module}'), function)
    except ImportError as error:
        if not (error.name or '').startswith('pxr'):
            raise
        raise ExportError(f'"{path}": USD needs the package usd-core: '
                          'pip install usd-core') from error


def _check_scene(source: object) -> None:
    if not isinstance(source, Scene):
        raise ExportError(f'{short(source)} is no scene; Scene.add places what a grammar builds')


def _check(name: str, value: float, least: float, most: float, unit: str) -> None:
    if not least <= value <= most:
        raise ExportError(f'the {name} is {value:g} {unit}, it must lie from {least:g} to '
                          f'{most:g}')


def _guarded(path: Path, write: Callable[[], None]) -> None:
    try:
        write()
    except OSError as error:
        raise ExportError(f'"{path}" cannot be written: {error.strerror or error}') from error
