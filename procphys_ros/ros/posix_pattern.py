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


"""
Extended regular expressions of POSIX, searched for in bounded time.

Strangers send them to the node, and Python's `re` may need years for a short one. Here all ways
through the expression are followed at once, a character at a time (Ken Thompson, Regular
expression search algorithm, 1968).
"""

from collections.abc import Sequence
from typing import NoReturn

from procphys_ros.errors import CommandError
from procphys_ros.schema import short

_LONGEST = 1000  # [characters] of an expression
_LARGEST = 2000  # [instructions] of an expression with its repetitions expanded
_WORK = 300_000  # [comparisons] in all searches for an expression: at most half a second
_CLASSES = {'alnum': ['az', 'AZ', '09'], 'alpha': ['az', 'AZ'], 'blank': [' ', '\t'],
            'digit': ['09'], 'lower': ['az'], 'punct': ['!/', ':@', '[`', '{~'],
            'space': ['\t\r', ' '], 'upper': ['AZ'], 'xdigit': ['09', 'AF', 'af']}
_SHORT = {'d': _CLASSES['digit'], 's': _CLASSES['space'], 'w': [*_CLASSES['alnum'], '_']}
_START, _END = '^', '$'
_TIMES = {'*': (0, None), '+': (1, None), '?': (0, 1)}  # least and largest count


class _Characters:
    """A set of characters: ranges such as `az`, or their complement."""

    def __init__(self, ranges: Sequence[str], inverted: bool = False):
        self.ranges, self._inverted = ranges, inverted

    def __contains__(self, character: str) -> bool:
        return self._inverted != any(r[0] <= character <= r[-1] for r in self.ranges)


# The next characters to match, or relative jumps to instructions.
_Code = list[_Characters | str | tuple[int, ...]]


class PosixPattern:
    r"""
    Search for an expression in names.

    :param text: extended regular expression; also takes the classes \d, \s, \w, \D, \S, \W.
    :raises CommandError: if it is invalid, or too large.
    """

    def __init__(self, text: str):
        self._text = text
        self._code = _PatternReader(text).read()
        self._work = 0
        self._known: dict[tuple[frozenset[int], bool, str], frozenset[int] | None] = {}

    def is_in(self, name: str) -> bool:
        """
        Return whether the expression matches some part of a name.

        :raises CommandError: if the names so far have taken too long.
        """
        places: frozenset[int] | None = frozenset([0])
        for i, character in enumerate([*name, '']):
            assert places is not None
            key = places, i == 0, character
            if key not in self._known:
                self._known[key] = self._follow(*key)
            places = self._known[key]
            if places is None:
                return True
        return False

    def _follow(self, places: frozenset[int], is_first: bool,
                character: str) -> frozenset[int] | None:
        """Return the instructions after the next character ('' = the end); None = matched."""
        code, reached, following = self._code, list(places), {0}
        seen = set(reached)
        while reached:
            place = reached.pop()
            if place == len(code):
                return None
            wanted = code[place]
            self._work += 1
            if isinstance(wanted, _Characters):
                self._work += len(wanted.ranges)
                if character and character in wanted:
                    following.add(place + 1)
                continue
            if isinstance(wanted, str):
                wanted = (1,) if (is_first if wanted == _START else not character) else ()
            new = {place + offset for offset in wanted} - seen
            seen |= new
            reached += new
        if self._work > _WORK:
            raise CommandError(f'{short(self._text)} takes too long to search for; give a '
                               'simpler regular expression')
        return frozenset(following)


