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


"""Schema: settings declared once, where they are used; checks, parameters and tables follow."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
import numbers
import re
from typing import Any, ClassVar, Self

from procphys_ros.errors import nearest_names, ProcPhysError, SceneError

LARGEST = 1e9  # [any unit] larger values are mistakes
NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*\Z')  # of what parameters and topics are called after
_KEY = 'parameter'
_SWITCH = {True: 'on', False: 'off'}  # texts that YAML 1.1, and so ROS, reads as truth values


@dataclass(frozen=True)
class Parameter:
    """
    Setting of a scene, which is a parameter of the node.

    :ivar name: dotted; of an object's parameter the part behind `<name>.`.
    :ivar default: also sets the type: bool, int, float, str, list of floats or of str.
    :ivar description: for `ros2 param describe` and docs/parameters.md.
    :ivar unit: '' where there is none.
    :ivar low, high: least and largest number allowed.
    :ivar choices: texts allowed; () = any.
    :ivar read_only: fixed once the node runs.
    :ivar takes_effect: 'now', 'reload' (at ~/reload_scene) or 'use' (when next used).
    :ivar optional: the default stands for "not given".
    :ivar any_length: a list of numbers may be of any length, and one number is a list of one.
    """

    name: str
    default: Any
    description: str
    unit: str = ''
    low: float = -LARGEST
    high: float = LARGEST
    choices: tuple[str, ...] = ()
    read_only: bool = False
    takes_effect: str = 'now'
    optional: bool = False
    any_length: bool = False

    @property
    def takes_any_length(self) -> bool:
        """Return whether the parameter is a list of any length."""
        return isinstance(self.default, list) and (self.any_length or not self.default)

    def read(self, value: Any, name: str = '') -> Any:
        """
        Check a value and convert it to the parameter's type; integers are valid doubles.

        :param value: as given.
        :param name: full name for messages, when it is an object's parameter.
        :raises SceneError: naming the parameter, the value and what is allowed.
        """
        name = name or self.name
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise SceneError(f'{name} is {short(value)}, it must be true or false')
            return value
        if isinstance(self.default, (int, float)):
            return self._number(value, name)
        if isinstance(self.default, str):
            return self._text(value, name)
        items = list(value) if _is_sequence(value) else None
        if value is None and self.takes_any_length:  # as ROS reads an empty list of a file
            items = []
        if self.any_length:
            return [self._number(item, name) for item in ([value] if items is None else items)]
        if not self.takes_any_length:
            if items is None or len(items) != len(self.default):
                raise SceneError(f'{name} is {short(value)}, it must be a list of '
                                 f'{len(self.default)} numbers')
            return [self._number(item, name) for item in items]
        if items is None or not all(isinstance(item, str) for item in items):
            raise SceneError(f'{name} is {short(value)}, it must be a list of texts')
        return [item for item in items if item]

    def _number(self, value: Any, name: str) -> Any:
        whole = isinstance(self.default, int)
        kind = 'whole number' if whole else 'number'
        is_number = isinstance(value, numbers.Integral if whole else numbers.Real)
        if isinstance(value, bool) or not is_number:
            raise SceneError(f'{name} is {short(value)}, it must be a {kind}')
        if not self.low <= value <= self.high:
            unit = f' {self.unit}' if self.unit else ''
            shown = f'{float(value):g}' if abs(value) < 1e300 else short(value)
            raise SceneError(f'{name} is {shown}, it must be a {kind} from '
                             f'{self.low:g} to {self.high:g}{unit}')
        return int(value) if whole else float(value)

    def _text(self, value: Any, name: str) -> str:
        if isinstance(value, bool) and _SWITCH[value] in self.choices:
            return _SWITCH[value]
        if not isinstance(value, str):
            raise SceneError(f'{name} is {short(value)}, it must be a text')
        if self.choices and value not in self.choices:
            raise SceneError(f'{name} is {short(value)}, it must be one of '
                             f'{", ".join(self.choices)}')
        return value


def unknown_key(group: str, key: Any, known: Sequence[str]) -> SceneError:
    """Make the error for a key that a group does not have."""
    return SceneError(f'{group}.{short(str(key))[1:-1]}: there is no such key'
                      f'{nearest_names(str(key), known)} (known: {", ".join(known)})')


def _is_sequence(value: Any) -> bool:
    return (isinstance(value, Collection) and not isinstance(value, (str, Mapping))
            and getattr(value, 'shape', None) != ())


def short(value: Any) -> str:
    """Format a value for a message, shortened when it is long."""
    text = repr(list(value) if _is_sequence(value) else value)
    return text if len(text) <= 60 else f'{text[:57]}...'


def declared(default: Any, description: str, unit: str = '', low: float = -LARGEST,
             high: float = LARGEST, shown: Any = None, **about: Any) -> Any:
    """
    Declare a field of a dataclass of settings.

    :param default: of the field; a tuple where it is a list.
    :param description: of the parameter.
    :param shown: default of the parameter where that cannot be the field's own: it stands for "not
        given" if the field's is None, and for a list if that is one number.
    :param about: further fields of `Parameter`.
    """
    value = default if shown is None else shown
    parameter = Parameter('', list(value) if isinstance(value, tuple) else value, description,
                          unit, low, high, optional=default is None, **about)
    return field(default=default, metadata={_KEY: parameter})


class ParameterGroup:
    """
    Base of the frozen dataclasses of settings: checks declared fields while one is made.

    Meaning, unit and range of a field stand in its declaration only.

    :ivar group: what the names of its parameters begin with; '' = nothing.
    :ivar error: class of the exceptions.
    """

    group: ClassVar[str]
    error: ClassVar[type[ProcPhysError]]

    def __init_subclass__(cls, group: str = '',
                          error: type[ProcPhysError] = SceneError) -> None:
        cls.group, cls.error = group, error

    def __post_init__(self) -> None:
        self.check(self.group)

    def check(self, group: str) -> None:
        """
        Check the fields, and convert them to their types; None stays where it is the default.

        :param group: prefix of names in messages.
        :raises ProcPhysError: of the class `error`, naming parameter, value and what is allowed.
        """
        for parameter in parameters(type(self)):
            name = parameter.name.rpartition('.')[2]
            value = getattr(self, name)
            if value is None and parameter.optional:
                continue
            try:
                value = parameter.read(value, f'{group}.{name}' if group else name)
            except SceneError as problem:
                raise self.error(str(problem)) from None
            object.__setattr__(self, name, tuple(value) if isinstance(value, list) else value)

    @classmethod
    def read(cls, parameters: Mapping[str, Any]) -> Self:
        """
        Read the group from nested parameters; what is not given has its default.

        :raises SceneError: naming the key and what is allowed; else as `check`.
        """
        given = parameters.get(cls.group, {})
        known = [f.name for f in fields(cls)]  # type: ignore[arg-type]
        if not isinstance(given, Mapping):
            raise SceneError(f'{cls.group} is {given!r}, it must be a group of {", ".join(known)}')
        for key in given:
            if key not in known:
                raise unknown_key(cls.group, key, known)
        return cls(**given)


def parameters(kind: type[ParameterGroup], **about: Any) -> tuple[Parameter, ...]:
    """
    Return the parameters that the fields of a group declare, in their order.

    :param about: fields of `Parameter` that all have in common, such as `takes_effect`.
    """
    prefix = f'{kind.group}.' if kind.group else ''
    return tuple(replace(f.metadata[_KEY], name=prefix + f.name, **about)
                 for f in fields(kind) if _KEY in f.metadata)  # type: ignore[arg-type]


def read_words(words: Sequence[str], kind: Any) -> dict[str, Any]:
    """
    Read name=value words in the types of the fields of a dataclass that they set.

    :raises SceneError: naming the word.
    """
    known = {f.name: f.default for f in fields(kind)}
    values: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition('=')
        if not equals or name not in known:
            raise SceneError(f'"{clip(word)}" sets nothing{nearest_names(name[:99], known)} '
                             f'(known: {", ".join(f"{k}=" for k in known)})')
        if name in values:
            raise SceneError(f'"{clip(word)}": "{name}" stands there twice')
        values[name] = value if isinstance(known[name], str) else _numbers(word, value)
        if type(known[name]) is int and isinstance(values[name], float):
            values[name] = int(values[name]) if values[name].is_integer() else values[name]
    return values


def _numbers(word: str, value: str) -> float | list[float]:
    try:
        found = [float(v) for v in value.split(',')]
    except ValueError:
        raise SceneError(f'"{clip(word)}": numbers are expected, several with commas between '
                         'them and no spaces') from None
    return found[0] if len(found) == 1 else found


def clip(text: str) -> str:
    """Shorten a text for a message when it is long."""
    return text if len(text) <= 80 else f'{text[:77]}...'
