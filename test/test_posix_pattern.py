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

"""Regular expressions that strangers send: what they find, and how long they may take."""

import random
import re

import pytest

from procphys_ros.errors import CommandError
from procphys_ros.ros.posix_pattern import PosixPattern

NAMES = [f'oak_{i}' for i in range(5000)]
HOSTILE = ['^(a|a)*b', '(a+)+b', '((a*)*)*b', '(a|aa)+$b', '(x?){30}x{30}', '([a-z0-9_]?){400}Z',
           '(a|b)*a(a|b){300}', '(a|b)*a(a|b){12}!', '(((a{250}){250}){250}){250}', '(){99999}',
           '(' * 499 + 'a' + ')' * 499, '(' * 1000, '(a' * 300 + ')*' * 300, '|' * 1000,
           '[' * 1000, f'a{{{"9" * 990}}}', 'a{255}{255}', '[' + 'a-z' * 300 + ']*!', 'a' * 10**6,
           '[[:' + 'a' * 900 + ':]]', '(a*)*' * 190 + '!', '.*' * 400 + '!']


def written(chance: random.Random, depth: int) -> str:
    """Write some expression that POSIX and Python read alike."""
    kind = chance.choice('llllgcabr' if depth else 'lllab')
    if kind == 'l':
        return chance.choice(['a', 'b', '_', '.', r'\.', '1'])
    if kind == 'a':
        return chance.choice('^$')
    if kind == 'b':
        return chance.choice(['[ab]', '[^a]', '[a-b1]', '[]b]', '[^]_]', '[b-]', r'\d', r'\W'])
    inner = [written(chance, depth - 1) for _ in range(chance.randint(1, 3))]
    if kind == 'r':
        times = chance.choice(['*', '+', '?', '{2}', '{0}', '{1,}', '{0,2}', '{,2}'])
        return f'({inner[0]}){times}'
    return f'({"|".join(inner)})' if kind == 'g' else ''.join(inner)


@pytest.mark.parametrize('seed', range(20))
def test_what_is_found_is_what_python_finds(seed):
    """Agree with `re` about random expressions in random names."""
    chance = random.Random(seed)
    for _ in range(150):
        text = '|'.join(written(chance, 3) for _ in range(chance.randint(1, 2)))
        pattern = PosixPattern(text)
        for _ in range(8):
            name = ''.join(chance.choices('ab_1.]-', k=chance.randint(0, 6)))
            assert pattern.is_in(name) == bool(re.search(text, name)), (text, name)


@pytest.mark.parametrize('text, fitting', [
    ('', ['oak_1', 'Fir 2']), ('[[:digit:]]$', ['oak_1', 'Fir 2']), ('[[:space:]]', ['Fir 2']),
    ('^[[:lower:]_[:digit:]]+$', ['oak_1']), ('[^[:alnum:]_]', ['Fir 2']), (r'\s\d', ['Fir 2']),
    ('[[:punct:]]', ['oak_1']), ('^o{1}a+k?_|F[h-j]r', ['oak_1', 'Fir 2']), ('^$', []),
    ('[[:xdigit:]]{2}', []), ('[[:upper:]]|[[:blank:]]', ['Fir 2'])])
def test_expressions_of_posix_are_read(text, fitting):
    """Take classes, sets, intervals, groups and anchors."""
    pattern = PosixPattern(text)
    assert [name for name in ('oak_1', 'Fir 2') if pattern.is_in(name)] == fitting


@pytest.mark.parametrize('text, reason', [
    ('(a', r'a \( is not closed'), ('a)', r'a \) closes nothing'), ('*a', r'nothing before a \*'),
    ('(|+)', r'nothing before a \+'), ('(?:a)', r'nothing before a \?'), ('a{', 'a } is missing'),
    ('a{x}', 'number of repetitions'), ('a{}', 'number of repetitions'),
    ('a{1,2,3}', 'number of repetitions'), ('a{3,2}', 'ends before it begins'),
    ('[a', 'a ] is missing'), ('[z-a]', 'ends before it begins'), (r'[\d]', 'no meaning'),
    ('[[:digits:]]', 'there is no class .*xdigit'), ('[[:digit]', ':] is missing'),
    ('a\\', 'means nothing'), (r'(a)\1', r'\\1 means nothing'), ('a{2001}', 'too large'),
    ('a' * 1001, 'longer than 1000 characters')])
def test_what_is_no_expression_is_refused(text, reason):
    """Say what is wrong."""
    with pytest.raises(CommandError, match=f'is no regular expression: .*{reason}'):
        PosixPattern(text)


@pytest.mark.timeout(60)  # none takes half a second; Python's `re` needs years for some
@pytest.mark.parametrize('text', HOSTILE, ids=lambda text: text[:30])
@pytest.mark.parametrize('names', [NAMES, ['a' * 60], ['ab' * 5000], random.Random(1).choices(
    ['a' * i + 'b' * j + 'a' * k for i in range(9) for j in range(9) for k in range(9)], k=500)],
    ids=['many', 'alike', 'long', 'mixed'])
def test_no_expression_holds_anything_up(text, names):
    """Answer or refuse at once, for all patterns and names of objects."""
    try:
        pattern = PosixPattern(text)
        for name in names:
            pattern.is_in(name)
    except CommandError as error:
        assert len(str(error)) < 250
