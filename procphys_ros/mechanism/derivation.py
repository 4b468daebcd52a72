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

"""Derivation: rules write parts and joints, in the order of the text."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import FASTEST, GROUND
from procphys_ros.errors import nearest_names
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.language import Expression, Place
from procphys_ros.mechanism.spec import (
    Application,
    Block,
    Definition,
    JointStatement,
    MechanismRule,
    MechanismSpec,
    PartStatement,
    Repetition,
    Statement,
)
from procphys_ros.mechanism.tables import RANGES

_DEEPEST = 1000        # nesting of rules
_MOST_STEPS = 100_000  # statements of one mechanism
_HEAVIEST = 1e12       # weight of a rule; sums stay finite
_STRAIGHT = 1e-9       # length of an axis that counts as none
_ROUNDING = 1e-6       # of lengths and displacements that expressions give
AXES = np.eye(3)


class WrittenPart(NamedTuple):
    """
    A part of the derived mechanism.

    :ivar pose: of its centre, in the mechanism [m], (7,).
    :ivar numbers: values of its keys, but for those of its place.
    :ivar inertia: principal moments in its axes [kg·m²], (3,); None = of a solid.
    :ivar skin: triangles that are drawn instead of it, in its axes [m], (T, 9); None = none.
    """

    kind: str
    name: str
    pose: np.ndarray
    numbers: Mapping[str, tuple[float, ...]]
    material: str
    place: Place
    inertia: np.ndarray | None = None
    skin: np.ndarray | None = None


class WrittenJoint(NamedTuple):
    """
    A joint of the derived mechanism.

    :ivar parts: the one it leads to, or `GROUND`, and the one it belongs to.
    :ivar frame: on the second part, x along the axis, in the mechanism [m], (7,).
    :ivar end: of a rope, on the first part, likewise [m], (3,); of others the same point.
    """

    kind: str
    name: str
    parts: tuple[int, int]
    frame: np.ndarray
    end: np.ndarray
    numbers: Mapping[str, tuple[float, ...]]
    place: Place


@dataclass
class RuleScope:
    """
    What a rule knows while it is applied.

    :ivar values: of parameters and lets.
    :ivar frame: of its coordinates in the mechanism [m], (7,).
    :ivar parent: part that joints lead to unless they say otherwise.
    :ivar parts: own parts by name.
    :ivar outer: of whoever applies it, whose parts it knows, too.
    """

    values: dict[str, float]
    frame: np.ndarray
    parent: int
    parts: dict[str, int] = field(default_factory=dict)
    outer: 'RuleScope | None' = None
    level: int = 0

    def find(self, name: str, place: Place) -> int:
        """Find a part by its name, here or outside; raise GrammarError if there is none."""
        if name == 'ground':
            return GROUND
        if name == 'parent':
            return self.parent
        names, scope = ['ground', 'parent'], self
        while True:
            if name in scope.parts:
                return scope.parts[name]
            names += scope.parts
            if scope.outer is None:
                break
            scope = scope.outer
        known = list(dict.fromkeys(names))
        raise place.error(f'there is no part "{name}" yet{nearest_names(name, known)} (parts: '
                          f'{", ".join(known[:20])})')


@dataclass
class MechanismWriter:
    """
    Applies the rules of a spec.

    :ivar values: of the mechanism's parameters, and of lets outside of it.
    :ivar generator: draws weighted rules and random numbers.
    :ivar parts, joints: written so far.
    """

    spec: MechanismSpec
    values: dict[str, float]
    generator: np.random.Generator
    most_parts: int
    parts: list[WrittenPart] = field(default_factory=list)
    joints: list[WrittenJoint] = field(default_factory=list)
    steps: int = 0

    def write(self) -> None:
        """
        Derive the mechanism.

        :raises GrammarError: for endless recursion of rules, values out of range, and parts that
            do not exist.
        """
        for let in self.spec.definitions:
            self.values[let.name] = let.value.number(self.values, self.generator)
        start = RuleScope(dict(self.values), rotation.ORIGIN, GROUND)
        # Statements under way, innermost last; recursion is deeper than Python's.
        running = [self._statements(self.spec.statements, start)]
        while running:
            inner = next(running[-1], None)
            if inner is None:
                running.pop()
            else:
                running.append(inner)

    def _statements(self, statements: tuple[Statement, ...],
                    scope: RuleScope) -> 'Iterator[Iterator]':
        """Execute statements; yield the execution of inner ones."""
        for statement in statements:
            self._count()
            if isinstance(statement, Definition):
                scope.values[statement.name] = self._number(statement.value, scope)
            elif isinstance(statement, PartStatement):
                self._part(statement, scope)
            elif isinstance(statement, Repetition):
                yield from self._repeat(statement, scope)
            else:
                yield self._apply(statement, scope)

    def _count(self) -> None:
        """Count a statement or a repetition; raise GrammarError for too many."""
        self.steps += 1
        if self.steps > _MOST_STEPS:
            raise self.spec.place.error(f'the mechanism takes more than {_MOST_STEPS} '
                                        'statements; make it smaller')

    def _number(self, expression: Expression, scope: RuleScope) -> float:
        return expression.number(scope.values, self.generator)

    def _numbers(self, settings: Block, scope: RuleScope) -> dict[str, tuple[float, ...]]:
        """Evaluate the values of a block that are numbers."""
        out = {}
        for key, setting in settings.items():
            if setting.name:
                continue
            limits = RANGES[key]
            out[key] = tuple(self._number(value, scope) for value in setting.values)
            for number in out[key]:
                if not limits.low <= number <= limits.high:
                    raise setting.place.error(
                        f'{key} is {number:g}, it must be from {limits.low:g} to '
                        f'{limits.high:g} {limits.unit}'.rstrip())
        return out

    def _repeat(self, statement: Repetition, scope: RuleScope) -> 'Iterator[Iterator]':
        count = self._number(statement.count, scope)
        if not 0 <= count <= self.most_parts or count != int(count):
            raise statement.count.place.error(f'repeat is {count:g}, it must be a whole number '
                                              f'from 0 to {self.most_parts}')
        for k in range(int(count)):
            self._count()
            inner = RuleScope({**scope.values, statement.variable: float(k)}, scope.frame,
                              scope.parent, outer=scope, level=scope.level)
            yield self._statements(statement.statements, inner)

    def _apply(self, call: Application, scope: RuleScope) -> 'Iterator[Iterator]':
        if scope.level >= _DEEPEST:
            raise call.place.error(f'rules are nested more than {_DEEPEST} deep: "{call.name}" '
                                   'seems to apply itself without end')
        arguments = [self._number(a, scope) for a in call.arguments]
        rule = self._choose(call, arguments)
        numbers = self._numbers(call.settings, scope)
        on = call.settings.get('on')
        parent = scope.parent if on is None else scope.find(on.name, on.place)
        inner = RuleScope({**self.values, **dict(zip(rule.parameters, arguments))},
                          rotation.compose(scope.frame, _pose(numbers)), parent, outer=scope,
                          level=scope.level + 1)
        return self._statements(rule.statements, inner)

    def _choose(self, call: Application, arguments: list[float]) -> MechanismRule:
        """Choose the first rule whose condition holds; draw among weighted ones that follow it."""
        drawn: list[tuple[MechanismRule, float]] = []
        for rule in self.spec.rules[call.name]:
            if len(rule.parameters) != len(arguments):
                continue
            values = {**self.values, **dict(zip(rule.parameters, arguments))}
            if (rule.condition is not None
                    and not rule.condition.number(values, self.generator)):
                continue
            if rule.weight is None:
                if drawn:
                    break
                return rule
            weight = rule.weight.number(values, self.generator)
            if not 0.0 <= weight <= _HEAVIEST:
                raise rule.weight.place.error(f'a weight must be from 0 to {_HEAVIEST:g}, '
                                              f'found {weight:g}')
            drawn.append((rule, weight))
        point = self.generator.random() * sum(weight for _, weight in drawn) if drawn else 0.0
        for rule, weight in drawn:
            point -= weight
            if point < 0.0:
                return rule
        shown = f'({", ".join(f"{a:g}" for a in arguments)})'
        raise call.place.error(f'no rule "{call.name}{shown}" applies: every condition is false '
                               'or every weight zero')

    def _part(self, statement: PartStatement, scope: RuleScope) -> None:
        if len(self.parts) >= self.most_parts:
            raise statement.place.error(f'the mechanism has more than {self.most_parts} parts')
        numbers = self._numbers(statement.settings, scope)
        local = _pose(numbers)
        if statement.kind == 'rod':
            local = _between(numbers, statement)
        material = statement.settings.get('material')
        number = len(self.parts)
        self.parts.append(WrittenPart(
            statement.kind, statement.name or statement.kind,
            rotation.compose(scope.frame, local), numbers,
            material.name if material else '', material.place if material else statement.place))
        for joint in statement.joints:  # to which its name means a part of the same name outside
            self._joint(joint, number, local[:3], scope)
        if statement.name:
            scope.parts[statement.name] = number

    def _joint(self, joint: JointStatement, part: int, centre: np.ndarray,
               scope: RuleScope) -> None:
        numbers = self._numbers(joint.settings, scope)
        to = joint.settings.get('to')
        other = scope.parent if to is None else scope.find(to.name, to.place)
        axis = np.array(numbers.get('axis', (0.0, 0.0, 1.0)))
        if joint.kind == 'rope':
            axis = np.array(numbers.get('at', tuple(centre))) - np.array(numbers['end'])
        elif norm(axis) < _STRAIGHT:
            raise joint.settings['axis'].place.error('the axis has no direction, all of it is 0')
        turn = turned(AXES[0], axis)
        place = np.array([*numbers.get('at', tuple(centre)), *turn])
        end = np.array(numbers.get('end', tuple(place[:3])))
        self._check(joint, numbers)
        span = float(norm(place[:3] - end))
        length = numbers.get('length', (span,))[0]
        if length < span * (1.0 - _ROUNDING):
            raise joint.settings['length'].place.error(
                f'length is {length:g}, it must not be below the {span:g} m between its ends')
        self.joints.append(WrittenJoint(
            joint.kind, joint.name or self.parts[part].name, (other, part),
            rotation.compose(scope.frame, place),
            scope.frame[:3] + rotation.rotate(scope.frame[3:], end), numbers, joint.place))

    def _check(self, joint: JointStatement, numbers: Mapping[str, tuple[float, ...]]) -> None:
        """Check what a range of one number does not say."""
        low, high = numbers.get('limits', (0.0, 0.0))
        if low > high:
            raise joint.settings['limits'].place.error(f'limits are {low:g}, {high:g}: the first '
                                                       'must not be above the second')
        if not low - _ROUNDING <= 0.0 <= high + _ROUNDING:
            raise joint.settings['limits'].place.error(
                f'limits are {low:g}, {high:g}: 0, where it is built, must not be beyond them')
        if numbers.get('collides', (0.0,))[0] not in (0.0, 1.0):
            raise joint.settings['collides'].place.error(
                f'collides is {numbers["collides"][0]:g}, it must be 0 or 1')
        if abs(numbers.get('motor', (0.0,))[0]) > FASTEST:
            raise joint.settings['motor'].place.error(
                f'the speed of a motor is {numbers["motor"][0]:g}, it must be from '
                f'{-FASTEST:g} to {FASTEST:g}')
        for key, place, name in (('spring', 0, 'stiffness'), ('motor', 1, 'force or moment'),
                                 ('motor', 2, 'highest speed')):
            if len(numbers.get(key, ())) > place and numbers[key][place] < 0.0:
                raise joint.settings[key].place.error(
                    f'{key} is {", ".join(f"{n:g}" for n in numbers[key])}: its {name} must be 0 '
                    'or more')


def _pose(numbers: Mapping[str, tuple[float, ...]]) -> np.ndarray:
    """Return the pose of `at` and `turn`, roll, pitch and yaw about fixed axes, (7,)."""
    place = numbers.get('at', (0.0, 0.0, 0.0))
    if 'turn' not in numbers:
        return np.array([*place, *rotation.IDENTITY])
    roll, pitch, yaw = (rotation.from_axis_angle(axis, np.radians(angle)) for axis, angle
                        in zip(AXES, numbers['turn']))
    turn = rotation.multiply(yaw, rotation.multiply(pitch, roll))
    return np.array([*place, *turn])


def _between(numbers: Mapping[str, tuple[float, ...]], rod: PartStatement) -> np.ndarray:
    """Return the pose of a rod, z from its first end to its second, (7,)."""
    first, last = np.array(numbers['from']), np.array(numbers['to'])
    if norm(last - first) < numbers['diameter'][0]:
        raise rod.settings['to'].place.error(f'a rod is at least as long as wide, this one is '
                                             f'{norm(last - first):g} m long')
    return np.array([*(0.5 * (first + last)), *turned(AXES[2], last - first)])


def turned(start: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the shortest rotation of a unit vector to a direction, (4,)."""
    length = norm(way)
    if length < _STRAIGHT:
        return rotation.IDENTITY
    way = way / length
    turn = np.array([*np.cross(start, way), 1.0 + float((start * way).sum())])
    if norm(turn) < 1e-6:  # straight back: any axis across
        return np.array([0.0, 1.0, 0.0, 0.0])
    return turn / norm(turn)
