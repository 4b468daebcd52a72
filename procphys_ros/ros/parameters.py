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


"""Declare the parameters on a node, check every change, and hold their present values."""

from collections.abc import Callable, Mapping
from dataclasses import replace
import sys
from types import MappingProxyType
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.ros.commands import describe, shortened
from procphys_ros.ros.file_access import bounds_at_start
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.parameter_table import (
    check_object_names,
    find,
    GLOBAL,
    nested,
    OBJECT,
    Parameter,
)
from procphys_ros.scene.settings import read_settings
from procphys_ros.scene.unused import flat, unused
from procphys_ros.scene.yaml_file import read_yaml


class UnknownParameterError(ParameterNotDeclaredException):
    """
    A change of parameters that do not exist; rclpy itself loses the name of the first one.

    :param message: with the names.
    """

    def __init__(self, message: str):
        Exception.__init__(self, message)


class Parameters:
    """
    Store the node's parameters with their present values, checked and in the types of the table.

    Types are declared dynamic and checked here, because a statically typed double refuses an
    integer (`wind.velocity: [5, 0, 0]` would stop the node). Changes replace the values as a
    whole, so another thread may read them at any time.

    :param node: the node that declares them.
    :ivar bounds: of the files that they may name.
    :ivar is_demo: whether no scene was given, so that the parameters are those of the demo.
    :raises SceneError: if a value given at start is not allowed.
    """

    def __init__(self, node: Node):
        self._node = node
        self._values: dict[str, Any] = {}
        self._objects: list[str] = []
        # Rows and values of objects in a change, which are not declared yet.
        self._joining: dict[str, tuple[Parameter, Any]] = {}
        self._on_change: Callable[[set[str]], None] = lambda names: None
        self._defaults = {} if 'scene.objects' in node._parameter_overrides else demo()
        self.is_demo = bool(self._defaults)
        for parameter in GLOBAL:
            self._declare(parameter, parameter.name)
        self._declare_objects({})
        _check_groups(self.nested())
        self.bounds = bounds_at_start(self._values['files.root'], self.given(), sys.argv)
        node.add_pre_set_parameters_callback(self._prepare)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take_over)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def on_change(self, callback: Callable[[set[str]], None]) -> None:
        """Register a function called with the names of changed parameters."""
        self._on_change = callback

    def nested(self) -> dict[str, Any]:
        """Return the present values as read by `Scene.from_parameters`."""
        return nested(self._values, self._objects)

    def tell(self, name: str, value: Any) -> None:
        """Set a parameter to the value in effect, without a call of the change function."""
        on_change, self._on_change = self._on_change, lambda names: None
        self._node.set_parameters([RosParameter(name, value=value)])
        self._on_change = on_change

    def given(self) -> dict[str, Any]:
        """Return the values that ROS was given at start."""
        return {name: given.value for name, given in self._node._parameter_overrides.items()}

    def unused_overrides(self) -> list[str]:
        """Describe in few lines the values given at start that belong to no parameter."""
        return unused((name for name, value in self.given().items()
                       if value is not None and name not in self._values), self._objects)

    def _declare(self, parameter: Parameter, name: str,
                 given: Mapping[str, Any] = MappingProxyType({})) -> None:
        default = given.get(name, self._defaults.get(name, parameter.default))
        writable = _descriptor(replace(parameter, read_only=False))
        declared = self._node.declare_parameter(name, default, writable, name in given)
        value = parameter.read(declared.value, name)
        self._values = {**self._values, name: value}
        if not value and parameter.takes_any_length:  # rclpy cannot infer the type of its items
            self._node.set_parameters([_typed(parameter, name)])
        if parameter.read_only:
            self._node.set_descriptor(name, _descriptor(parameter))

    def _declare_objects(self, given: Mapping[str, Any]) -> None:
        """
        Declare the parameters of new objects in `scene.objects`.

        :param given: values, by full name, from the same change.
        """
        check_object_names(self._values['scene.objects'])
        for name in self._values['scene.objects']:
            if name not in self._objects:
                self._objects = [*self._objects, name]
                for parameter in OBJECT:
                    self._declare(parameter, f'{name}.{parameter.name}', given)

    def _prepare(self, changes: list[RosParameter]) -> list[RosParameter]:
        """
        Accept an empty list in any form: tools send no value, or no type.

        Parameters of new objects in the same change are stored, and declared with their values
        when the change has been accepted.

        :raises UnknownParameterError: if there is no such parameter.
        """
        objects = [*self._objects, *_new_objects(changes)]
        absent = [c for c in changes if not self._node.has_parameter(c.name)]
        self._joining = {c.name: (row, [] if _is_empty(c.value) else c.value) for c in absent
                         if (row := find(c.name, objects)) is not None}
        unknown = [c.name for c in absent if c.name not in self._joining]
        if unknown:
            raise UnknownParameterError(shortened('; '.join(unused(unknown, objects))
                                                  or f'there is no parameter {unknown[0]}'))
        typed = []
        for change in changes:
            if change.name in self._joining:
                continue
            parameter = find(change.name, self._objects)
            if parameter is not None and parameter.takes_any_length and _is_empty(change.value):
                change = _typed(parameter, change.name)
            typed.append(change)
        return typed

    def _check(self, changes: list[RosParameter]) -> SetParametersResult:
        """Validate changes without side effects; foreign parameters are accepted."""
        own = [(change, parameter) for change in changes
               if (parameter := find(change.name, self._objects)) is not None]
        if not own:  # such as the dozens for qualities of service, which rclpy declares
            return SetParametersResult(successful=True)
        try:
            values = dict(self._values)
            for change, parameter in own:
                values[change.name] = parameter.read(change.value, change.name)
            check_object_names(values['scene.objects'])
            for name, (row, value) in self._joining.items():
                row.read(value, name)
            _check_groups(nested(values, self._objects))
        except Exception as error:
            return SetParametersResult(successful=False, reason=shortened(describe(error)))
        return SetParametersResult(successful=True)

    def _take_over(self, changes: list[RosParameter]) -> None:
        """Store accepted changes, and notify the listener."""
        values = dict(self._values)
        for change in changes:
            parameter = find(change.name, self._objects)
            if parameter is not None and change.name in values:
                values[change.name] = parameter.read(change.value, change.name)
        names = {change.name for change in changes} & values.keys()
        self._values = values
        if 'scene.objects' in names:
            self._declare_objects({name: value for name, (_, value) in self._joining.items()})
        if names:
            self._on_change(names)


