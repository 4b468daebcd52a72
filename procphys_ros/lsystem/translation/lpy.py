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

"""Reader of grammars for L-Py, of OpenAlea: their productions; nothing of Python is run."""

from collections.abc import Iterator
import re
from typing import NamedTuple

from lark import Tree

from procphys_ros.language import Place, shorten
from procphys_ros.lsystem.statements import Statement
from procphys_ros.lsystem.translation.dialect import LPY_DIALECT
from procphys_ros.lsystem.translation.meanings import LPY_RANDOM
from procphys_ros.lsystem.translation.translator import ForeignStatement, Translator

_SECTION = re.compile(r'(production|decomposition|interpretation|homomorphism)s?\s*:\s*$')
_SETTING = re.compile(r'(axiom|derivation\s+length|maximum\s+depth|ignore|consider|module)\b\s*:?',
                      re.IGNORECASE)
_GROUP = re.compile(r'(group\s+\d+\s*:|endgroup)\s*$')
_END = re.compile(r'^(endlsystem\b|###### INITIALISATION ######)', re.MULTILINE)
_ASSIGNED = re.compile(r'([A-Za-z_]\w*)\s*=(?!=)')
_LEFT_OUT = re.compile(r'(import|from)\s|(\w+\.)?seed\(')
_QUOTED = re.compile(r'("""|\'\'\').*?(?:\1|\Z)', re.DOTALL)
_COMMENT = re.compile(r'(?<!@)#.*')
_NEWER = re.compile(r'<<|>>')
_PRODUCE = re.compile(r'produce\b')
_CLAUSE = re.compile(r'(if|elif|else)\b')
_STARTS = {'axiom': 'axiom', 'ignore': 'symbols', 'consider': 'symbols'}
_PLAIN = ('only plain productions are read, "A(l) --> F(l)", and rules of "if", "elif", "else" '
          'and "produce"; this is other Python')


_MOST_CONDITIONS = 100  # of one "produce"; keeps expressions below their deepest nesting


class _Line(NamedTuple):
    """
    One line, or several that are joined.

    :ivar text: without comments, in its columns.
    :ivar number: of the first line.
    """

    text: str
    number: int

    @property
    def indent(self) -> int:
        return len(self.text) - len(self.text.lstrip())


def _lines(text: str) -> list[_Line]:
    """Join the lines of the text where brackets do, up to the end of its rules."""
    blank = _QUOTED.sub(lambda found: re.sub(r'[^\n]', ' ', found[0]), text)
    result: list[_Line] = []
    buffer, begun = '', 0
    for number, line in enumerate(blank.expandtabs().splitlines(), 1):
        if _END.match(line):
            break
        line = _COMMENT.sub('', line).rstrip()
        begun = begun or number
        buffer += line
        if sum(buffer.count(one) for one in '([') > sum(
                buffer.count(one) for one in ')]'):
            buffer += '\n'
            continue
        if buffer.strip():
            result.append(_Line(buffer, begun))
        buffer, begun = '', 0
    return [*result, _Line(buffer, begun)] if buffer.strip() else result


