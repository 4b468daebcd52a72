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

"""Objects named in the parameters of a scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
import math
import re
from typing import Any

from procphys_ros.errors import SceneError
from procphys_ros.scene.layout import LAYOUTS
from procphys_ros.schema import declared, NAME, ParameterGroup, unknown_key

_SCENE_KEYS = ('objects', 'cues')
MAX_COUNT = 100_000  # instances of one object; beyond it no machine would hold the parts
MAX_STEPS = 10_000  # derivation steps
_DEFINE = re.compile(r'\s*([A-Za-z_]\w*)\s*=\s*([-+0-9.eE]+)\s*\Z')


@dataclass(frozen=True)
class ObjectSpec(ParameterGroup):
    """
    One object of a scene, as its parameters `<name>.…` describe it.

    :ivar name: instances are called after it.
    """

    name: str
    grammar: str = declared(
        '', 'file in grammars/, a path, or package://procphys_ros/…; or a scanned tree, a plan '
        'of a street, or a map')
    grammar_text: str = declared('', 'the grammar itself, instead of a file')
    defines: tuple[str, ...] = declared(
        (), 'values that override the grammar\'s own, as "name=number"')
    count: int = declared(0, 'instances, called oak_0, oak_1, …; 0 = one, called oak', '',
                          0, MAX_COUNT)
    layout: str = declared('grid', 'how instances are placed', choices=LAYOUTS)
    spacing: float = declared(8.0, 'distance between instances', 'm', 1e-3, 1e5)
    origin: tuple[float, ...] = declared(
        (0.0, 0.0, 0.0), 'where the layout is centred; z counts from the ground', 'm', -1e6, 1e6)
    on: str = declared(
        '', 'object, listed before it, that it stands on and is bonded to; z counts from its top')
    tied_to: str = declared(
        '', 'object, listed before it, to whose branches its ropes to the ground are tied instead')
    yaw: float = declared(
        0.0, 'turn of the whole layout about `origin`, and with it of every instance', 'rad',
        -1e3, 1e3)
    seed: int = declared(-1, 'seed of the first instance; -1 = from the seed of the scene', '',
                         -1, 2**62)
    variants: int = declared(0, 'different individuals among the instances; 0 = all differ', '',
                             0, MAX_COUNT)
    rules: str = declared('', 'file that says which grammars the buildings and trees of a map '
                          'take; none = map.rules of the package')
    steps: int = declared(-1, 'derivation steps of its L-system, a year each, so that plants can '
                          'begin young and grow on; -1 = as the grammar says', '', -1, MAX_STEPS)

    def __post_init__(self) -> None:
        self.check(self.name)
        read_defines(self.defines, f'{self.name}.defines')
        if bool(self.grammar) == bool(self.grammar_text):
            raise SceneError(f'{self.name}: give either {self.name}.grammar (a file) or '
                             f'{self.name}.grammar_text (the grammar itself)')

    @property
    def instance_names(self) -> list[str]:
        """Names of the instances, in part order."""
        if not self.count:
            return [self.name]
        return [f'{self.name}_{i}' for i in range(self.count)]

    @property
    def length(self) -> int | None:
        """Return the number of derivation steps; None = as the grammar says."""
        return None if self.steps < 0 else self.steps

    @property
    def numbers(self) -> dict[str, float]:
        """Parse the defines to numbers by name."""
        return read_defines(self.defines, f'{self.name}.defines')


def read_defines(defines: Sequence[str], key: str) -> dict[str, float]:
    """
    Parse defines to numbers by name.

    :param defines: each as 'name=number'.
    :param key: of the parameter, for messages.
    :raises SceneError: when one is not of that form, or two have the same name.
    """
    numbers = {}
    for text in defines:
        match = _DEFINE.match(text)
        try:
            value = float(match[2]) if match else math.nan
        except ValueError:
            value = math.nan
        if match is None or not math.isfinite(value):
            raise SceneError(f'{key}: {text!r} is not of the form name=number')
        if match[1] == 'seed':
            raise SceneError(f'{key}: a grammar has no value "seed"; it is a parameter beside '
                             f'{key}')
        if match[1] in numbers:
            raise SceneError(f'{key}: "{match[1]}" stands there twice')
        numbers[match[1]] = value
    return numbers


OBJECT_KEYS = tuple(f.name for f in fields(ObjectSpec) if f.name != 'name')


def read_objects(parameters: Mapping[str, Any]) -> list[ObjectSpec]:
    """
    Read the objects of a scene.

    :param parameters: nested mapping as a ROS parameter file holds it, with `scene.objects`.
    :raises SceneError: naming the key, the value and what is allowed.
    """
    scene = parameters.get('scene', {})
    if isinstance(scene, Mapping):
        for key in scene:
            if key not in _SCENE_KEYS:
                raise unknown_key('scene', key, _SCENE_KEYS)
    names = scene.get('objects', []) if isinstance(scene, Mapping) else None
    if not isinstance(names, (list, tuple)) or not all(isinstance(n, str) for n in names):
        raise SceneError(f'scene.objects: {names!r} is not a list of names')
    names = [n for n in names if n]
    for name in names:
        if not NAME.match(name):
            raise SceneError(f'scene.objects: {name!r} cannot name an object; use letters, '
                             'digits and _, beginning with a letter')
        if names.count(name) > 1:
            raise SceneError(f'scene.objects: "{name}" stands there twice')
    return [_read_object(name, parameters.get(name, {})) for name in names]


def _read_object(name: str, given: Any) -> ObjectSpec:
    if not isinstance(given, Mapping):
        raise SceneError(f'{name}: {given!r} is not a group of parameters '
                         f'({", ".join(OBJECT_KEYS)})')
    for key in given:
        if key not in OBJECT_KEYS:
            raise unknown_key(name, key, OBJECT_KEYS)
    return ObjectSpec(name=name, **given)
