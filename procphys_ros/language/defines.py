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


"""Defines: named numbers of a grammar, which its users may override."""

from collections.abc import Mapping, Sequence
import numbers
import sys

import numpy as np

from procphys_ros.errors import GrammarError, nearest_names
from procphys_ros.language.expressions import Expression

_LARGEST = sys.float_info.max


def generator_of(seed: int, source: str) -> np.random.Generator:
    """
    Make the generator of all random numbers of a derivation.

    :param source: name of the grammar, for errors.
    :raises GrammarError: for a seed that is negative or not a whole number.
    """
    if not isinstance(seed, numbers.Integral) or seed < 0:
        raise GrammarError(f'the seed is {seed!r}, it must be a whole number, 0 or more', source)
    return np.random.default_rng(int(seed))


def check_overrides(known: Sequence[str], overrides: Mapping[str, float], source: str) -> None:
    """
    Check values that replace those of defines.

    :param known: names of the defines.
    :param source: name of the grammar, for errors.
    :raises GrammarError: for an unknown define, or one that is not a number.
    """
    for name, value in overrides.items():
        if name not in known:
            raise GrammarError(f'unknown define "{name}"{nearest_names(name, known)} '
                               f'(defines: {", ".join(known) or "none"})', source)
        if not isinstance(value, numbers.Real) or not -_LARGEST <= value <= _LARGEST:
            raise GrammarError(f'define "{name}" must be a finite number, found {value!r}', source)


def resolve_defines(definitions: Sequence[tuple[str, Expression]],
                    overrides: Mapping[str, float], generator: np.random.Generator,
                    source: str = '<text>') -> dict[str, float]:
    """
    Evaluate the defines of a grammar in order; each may use those before it.

    :param definitions: name and compiled value.
    :param overrides: values that replace those of the grammar.
    :param generator: source of random numbers.
    :param source: name of the grammar, for errors.
    :returns: value of every define.
    :raises GrammarError: for an override of an unknown define, or one that is not a number.
    """
    check_overrides([name for name, _ in definitions], overrides, source)
    values: dict[str, float] = {}
    for name, expression in definitions:
        values[name] = (float(overrides[name]) if name in overrides
                        else expression.number(values, generator))
    return values
