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


"""Texts of grammars and their syntax errors, explained in the user's words."""

from collections.abc import Iterable, Mapping
import os
from pathlib import Path
import stat

from lark import Token
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken
from lark.parsers.lalr_interactive_parser import InteractiveParser

from procphys_ros.errors import GrammarError
from procphys_ros.language.grammar import EXPRESSION_WORDS
from procphys_ros.schema import short

# [characters] Ten times the largest grammar; a text of symbols only takes 10 s to parse, which
# cannot be interrupted.
LONGEST_TEXT = 200_000


def check_length(text: str, source: str) -> None:
    """
    Check that a grammar is a text of acceptable length.

    :param text: of the grammar.
    :param source: name of the file or parameter.
    :raises GrammarError: when it is longer than `LONGEST_TEXT`, or not a text.
    """
    if not isinstance(text, str):
        raise GrammarError(f'the grammar is {short(text)}, it must be a text', source)
    if len(text) > LONGEST_TEXT:
        raise GrammarError(f'the grammar has {len(text)} characters, at most {LONGEST_TEXT} are '
                           'read', source)


def read_text(path: str | Path) -> str:
    """
    Read a grammar file, up to the greatest length of a grammar.

    :param path: of the file, UTF-8 with or without byte order mark.
    :raises GrammarError: when it cannot be read, or is too long.
    """
    source = shorten(str(path))
    try:
        raw = read_regular(path, 4 * LONGEST_TEXT + 4)  # [bytes] at most four per character
    except (OSError, ValueError) as problem:
        reason = getattr(problem, 'strerror', None) or problem
        raise GrammarError(f'cannot read the grammar: {reason}', source) from None
    try:
        text = raw.decode('utf-8-sig')
    except UnicodeDecodeError as problem:
        if len(raw) <= 4 * LONGEST_TEXT:
            line = raw.count(b'\n', 0, problem.start) + 1
            raise GrammarError('cannot read the grammar: this is no UTF-8 text', source,
                               line) from None
        text = ' ' * len(raw)  # cut in the middle of a character, but too long in any case
    if len(text) > LONGEST_TEXT:
        raise GrammarError(f'the grammar has more than {LONGEST_TEXT} characters', source)
    return text.replace('\r\n', '\n').replace('\r', '\n')


def read_regular(path: str | Path, most: int) -> bytes:
    """
    Read a regular file up to a length [bytes].

    :raises OSError: when it cannot be read.
    :raises ValueError: for pipes and devices, which may never end.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe without writer would wait
    with open(handle, 'rb') as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise ValueError('it is not a regular file')
        return file.read(most)


def shorten(text: str, most: int = 200) -> str:
    """Format a name for messages: shortened, with unprintable characters escaped."""
    text = _shown(text)
    return text if len(text) <= most else f'{text[:most]}… ({len(text)} characters)'


def _shown(text: str) -> str:
    """Escape unprintable characters."""
    return text if text.isprintable() else ascii(text)[1:-1]


class _NoLexer:
    """Stub of the lexer where only the parser is used; lark 1.3 takes the token class."""

    _Token = Token


def _accepted(problem: UnexpectedCharacters) -> Iterable[str]:
    """Filter the terminals that the lexer tried to those that the parser accepts."""
    if not hasattr(problem.state, 'parse_conf'):  # raised outside the LALR parser
        return problem.allowed or ()
    return InteractiveParser(None, problem.state, _NoLexer()).accepts()


def _expected_words(names: Iterable[str], words: Mapping[str, str]) -> str:
    table = {**EXPRESSION_WORDS, **words}
    names = set(names)
    if 'NUMBER' in names:  # where a value may begin, these are signs of that value
        names -= {'_PLUS', '_MINUS', '_NOT'}
    said = sorted({table.get(name, name.strip('_').lower()) for name in names})
    if not said:
        return 'nothing more'
    return ' or '.join([', '.join(said[:-1]), said[-1]] if len(said) > 1 else said)


def syntax_error(problem: UnexpectedInput, source: str, first_line: int = 1,
                 words: Mapping[str, str] | None = None) -> GrammarError:
    """
    Explain an input that does not fit the grammar: what was found, what was expected.

    :param problem: raised by lark.
    :param source: name of the file or parameter.
    :param first_line: line of the file on which the parsed text began.
    :param words: names of the grammar's terminals in messages; those of expressions are known.
    """
    expected: Iterable[str] = ()
    found, line, column = 'the end', 0, 0
    if isinstance(problem, UnexpectedCharacters):
        found = f'"{_shown(problem.char)}"'
        expected, line, column = _accepted(problem), problem.line, problem.column
    elif isinstance(problem, UnexpectedToken):
        if problem.token.type != '$END':
            found = f'"{problem.token}"' if str(problem.token).strip() else 'the end of the line'
        expected = problem.accepts or problem.expected
        line, column = problem.token.line or problem.line, problem.token.column or problem.column
    elif isinstance(problem, UnexpectedEOF):
        expected = problem.expected
    line = line + first_line - 1 if line and line > 0 else first_line
    message = f'found {found}, expected {_expected_words(expected, words or {})}'
    return GrammarError(message, source, line, max(column or 0, 0))
