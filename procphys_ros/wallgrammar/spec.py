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

"""Spec: a wall grammar as parsed, before any number is evaluated."""

from dataclasses import dataclass, field
from typing import TypeAlias

from procphys_ros.language import Entry, Expression, Place

KINDS_OF_PANELS = ('boards(material), door(material, side, from, to), '
                   'shutters(frame, glass, material, from, to), glazing(frame, glass), '
                   'beam(material), none, arch(shape, rings)')  # beside layouts, for messages
Successor: TypeAlias = 'Call | Split | Division'


@dataclass(frozen=True)
class Call:
    """Reference to a rule or panel by name, or any other name with arguments."""

    name: str
    arguments: tuple[Expression, ...]
    place: Place


@dataclass(frozen=True)
class Part:
    """
    One part of a split.

    :ivar kind: 'absolute', 'relative' or 'floating'.
    """

    kind: str
    size: Expression
    successor: Successor


@dataclass(frozen=True)
class Repeat:
    """Parts that repeat to the nearest whole count."""

    parts: 'tuple[Part | Repeat, ...]'
    place: Place


@dataclass(frozen=True)
class Split:
    """Divide the scope along `axis`, 'x' or 'y'."""

    axis: str
    parts: tuple[Part | Repeat, ...]
    place: Place


@dataclass(frozen=True)
class Division:
    """
    Change of the scope by lengths.

    :ivar kind: 'border': a border of this width is cut off all four sides; 'grid': the nearest
        whole count of columns and rows of this width and height; 'extrude': moved outwards from
        the facade by this depth; 'insert': a middle of this width and height.
    :ivar sizes: these lengths.
    :ivar contents: of the middle, each cell or the whole; then of the rest around a middle.
    """

    kind: str
    sizes: tuple[Expression, ...]
    contents: tuple[Successor, ...]


@dataclass(frozen=True)
class Rule:
    """
    Production rule.

    :ivar condition: None = always.
    :ivar weight: None = not drawn.
    """

    name: str
    parameters: tuple[str, ...]
    condition: Expression | None
    successor: Successor
    weight: Expression | None
    place: Place


@dataclass(frozen=True)
class Panel:
    """
    Definition of a terminal: a layout, `boards`, `glazing`, `beam`, `arch`, `door`, … or `none`.

    :ivar arguments: names of materials.
    :ivar shape: of an arch; or the side of a door's hinges.
    :ivar numbers: of an arch: parameters of its shape, and its number of rings; of a door or
        shutters: how far they open [degrees].
    """

    name: str
    kind: str
    arguments: tuple[str, ...]
    place: Place
    shape: str = ''
    numbers: tuple[Expression, ...] = ()


@dataclass(frozen=True)
class Building:
    """
    The building, or one of its wings; `None` stands for omitted entries.

    :ivar parameters: names with their defaults, in order.
    """

    name: str
    parameters: tuple[tuple[str, Expression], ...]
    footprint: tuple[tuple[Expression, Expression], ...]
    corners: tuple[Place, ...]
    facades: tuple[Call, ...]
    storey_height: Expression
    storeys: Expression | None
    floors: Call | None
    roof: Call | None
    partitions: Call | None
    place: Place


@dataclass(frozen=True)
class Spec:
    """
    A whole grammar text.

    :ivar wings: built against the building, with parameters and tables in common.
    """

    building: Building
    wings: tuple[Building, ...] = ()
    rules: dict[str, list[Rule]] = field(default_factory=dict)
    panels: dict[str, Panel] = field(default_factory=dict)
    materials: dict[str, dict[str, Entry]] = field(default_factory=dict)
    layouts: dict[str, dict[str, Entry]] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
