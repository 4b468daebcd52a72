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


"""
Records: objects of a state as tables of plain fields and arrays, and back.

A record names no class. Which class an object has follows from where it is found: the class around
it declares it as the type of that field. So reading makes what these classes declare and nothing
else, and runs no code of theirs but `__setstate__`. Fields without objects in them need no
declaration.

Objects and arrays that are found in several places are written once, and are one again when they
are read. Constants, which a model holds, are named.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints, NamedTuple, Union

import numpy as np

_PACKAGE = 'procphys_ros.'
_PLAIN = (type(None), bool, int, float, str)
_SERIES: dict[str, type] = {'list': list, 'tuple': tuple, 'set': set}
_NUMBERS: dict[Any, tuple[type, ...]] = {
    bool: (bool, np.bool_), int: (int, np.integer), float: (int, float, np.integer, np.floating)}


class Form(NamedTuple):
    """
    Conversion to plain data of objects of foreign classes, or whose attributes are not data.

    :ivar write: returns containers of plain values and arrays.
    :ivar read: returns the object's substitute made from them.
    """

    write: Callable[[Any], Any]
    read: Callable[[Any], Any]


Forms = Mapping[type, Form]


class Writer:
    """
    Write values as lists for JSON, and collect the objects and arrays in them.

    :param constants: objects written by name only.
    :param forms: of classes that have one.

    :ivar objects: fields of each object met so far.
    :ivar arrays: arrays met so far.
    """

    def __init__(self, constants: Mapping[str, Any], forms: Forms):
        self._names = {id(constant): name for name, constant in constants.items()}
        self._forms = forms
        self._places: dict[int, int] = {}  # of objects and arrays, by id
        self._alive: list[Any] = []        # so that no id is reused
        self.objects: list[dict[str, Any]] = []
        self.arrays: list[np.ndarray] = []

    def write(self, value: Any, kind: Any) -> Any:
        """
        Write a value.

        :param kind: its declared type; `Any` = none.
        :raises TypeError: if it contains an object without a declared type: a defect.
        """
        if type(value) in _PLAIN:
            return value
        name = self._names.get(id(value))
        if name is not None:
            return ['constant', name]
        if isinstance(value, np.ndarray):
            return ['array', self._place(value, self.arrays, value)]
        if isinstance(value, np.generic):
            return ['scalar', self._place(value, self.arrays, np.asarray(value))]
        if type(value) in _SERIES.values():
            kinds = _inner(kind, type(value), len(value))
            return [type(value).__name__, *map(self.write, value, kinds)]
        if type(value) is deque:
            kinds = _inner(kind, deque, len(value))
            return ['deque', value.maxlen, *map(self.write, value, kinds)]
        if type(value) is dict:
            key, inner = _inner(kind, dict, 2)
            return ['dict', *([self.write(k, key), self.write(v, inner)]
                              for k, v in value.items())]
        return ['object', self._object(value, kind)]

    def _object(self, value: Any, kind: Any) -> int:
        declared = _class(kind, self._forms)
        if type(value) is not declared:
            raise TypeError(f'a {type(value).__name__} in a field declared as {kind}')
        if id(value) in self._places:
            return self._places[id(value)]
        record: dict[str, Any] = {}
        number = self._place(value, self.objects, record)
        if declared in self._forms:
            record['data'] = self.write(self._forms[declared].write(value), Any)
        else:
            kinds = get_type_hints(declared)
            for name, item in content(value).items():
                record[name] = self.write(item, kinds.get(name, Any))
        return number

    def _place(self, value: Any, column: list, row: Any) -> int:
        if id(value) not in self._places:
            self._places[id(value)] = len(column)
            column.append(row)
            self._alive.append(value)
        return self._places[id(value)]


class Reader:
    """
    Read the output of a `Writer`.

    :param objects: fields of each object.
    :param arrays: referred to by records; the values share them.
    :param constants: by name.
    :param forms: of classes that have one.
    :raises ValueError: from `read` and its callees, like TypeError, KeyError and OverflowError,
        if a record is invalid or does not match its declared type.
    """

    def __init__(self, objects: Sequence[Any], arrays: Sequence[np.ndarray],
                 constants: Mapping[str, Any], forms: Forms):
        self._objects, self._arrays = objects, arrays
        self._constants, self._forms = constants, forms
        self._made: dict[int, Any] = {}

    def read(self, record: Any, kind: Any) -> Any:
        """
        Read a value.

        :param kind: its declared type; `Any` = none.
        """
        value = self._value(record, kind)
        if not _fits(value, kind, self._forms):
            raise ValueError(f'a {type(value).__name__} stands where {_name(kind)} belongs')
        return value

    def _value(self, record: Any, kind: Any) -> Any:
        match record:
            case None | bool() | int() | float() | str():
                return record
            case ['constant', str(name)] if name in self._constants:
                return self._constants[name]
            case ['array', int(number)] if 0 <= number < len(self._arrays):
                return self._arrays[number]
            case ['scalar', int(number)] if 0 <= number < len(self._arrays):
                return self._arrays[number][()]
            case ['list' | 'tuple' | 'set' as series, *items]:
                kinds = _inner(kind, _SERIES[series], len(items))
                return _SERIES[series](map(self.read, items, kinds))
            case ['deque', None | int() as most, *items]:
                return deque(map(self.read, items, _inner(kind, deque, len(items))), most)
            case ['dict', *pairs]:
                key, inner = _inner(kind, dict, 2)
                return {self.read(k, key): self.read(v, inner) for k, v in pairs}
            case ['object', int(number)] if 0 <= number < len(self._objects):
                return self._object(number, _class(kind, self._forms))
        raise ValueError('a record is none of the known kinds')

    def _object(self, number: int, declared: type) -> Any:
        if number in self._made:
            return self._made[number]
        record = self._objects[number]
        if declared in self._forms:
            self._made[number] = self._forms[declared].read(self.read(record['data'], Any))
            return self._made[number]
        _check_names(declared, record)
        kinds = get_type_hints(declared)
        if issubclass(declared, tuple):  # a tuple cannot contain itself
            self._made[number] = declared._make(  # type: ignore[attr-defined]
                self.read(record[name], kinds[name]) for name in kinds)
            return self._made[number]
        made = self._made[number] = object.__new__(declared)
        values = {name: self.read(item, kinds.get(name, Any)) for name, item in record.items()}
        if hasattr(declared, '__setstate__'):
            declared.__setstate__(made, values)
        else:
            made.__dict__.update(values)
        return made


def content(value: Any) -> dict[str, Any]:
    """Return the fields of an object to be written, by name."""
    if isinstance(value, tuple):
        return value._asdict()  # type: ignore[attr-defined]
    return value.__getstate__() if '__getstate__' in vars(type(value)) else vars(value)


def check_alike(pattern: Any, found: Any, forms: Forms, path: str,
                seen: set[int] | None = None) -> None:
    """
    Compare types, and dtypes and widths of arrays.

    Values that are None or empty on one side are not compared, nor are items of containers.

    :param pattern: a valid object.
    :param found: an object as read.
    :param forms: of classes that are not compared.
    :param path: name of the object.
    :raises ValueError: naming the first field that differs.
    """
    seen = set() if seen is None else seen
    if pattern is None or found is None or type(pattern) in forms or id(found) in seen:
        return
    if isinstance(pattern, np.ndarray):
        alike = (isinstance(found, np.ndarray) and found.dtype == pattern.dtype
                 and found.ndim == pattern.ndim
                 and all(map(_same_width, pattern.shape[1:], found.shape[1:])))
    elif isinstance(pattern, (int, float, np.generic)):
        alike = isinstance(found, (int, float, np.generic))
    else:
        alike = type(found) is type(pattern)
    if not alike:
        raise ValueError(f'{path} is not what it should be')
    if type(pattern).__module__.startswith(_PACKAGE):
        seen.add(id(found))
        inner = content(found)
        for name, item in content(pattern).items():
            if name not in inner:
                raise ValueError(f'{path} has no {name}')
            check_alike(item, inner[name], forms, f'{path}.{name}', seen)


def _same_width(one: int, other: int) -> bool:
    return one == other or 0 in (one, other)


def _options(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _class(kind: Any, forms: Forms) -> type:
    """Return the single class of objects that a declared type allows."""
    for option in _options(kind):
        if isinstance(option, type) and (option in forms
                                         or option.__module__.startswith(_PACKAGE)):
            return option
    raise TypeError(f'an object stands where {_name(kind)} belongs')


def _inner(kind: Any, container: type, count: int) -> Sequence[Any]:
    """Return the declared types of the items of a container; of a dict, of key and value."""
    kinds = next((get_args(option) for option in _options(kind)
                  if get_origin(option) is container), (Any, ...))
    if len(kinds) == 1 or kinds[1] is ...:
        return [kinds[0]] * count
    if len(kinds) != count:
        raise ValueError(f'{count} items stand where {_name(kind)} belongs')
    return kinds


def _fits(value: Any, kind: Any, forms: Forms) -> bool:
    """Return whether a value matches a declared type."""
    def fits(option: Any) -> bool:
        if option is Any or option in forms:
            return True
        return isinstance(value, _NUMBERS.get(option, get_origin(option) or option))
    return any(map(fits, _options(kind)))


def _check_names(declared: type, record: Mapping[str, Any]) -> None:
    """Raise ValueError unless the names in a record are the fields of its class."""
    if is_dataclass(declared) or issubclass(declared, tuple):
        known = ({field.name for field in fields(declared)} if is_dataclass(declared)
                 else set(declared._fields))  # type: ignore[attr-defined]
        sound = set(record) == known
    else:
        sound = not any(hasattr(declared, name) for name in record)
    if not sound:
        raise ValueError(f'the fields of a {declared.__name__} are not those it has')


def _name(kind: Any) -> str:
    return getattr(kind, '__name__', None) or str(kind)
