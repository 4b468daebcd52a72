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


"""Sweep: which values of which parameters are combined, and the runs that this makes."""

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
import hashlib
from itertools import product
import json
from pathlib import Path
import re
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from procphys_ros import __version__
from procphys_ros.batch.run import Run
from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry.linear import norm
from procphys_ros.scene.data_file import find_data_file
from procphys_ros.scene.objects import read_objects
from procphys_ros.scene.parameter_table import find, GLOBAL, NODE, OBJECT, put
from procphys_ros.scene.settings import read_settings
from procphys_ros.scene.sources import locate, SCANS
from procphys_ros.scene.unused import check_given
from procphys_ros.scene.yaml_file import BoundedLoader, read_yaml
from procphys_ros.schema import Parameter

_GRAMMAR = re.compile(r'[^\s",\[\]{}]+\.(?:lsys|wall|l|h|lpy|csv|mtg|ply)\b')  # name of a file
_DATA_FILES = ('terrain.file', 'wind.file', 'wind.map', 'ground.motion')
_MOST = 1_000_000  # runs
_LONGEST = 1e6  # [s] of a run, also the latest time of a cue
# Parameters without effect on a run: of topics, messages, services and pictures.
_IDLE = {p.name for p in NODE} | {'world_frame'}
_IDLE_GROUPS = ('camera', 'culling', 'inspect', 'intruder', 'intruders', 'lidar', 'sky', 'spawn',
                'state', 'sun')


@dataclass(frozen=True)
class Variation:
    """
    The values of one varied parameter.

    :ivar name: full name of the parameter, such as `wind.velocity` or `oak.seed`.
    :ivar values: of its type.
    """

    name: str
    values: tuple[Any, ...]

    @classmethod
    def read(cls, text: str, objects: Sequence[str],
             scene: Mapping[str, Any] = MappingProxyType({})) -> 'Variation':
        """
        Read a variation from the command line.

        :param text: `name=[value, …]` in YAML, `name=value,value,…`, or `name=first..last/number`
            for evenly spaced numbers, or vectors; for a vector, numbers are lengths in the
            direction of the scene's value.
        :param objects: names of the objects of the scene.
        :param scene: its parameters, nested.
        :raises SceneError: if there is no such parameter, or a value is not allowed.
        """
        name, sign, given = text.partition('=')
        parameter = find(name.strip(), list(objects))
        if parameter is None or not sign:
            known = [p.name for p in GLOBAL] + [f'{o}.{p.name}' for o in objects for p in OBJECT]
            raise SceneError(f'--vary {text}: say name=values; there is no parameter '
                             f'"{name.strip()}"{nearest_names(name.strip(), known)}')
        if name.strip() == 'seed':
            raise SceneError('--vary seed: say --seeds and their number')
        if name.strip() in _IDLE or name.strip().partition('.')[0] in _IDLE_GROUPS:
            raise SceneError(f'--vary {name.strip()}: no run depends on it; it is for a node that '
                             'somebody listens or talks to, or for pictures')
        values = tuple(parameter.read(value, name.strip())
                       for value in _values(parameter, given, text, scene))
        if not values:
            raise SceneError(f'--vary {text}: there are no values')
        return cls(name.strip(), values)


