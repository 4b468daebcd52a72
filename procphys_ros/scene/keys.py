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


"""Keys: mappings of YAML files whose values are read by key, checked and named in errors."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np
import yaml

from procphys_ros.appearance.palette import is_known, LOOKS
from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.scene.sources import GRAMMARS
from procphys_ros.scene.yaml_file import BoundedLoader


class Keys:
    """Mapping of a YAML file, whose values are read by key and checked."""

    def __init__(self, node: Any, file: str, known: Sequence[str]):
        self.where = f'{file}:{node.start_mark.line + 1}' if node is not None else file
        self._file = file
        self._nodes: dict[Any, Any] = {}
        if not isinstance(node, yaml.MappingNode):
            raise SceneError(f'{self.where}: keys with values are expected ({", ".join(known)})')
        for key, value in node.value:
            if key.value not in known:
                raise SceneError(f'{file}:{key.start_mark.line + 1}: there is no key '
                                 f'"{key.value}"{nearest_names(str(key.value), known)} (known: '
                                 f'{", ".join(known)})')
            if key.value in self._nodes:
                raise SceneError(f'{file}:{key.start_mark.line + 1}: {key.value} stands there '
                                 'twice')
            self._nodes[key.value] = value

    def error(self, key: str, text: str) -> SceneError:
        node = self._nodes.get(key)
        where = f'{self._file}:{node.start_mark.line + 1}' if node is not None else self.where
        return SceneError(f'{where}: {key} {text}')

    def value(self, key: str, default: Any = None) -> Any:
        if key not in self._nodes:
            if default is None:
                raise SceneError(f'{self.where}: {key} is missing')
            return default
        loader = BoundedLoader('')
        try:
            return loader.construct_document(self._nodes[key])
        except (yaml.YAMLError, ValueError, RecursionError):
            raise self.error(key, 'cannot be read') from None

    def number(self, key: str, low: float, high: float, default: float | None = None) -> float:
        value = self.value(key, default)
        if (isinstance(value, bool) or not isinstance(value, int | float)
                or not low <= value <= high):
            raise self.error(key, f'is {value!r}, it must be a number from {low:g} to {high:g}')
        return float(value)

    def count(self, key: str, most: int) -> int:
        value = self.value(key)
        if type(value) is not int or not 1 <= value <= most:
            raise self.error(key, f'is {value!r}, it must be a whole number from 1 to {most}')
        return value

    def point(self, key: str) -> np.ndarray:
        value = self.value(key)
        if not _are_numbers(value, (2,)):
            raise self.error(key, f'is {value!r}, it must be two numbers, [x, y]')
        return np.array(value, float)

    def choice(self, key: str, known: Sequence[str]) -> str:
        value = self.value(key)
        if value not in known:
            raise self.error(key, f'is {value!r}, it must be one of {", ".join(known)}'
                             f'{nearest_names(str(value), known)}')
        return str(value)

    def texture(self, key: str, default: str) -> str:
        value = self.value(key, default)
        if value != default and not (isinstance(value, str) and is_known(value)):
            raise self.error(key, f'is {value!r}, it must be a texture, such as asphalt, cobbles, '
                             f'gravel, paving or concrete{nearest_names(str(value), LOOKS)}')
        return str(value)

    def names(self, key: str) -> tuple[str, ...]:
        value = self.value(key)
        value = [value] if isinstance(value, str) else value
        if not isinstance(value, list) or not value or not all(
                isinstance(name, str) and name.endswith(GRAMMARS) for name in value):
            raise self.error(key, f'is {value!r}, it must name files that end in '
                             f'{", ".join(GRAMMARS)}')
        return tuple(value)

    def ranges(self, key: str) -> dict[str, tuple[float, float, float]]:
        value = self.value(key, {})
        if not isinstance(value, dict):
            raise self.error(key, f'is {value!r}, it must be {{name: value, …}}')
        found = {}
        if 'seed' in value:
            raise self.error(key, 'has a value "seed", which no grammar has; each takes its own '
                             'from the seed of the plan')
        for name, given in value.items():
            given = [given, given] if _are_numbers([given], (1,)) else given
            if not _are_numbers(given, (2, 3)) or given[0] > given[1] or min(given[2:] or [0]) < 0:
                raise self.error(key, f'has {name}: {given!r}, it must be a number, [least, '
                                 'largest] or [least, largest, step]')
            found[str(name)] = (float(given[0]), float(given[1]), float((given[2:] or [0])[0]))
        return found

    def mapping(self, key: str) -> list[tuple[str, Any]]:
        node = self._nodes.get(key)
        if not isinstance(node, yaml.MappingNode) or not node.value:
            raise self.error(key, 'must name streets, as {high: {from: [0, 0], to: [90, 0]}}')
        named = [(str(name.value), value) for name, value in node.value]
        for place, (name, value) in enumerate(named):
            if name in dict(named[:place]):
                raise SceneError(f'{self._file}:{value.start_mark.line + 1}: {name} stands there '
                                 'twice')
        return named

    def items(self, key: str) -> list[Any]:
        node = self._nodes.get(key)
        if node is None:
            return []
        if not isinstance(node, yaml.SequenceNode):
            raise self.error(key, 'must be a list of rows, each in its "- {…}"')
        return list(node.value)


def draw_defines(ranges: Mapping[str, tuple[float, float, float]],
                 rng: np.random.Generator) -> dict[str, float]:
    """Draw a value of each define between its least and its largest one, in steps if not 0."""
    values = {}
    for name, (low, high, step) in ranges.items():
        value = rng.uniform(low, high)
        if step:  # never beyond the largest, where that is not a whole number of steps
            most = math.floor((high - low) / step + 1e-9)
            value = low + step * min(round((value - low) / step), most)
        values[name] = value
    return values


def _are_numbers(value: Any, counts: Sequence[int]) -> bool:
    return isinstance(value, list) and len(value) in counts and all(
        isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e300
        for v in value)
