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

"""Reader of grammars for cpfg, of L-studio and the Virtual Laboratory."""

from pathlib import Path
import re

from lark import Token, Tree

from procphys_ros.language import Place, shorten
from procphys_ros.lsystem.statements import RULE_SECTIONS, Statement
from procphys_ros.lsystem.translation.dialect import CPFG_DIALECT
from procphys_ros.lsystem.translation.preprocessor import Preprocessor
from procphys_ros.lsystem.translation.translator import ForeignStatement, Translator

_COLON = re.compile(
    r'\s*(l-?system|seed|derivation ?length|maximum depth|consider|ignore|axiom|define|'
    r'start ?each|start|end ?each|end|production)s?\s*:', re.IGNORECASE)
_BARE = re.compile(r'\s*(ring l-?system|homomorphism|interpretation|decomposition|endlsystem)'
                   r'[\s:]*((no )?warnings)?\s*$', re.IGNORECASE)
_LABEL = re.compile(r'\s*p\d+\s*:')
_ARROW = re.compile(r'-{1,2}>')
_PROGRAM = re.compile(r'\s*(module\s+\w+\s*\(|produce\b|.*\{\s*produce\b)')
_KEPT = {'derivation length': 'derivation length', 'derivationlength': 'derivation length',
         'consider': 'consider', 'ignore': 'ignore', 'axiom': 'axiom'}
_STARTS = {'axiom': 'axiom', 'consider': 'symbols', 'ignore': 'symbols', 'define': 'defines',
           **dict.fromkeys(RULE_SECTIONS, 'rule')}  # all else is a value
_LEFT_OUT = {
    'seed': 'seeds are those of the scene; this one is left out',
    'ring lsystem': 'ends are not joined; "ring L-system" is left out',
    'define': 'arrays are left out; write curve f: (0, 1) (1, 0) in a .lsys file',
}
_BLOCK = 'blocks of code are left out'


class _Cutter:
    """
    Cuts lines into statements.

    :ivar found: section, text and line of each.
    :ivar stochastic: whether a seed makes all rules that fit alternatives of one draw.
    """

    def __init__(self, source: str, translator: Translator):
        self.found: list[tuple[str, str, int]] = []
        self.stochastic = False
        self._source, self._translator = source, translator
        self._section = ''  # of rules
        self._buffer: list[str] = []
        self._open = ('', 0)  # section and line of what the buffer holds
        self._depth = 0       # of braces
        self._systems = 0

    def cut(self, lines: list[str]) -> None:
        for number, line in enumerate(lines, 1):
            if _PROGRAM.match(line):
                raise Place(self._source, number).error(
                    'this is a program for lpfg, in C++; the productions of cpfg are read: '
                    'A(l) : l > 1 --> F(l)')
            header, bare = _COLON.match(line), _BARE.match(line)
            if self._depth > 0:
                self._add(line)
            elif header or bare:
                found = (header or bare)[1].lower().replace('l-system', 'lsystem')  # type: ignore
                if self._begin(found, line, header.end() if header else len(line), number):
                    return
            elif not line.strip():
                self.close()
            else:
                self._rule(line, number)
        self.close()

    def _begin(self, word: str, line: str, end: int, number: int) -> bool:
        """Begin a section; return whether all that follows is left out."""
        self.close()
        place = Place(self._source, number, 1)
        if word == 'lsystem':
            self._systems += 1
            if self._systems > 1:
                place.warn('sub-L-systems are left out: only the first L-system is read')
            return self._systems > 1
        if word in ('homomorphism', 'interpretation', 'decomposition', 'production'):
            self._section = word.replace('homomorphism', 'interpretation')
        elif word == 'maximum depth':
            if self._section == 'interpretation':
                self._start('maximum depth', line, end, number)
            else:
                place.warn('decomposition goes on until no rule fits; its depth is left out')
        elif word in _KEPT:
            self._start(_KEPT[word], line, end, number)
            if word == 'axiom':
                self._section = 'production'
        elif word in _LEFT_OUT or word.startswith(('start', 'end')) and word != 'endlsystem':
            if word != 'seed' or self._section:
                self._translator.tell(place, _LEFT_OUT.get(word, _BLOCK))
            elif not self.stochastic:
                self.stochastic = True
                place.warn(_LEFT_OUT[word])
            self._start('', line, end, number)
        return False

    def _start(self, section: str, line: str, end: int, number: int) -> None:
        self._open = (section, number)
        self._add(' ' * end + line[end:])

    def _add(self, line: str) -> None:
        self._buffer.append(line)
        if not self._open[0]:
            self._depth += line.count('{') - line.count('}')

    def _rule(self, line: str, number: int) -> None:
        """Begin a rule, or carry on what the buffer holds."""
        before = '\n'.join(self._buffer)
        waits = self._open[0] == self._section and not _ARROW.search(before)
        if before.strip() and (waits or line[0] == '\t' or line[0] == ' '
                               and not _ARROW.search(line)
                               or before.count('(') > before.count(')')):
            self._add(line)
            return
        self.close()
        if not self._section:
            raise Place(self._source, number, 1).error(
                f'found "{shorten(line.strip()[:20])}" before the axiom; productions come '
                'after it')
        label = _LABEL.match(line)
        if label:
            line = ' ' * label.end() + line[label.end():]
        self._start(self._section, line, 0, number)

    def close(self) -> None:
        text = '\n'.join(self._buffer)
        if text.strip() and self._open[0]:
            self.found.append((self._open[0], text, self._open[1]))
        self._buffer, self._open, self._depth = [], ('', 0), 0


def read_cpfg(text: str, source: str, folder: Path | None) -> list[Statement]:
    """
    Translate a grammar for cpfg; parameters as in `translate`.

    :raises GrammarError: for what cannot be read.
    """
    translator = Translator(CPFG_DIALECT, source)
    preprocessor = Preprocessor(source, folder)
    cutter = _Cutter(source, translator)
    cutter.cut(preprocessor.read(text))
    pieces = [*(('define', *define) for define in preprocessor.defines), *cutter.found]
    found = []
    for section, piece, line in pieces:
        tree = CPFG_DIALECT.read(_STARTS.get(section, 'value'), piece, Place(source, line))
        if section == 'production' and cutter.stochastic and tree.children[4] is None:
            one = Tree('number', [Token('NUMBER', '1')], tree.meta)
            tree = Tree('rule', [*tree.children[:4], one], tree.meta)
        found.append(ForeignStatement(section, tree, line))
    return translator.translate(found)
