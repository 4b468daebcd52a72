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

"""Map rules: which grammars the buildings and trees of a map take, and how wide its roads are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from procphys_ros.scene.keys import Keys
from procphys_ros.scene.yaml_file import BoundedLoader, parsed

_BUILDING = ('tags', 'grammar', 'defines', 'storey_height')
_TREE = ('tags', 'grammar', 'defines')
_ROAD = ('tags', 'width', 'surface', 'pavement', 'pavement_surface')
_NONE = 'none'  # grammar of what is left out


@dataclass(frozen=True)
class MapRule:
    """
    Rule for features of a map; of those of its kind the first that fits counts.

    :ivar tags: values that each of these keys may have; none = any.
    :ivar grammar: file, '' = left out.
    :ivar defines: least, largest value and step of each define.
    :ivar storey_height: where the map does not tell [m]; 0 = that of the grammar.
    :ivar width: of roads, where the map does not tell [m].
    :ivar surface: texture of the road; '' = none.
    :ivar pavement: width of those on both sides [m].
    :ivar pavement_surface: their texture.
    """

    tags: Mapping[str, tuple[str, ...]]
    grammar: str = ''
    defines: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    storey_height: float = 0.0
    width: float = 0.0
    surface: str = ''
    pavement: float = 0.0
    pavement_surface: str = 'paving'

    def fits(self, tags: Mapping[str, str]) -> bool:
        """Return whether a feature with these tags takes this rule."""
        return all(key in tags and (not values or tags[key] in values)
                   for key, values in self.tags.items())


@dataclass(frozen=True)
class MapRules:
    """Rules for each kind of feature, in order."""

    building: Sequence[MapRule]
    tree: Sequence[MapRule]
    road: Sequence[MapRule]

    def of(self, kind: str, tags: Mapping[str, str]) -> MapRule | None:
        """Return the rule for a feature; None = it is left out."""
        return next((rule for rule in getattr(self, kind) if rule.fits(tags)), None)


def read_rules(path: Path) -> MapRules:
    """
    Read map rules.

    :raises SceneError: naming file, line, key and what is allowed.
    """
    root = parsed(path, lambda text: yaml.compose(text, BoundedLoader))
    top = Keys(root, str(path), ('buildings', 'trees', 'roads'))
    return MapRules(
        [_grown(Keys(node, str(path), _BUILDING), '.wall') for node in top.items('buildings')],
        [_grown(Keys(node, str(path), _TREE), '') for node in top.items('trees')],
        [_road(Keys(node, str(path), _ROAD)) for node in top.items('roads')])


def _grown(keys: Keys, ending: str) -> MapRule:
    """Read a rule of a building or a tree."""
    name = keys.value('grammar')
    if name == _NONE:
        return MapRule(_tags(keys))
    name = keys.names('grammar')[0]
    if ending and not name.endswith(ending):
        raise keys.error('grammar', f'is {name!r}, it must be a file that ends in {ending}, or '
                         f'{_NONE}')
    height = keys.number('storey_height', 0.0, 100.0, 0.0) if ending else 0.0
    return MapRule(_tags(keys), name, keys.ranges('defines'), height)


def _road(keys: Keys) -> MapRule:
    return MapRule(_tags(keys), width=keys.number('width', 0.1, 200.0),
                   surface=keys.texture('surface', ''),
                   pavement=keys.number('pavement', 0.0, 50.0, 0.0),
                   pavement_surface=keys.texture('pavement_surface', 'paving'))


def _tags(keys: Keys) -> dict[str, tuple[str, ...]]:
    """Read tags: a text, a list of texts, or [] for any value."""
    given: Any = keys.value('tags', {})
    if not isinstance(given, dict):
        raise keys.error('tags', f'is {given!r}, it must be {{key: value, …}}')
    found = {}
    for key, values in given.items():
        values = values if isinstance(values, list) else [values]
        if not all(isinstance(value, str) for value in values):
            raise keys.error('tags', f'has {key}: {values!r}, it must be a text in quotes, or a '
                             'list of these')
        found[str(key)] = tuple(values)
    return found