def _check_groups(values: Mapping[str, Any]) -> None:
    """Raise SceneError if individually valid values are invalid together."""
    carriers = (INTRUDER, *read_settings(values).intruders.names)
    carrier = LidarSettings.read(values).attached_to
    if carrier and carrier not in carriers:
        raise SceneError(f'lidar.attached_to: there is no intruder "{carrier}"'
                         f'{nearest_names(carrier, carriers)}')


def demo() -> dict[str, Any]:
    """Return the parameters of the demo by their full names."""
    return dict(flat(read_yaml(shared_folder() / 'config' / 'demo.yaml')))


def _new_objects(changes: list[RosParameter]) -> list[str]:
    """Return the names of objects in a change of several parameters."""
    values = next((c.value for c in changes if c.name == 'scene.objects'), None)
    return [v for v in values if isinstance(v, str)] if isinstance(values, (list, tuple)) else []


def _is_empty(value: Any) -> bool:
    return value is None or (not isinstance(value, str) and hasattr(value, '__len__')
                             and len(value) == 0)


def _typed(parameter: Parameter, name: str) -> RosParameter:
    """Make an empty list with the type of its items."""
    of_numbers, of_texts = RosParameter.Type.DOUBLE_ARRAY, RosParameter.Type.STRING_ARRAY
    return RosParameter(name, of_numbers if parameter.any_length else of_texts, [])


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    unit = f' [{parameter.unit}]' if parameter.unit else ''
    when = {'now': '', 'reload': '; takes effect at ~/reload_scene', 'use': ''}
    descriptor = ParameterDescriptor(
        description=f'{parameter.description}{unit}{when[parameter.takes_effect]}',
        additional_constraints=f'one of {", ".join(parameter.choices)}'
        if parameter.choices else '',
        read_only=parameter.read_only, dynamic_typing=True)
    if type(parameter.default) is float:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
    elif type(parameter.default) is int:
        descriptor.integer_range = [
            IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high), step=0)]
    return descriptor