class _LpyReader:
    """
    Reads the lines of one text.

    :ivar found: statements so far.
    :ivar declared: names of modules that it declares.
    """

    def __init__(self, source: str, lines: list[_Line]):
        self.found: list[ForeignStatement] = []
        self.declared: list[str] = []
        self._source = source
        self._lines = lines
        self._section = ''
        self._first = 1  # line of the rule that is read

    def read(self) -> None:
        while self._lines:
            line = self._lines.pop(0)
            text = line.text.strip()
            place = Place(self._source, line.number, line.indent + 1)
            setting = _SETTING.match(text)
            if section := _SECTION.match(text):
                self._section = section[1].replace('homomorphism', 'interpretation')
            elif _GROUP.match(text):
                place.warn('groups are left out: all rules are applied')
            elif setting and (text[setting.end() - 1] == ':' or setting[1] == 'module'):
                self._set(' '.join(setting[1].lower().split()), line, setting.end(), place)
            elif self._section and not line.indent and '-->' in text:
                self._add(self._section, self._parse('rule', line), line.number)
            elif self._section and not line.indent and _head_ends(text) >= 0:
                self._rule(line)
            elif assigned := _ASSIGNED.match(text):
                self._define(line, assigned, place)
            elif _LEFT_OUT.match(text):
                place.warn(f'"{shorten(text[:40])}" is left out: nothing of Python is run')
            else:
                raise place.error(f'found "{shorten(text[:20])}"; {_PLAIN}')

    def _parse(self, start: str, line: _Line, first: int = 0) -> Tree:
        """Read a text whose places are counted from a first line, its own unless one is given."""
        first = first or line.number
        newer = _NEWER.search(line.text) if start == 'rule' else None
        if newer:
            raise Place(self._source, line.number, newer.start() + 1).error(
                'contexts "<<" and ">>", which look at the new string, are not read')
        padded = '\n' * (line.number - first) + line.text
        return LPY_DIALECT.read(start, padded, Place(self._source, first))

    def _add(self, section: str, tree: Tree, number: int) -> None:
        self.found.append(ForeignStatement(section, tree, number))

    def _set(self, word: str, line: _Line, end: int, place: Place) -> None:
        """Read one setting."""
        rest = _Line(' ' * (line.indent + end) + line.text[line.indent + end:], line.number)
        if word == 'module':
            words, _, scale = re.sub(r'\([^)]*\)', '', rest.text).partition(':')
            names = words.replace(',', ' ').split()
            if scale:
                place.warn('scales and bases of modules are left out')
            for name in names:
                if not name.isalnum():
                    raise place.error(f'"{shorten(name[:20])}" is no name of a module; names '
                                      'are of letters and digits')
            self.declared += [name for name in names if len(name) > 1]
        elif word == 'maximum depth' and self._section != 'interpretation':
            place.warn('decomposition goes on until no rule fits; its depth is left out')
        else:
            self._add(word, self._parse(_STARTS.get(word, 'value'), rest), line.number)

    def _define(self, line: _Line, assigned: re.Match, place: Place) -> None:
        if '__' in assigned[1]:
            place.warn(f'"{assigned[1]}" is left out')
            return
        self._add('define', self._parse('defines', line), line.number)

    def _rule(self, line: _Line) -> None:
        """Read a rule with a body as one plain rule for each "produce", in their order."""
        self._first = line.number
        end = _head_ends(line.text)
        head = self._parse('rule', _Line(f'{line.text[:end]} --> *', line.number))
        body = []
        if line.text[end + 1:].strip():
            body = [_Line(' ' * (end + 1) + line.text[end + 1:], line.number)]
        while self._lines and self._lines[0].indent > line.indent:
            body.append(self._lines.pop(0))
        if not body:
            raise Place(self._source, line.number, 1).error(f'this rule has no body; {_PLAIN}')
        for conditions, successor in self._branches(body, []):
            condition = None
            for one in conditions:
                condition = one if condition is None else Tree('both', [condition, one], one.meta)
            text = successor if successor.text.strip() else _Line('*', successor.number)
            produced = self._parse('axiom', text, line.number).children[0]
            self._add(self._section, Tree('rule', [
                head.children[0], condition, head.children[2], produced, None], head.meta),
                line.number)

    def _branches(self, body: list[_Line], before: list[Tree], depth: int = 0
                  ) -> Iterator[tuple[list[Tree], _Line]]:
        """List the conditions and the successor of each "produce" in a block."""
        indent = body[0].indent
        chain: list[Tree] = []  # what earlier clauses leave to the next ones
        while body:
            line = body.pop(0)
            text = line.text.strip()
            place = Place(self._source, line.number, line.indent + 1)
            clause = _CLAUSE.match(text)
            if line.indent != indent or not clause and not _PRODUCE.match(text):
                raise place.error(f'found "{shorten(text[:20])}"; {_PLAIN}')
            if not clause:
                start = line.indent + len('produce')
                yield before, _Line(' ' * start + line.text[start:], line.number)
                return
            chain = chain if clause[1] != 'if' else []
            own, inner = self._clause(line, clause, body, place)
            conditions = [*before, *chain, *own]
            if len(conditions) > _MOST_CONDITIONS or depth > _MOST_CONDITIONS:
                raise place.error(f'more than {_MOST_CONDITIONS} conditions hold at once here')
            found = list(self._branches(inner, conditions, depth + 1))
            yield from found
            if not any(len(others) == len(conditions) for others, _ in found):
                chain += [Tree('negation', [one], one.meta) for one in own]
                found.append(found[0])
            if len(found) > 1 and any(map(_is_random, own)):
                raise place.error('a random condition stands before exactly one "produce"')

    def _clause(self, line: _Line, clause: re.Match, body: list[_Line],
                place: Place) -> tuple[list[Tree], list[_Line]]:
        """Return the condition of a clause, none of "else", and the lines below it."""
        start = line.indent + clause.end()
        end = _head_ends(line.text, start)
        if end < 0:
            raise place.error(f'"{clause[1]}" needs a ":"')
        own, inner = [], []
        if clause[1] != 'else':
            text = _Line(' ' * start + line.text[start:end], line.number)
            own = [self._parse('value', text, self._first).children[0]]
        if line.text[end + 1:].strip():
            inner = [_Line(' ' * (end + 1) + line.text[end + 1:], line.number)]
        while body and body[0].indent > line.indent:
            inner.append(body.pop(0))
        if not inner:
            raise place.error(f'"{clause[1]}" has no "produce"')
        return own, inner


def _is_random(condition: Tree) -> bool:
    return any(call.children[0] in LPY_RANDOM for call in condition.find_data('call'))


def _head_ends(text: str, start: int = 0) -> int:
    """Return where the first colon outside of brackets stands, -1 = nowhere."""
    depth = 0
    for at in range(start, len(text)):
        depth += (text[at] == '(') - (text[at] == ')')
        if text[at] == ':' and depth == 0:
            return at
    return -1


def read_lpy(text: str, source: str) -> list[Statement]:
    """
    Translate a grammar for L-Py; parameters as in `translate`.

    :raises GrammarError: for what cannot be read, and for other Python.
    """
    reader = _LpyReader(source, _lines(text))
    reader.read()
    end = _END.search(text)
    if end and text[end.end():].strip():
        Place(source, text.count('\n', 0, end.start()) + 1, 1).warn(
            'what follows the rules is left out: nothing of Python is run')
    return Translator(LPY_DIALECT, source, reader.declared).translate(reader.found)
