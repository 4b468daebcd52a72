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


"""Compiler: from the text of an L-system to rules that can be applied."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from lark import Tree
import numpy as np

from procphys_ros.appearance.palette import is_known, LOOKS
from procphys_ros.errors import GrammarError, nearest_names
from procphys_ros.language import compile_expression, ControlCurve, Expression, Place
from procphys_ros.language.arithmetic import FUNCTIONS, RANDOM_FUNCTIONS
from procphys_ros.lsystem.derivation import Derivation
from procphys_ros.lsystem.inclusion import gather_statements
from procphys_ros.lsystem.modules import Vocabulary
from procphys_ros.lsystem.rewriting import RuleSet
from procphys_ros.lsystem.rules import Produced, Production, RuleCompiler
from procphys_ros.lsystem.statements import RULE_SECTIONS, Statement
from procphys_ros.lsystem.symbols import arity_message, SYMBOLS
from procphys_ros.lsystem.syntax import parse_statement


class CompiledGrammar(NamedTuple):
    """
    A compiled grammar.

    :ivar source: name of the text.
    :ivar name: as stated in the text.
    :ivar defines: name and value of each define, in order.
    :ivar steps: derivation length, None = not given.
    :ivar angle: default angle [degrees], None = not given.
    :ivar depth: of interpretation, None = not given.
    :ivar unit: of its lengths [m], None = not given.
    :ivar textures: names of the textures.
    :ivar derivation: its rules.
    :ivar origins: place and name of every module that it writes.
    :ivar made_from: arguments of `compile_grammar`, from which a pickled one is compiled again.
    """

    source: str
    name: str
    defines: list[tuple[str, Expression]]
    steps: Expression | None
    angle: Expression | None
    depth: Expression | None
    unit: Expression | None
    textures: tuple[str, ...]
    derivation: Derivation
    origins: list[tuple[Place, str]]
    made_from: tuple[str, str, int, Path | None]

    def __reduce__(self) -> tuple:
        return compile_grammar, self.made_from


_RESERVED = ('self', 'steps', 'seed')  # defines are overridden by keyword


@dataclass(frozen=True)
class _SectionReader:
    """Statements of one text, by section."""

    source: str
    statements: list[Statement]

    def trees(self, section: str) -> Iterable[tuple[Tree, Statement]]:
        for statement in self.statements:
            if statement.section == section:
                yield parse_statement(statement), statement

    def single(self, section: str) -> tuple[Tree, Statement] | None:
        found = [s for s in self.statements if s.section == section]
        if len(found) > 1:
            raise Place(self.source, found[1].line, 1).error(
                f'"{section}:" stands twice, first on line {found[0].line}')
        return next(iter(self.trees(section)), None)

    def name(self) -> str:
        names = [s.text.strip() for s in self.statements if s.section == 'name']
        return names[0] if names else ''

    def words(self, section: str) -> list[tuple[str, Place]]:
        return [(str(token), Place.of(token, at.source, at.line))
                for tree, at in self.trees(section) for token in tree.children
                if token is not None]

    def textures(self) -> tuple[str, ...]:
        words = self.words('textures')
        for name, place in words:
            if not is_known(name):
                raise place.error(f'unknown texture "{name}"{nearest_names(name, LOOKS)} '
                                  f'(textures contain one of: {", ".join(LOOKS)})')
        return tuple(name for name, _ in words)

    def defines(self, curves: Mapping[str, ControlCurve]) -> list[tuple[str, Expression]]:
        """Compile the defines, those of included files last; a define of the text itself wins."""
        found = [(child.children, at) for tree, at in self.trees('define')
                 for child in tree.children if child is not None]
        result: list[tuple[str, Expression]] = []
        for (name, value), at in sorted(found, key=lambda define: define[1].source != self.source):
            place = Place.of(name, at.source, at.line)
            if at.source != self.source and str(name) in dict(result):
                continue
            if name in _RESERVED:
                raise place.error(f'"{name}" cannot be a define: it names an argument of derive')
            if str(name) in dict(result):
                raise place.error(f'"{name}" is defined twice')
            known = [defined for defined, _ in result]
            result.append((str(name), compile_expression(value, at.source, at.line, known,
                                                         curves)))
        return result

    def curves(self) -> dict[str, ControlCurve]:
        """Compile the curves; those of the text itself win over included ones."""
        result: dict[str, ControlCurve] = {}
        for tree, at in self.trees('curve'):
            name, *points = tree.children
            place = Place.of(name, at.source, at.line)
            if name in FUNCTIONS or name in RANDOM_FUNCTIONS:
                raise place.error(f'"{name}" cannot be a curve: it is a function already')
            if name in result:
                if at.source == self.source:
                    raise place.error(f'the curve "{name}" stands twice')
                continue
            found = [tuple(compile_expression(value, at.source, at.line, ()).number(
                {}, np.random.default_rng(0)) for value in point.children) for point in points]
            if any(x >= next_x for (x, _), (next_x, _) in pairwise(found)):
                raise place.error(f'the points of the curve "{name}" must go from left to right')
            result[str(name)] = ControlCurve(found)
        return result

    def value(self, section: str, known: list[str]) -> Expression | None:
        found = self.single(section)
        if found is None:
            return None
        tree, at = found
        return compile_expression(tree.children[0], at.source, at.line, known)


def compile_grammar(text: str, source: str, max_modules: int,
                    folder: Path | None = None) -> CompiledGrammar:
    """
    Compile a whole grammar.

    :param text: of the grammar.
    :param source: its name, for errors.
    :param max_modules: longest string that it may derive.
    :param folder: searched first for included files.
    :raises GrammarError: for statements that cannot be read or contradict each other.
    """
    reader = _SectionReader(source, gather_statements(text, source, folder))
    curves = reader.curves()
    defines = reader.defines(curves)
    names = [name for name, _ in defines]
    declared = {name for name, _ in reader.words('module')}
    compiler = RuleCompiler(source, declared, names, curves)
    axiom = reader.single('axiom')
    if axiom is None:
        raise GrammarError('the section "axiom:" is missing; it gives the first string, '
                           'for example "axiom: A(1)"', source)
    tree, at = axiom
    start = compiler.produced(tree.children[0], at.line, names)
    rules = {section: [compiler.of(at.source).rule(tree, at.line)
                       for tree, at in reader.trees(section)] for section in RULE_SECTIONS}
    compiler.of(source)
    skipped = _skipped_names(reader, compiler)
    ignored = np.array([skipped(name) for name in compiler.vocabulary.names])
    _check_rules(rules, ignored, compiler.vocabulary)
    _check_meanings(compiler, start, rules)
    sets = [RuleSet(rules[section], ignored, max_modules) for section in RULE_SECTIONS]
    return CompiledGrammar(
        source, reader.name(), defines, reader.value('derivation length', names),
        reader.value('angle', names), reader.value('maximum depth', names),
        reader.value('unit', names), reader.textures(),
        Derivation(start, compiler.vocabulary, *sets), compiler.origins,
        (text, source, max_modules, folder))


def _skipped_names(reader: _SectionReader, compiler: RuleCompiler):
    """Make the predicate for names that contexts skip."""
    ignored = [name for tree, at in reader.trees('ignore')
               for name in compiler.names(tree, at.line)]
    considered = [name for tree, at in reader.trees('consider')
                  for name in compiler.names(tree, at.line)]
    if ignored and considered:
        raise GrammarError('give either "ignore:" or "consider:", not both', reader.source)
    if considered:
        return lambda name: name not in considered and name not in '[]'
    return lambda name: name in ignored


def _check_rules(rules: dict[str, list[Production]], ignored: np.ndarray,
                 vocabulary: Vocabulary) -> None:
    """Check contexts, and that interpretation leaves queries, which are answered, alone."""
    for section, some in rules.items():
        for rule in some:
            if section != 'production' and (rule.left or rule.right):
                raise rule.place.error(f'rules under "{section}:" have no contexts')
            for key in (*rule.left, *rule.right):
                if key >= 0 and ignored[key]:
                    raise rule.place.error(f'the context names {vocabulary.names[key]}, '
                                           'which contexts ignore: it would never match')
            used = (rule.predecessor, *(piece.key for piece in rule.successor))
            if section == 'interpretation' and any(vocabulary.names[k][0] == '?' for k in used):
                raise rule.place.error('rules under "interpretation:" neither write nor replace '
                                       'queries; productions do')


def _check_meanings(compiler: RuleCompiler, axiom: tuple[Produced, ...],
                    rules: dict[str, list[Production]]) -> None:
    """Check for misspelt words, and known symbols with a wrong number of parameters."""
    every = [rule for section in RULE_SECTIONS for rule in rules[section]]
    replaced = {rule.predecessor for rule in every}
    vocabulary = compiler.vocabulary
    compiler.check_words({*SYMBOLS, *(vocabulary.names[key] for key in replaced)})
    for piece in (*axiom, *(p for rule in every for p in rule.successor)):
        symbol = SYMBOLS.get(vocabulary.names[piece.key])
        arity = vocabulary.arities[piece.key]
        if symbol and piece.key not in replaced and arity not in symbol.arities:
            place, name = compiler.origins[piece.origin]
            raise place.error(f'{name} {arity_message(symbol, arity)}')
    _warn_of_strangers(compiler, axiom, rules)


def _warn_of_strangers(compiler: RuleCompiler, axiom: tuple[Produced, ...],
                       rules: dict[str, list[Production]]) -> None:
    """Warn of single letters without a meaning, and of rules that never match a module."""
    vocabulary = compiler.vocabulary
    every = [rule for section in RULE_SECTIONS for rule in rules[section]]
    written = [*axiom, *(piece for rule in every for piece in rule.successor)]
    counts: dict[str, set[int]] = {}
    for piece in written:
        counts.setdefault(vocabulary.names[piece.key], set()).add(vocabulary.arities[piece.key])
    matched = {vocabulary.names[key] for rule in every
               for key in (rule.predecessor, *rule.left, *rule.right) if key >= 0}
    strangers = [compiler.origins[piece.origin] for piece in written
                 if len(vocabulary.names[piece.key]) == 1
                 and vocabulary.names[piece.key] not in compiler.declared]
    for name, place in {name: place for place, name in reversed(strangers)}.items():
        if name not in SYMBOLS and name not in matched:
            place.warn(f'no rule and no meaning for the module {name}; declare it, '
                       f'"module: {name}", if it is only a mark')
    for rule in every:
        name, arity = vocabulary.names[rule.predecessor], vocabulary.arities[rule.predecessor]
        if arity not in counts.get(name, {arity}):
            found = ' or '.join(map(str, sorted(counts[name])))
            rule.place.warn(f'this rule never applies: it takes {name} with {arity} parameters, '
                            f'which is written with {found} only')
