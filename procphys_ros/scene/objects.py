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

"""What a scene is asked to hold: the objects named by its parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
import math
import numbers
import re
from typing import Any

from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.scene.layout import LAYOUTS

MAX_COUNT = 100_000  # instances of one object; beyond it no machine would hold the parts
_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*\Z')
_DEFINE = re.compile(r'\s*([A-Za-z_]\w*)\s*=\s*([-+0-9.eE]+)\s*\Z')


@dataclass(frozen=True)
class ObjectSpec:
    """
    One object of a scene, as its parameters `<name>.…` describe it.

    :ivar name: instances are called after it.
    :ivar grammar: file that holds the grammar; empty when `grammar_text` is given.
    :ivar grammar_text: the grammar itself; empty when `grammar` is given.
    :ivar defines: values that override the grammar's own, as 'name=number'.
    :ivar count: number of instances; 0 = one, called by the bare name.
    :ivar layout: how instances are placed, one of `LAYOUTS`.
    :ivar spacing: distance between instances [m].
    :ivar origin: where the layout is centred [m], (3,).
    :ivar yaw: heading of every instance about the vertical [rad].
    :ivar seed: seed of the first instance; -1 = from the seed of the scene.
    :ivar variants: number of different individuals among the instances; 0 = all differ.
    """

    name: str
    grammar: str = ''
    grammar_text: str = ''
    defines: tuple[str, ...] = ()
    count: int = 0
    layout: str = 'grid'
    spacing: float = 8.0
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    yaw: float = 0.0
    seed: int = -1
    variants: int = 0

    @property
    def instance_names(self) -> list[str]:
        """Names of the instances, in part order."""
        if not self.count:
            return [self.name]
        return [f'{self.name}_{i}' for i in range(self.count)]

    @property
    def numbers(self) -> dict[str, float]:
        """Turn the defines into numbers by name."""
        return {m[1]: float(m[2]) for m in map(_DEFINE.match, self.defines) if m}


OBJECT_KEYS = tuple(f.name for f in fields(ObjectSpec) if f.name != 'name')


def read_objects(parameters: Mapping[str, Any]) -> list[ObjectSpec]:
    """
    Read the objects of a scene.

    :param parameters: nested mapping as a ROS parameter file holds it, with `scene.objects`.
    :raises SceneError: naming the key, the value and what is allowed.
    """
    scene = parameters.get('scene', {})
    names = scene.get('objects', []) if isinstance(scene, Mapping) else None
    if not isinstance(names, (list, tuple)) or not all(isinstance(n, str) for n in names):
        raise SceneError(f'scene.objects: {names!r} is not a list of names')
    names = [n for n in names if n]
    for name in names:
        if not _NAME.match(name):
            raise SceneError(f'scene.objects: {name!r} cannot name an object; use letters, '
                             'digits and _, beginning with a letter')
        if names.count(name) > 1:
            raise SceneError(f'scene.objects: "{name}" stands there twice')
    return [_read_object(name, parameters.get(name, {})) for name in names]


def _read_object(name: str, given: Any) -> ObjectSpec:
    if not isinstance(given, Mapping):
        raise SceneError(f'{name}: {given!r} is not a group of parameters '
                         f'({", ".join(OBJECT_KEYS)})')
    values = {}
    for key, value in given.items():
        if key not in _READERS:
            raise SceneError(f'{name}.{key}: there is no such key'
                             f'{nearest_names(str(key), OBJECT_KEYS)} '
                             f'(known: {", ".join(OBJECT_KEYS)})')
        values[key] = _READERS[key](f'{name}.{key}', value)
    spec = ObjectSpec(name=name, **values)
    if bool(spec.grammar) == bool(spec.grammar_text):
        raise SceneError(f'{name}: give either {name}.grammar (a file) or {name}.grammar_text '
                         '(the grammar itself)')
    return spec


def _text(key: str, value: Any) -> str:
    if not isinstance(value, str):
        raise SceneError(f'{key}: {value!r} is not a text')
    return value


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not math.isfinite(value):
        raise SceneError(f'{key}: {value!r} is not a finite number')
    return float(value)


def _positive(key: str, value: Any) -> float:
    number = _number(key, value)
    if number <= 0:
        raise SceneError(f'{key}: {number:g} is not above 0')
    return number


def _whole(lowest: int, highest: int):
    def read(key: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, numbers.Integral):
            raise SceneError(f'{key}: {value!r} is not a whole number')
        if not lowest <= int(value) <= highest:
            raise SceneError(f'{key}: {value} lies outside {lowest} … {highest}')
        return int(value)
    return read


def _vector(key: str, value: Any) -> tuple[float, ...]:
    items = list(value) if isinstance(value, (list, tuple)) or hasattr(value, 'tolist') else []
    if len(items) != 3:
        raise SceneError(f'{key}: {value!r} is not three numbers [x, y, z] in metres')
    return tuple(_number(key, item) for item in items)


def _defines(key: str, value: Any) -> tuple[str, ...]:
    items = value if isinstance(value, (list, tuple)) else None
    if items is None or not all(isinstance(item, str) for item in items):
        raise SceneError(f'{key}: {value!r} is not a list of texts such as ["storeys=3"]')
    for item in items:
        match = _DEFINE.match(item)
        try:
            valid = match is not None and math.isfinite(float(match[2]))
        except ValueError:
            valid = False
        if item and not valid:
            raise SceneError(f'{key}: {item!r} is not of the form name=number')
    return tuple(item for item in items if item)


def _layout(key: str, value: Any) -> str:
    if value not in LAYOUTS:
        raise SceneError(f'{key}: {value!r} is not known; use one of {", ".join(LAYOUTS)}')
    return value


_READERS = {
    'grammar': _text,
    'grammar_text': _text,
    'defines': _defines,
    'count': _whole(0, MAX_COUNT),
    'layout': _layout,
    'spacing': _positive,
    'origin': _vector,
    'yaw': _number,
    'seed': _whole(-1, 2**62),
    'variants': _whole(0, MAX_COUNT),
}
