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

"""Parts: the state of all parts as columns, a row per part, and their names."""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
import numbers
from typing import Any

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.errors import CommandError, nearest_names
from procphys_ros.physics.air import CUBE_DRAG, CYLINDER_DRAG, FOLIAGE_DRAG
from procphys_ros.scene import SceneObject
from procphys_ros.schema import short
from procphys_ros.simulation.model import Model

_MOST_DIGITS = 19  # of an index; Python refuses to parse numbers of thousands
_NONE = np.zeros(0, np.intp)
_SIDE_MEAN = np.pi / 4.0  # mean projected width of a slender body over all attitudes


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


class Owner(ArrayEnum):
    """The subsystem that moves a part; every part has exactly one owner at any time."""

    STANDING = 0  # frozen in a wall, until the stress solver or a blow releases it
    TREE = 1      # segment of the articulated forest
    BODY = 2      # part of a rigid body of the world
    GONE = 3      # pulverised, or broken into new parts; keeps its last pose


class Columns:
    """
    Named arrays of equal length.

    Appending doubles the capacity when it is exhausted, so the cost of a row does not depend on
    their number. Every array is an attribute; read it again after `append`, older references may
    be stale.

    :param columns: first rows of each array, (N, ...).
    """

    def __init__(self, **columns: np.ndarray):
        self._stores = {name: np.array(column) for name, column in columns.items()}
        self._count = len(next(iter(columns.values())))
        self._expose()

    def __len__(self) -> int:
        return self._count

    def __getattr__(self, name: str) -> np.ndarray:
        raise AttributeError(f'there is no column "{name}"')

    def append(self, **rows: Any) -> None:
        """
        Append rows.

        :param rows: of every column, (K, ...); a scalar fills all rows of its column.
        """
        count = max(len(np.atleast_1d(value)) for value in rows.values())
        end = self._count + count
        for name, store in self._stores.items():
            if end > len(store):
                room = np.empty((max(end, 2 * len(store)), *store.shape[1:]), store.dtype)
                room[:self._count] = store[:self._count]
                store = self._stores[name] = room
            store[self._count:end] = rows[name]
        self._count = end
        self._expose()

    def _expose(self) -> None:
        for name, store in self._stores.items():
            self.__dict__[name] = store[:self._count]

    def __getstate__(self) -> dict[str, np.ndarray]:
        return {name: store[:self._count] for name, store in self._stores.items()}

    def __setstate__(self, columns: dict[str, np.ndarray]) -> None:
        Columns.__init__(self, **columns)


@dataclass
class RigidBodyMap:
    """
    The parts of each rigid body of the world.

    :ivar members: parts of each body, ascending, by id.
    :ivar drag_area: drag coefficient times projected area of each body [m²], by id, (B,).
    :ivar size: number of parts of each body, by id, (B,).
    :ivar carried: all parts in bodies; None = outdated.
    """

    members: dict[int, np.ndarray] = field(default_factory=dict)
    drag_area: np.ndarray = field(default_factory=lambda: np.zeros(0))
    size: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    carried: np.ndarray | None = None

    def parts_of(self, body: int) -> np.ndarray:
        """Return the parts of a body, ascending; none for a body without parts."""
        return self.members.get(int(body), _NONE)


def part_columns(model: Model) -> Columns:
    """
    Make the columns of all parts, at rest.

    `shape`, `size`, `visual_size` and `solid_size` [m] (N, 3), `mass` [kg] and `inertia` [kg·m²]
    (N, 3) are those of the blueprint, but for plants that grow. Variable are `drag_area` [m²],
    which falls with the leaves; `poses` (N, 7) and `velocities` (N, 6), world; `owner`; `body`, id
    of the rigid body that the part is or belongs to, -1 for none; `local`, pose in the frame of
    that body, (N, 7); `moved`, whether it moved in the last step. `row` is the part's row of the
    forest, -1 for none.
    """
    source = model.blueprint
    return Columns(**columns_of(source), owner=owners(model), row=model.trees.row)


def owners(model: Model) -> np.ndarray:
    """Return the owner of each part at rest: STANDING with mortar, TREE with a hinge, (N,)."""
    owner = np.full(len(model.blueprint), Owner.BODY, np.uint8)
    owner[model.masonry.members] = Owner.STANDING
    owner[model.trees.row >= 0] = Owner.TREE
    return owner


def columns_of(source: Blueprint) -> dict[str, np.ndarray]:
    """Return the columns of parts that are at rest and have no body."""
    count = len(source)
    return {
        'shape': source.shape, 'size': source.size, 'visual_size': source.visual_size,
        'solid_size': source.solid_size(np.arange(count)), 'mass': source.mass,
        'inertia': source.inertia, 'drag_area': drag_area(source), 'poses': source.poses,
        'velocities': np.zeros((count, 6)), 'body': np.full(count, -1, np.intp),
        'local': np.zeros((count, 7)), 'moved': np.zeros(count, bool)}


def box_drag(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the mean drag area of boxes of full extents x, y, z over all attitudes [m²], (N,)."""
    return CUBE_DRAG * 0.5 * (x * y + y * z + z * x)


def drag_area(blueprint: Blueprint) -> np.ndarray:
    """
    Return the mean drag area Cd·A of each part over all attitudes [m²], (N,).

    The mean projected area of a convex body is a quarter of its surface (Cauchy).
    """
    x, y, z = blueprint.visual_size.T
    box = box_drag(x, y, z)
    rod = CYLINDER_DRAG * _SIDE_MEAN * 0.5 * (x + y) * z
    solid = np.where(blueprint.shape == Shape.BOX, box, rod)
    solid[blueprint.plates.part] = 0.0  # see `mechanisms.press_plates`
    return solid + FOLIAGE_DRAG * blueprint.leaf_area