class _PatternReader:
    """Compile an expression to instructions; a stack holds those of open brackets."""

    def __init__(self, text: str):
        self._text, self._place = text, 0
        self._open: list[list[list[_Code]]] = [[[]]]  # alternatives of pieces

    def read(self) -> _Code:
        """
        Read the whole expression.

        :raises CommandError: if it is invalid, or too large.
        """
        if len(self._text) > _LONGEST:
            self._refuse(f'it is longer than {_LONGEST} characters')
        while self._place < len(self._text):
            self._read_one(self._next())
        if len(self._open) > 1:
            self._refuse('a ( is not closed')
        return self._close()

    def _read_one(self, character: str) -> None:
        if character == '(':
            self._open.append([[]])
        elif character == ')':
            if len(self._open) == 1:
                self._refuse('a ) closes nothing')
            self._add(self._close())
        elif character == '|':
            self._open[-1].append([])
        elif character in '*+?{':
            self._repeat(character)
        elif character in (_START, _END):
            self._add([character])
        elif character == '.':
            self._add([_Characters([], inverted=True)])
        elif character == '[':
            self._add([self._bracket()])
        else:
            self._add([self._escaped() if character == '\\' else _Characters([character])])

    def _next(self) -> str:
        """Return the next character; '' at the end."""
        self._place += 1
        return self._text[self._place - 1:self._place]

    def _until(self, end: str) -> str:
        """Return the text up to a delimiter, and skip both."""
        found = self._text.find(end, self._place)
        if found < 0:
            self._refuse(f'a {end} is missing')
        before = self._text[self._place:found]
        self._place = found + len(end)
        return before

    def _add(self, code: _Code) -> None:
        self._open[-1][-1].append(self._fitting(len(code), code))

    def _fitting(self, size: int, code: _Code) -> _Code:
        if size > _LARGEST:
            self._refuse('its repetitions are too large')
        return code

    def _close(self) -> _Code:
        """Join the alternatives of the last bracket."""
        *others, last = [[step for piece in pieces for step in piece]
                         for pieces in self._open.pop()]
        for other in reversed(others):
            last = [(1, len(other) + 2), *other, (len(last) + 1,), *last]
        return self._fitting(len(last), last)

    def _repeat(self, character: str) -> None:
        low, high = _TIMES.get(character) or self._interval()
        pieces = self._open[-1][-1]
        if not pieces:
            self._refuse(f'there is nothing before a {character}')
        piece = pieces[-1]
        count = low if high is None else high
        self._fitting((len(piece) + 1) * (count + 1), [])
        more: _Code = [(1, len(piece) + 2), *piece, (-len(piece) - 1,)]
        if high is not None:
            more = [(1, len(piece) + 1), *piece] * (high - low)
        pieces[-1] = piece * low + more

    def _interval(self) -> tuple[int, int | None]:
        """Read the limits of a repetition, after a {."""
        inner = self._until('}')
        first, comma, last = inner.partition(',')
        if not all(n.isdecimal() or (comma and not n) for n in (first, last or '0')):
            self._refuse(f'{short(inner)} is no number of repetitions, such as {{2}}, {{2,}}, '
                         '{2,5}')
        low = int(first or 0)
        high = (int(last) if last else None) if comma else low
        if high is not None and high < low:
            self._refuse(f'{short(inner)} ends before it begins')
        return low, high

    def _escaped(self) -> _Characters:
        """Read the character after a backslash."""
        character = self._next()
        if character.lower() in _SHORT:
            return _Characters(_SHORT[character.lower()], character.isupper())
        if not character or character.isalnum():
            self._refuse(f'\\{character} means nothing')
        return _Characters([character])

    def _bracket(self) -> _Characters:
        """Read a set of characters, after a [."""
        inverted = self._text.startswith('^', self._place)
        self._place += inverted
        ranges: list[str] = []
        while not self._text.startswith(']', self._place) or not ranges:
            if self._text.startswith('[:', self._place):
                self._place += 2
                ranges += self._class(self._until(':]'))
                continue
            low = high = self._next()
            if self._text.startswith('-', self._place) and \
                    self._text[self._place + 1:self._place + 2] not in ('', ']'):
                self._place += 1
                high = self._next()
            if not low or '\\' in (low, high):
                self._refuse('a backslash has no meaning in [ ]' if low else 'a ] is missing')
            if high < low:
                self._refuse(f'{low}-{high} ends before it begins')
            ranges.append(low + high)
        self._place += 1
        return _Characters(ranges, inverted)

    def _class(self, name: str) -> list[str]:
        if name not in _CLASSES:
            self._refuse(f'there is no class {short(name)} ({", ".join(_CLASSES)})')
        return _CLASSES[name]

    def _refuse(self, reason: str) -> NoReturn:
        raise CommandError(f'{short(self._text)} is no regular expression: {reason}')
