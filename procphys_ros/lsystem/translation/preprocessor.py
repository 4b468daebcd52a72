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

"""Preprocessor: comments, defines and includes of texts for cpfg, as the one of C reads them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
import re
from typing import NamedTuple

from procphys_ros.errors import GrammarError
from procphys_ros.language import Place, read_include
from procphys_ros.language.arithmetic import FUNCTIONS
from procphys_ros.language.syntax import LONGEST_TEXT

_COMMENT = re.compile(r'/\*.*?(?P<end>\*/|\Z)|(?:^|(?<=\s))//[^\n]*', re.DOTALL | re.MULTILINE)
_DIRECTIVE = re.compile(
    r'\s*#\s*(define|include|undef|ifdef|ifndef|if|elif|else|endif|line|pragma)\b(.*)')
_DEFINE = re.compile(r'(\s+)([A-Za-z_]\w*)(\([^)]*\))?(\s+|$)(.*)')
_INCLUDED = re.compile(r'\s*["<]([^">]*)[">]')
_IDENTIFIER = re.compile(r'(?<![\w.])[A-Za-z_]\w*')
_NUMBER = re.compile(r'-?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?')
_RESERVED = ('self', 'steps', 'seed')  # defines of our language cannot have these names
_MOST_EXPANSIONS = 100_000  # in one text; a second of work
_DEEPEST = 50               # macros within macros, and within their arguments


class Macro(NamedTuple):
    """
    A define that is replaced by its text.

    :ivar parameters: their names, None = it has none.
    :ivar body: the text.
    """

    parameters: tuple[str, ...] | None
    body: str


class ForeignDefine(NamedTuple):
    """
    A define that is a number, and stays one here.

    :ivar text: `name = value`, in the columns of the file.
    :ivar line: of the file.
    """

    text: str
    line: int


@dataclass
class Preprocessor:
    """
    Reads one text, line by line, so that all places stay what they are.

    :ivar source: name of the text.
    :ivar folder: searched first for included files; None = there is none.
    :ivar defines: those that are numbers.
    """

    source: str
    folder: Path | None
    defines: list[ForeignDefine] = field(default_factory=list)
    _numbers: set[str] = field(default_factory=set)
    _macros: dict[str, Macro] = field(default_factory=dict)
    _seen: set[Path] = field(default_factory=set)
    _expansions: int = 0

    def read(self, text: str) -> list[str]:
        """
        Return the lines with all comments and directives taken out and macros replaced.

        :raises GrammarError: for directives that are not read, and endless expansions.
        """
        self._seen.add(Path(self.source).resolve())
        result, length = [], 0
        for number, line in enumerate(list(self._directives(text)), 1):
            result.append(self._expand(line, number))
            length += len(result[-1])
            if length > LONGEST_TEXT:
                raise Place(self.source, number).error(
                    f'the grammar has more than {LONGEST_TEXT} characters once its defines are '
                    'replaced')
        return result

    def _directives(self, text: str) -> Iterator[str]:
        """Take out comments, and carry out directives."""
        lines = _COMMENT.sub(self._blank, text).splitlines()
        powers = set(re.findall(r'\b(\w++)\s*+\^', text))
        number = 0
        while number < len(lines):
            begun, line = number + 1, lines[number]
            directive = _DIRECTIVE.match(line)
            number += 1
            if not directive:
                yield line
                continue
            while line.endswith('\\') and number < len(lines):
                line = f'{line[:-1]} {lines[number]}'
                number += 1
            self._directive(_DIRECTIVE.match(line) or directive, begun, powers)
            yield from [''] * (number - begun + 1)

    def _blank(self, comment: re.Match) -> str:
        """Return blanks in the place of a comment; raise GrammarError if it is never closed."""
        if comment['end'] == '':
            before = comment.string[:comment.start()]
            line, column = before.count('\n') + 1, len(before) - before.rfind('\n')
            raise Place(self.source, line, column).error('this comment is never closed with "*/"')
        return re.sub(r'[^\n]', ' ', comment[0])

    def _directive(self, found: re.Match, number: int, powers: set[str]) -> None:
        word, rest = found[1], found[2]
        place = Place(self.source, number, found.start(1) + 1)
        if word == 'include':
            self._include(rest, place)
        elif word == 'define' and (parts := _DEFINE.fullmatch(rest)):
            space, name, parameters, gap, body = parts.groups()
            body = body.rstrip()
            if parameters is None and self._is_number(name, body, powers):
                self._numbers.add(name)
                before = ' ' * (found.start(2) + len(space))
                self.defines.append(ForeignDefine(f'{before}{name}={gap[1:]}{body}', number))
            else:
                self._macros[name] = Macro(
                    None if parameters is None else
                    tuple(_IDENTIFIER.findall(parameters)), body)
        else:
            raise place.error(f'"#{word}" is not read; of directives, "#define NAME value" and '
                              '"#include" are')

    def _is_number(self, name: str, body: str, powers: set[str]) -> bool:
        """Return whether a define means the same as a number and as a text."""
        if name in _RESERVED or name in self._macros:
            return False
        if _NUMBER.fullmatch(body):
            return body[0] != '-' or name not in powers
        return (_enclosed(body) and set(_IDENTIFIER.findall(body)) <= {*self._numbers, *FUNCTIONS}
                and not set(body) & set('{}[];?='))

    def _include(self, rest: str, place: Place) -> None:
        """Take the defines of an included file."""
        named = _INCLUDED.match(rest)
        name = named[1] if named else rest.strip()
        if name.startswith('lpfg'):
            raise place.error('this is a program for lpfg, in C++; the productions of cpfg are '
                              'read: A(l) : l > 1 --> F(l)')
        try:
            found = read_include(name, self.folder, place, self._seen, ('.l', '.h'))
        except GrammarError as error:
            place.warn(f'{error.message}; it is left out')
            return
        if found is None:
            return
        path, text = found
        self._seen.add(path)
        inner = Preprocessor(str(path), path.parent, self.defines, self._numbers, self._macros,
                             self._seen)
        before = len(self.defines)
        rest_of_file = ''.join(inner._directives(text)).strip()
        # errors in included defines are told at the include, which is in this text
        self.defines[before:] = [ForeignDefine(one.text.strip(), place.line)
                                 for one in self.defines[before:]]
        if rest_of_file:
            place.warn(f'only the defines of "{name}" are read; all else in it is left out')

    def _expand(self, line: str, number: int, hidden: frozenset[str] = frozenset(),
                depth: int = 0) -> str:
        result, end = [], 0
        while found := _IDENTIFIER.search(line, end):
            macro = self._macros.get(found[0])
            result.append(line[end:found.start()])
            end = found.end()
            arguments = _arguments(line, end) if macro and macro.parameters is not None else None
            if macro is None or found[0] in hidden or (
                    macro.parameters is not None and arguments is None):
                result.append(found[0])
                continue
            body = macro.body
            if arguments is not None:
                given, end = arguments
                self._count(number, depth, 0)
                body = self._fill(
                    macro, [self._expand(one, number, hidden, depth + 1) for one in given],
                    Place(self.source, number, found.start() + 1))
            self._count(number, depth, sum(map(len, result)) + len(body))
            result.append(self._expand(body, number, hidden | {found[0]}, depth + 1))
        return ''.join([*result, line[end:]])

    def _count(self, number: int, depth: int, length: int) -> None:
        self._expansions += 1
        if self._expansions > _MOST_EXPANSIONS or depth > _DEEPEST or length > LONGEST_TEXT:
            raise Place(self.source, number).error(
                f'the defines in this line grow past {_MOST_EXPANSIONS} replacements, '
                f'{LONGEST_TEXT} characters or {_DEEPEST} levels')

    def _fill(self, macro: Macro, given: list[str], place: Place) -> str:
        names = macro.parameters or ()
        if len(names) != len(given):
            raise place.error(f'this define takes {len(names)} parameters, found {len(given)}')
        values = dict(zip(names, given))
        return _IDENTIFIER.sub(lambda found: values.get(found[0], found[0]), macro.body)


def _enclosed(text: str) -> bool:
    """Return whether the first parenthesis closes at the end."""
    depth = 0
    for at, letter in enumerate(text):
        depth += (letter == '(') - (letter == ')')
        if depth <= 0:
            return at > 0 and at == len(text) - 1
    return False


def _arguments(line: str, start: int) -> tuple[list[str], int] | None:
    """Return the arguments in parentheses and where they end, None = there are none."""
    while start < len(line) and line[start].isspace():
        start += 1
    if line[start:start + 1] != '(':
        return None
    depth, parts, begun = 0, [], start + 1
    for at in range(start, len(line)):
        depth += (line[at] in '([{') - (line[at] in ')]}')
        if depth == 1 and line[at] == ',' or depth == 0:
            parts.append(line[begun:at].strip())
            begun = at + 1
        if depth == 0:
            return parts, at + 1
    return None