@dataclass(frozen=True)
class Sweep:
    """
    All combinations of some variations, each with several seeds.

    :ivar scene: scene file.
    :ivar parameters: nested, as in that file.
    :ivar variations: of parameters, the last one fastest.
    :ivar seeds: runs of each combination; the first has the seed of the scene.
    :ivar duration: simulated time of each run [s].
    :ivar series: recorded parts, as in `Simulation.series`; () = none.
    :ivar every: time steps per row of the series.
    """

    scene: Path
    parameters: Mapping[str, Any]
    variations: tuple[Variation, ...]
    seeds: int
    duration: float
    series: tuple[str, ...] = ()
    every: int = 1

    @classmethod
    def read(cls, scene: Path, variations: Sequence[str], seeds: int, duration: float,
             series: Sequence[str] = (), every: int = 1) -> 'Sweep':
        """
        Read a sweep from the command line.

        :raises SceneError: if the file cannot be read, or a variation is invalid.
        """
        parameters = read_yaml(scene)
        try:
            objects = [spec.name for spec in read_objects(parameters)]
            check_given(parameters, objects)
            _check_duration(duration, read_settings(parameters).time_step, every)
        except SceneError as error:
            raise SceneError(f'{scene}: {error}') from error
        read = tuple(Variation.read(text, objects, parameters) for text in variations)
        names = [variation.name for variation in read]
        for name in names:
            if names.count(name) > 1:
                raise SceneError(f'--vary {name} stands there twice')
        sweep = cls(scene, parameters, read, seeds, duration, tuple(series), every)
        if len(sweep) > _MOST:
            raise SceneError(f'these are {len(sweep)} runs, at most {_MOST} are possible')
        for _, run in replace(sweep, seeds=1).runs():  # also values invalid only together
            read_objects(run.parameters)
            _check_duration(duration, read_settings(run.parameters).time_step, every)
        return sweep

    def __len__(self) -> int:
        """Return the number of runs."""
        return int(np.prod([len(v.values) for v in self.variations], dtype=object)) * self.seeds

    @property
    def digest(self) -> str:
        """
        Hash the arguments, the version, and the contents of referenced files, to identify sweeps.

        Files referenced by a grammar or a plan are included.
        """
        about = json.dumps([__version__, self.parameters, sorted(self._grammars()),
                            [*self._data()],
                            [(v.name, v.values) for v in self.variations],
                            self.seeds, self.duration, self.series, self.every],
                           sort_keys=True, default=str)
        return hashlib.sha256(about.encode()).hexdigest()[:12]

    def _grammars(self) -> Iterator[str]:
        """Yield the digests of the texts of all grammars, varied ones included."""
        named = {(f'{spec.name}.grammar', spec.grammar)
                 for spec in read_objects(self.parameters)}
        named |= {(v.name, value) for v in self.variations for value in v.values
                  if v.name.endswith('.grammar')}
        todo = [(name, key, self.scene.absolute().parent) for key, name in named if name]
        seen: set[Path] = set()
        while todo:
            path = locate(*todo.pop()).resolve()
            if path not in seen:
                seen.add(path)
                text = path.read_bytes()
                yield hashlib.sha256(text).hexdigest()
                if path.suffix not in SCANS:
                    todo += [(name, str(path), path.parent)
                             for name in _names_in(text, path.parent)]

    def _data(self) -> Iterator[str]:
        """Yield the digests of the other files of the scene, varied ones included."""
        for key in _DATA_FILES:
            group, _, name = key.partition('.')
            given = [self.parameters.get(group, {}).get(name, ''),
                     *(value for v in self.variations if v.name == key for value in v.values)]
            names = {named for value in given
                     for named in ([value] if isinstance(value, str) else value or ())}
            for named in sorted(names - {''}):
                path = find_data_file(key, named, self.scene.absolute().parent)
                yield hashlib.sha256(path.read_bytes()).hexdigest()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the varied parameters."""
        return (*(variation.name for variation in self.variations), 'seed')

    def runs(self) -> Iterator[tuple[tuple[Any, ...], Run]]:
        """Yield the values of `columns` and the run of each combination."""
        first = int(self.parameters.get('seed', 0))
        combinations = product(*(variation.values for variation in self.variations),
                               range(first, first + self.seeds))
        for number, values in enumerate(combinations):
            parameters: dict[str, Any] = deepcopy(dict(self.parameters))
            for name, value in zip(self.columns, values):
                put(parameters, name, value)
            yield values, Run(number, parameters, self.scene.absolute().parent, self.duration,
                              self.series, self.every)


def _names_in(text: bytes, folder: Path) -> Iterator[str]:
    """Yield the existing files that a grammar or a plan references."""
    for word in set(_GRAMMAR.findall(text.decode('utf-8', 'replace'))):
        if any((place / word).is_file() for place in (folder, shared_folder() / 'grammars')):
            yield word


def _check_duration(duration: float, time_step: float, every: int) -> None:
    """Raise SceneError for runs [s] of no step, without a row of series, or of excess length."""
    if not time_step <= duration <= _LONGEST:
        raise SceneError(f'a run lasts {duration:g} s, it must be from one time step '
                         f'({time_step:g} s) to {_LONGEST:g} s')
    if (steps := round(duration / time_step)) < every:
        raise SceneError(f'--every {every}: no row is recorded, a run has {steps} time steps')


def _values(parameter: Parameter, given: str, text: str, scene: Mapping[str, Any]) -> list[Any]:
    """Read the text after the equals sign; `..` is a range unless the parameter is a string."""
    if '..' in given and _is_numeric(parameter):
        return _range(parameter, given, text, scene)
    try:
        values = yaml.load(given if given.startswith('[') else f'[{given}]', BoundedLoader)
    except (yaml.YAMLError, ValueError, RecursionError):
        raise SceneError(f'--vary {text[:99]}: cannot be read as YAML') from None
    return values if isinstance(values, list) else [values]


def _is_numeric(parameter: Parameter) -> bool:
    """Distinguish numbers and vectors from switches, strings, and lists of strings."""
    default = parameter.default
    return (isinstance(default, (int, float)) and not isinstance(default, bool)
            or isinstance(default, list) and not parameter.takes_any_length)


def _range(parameter: Parameter, given: str, text: str, scene: Mapping[str, Any]) -> list[Any]:
    """Return evenly spaced numbers or vectors."""
    vector = isinstance(parameter.default, list)
    example = '0..20/5, or [0, 0, 0]..[20, 0, 0]/5' if vector else '0..20/5'
    first, _, rest = given.partition('..')
    last, _, number = rest.partition('/')
    try:
        count = int(number)
        ends = np.array([[float(v) for v in end.strip().removeprefix('[').removesuffix(']')
                          .split(',')] for end in (first, last)])
    except ValueError:
        count, ends = -1, np.zeros((2, 0))
    if count < 0 or ends.shape[1] not in ({1, len(parameter.default)} if vector else {1}):
        raise SceneError(f'--vary {text}: say first..last/number, as in {example}') from None
    if count > _MOST:
        raise SceneError(f'--vary {text}: at most {_MOST} values are possible')
    steps = np.linspace(ends[0], ends[1], count)
    if vector:
        along = _direction(text, parameter, scene) if ends.shape[1] == 1 else 1.0
        return (steps * along).tolist()
    whole = isinstance(parameter.default, int)
    return [int(v) if whole and v.is_integer() else v for v in steps[:, 0].tolist()]


def _direction(text: str, parameter: Parameter, scene: Mapping[str, Any]) -> np.ndarray:
    """Return the direction of a vector of the scene, (D,)."""
    name, inner = text.partition('=')[0].strip(), scene
    *groups, key = name.split('.')
    for group in groups:
        inner = inner.get(group, {})
    vector = np.array(parameter.read(inner.get(key, parameter.default), name))
    length = float(norm(vector))
    if not length:
        raise SceneError(f'--vary {text}: {name} has no direction in the scene; say it there, or '
                         'vary vectors, as in [10, 0, 0]..[40, 0, 0]/4')
    return vector / length
