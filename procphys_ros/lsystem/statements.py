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


"""Statements: cut the text of an L-system into sections, and sections into rules."""

import re
from typing import NamedTuple

from lark import Tree

from procphys_ros.errors import nearest_names
from procphys_ros.language import Place, shorten
from procphys_ros.lsystem.dialects import check_line

ONE_LINE = ('name', 'derivation length', 'angle', 'unit', 'maximum depth')
_SEVERAL_LINES = ('include', 'axiom', 'define', 'module', 'ignore', 'consider', 'textures',
                  'curve')
RULE_SECTIONS = ('production', 'decomposition', 'interpretation')
_SYNONYMS = {'homomorphism': 'interpretation'}
HEADERS = (*ONE_LINE, *_SEVERAL_LINES, *RULE_SECTIONS, *_SYNONYMS)
_HEADER = re.compile(r'^\s*(' + '|'.join(HEADERS) + r')\s*:', re.IGNORECASE)
_CURVE = re.compile(r'^(\s*curve)\s+\w+\s*:', re.IGNORECASE)
_LOOKS_LIKE_HEADER = re.compile(r'^\s*([A-Za-z][A-Za-z_ ]{2,})\s*:')
_ARROW = re.compile(r'-{1,2}>')
_CARRIES_ON = re.compile(r'^\s*(-{1,2}>|[:<>])')


class Statement(NamedTuple):
    """
    One setting or one rule, over one or more lines.

    :ivar section: which section it stands in.
    :ivar text: without header and comments; columns are those of the file.
    :ivar line: line of the file on which the text begins.
    :ivar source: name of the file.
    :ivar tree: read already, from the language of another tool; None = the text is to be read.
    """

    section: str
    text: str
    line: int
    source: str
    tree: Tree | None = None


def split_statements(text: str, source: str) -> list[Statement]:
    """
    Cut a text into statements.

    A rule begins on the line that holds its arrow, or on the lines before it when the arrow, a
    condition or a context begins a line. Lines without an arrow that follow belong to it.

    :param text: of the whole L-system.
    :param source: its name, for errors.
    :raises GrammarError: for text outside any section, misspelt headers, and syntax of other
        programs.
    """
    statements: list[Statement] = []
    buffer: list[str] = []
    section, start = '', 0
    lines = [line.split('#', 1)[0].rstrip() for line in text.splitlines()]
    for number, (written, line) in enumerate(zip(text.splitlines(), lines), 1):
        check_line(written, text, Place(source, number, 1))
        if curve := _CURVE.match(line):  # its name stands before the colon
            _close(statements, section, buffer, start, source)
            section, start = 'curve', number
            buffer = [' ' * curve.end(1) + line[curve.end(1):]]
            continue
        header = _HEADER.match(line)
        if header:
            _close(statements, section, buffer, start, source)
            found = _SYNONYMS.get(header[1].lower(), header[1].lower())
            buffer, start = [' ' * header.end() + line[header.end():]], number
            if found in ONE_LINE:  # rules may go on below `maximum depth:`
                _close(statements, found, buffer, start, source)
                section, buffer = section if section in RULE_SECTIONS else '', ['']
            else:
                section = found
        elif line.strip():
            _check_header(line, section, Place(source, number, 1))
            if section in RULE_SECTIONS and _starts_rule(lines, number - 1, buffer):
                _close(statements, section, buffer, start, source)
                buffer, start = [line], number
            else:
                buffer.append(line)
        else:
            buffer.append('')
    _close(statements, section, buffer, start, source)
    return statements


def _close(statements: list[Statement], section: str, buffer: list[str], start: int,
           source: str) -> None:
    text = '\n'.join(buffer).rstrip()
    if section and (text.strip() or section not in RULE_SECTIONS):
        statements.append(Statement(section, text, start, source))


def _check_header(line: str, section: str, place: Place) -> None:
    found = _LOOKS_LIKE_HEADER.match(line)
    if found and not _ARROW.search(line):
        near = nearest_names(found[1].strip().lower(), HEADERS)
        if near or section not in RULE_SECTIONS:
            raise place.error(f'unknown section "{found[1].strip()}:"{near} '
                              f'(sections: {", ".join(HEADERS)})')
    if not section:
        raise place.error(f'found "{shorten(line.strip()[:20])}" outside any section; '
                          f'begin with one of: {", ".join(HEADERS)}')


def _starts_rule(lines: list[str], index: int, buffer: list[str]) -> bool:
    """Return whether a line begins a rule, or carries on the one in the buffer."""
    before = '\n'.join(buffer)
    if before.count('(') > before.count(')'):
        return False
    if before.strip() and not _ARROW.search(before):
        return False  # the rule in the buffer still waits for its arrow
    if _CARRIES_ON.match(lines[index]):
        return False
    while not _ARROW.search(lines[index]):
        index += 1
        if index == len(lines) or lines[index].strip() and not _CARRIES_ON.match(lines[index]):
            return False
    return True
