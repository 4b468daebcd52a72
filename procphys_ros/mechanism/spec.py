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

"""Spec: a mechanism grammar as parsed, before any number is evaluated."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from procphys_ros.language import Entry, Expression, Place

Statement: TypeAlias = 'Definition | Application | Repetition | PartStatement'


@dataclass(frozen=True)
class Setting:
    """
    Values of a key.

    :ivar name: where the value is one name, such as a material; else ''.
    """

    values: tuple[Expression, ...]
    name: str
    place: Place


Block: TypeAlias = Mapping[str, Setting]


@dataclass(frozen=True)
class Definition:
    """A `let`: a name for a number, known from there on."""

    name: str
    value: Expression


@dataclass(frozen=True)
class Application:
    """Application of a rule, with its own frame and parent."""

    name: str
    arguments: tuple[Expression, ...]
    settings: Block
    place: Place


@dataclass(frozen=True)
class Repetition:
    """Statements that are repeated; the variable counts from 0."""

    variable: str
    count: Expression
    statements: 'tuple[Statement, ...]'


@dataclass(frozen=True)
class JointStatement:
    """A joint of a part, `kind` one of `tables.JOINT_KEYS`."""

    kind: str
    name: str
    settings: Block
    place: Place


@dataclass(frozen=True)
class PartStatement:
    """A part, `kind` one of `tables.PART_KEYS`, and its joints."""

    kind: str
    name: str
    settings: Block
    joints: tuple[JointStatement, ...]
    place: Place


@dataclass(frozen=True)
class MechanismRule:
    """
    Rule of a mechanism.

    :ivar condition: of its arguments; None = it always applies.
    :ivar weight: for random choice; None = the first one that applies is taken.
    """

    name: str
    parameters: tuple[str, ...]
    condition: Expression | None
    statements: tuple[Statement, ...]
    weight: Expression | None
    place: Place


@dataclass
class MechanismSpec:
    """
    All definitions of a mechanism grammar.

    :ivar parameters: names with their default values.
    :ivar statements: of the mechanism itself.
    :ivar definitions: lets outside of mechanism and rules, which all of these know.
    :ivar materials: entries by name; `places` tells where they stand, as 'material <name>'.
    """

    name: str
    parameters: tuple[tuple[str, Expression], ...]
    statements: tuple[Statement, ...]
    place: Place
    definitions: tuple[Definition, ...] = ()
    rules: dict[str, list[MechanismRule]] = field(default_factory=dict)
    materials: dict[str, dict[str, Entry]] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
