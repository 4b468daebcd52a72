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

"""Derivation: rules divide a facade until only panels are left."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from procphys_ros.language import Expression, Place
from procphys_ros.wallgrammar.boxes import micro
from procphys_ros.wallgrammar.division import divide, Repeated, Share
from procphys_ros.wallgrammar.spec import (
    Call,
    Division,
    Part,
    Repeat,
    Rule,
    Spec,
    Split,
    Successor,
)

_DEEPEST = 64          # nesting of rules
_MOST_STEPS = 100_000  # rules, divisions and panels of one building
_HEAVIEST = 1e12       # weight of a rule; sums stay finite
_LARGEST = 1e6         # [m] border, insert or extrusion: more than the longest facade


class FacadeScope(NamedTuple):
    """
    Rectangle of the facade.

    :ivar left, bottom, right, top: [µm].
    :ivar depth: distance inwards from the facade plane [µm].
    """

    left: int
    bottom: int
    right: int
    top: int
    depth: int = 0


class Piece(NamedTuple):
    """
    Panel of the derived facade, and its place in the text.

    :ivar numbers: values of `Panel.numbers`.
    """

    scope: FacadeScope
    panel: str
    place: Place
    numbers: tuple[float, ...] = ()


class _Task(NamedTuple):
    successor: Successor
    scope: FacadeScope
    values: Mapping[str, float]
    level: int


@dataclass
class Deriver:
    """
    Applies the rules of a spec.

    :ivar spec: rules and panels.
    :ivar values: values of the building's parameters.
    :ivar generator: draws weighted rules and random numbers.
    :ivar applied: number of rules, divisions and panels so far, on all facades.
    """

    spec: Spec
    values: Mapping[str, float]
    generator: np.random.Generator
    applied: int = 0

    def facade(self, start: Call, length: int, height: int) -> list[Piece]:
        """
        Derive one facade.

        :param start: its start rule.
        :param length: of the facade [µm].
        :param height: [µm].
        :returns: panels, in the order of the text.
        :raises GrammarError: for endless recursion of rules, and too many divisions.
        """
        pieces: list[Piece] = []
        tasks = [_Task(start, FacadeScope(0, 0, length, height), self.values, 0)]
        while tasks:
            task = tasks.pop()
            call = task.successor
            self.applied += 1
            if self.applied + len(tasks) > _MOST_STEPS:
                raise start.place.error(f'the facades take more than {_MOST_STEPS} divisions; '
                                        f'make their parts larger')
            if isinstance(call, Call) and call.name in self.spec.panels:
                numbers = tuple(self._number(number, task)
                                for number in self.spec.panels[call.name].numbers)
                pieces.append(Piece(task.scope, call.name, call.place, numbers))
                continue
            tasks.extend(reversed(self._expand(task)))
        return pieces

    def _number(self, expression: Expression, task: _Task) -> float:
        scope = task.scope
        values = {**task.values, 'scope_x': (scope.right - scope.left) * 1e-6,
                  'scope_y': (scope.top - scope.bottom) * 1e-6}
        return expression.number(values, self.generator)

    def _extent(self, expression: Expression, task: _Task, least: float = 0.0) -> int:
        """Evaluate a length [µm]."""
        metres = self._number(expression, task)
        if not least <= metres <= _LARGEST:
            raise expression.place.error(f'a length must be from {least:g} to {_LARGEST:g} m, '
                                         f'found {metres:g}')
        return micro(metres)

    def _expand(self, task: _Task) -> list[_Task]:
        node = task.successor
        if isinstance(node, Call):
            return [self._apply(node, task)]
        if isinstance(node, Split):
            return self._split(node.axis, tuple(self._shares(node.parts, task)), task)
        if node.kind == 'grid':
            return self._grid(node, task)
        if node.kind == 'extrude':
            depth = task.scope.depth - self._extent(node.sizes[0], task, -_LARGEST)
            return [task._replace(successor=node.contents[0],
                                  scope=task.scope._replace(depth=depth))]
        return self._frame(node, task)

    def _shares(self, parts: tuple[Part | Repeat, ...], task: _Task) -> list[Share | Repeated]:
        return [Repeated(tuple(self._shares(p.parts, task)), p.place) if isinstance(p, Repeat)
                else Share(p.kind, self._number(p.size, task), p.successor, p.size.place)
                for p in parts]

    def _split(self, axis: str, shares: tuple[Share | Repeated, ...],
               task: _Task) -> list[_Task]:
        scope = task.scope
        if axis == 'x':
            return [task._replace(successor=content, scope=scope._replace(
                left=scope.left + start, right=scope.left + end))
                for start, end, content in divide(shares, scope.right - scope.left)]
        return [task._replace(successor=content, scope=scope._replace(
            bottom=scope.bottom + start, top=scope.bottom + end))
            for start, end, content in divide(shares, scope.top - scope.bottom)]

    def _grid(self, node: Division, task: _Task) -> list[_Task]:
        columns, row = ((Repeated((Share('floating', self._number(size, task),
                                         node.contents[0], size.place),), size.place),)
                        for size in node.sizes)
        rows = self._split('y', row, task)
        if rows and len(rows) * len(self._split('x', columns, rows[0])) > _MOST_STEPS:
            raise node.sizes[0].place.error(f'a grid of more than {_MOST_STEPS} cells; make them '
                                            f'larger')
        return [cell for row in rows for cell in self._split('x', columns, row)]

    def _frame(self, node: Division, task: _Task) -> list[_Task]:
        """Surround a rectangle in the middle of the scope by four strips."""
        scope, (middle, edge) = task.scope, node.contents
        width, height = scope.right - scope.left, scope.top - scope.bottom
        wanted = [self._extent(size, task) for size in node.sizes]
        if node.kind == 'border':
            aside = above = wanted[0]
        else:
            if wanted[0] > width or wanted[1] > height or min(wanted) <= 0:
                raise node.sizes[0].place.error(
                    f'an insert of {wanted[0] / 1e6:g} x {wanted[1] / 1e6:g} m does not fit into '
                    f'a scope of {width / 1e6:g} x {height / 1e6:g} m')
            aside, above = (width - wanted[0]) // 2, (height - wanted[1]) // 2
        if 2 * aside >= width or 2 * above >= height:
            return [task._replace(successor=edge)]
        left, right = scope.left + aside, scope.right - aside
        bottom, top = scope.bottom + above, scope.top - above
        strips = [scope._replace(top=bottom), scope._replace(bottom=bottom, top=top, right=left),
                  scope._replace(bottom=bottom, top=top, left=right), scope._replace(bottom=top)]
        inner = FacadeScope(left, bottom, right, top, scope.depth)
        return [task._replace(successor=middle, scope=inner)] + [
            task._replace(successor=edge, scope=strip) for strip in strips
            if strip.right > strip.left and strip.top > strip.bottom]

    def _apply(self, call: Call, task: _Task) -> _Task:
        if task.level >= _DEEPEST:
            raise call.place.error(f'rules are nested more than {_DEEPEST} deep: "{call.name}" '
                                   f'seems to call itself without end')
        fitting = [r for r in self.spec.rules[call.name]
                   if len(r.parameters) == len(call.arguments)]
        arguments = [self._number(a, task) for a in call.arguments]
        rule = self._choose(fitting, arguments, call, task)
        values = {**self.values, **dict(zip(rule.parameters, arguments))}
        return _Task(rule.successor, task.scope, values, task.level + 1)

    def _choose(self, rules: list[Rule], arguments: list[float], call: Call,
                task: _Task) -> Rule:
        """Choose the first rule whose condition holds; draw among weighted ones that follow it."""
        drawn: list[tuple[Rule, float]] = []
        for rule in rules:
            inner = task._replace(values={**self.values, **dict(zip(rule.parameters, arguments))})
            if rule.condition is not None and not self._number(rule.condition, inner):
                continue
            if rule.weight is None:
                if drawn:
                    break
                return rule
            weight = self._number(rule.weight, inner)
            if not 0.0 <= weight <= _HEAVIEST:
                raise rule.weight.place.error(f'a weight must be from 0 to {_HEAVIEST:g}, '
                                              f'found {weight:g}')
            drawn.append((rule, weight))
        total = sum(weight for _, weight in drawn)
        if total <= 0.0:
            shown = f'({", ".join(f"{a:g}" for a in arguments)})' if arguments else ''
            raise call.place.error(f'no rule "{call.name}{shown}" applies: every condition is '
                                   f'false or every weight zero')
        point = self.generator.random() * total
        for rule, weight in drawn:
            point -= weight
            if point < 0.0:
                return rule
        return drawn[-1][0]
