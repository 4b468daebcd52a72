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


"""Rewriting: apply a set of rules to a whole string at once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.language import Value
from procphys_ros.lsystem.contexts import follow_tree, match_left, match_right
from procphys_ros.lsystem.modules import Modules
from procphys_ros.lsystem.rules import check_weight, Production


class _Match(NamedTuple):
    """Match of a rule: rows (N,) and the values of the names in its expressions."""

    rule: Production
    rows: np.ndarray
    values: dict


class Rewritten(NamedTuple):
    """
    Result of a pass.

    :ivar modules: the new string.
    :ivar fresh: mask of the modules that a rule wrote, (M,) bool.
    :ivar applied: the rule that wrote most, None when none applied.
    :ivar source: row of the old string that each module comes from, (M,).
    :ivar continues: mask of the modules that are the old ones, changed or not, (M,) bool.
    """

    modules: Modules
    fresh: np.ndarray
    applied: Production | None
    source: np.ndarray
    continues: np.ndarray


@kernel
def _copy_unchanged(unchanged, key, origin, values, starts, counts, to, to_values,
                    new_key, new_origin, new_values):
    """Copy the modules that no rule matched to their new places."""
    for i in range(len(key)):
        if unchanged[i]:
            new_key[to[i]] = key[i]
            new_origin[to[i]] = origin[i]
            for j in range(counts[i]):
                new_values[to_values[i] + j] = values[starts[i] + j]


@dataclass(frozen=True)
class RuleSet:
    """
    Rules that are applied together.

    :ivar rules: in file order.
    :ivar ignored: mask of the keys that contexts skip, (K,) bool.
    :ivar max_modules: longest string allowed.
    """

    rules: Sequence[Production]
    ignored: np.ndarray
    max_modules: int

    def rewrite(self, modules: Modules, defines: Mapping[str, float],
                generator: np.random.Generator, active: np.ndarray | None = None) -> Rewritten:
        """
        Rewrite all modules in parallel, once.

        :param modules: the string.
        :param defines: value of each define.
        :param generator: source of random numbers.
        :param active: mask of the modules that may be replaced, (M,) bool; None = all.
        :raises GrammarError: when the string would grow past `max_modules`.
        """
        tree = None
        if any(rule.left or rule.right for rule in self.rules):
            tree = follow_tree(modules.key, self.ignored)
        matches: list[_Match] = []
        starts = modules.starts
        for key in dict.fromkeys(rule.predecessor for rule in self.rules):
            found = modules.key == key
            rows = np.flatnonzero(found if active is None else found & active)
            if len(rows):
                same = [rule for rule in self.rules if rule.predecessor == key]
                matches += _choose(same, rows, modules, starts, tree, defines, generator)
        if not matches:
            return Rewritten(modules, np.zeros(len(modules), bool), None,
                             np.arange(len(modules)), np.ones(len(modules), bool))
        return self._write(modules, starts, matches, generator)

    def _write(self, modules: Modules, starts: np.ndarray, matches: list[_Match],
               generator: np.random.Generator) -> Rewritten:
        counts = modules.counts
        lengths = np.ones(len(modules), np.int64)
        sizes = counts.copy()
        unchanged = np.ones(len(modules), bool)
        for rule, rows, _ in matches:
            lengths[rows] = len(rule.successor)
            sizes[rows] = sum(len(piece.arguments) for piece in rule.successor)
            unchanged[rows] = False
        ends, value_ends = np.cumsum(lengths), np.cumsum(sizes)
        most = max(matches, key=lambda match: len(match.rows) * len(match.rule.successor))
        self._check_growth(int(ends[-1]), most)
        to, to_values = ends - lengths, value_ends - sizes
        key = np.empty(ends[-1], np.int32)
        origin = np.empty(ends[-1], np.int32)
        values = np.empty(value_ends[-1])
        _copy_unchanged(unchanged, modules.key, modules.origin, modules.values, starts, counts,
                        to, to_values, key, origin, values)
        fresh = np.ones(len(key), bool)
        fresh[to[unchanged]] = False
        continues = ~fresh
        for match in matches:
            _write_successors(match, to[match.rows], to_values[match.rows], key, origin, values,
                              generator)
            if match.rule.heir >= 0:
                continues[to[match.rows] + match.rule.heir] = True
        return Rewritten(Modules(modules.vocabulary, key, values, origin), fresh, most.rule,
                         np.repeat(np.arange(len(modules)), lengths), continues)

    def _check_growth(self, count: int, most: _Match) -> None:
        if count > self.max_modules:
            rule = most.rule
            raise rule.place.error(
                f'the string would grow to {count} modules, the limit is {self.max_modules}; '
                f'the rule for {rule.label} writes {len(most.rows) * len(rule.successor)} '
                'of them in this step')


def _write_successors(match: _Match, to: np.ndarray, to_values: np.ndarray, key: np.ndarray,
                      origin: np.ndarray, values: np.ndarray,
                      generator: np.random.Generator) -> None:
    offset = 0
    for place, piece in enumerate(match.rule.successor):
        key[to + place] = piece.key
        origin[to + place] = piece.origin
        for argument in piece.arguments:
            values[to_values + offset] = argument.evaluate(match.values, len(to), generator)
            offset += 1


def _choose(rules: Sequence[Production], rows: np.ndarray, modules: Modules, starts: np.ndarray,
            tree: tuple | None, defines: Mapping[str, float],
            generator: np.random.Generator) -> list[_Match]:
    """Choose the first rule that fits each row, or draw one among alternatives."""
    matches: list[_Match] = []
    for pattern, group in groupby(rules, key=lambda rule: rule.pattern):
        alternatives = [[rule] for rule in group]
        if not pattern[-1]:  # consecutive rules with weights are one draw
            alternatives = [[rule for single in alternatives for rule in single]]
        for candidates in alternatives:
            good, values = _fit(candidates, rows, modules, starts, tree, defines)
            fitting = rows[good]
            if not len(fitting):
                continue
            choice = _draw(candidates, values, len(fitting), generator)
            for number, rule in enumerate(candidates):
                chosen = choice == number
                if chosen.any():
                    matches.append(_Match(rule, fitting[chosen],
                                          _select(values[number], chosen)))
            taken = np.zeros(len(rows), bool)
            taken[np.flatnonzero(good)[choice >= 0]] = True
            rows = rows[~taken]
            if not len(rows):
                return matches
    return matches


def _select(values: dict, chosen: np.ndarray) -> dict:
    if chosen.all():
        return values
    return {n: v[chosen] if isinstance(v, np.ndarray) else v for n, v in values.items()}


def _fit(rules: Sequence[Production], rows: np.ndarray, modules: Modules, starts: np.ndarray,
         tree: tuple | None, defines: Mapping[str, float]) -> tuple[np.ndarray, list[dict]]:
    """Match the contexts that the rules share, and gather the parameters for each rule."""
    rule = rules[0]
    good = np.ones(len(rows), bool)
    met = {}
    if tree is not None and (rule.left or rule.right):
        before, onward, closing = tree
        good, met[-1] = match_left(rows, modules.key, before, np.array(rule.left, np.int32))
        ahead, met[1] = match_right(rows, modules.key, onward, closing,
                                    np.array(rule.right, np.int32))
        good &= ahead
    met[0] = rows[:, None]
    met = {side: places[good] for side, places in met.items()}
    gathered = []
    for one in rules:
        values: dict = dict(defines)
        for name, side, at, number in one.formals:
            values[name] = modules.values[starts[met[side][:, at]] + number]
        gathered.append(values)
    return good, gathered


def _draw(rules: Sequence[Production], values: Sequence[dict], count: int,
          generator: np.random.Generator) -> np.ndarray:
    """Draw the index of the rule for each row, -1 where no condition is true, (N,)."""
    weights = np.zeros((len(rules), count))
    for number, rule in enumerate(rules):
        true = np.ones(count, bool)
        if rule.condition is not None:
            true &= np.not_equal(rule.condition.evaluate(values[number], count, generator), 0.0)
        weights[number, true] = _weigh(rule, _select(values[number], true),
                                       int(np.count_nonzero(true)), generator)
    limits = np.cumsum(weights, axis=0)
    if len(rules) == 1:
        return np.where(limits[0] > 0.0, 0, -1)
    drawn = generator.random(count) * limits[-1]
    return np.where(limits[-1] > 0.0, np.argmax(limits > drawn, axis=0), -1)


def _weigh(rule: Production, values: dict, count: int, generator: np.random.Generator) -> Value:
    """Evaluate the weight of a rule where its condition holds."""
    if rule.weight is None:
        return 1.0
    weight = rule.weight.evaluate(values, count, generator)
    check_weight(weight, rule.weight.place)
    return weight
