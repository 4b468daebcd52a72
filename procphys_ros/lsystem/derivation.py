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


"""Derivation: the steps of an L-system from its axiom to the string that the turtle reads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.lsystem.modules import Modules, Vocabulary
from procphys_ros.lsystem.rewriting import Rewritten, RuleSet
from procphys_ros.lsystem.rules import Produced

_MOST_WORK = 100  # work of a derivation in strings of the greatest length, some 20 s to a minute
_MOST_PASSES = 1000  # of decomposition rules over their own result


class Work:
    """
    Counts the modules that rules examine, and ends a derivation that would take minutes.

    :param most: modules, over all passes.
    """

    def __init__(self, most: int):
        self._most, self._done, self._passes = most, 0, 0

    def rewrite(self, rules: RuleSet, modules: Modules, defines: Mapping[str, float],
                generator: np.random.Generator, active: np.ndarray | None = None) -> Rewritten:
        """Rewrite like `RuleSet.rewrite`, and count the work."""
        result = rules.rewrite(modules, defines, generator, active)
        self._passes += 1
        self._done += len(modules) if rules.rules else 0
        if self._done > self._most:
            rule = result.applied or rules.rules[0]
            raise rule.place.error(
                f'{self._done:,} modules were looked at in {self._passes} steps, the limit is '
                f'{self._most:,}; the string has {len(result.modules)} modules by now: take fewer '
                'steps, or let it grow less')
        return result


@dataclass(frozen=True)
class Derivation:
    """
    The rules of an L-system, ready to be applied.

    :ivar axiom: first string.
    :ivar vocabulary: of all its modules.
    :ivar production: applied once in each step.
    :ivar decomposition: applied to its own result, after the axiom and after every step.
    :ivar interpretation: applied to the final string, to a depth.
    """

    axiom: Sequence[Produced]
    vocabulary: Vocabulary
    production: RuleSet
    decomposition: RuleSet
    interpretation: RuleSet

    def first(self, defines: Mapping[str, float], generator: np.random.Generator,
              work: Work) -> Modules:
        """
        Write the axiom.

        :param defines: value of each define.
        :param generator: source of all random choices.
        :param work: done so far, from `work`.
        """
        return self._decompose(self._write_axiom(defines, generator), None, defines, generator,
                               work)[0]

    def following(self, modules: Modules, defines: Mapping[str, float],
                  generator: np.random.Generator, work: Work) -> tuple[Modules, np.ndarray]:
        """
        Derive the string that follows another; further arguments as in `first`.

        :returns: it, and the row of the old string that each module continues, -1 for new ones.
        :raises GrammarError: when growth or recursion pass their bounds.
        """
        result = work.rewrite(self.production, modules, defines, generator)
        return self._decompose(result.modules, result, defines, generator, work)

    def work(self) -> Work:
        """Begin to count the work of a derivation."""
        return Work(_MOST_WORK * self.production.max_modules)

    def interpret(self, modules: Modules, depth: int, defines: Mapping[str, float],
                  generator: np.random.Generator) -> tuple[Modules, np.ndarray]:
        """
        Replace modules by their geometry; results are interpreted again, to a depth.

        :param modules: derived string.
        :param depth: 1 = results are left as they are.
        :param defines: value of each define.
        :param generator: source of all random choices.
        :returns: the interpreted string, and the row that each of its modules comes from.
        """
        fresh, work = None, Work(_MOST_WORK * self.interpretation.max_modules)
        source = np.arange(len(modules))
        for _ in range(depth):
            result = work.rewrite(self.interpretation, modules, defines, generator, fresh)
            modules, fresh, source = result.modules, result.fresh, source[result.source]
            if result.applied is None:
                break
        return modules, source

    def _write_axiom(self, defines: Mapping[str, float],
                     generator: np.random.Generator) -> Modules:
        values = [argument.number(defines, generator)
                  for piece in self.axiom for argument in piece.arguments]
        return Modules(self.vocabulary, np.array([p.key for p in self.axiom], np.int32),
                       np.array(values, float), np.array([p.origin for p in self.axiom], np.int32))

    def _decompose(self, modules: Modules, rewritten: Rewritten | None,
                   defines: Mapping[str, float], generator: np.random.Generator,
                   work: Work) -> tuple[Modules, np.ndarray]:
        """Apply the decomposition to its own result; return as `following`."""
        rule, fresh, row = None, None, np.arange(len(modules))
        if rewritten is not None:
            fresh, row = rewritten.fresh, _continued(rewritten)
        for _ in range(_MOST_PASSES if self.decomposition.rules else 0):
            result = work.rewrite(self.decomposition, modules, defines, generator, fresh)
            if result.applied is None:
                return modules, row
            before, step = row, _continued(result)
            row = np.where(step >= 0, before[step], -1)
            modules, fresh, rule = result.modules, result.fresh, result.applied
        if rule is not None:
            raise rule.place.error(
                f'the decomposition of {rule.label} did not end after {_MOST_PASSES} passes '
                f'({len(modules)} modules); give it a condition that becomes false')
        return modules, row


def _continued(result: Rewritten) -> np.ndarray:
    """Return the row of the old string that each module continues, -1 for new ones, (M,)."""
    return np.where(result.continues, result.source, -1)
