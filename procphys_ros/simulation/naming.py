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


"""Names of parts: 'oak_0/17', 'oak_0/segment_17', or a plain index."""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
import numbers

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError, nearest_names
from procphys_ros.scene import SceneObject
from procphys_ros.schema import short

_MOST_DIGITS = 19  # of an index; Python refuses to parse numbers of thousands


class PartNames:
    """
    Find parts by name, and name parts.

    :param objects: instances in part order.
    :param blueprint: all parts of these instances.
    """

    _objects: dict[str, SceneObject]
    _firsts: list[int]
    _blueprints: list[Blueprint]

    def __init__(self, objects: Sequence[SceneObject], blueprint: Blueprint):
        self._objects = {}
        self._firsts = []
        self._blueprints = []
        self._total = 0
        self.extend(objects, blueprint)

    def extend(self, objects: Sequence[SceneObject], blueprint: Blueprint) -> None:
        """
        Add the names of parts that join after all others.

        :param objects: the new instances.
        :param blueprint: all parts of these instances.
        """
        self._objects.update((o.name, o) for o in objects)
        self._firsts.append(self._total)
        self._blueprints.append(blueprint)
        self._total += len(blueprint)

    def index(self, part: int | str) -> int:
        """
        Find the index of a part.

        :param part: index over all parts, as a number or text, or a name.
        :raises CommandError: if there is no such part; the message suggests the nearest names.
        """
        if isinstance(part, numbers.Integral) and not isinstance(part, bool):
            return self._checked(int(part), 0, self._total, str(part))
        if not isinstance(part, str):
            raise CommandError(f'{short(part)} is neither the name nor the index of a part')
        if part.isascii() and part.isdigit() and len(part) < _MOST_DIGITS:
            return self._checked(int(part), 0, self._total, part)
        owner, slash, local = part.partition('/')
        found = self._objects.get(owner)
        if found is None or not slash:
            raise CommandError(f'there is no part "{part}"{self.nearest(owner)}; '
                               'parts are called object/index, such as '
                               f'"{next(iter(self._objects), "oak_0")}/0"')
        return self._local(found, local, part)

    def indices(self, parts: Sequence[int | str] | None) -> np.ndarray:
        """
        Find the indices of parts, (K,).

        :param parts: each as in `index`, or the name of an object for all of its parts;
            None = all parts of all objects.
        :raises CommandError: if there is no such part or object.
        """
        if parts is None:
            return np.arange(self._total)
        if isinstance(parts, str) or not isinstance(parts, Iterable):
            parts = [parts]
        found = [self._objects.get(part) if isinstance(part, str) else None for part in parts]
        return np.concatenate([np.zeros(0, np.intp), *(
            [self.index(part)] if whole is None
            else np.arange(whole.first, whole.first + whole.count)
            for part, whole in zip(parts, found))])

    def name(self, index: int) -> str:
        """Return the name of a part, `<object>/<kind>_<local index>`."""
        for found in self._objects.values():
            if found.first <= index < found.first + found.count:
                return f'{found.name}/{self._kind(index)}_{index - found.first}'
        return str(index)

    def _local(self, found: SceneObject, local: str, part: str) -> int:
        kind, _, digits = local.rpartition('_')
        if not (digits.isascii() and digits.isdigit() and len(digits) < _MOST_DIGITS):
            raise CommandError(f'"{part}" has no part index behind the /; '
                               f'{found.name} has parts 0 to {found.count - 1}')
        index = self._checked(found.first + int(digits), found.first, found.count, part)
        actual = self._kind(index)
        if kind and kind != actual:
            raise CommandError(f'there is no part "{part}"; part {digits} of {found.name} is '
                               f'"{found.name}/{actual}_{digits}"')
        return index

    def _kind(self, index: int) -> str:
        place = bisect_right(self._firsts, index) - 1
        source = self._blueprints[place]
        return source.kinds[source.kind[index - self._firsts[place]]]

    def _checked(self, index: int, first: int, count: int, part: str) -> int:
        if not first <= index < first + count:
            raise CommandError(f'there is no part "{part}"; indices go from 0 to {count - 1}')
        return index

    def nearest(self, owner: str) -> str:
        """List objects with similar names, for an error message."""
        return nearest_names(owner, self._objects)
