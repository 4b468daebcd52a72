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

"""Read the parameters of the node from a ROS parameter file, without ROS."""

from collections.abc import Callable, Hashable, Mapping
import math
from pathlib import Path
import re
from typing import Any, TypeVar

import yaml

from procphys_ros.errors import SceneError
from procphys_ros.language import shorten
from procphys_ros.schema import short

_T = TypeVar('_T')
_LONGEST = 10_000_000  # characters of a file; a scene of 100,000 objects has as many
_ENDLESS = 'it is nested too deep, or contains itself'
# Words that are no texts, as ROS reads them, and how they begin. YAML 1.1 has 1e3 for a text, but
# neither 1_000 nor 1:30. Whole numbers come first: they fit the rule of the others, too.
_WORDS = {
    'bool': (r'(?:y|Y|yes|Yes|YES|true|True|TRUE|on|On|ON'
             r'|n|N|no|No|NO|false|False|FALSE|off|Off|OFF)\Z', 'yYtToOnNfF'),
    'int': (r'[-+]?(?:0x[0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)\Z', '-+0123456789'),
    'float': (r'(?:[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?'
              r'|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z', '-+.0123456789')}
_NODE_KEYS = ('/**', '/*', 'sim', '/sim')  # sections that apply to a node called sim


class BoundedLoader(yaml.SafeLoader):
    """
    Reads numbers as ROS does, and refuses a document that is too long with its aliases expanded.

    A few lines of nested aliases expand to billions of values, which would keep every reader
    busy.
    """

    yaml_implicit_resolvers = {
        first: [(tag, form) for tag, form in known
                if tag.rpartition(':')[2] not in (*_WORDS, 'timestamp')]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()}
    bool_values = {**yaml.SafeLoader.bool_values, 'y': True, 'n': False}

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None and (length := _length(node, {})) > _LONGEST:
            raise yaml.MarkedYAMLError(
                problem=_ENDLESS if length == math.inf else
                f'with its aliases written out it has more than {_LONGEST} characters',
                problem_mark=node.start_mark)
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            raise yaml.MarkedYAMLError(
                problem=f'the value is no {node.tag.rpartition(":")[2]}',
                problem_mark=node.start_mark) from error


for _kind, (_form, _firsts) in _WORDS.items():
    BoundedLoader.add_implicit_resolver(f'tag:yaml.org,2002:{_kind}', re.compile(_form),
                                        list(_firsts))


def _length(node: yaml.Node, known: dict[yaml.Node, float]) -> float:
    """Compute the least number of characters that a node takes without aliases."""
    if node not in known:
        known[node] = math.inf  # for a node that contains itself
        inner = (node.value if isinstance(node, yaml.SequenceNode) else
                 [each for pair in node.value for each in pair]
                 if isinstance(node, yaml.MappingNode) else [])
        known[node] = (sum(_length(each, known) for each in inner)
                       + (1 if inner else len(node.value)) + 1)
    return known[node]


class _Loader(BoundedLoader):
    """
    Reads names of parameters as ROS does: `on` is a name, not a truth value of YAML 1.1.

    A name that stands twice in a group is refused: one of its values would be lost.
    """

    def construct_mapping(self, node: yaml.MappingNode,
                          deep: bool = False) -> dict[Hashable, Any]:
        known = set()
        for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if key.tag == 'tag:yaml.org,2002:bool':
                key.tag = 'tag:yaml.org,2002:str'
            if isinstance(key, yaml.ScalarNode):
                if key.value in known:
                    raise yaml.MarkedYAMLError(
                        problem=f'"{shorten(key.value)}" stands there twice',
                        problem_mark=key.start_mark)
                known.add(key.value)
        return super().construct_mapping(node, deep)


def read_yaml(path: str | Path) -> dict[str, Any]:
    """
    Read the parameters that a parameter file holds for the node `sim`.

    :param path: the file.
    :returns: nested mapping; dotted keys are expanded to nested ones.
    :raises SceneError: when the file is missing, not YAML, or holds nothing for the node.
    """
    if not isinstance(path, str | Path):
        raise SceneError(f'{short(path)} is not the path of a scene file')
    document = parsed(Path(path), lambda text: yaml.load(text, _Loader))
    sections = [document[key]['ros__parameters'] for key in _NODE_KEYS
                if isinstance(document, Mapping) and isinstance(document.get(key), Mapping)
                and isinstance(document[key].get('ros__parameters'), Mapping)]
    if not sections:
        raise SceneError(f'{path}: no parameters for the node; the file must begin with '
                         '"/**:" (or "sim:") and "ros__parameters:" below it')
    merged: dict[str, Any] = {}
    try:
        for section in sections:
            _merge(merged, section, '', set())
    except SceneError as error:
        raise SceneError(f'{path}: {error}') from None
    except RecursionError:
        raise SceneError(f'{path}: {_ENDLESS}') from None
    return merged


def parsed(path: Path, parse: Callable[[str], _T]) -> _T:
    """
    Read a file with a parser of YAML.

    :param parse: converts the text to its content.
    :raises SceneError: when it cannot be read or has values that YAML forbids, with the place.
    """
    try:
        with path.open(encoding='utf-8') as file:
            text = file.read(_LONGEST + 1)
        if len(text) > _LONGEST:
            raise SceneError(f'{path}: it has more than {_LONGEST} characters')
        return parse(text)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'it is not UTF-8 text'
        raise SceneError(f'{path}: cannot be read: {reason}') from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f':{mark.line + 1}:{mark.column + 1}' if mark else ''
        raise SceneError(f'{path}{place}: not valid YAML: {error.problem}') from error
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a day such as 2026-02-30
        raise SceneError(f'{path}: not valid YAML: {str(error).splitlines()[0]}') from error
    except RecursionError:
        raise SceneError(f'{path}: {_ENDLESS}') from None


def _merge(into: dict[str, Any], section: Mapping[str, Any], prefix: str,
           given: set[str]) -> None:
    """
    Expand dotted keys.

    :param into: to be extended; a later section replaces the values of earlier ones.
    :param prefix: of the keys in front of their full names.
    :param given: full names of the values of this section so far.
    """
    for key, value in section.items():
        name = f'{prefix}{key}'
        *groups, last = str(key).split('.')
        target = into
        for group in groups:
            inner = target.setdefault(group, {})
            if not isinstance(inner, dict):
                raise SceneError(f'{name}: "{group}" is both a value and a group')
            target = inner
        if isinstance(value, Mapping):
            inner = target.setdefault(last, {})
            if not isinstance(inner, dict):
                raise SceneError(f'{name}: it is both a value and a group')
            _merge(inner, value, f'{name}.', given)
        elif isinstance(target.get(last), dict):
            raise SceneError(f'{name}: it is both a value and a group')
        elif name in given:
            raise SceneError(f'"{shorten(name)}" stands there twice')
        else:
            given.add(name)
            target[last] = value
