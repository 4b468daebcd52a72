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

"""Unused parameters of a scene file: an error in a known group, otherwise a warning."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.scene.parameter_table import (
    check_object_names,
    find,
    GLOBAL,
    GROUPS,
    is_of_an_object,
    OBJECT,
)
from procphys_ros.schema import short, unknown_key

_OF_EVERY_NODE = ('use_sim_time', 'start_type_description_service', 'qos_overrides')


def check_given(parameters: Mapping[str, Any], objects: Sequence[str]) -> list[str]:
    """
    Check all parameters of a scene file by the table; return messages on unused ones.

    Files may hold parameters of other nodes, so names outside the node's groups are not errors.

    :param parameters: nested mapping as a ROS parameter file holds it.
    :param objects: names of the objects of the scene.
    :raises SceneError: naming the key and what is allowed, for one in a group of the node's own.
    """
    check_object_names(list(objects))
    unknown = []
    for name, value in flat(parameters):
        parameter = find(name, list(objects))
        if parameter is not None:
            if value is not None or not parameter.optional:
                parameter.read(value, name)
            continue
        group, _, key = name.partition('.')
        if group in GROUPS:
            _refuse(group, key, parameters[group])
        unknown.append(name)
    return unused(unknown, objects)


def unused(names: Iterable[str], objects: Sequence[str]) -> list[str]:
    """
    Format messages on unused parameters.

    :param names: full names of those that the table does not have, or not for these objects.
    :param objects: names of the objects of the scene.
    """
    names = [name for name in sorted(names) if name.partition('.')[0] not in _OF_EVERY_NODE]
    absent = {name.partition('.')[0] for name in names if is_of_an_object(name)} - {*objects}
    known = [p.name for p in GLOBAL] + [f'{o}.{p.name}' for o in objects for p in OBJECT]
    unknown = [f'{short(name)[1:-1]}{nearest_names(name, known)}' for name in names
               if name.partition('.')[0] not in absent]
    others = any(name.partition('.')[0] not in {*GROUPS, *objects, *absent} for name in names)
    return [text for text, found in (
        (f'parameters of {", ".join(sorted(absent))} are not used, scene.objects does not '
         'name them', absent),
        (f'there is no parameter {", no ".join(unknown)}' + (
            f' (they begin with {", ".join(sorted(GROUPS))}, or a name of scene.objects)'
            if others else ''), unknown)) if found]


def flat(parameters: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Flatten nested parameters: yield full names and values."""
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            yield from flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def _refuse(group: str, key: str, value: Any) -> None:
    """Raise SceneError for an unknown key of a group, or for a value in place of a group."""
    single = find(group, [])
    if single is not None:
        single.read(value, group)
    known = [p.name.partition('.')[2] for p in GLOBAL if p.name.startswith(f'{group}.')]
    if not key:
        raise SceneError(f'{group} is {short(value)}, it must be a group of {", ".join(known)}')
    raise unknown_key(group, key, known)
