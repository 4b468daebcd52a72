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


"""Figure 1.31 of The Algorithmic Beauty of Plants, in the notation of the book."""

import pytest

from procphys_ros.lsystem import LSystem

# Figure: successor of the module in the middle for left, middle, right of 000, 001, … 111;
# derivation length; number of segments that the string then holds, counted by `_derive` below.
_FIGURES = {
    'a': ('0 1[+F1F1] 1 1 0 1F1 0 0', 30, 2501),
    'b': ('1 1[-F1F1] 1 1 0 1F1 1 0', 30, 5626),
    'c': ('0 1 0 1[+F1F1] 0 1F1 0 0', 26, 944),
    'd': ('1 0 0 1F1 1 1[+F1F1] 1 0', 24, 2356),
    'e': ('0 1[-F1F1] 1 1 0 1F1 1 0', 26, 824),
}


def _grammar(successors: str) -> str:
    rules = [f'{n >> 2 & 1} < {n >> 1 & 1} > {n & 1} -> {successor}'
             for n, successor in enumerate(successors.split())]
    return '\n'.join(['axiom: F1F1F1', 'ignore: + - F', 'production:', *rules,
                      '* < + > * -> -', '* < - > * -> +'])


def _neighbours(text: str, place: int) -> str:
    """Find the symbols before and behind a place on the tree, by the words of the book (p. 32)."""
    left = right = ''
    i = place - 1
    while i >= 0 and not left:
        if text[i] == ']':
            depth = 1
            while depth:
                i -= 1
                depth += {']': 1, '[': -1}.get(text[i], 0)
        elif text[i] not in '+-F[':
            left = text[i]
        i -= 1
    i = place + 1
    while i < len(text) and text[i] != ']' and not right:
        if text[i] == '[':
            depth = 1
            while depth:
                i += 1
                depth += {'[': 1, ']': -1}.get(text[i], 0)
        elif text[i] not in '+-F':
            right = text[i]
        i += 1
    return (left or '.') + text[place] + (right or '.')


def _derive(successors: str, steps: int) -> str:
    rules = {f'{n:03b}': successor for n, successor in enumerate(successors.split())}
    text = 'F1F1F1'
    for _ in range(steps):
        text = ''.join({'+': '-', '-': '+'}.get(c) or (
            rules.get(_neighbours(text, i), c) if c in '01' else c) for i, c in enumerate(text))
    return text


@pytest.mark.parametrize('figure', _FIGURES)
def test_figures_with_digits_as_modules(figure, recwarn):
    """Derive the figures from F1F1F1 to their full length, as an independent reading does."""
    successors, steps, segments = _FIGURES[figure]
    system = LSystem.parse(_grammar(successors))
    for length in (1, 2, steps // 2, steps):
        assert str(system.derive(length)) == _derive(successors, length)
    assert str(system.derive(steps)).count('F') == segments
    assert not list(recwarn)
