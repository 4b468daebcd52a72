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

"""Parser: from the text of a mechanism grammar to its spec."""

from collections.abc import Sequence
from pathlib import Path

from procphys_ros.errors import nearest_names
from procphys_ros.language import Expression, GrammarReader, Node, Place
from procphys_ros.mechanism.grammar import MECHANISM_GRAMMAR, MECHANISM_WORDS
from procphys_ros.mechanism.spec import (
    Application,
    Block,
    Definition,
    JointStatement,
    MechanismRule,
    MechanismSpec,
    PartStatement,
    Repetition,
    Setting,
    Statement,
)
from procphys_ros.mechanism.tables import (
    check_keys,
    check_kind,
    JOINT_KEYS,
    JOINT_NEEDS,
    NAMES,
    PART_KEYS,
    PART_NEEDS,
    RANGES,
    RULE_KEYS,
)

_DEEPEST = 32  # nesting of repetitions
_RESERVED = ('ground', 'parent')  # names of no part


def parse(text: str, source: str, folder: Path | None = None) -> MechanismSpec:
    """
    Read a grammar text.

    :param text: the grammar.
    :param source: name for errors.
    :param folder: searched first for included files; None = the shipped ones only.
    :raises GrammarError: where the text does not fit the language.
    """
    reader = _MechanismReader(text, source)
    spec = reader.spec()
    for inner in reader.included(folder):  # existing rules and materials win
        other = MechanismSpec('', (), (), Place(inner.source))
        inner.tables(other)
        spec.rules.update({**other.rules, **spec.rules})
        spec.materials.update({**other.materials, **spec.materials})
        spec.places.update({**other.places, **spec.places})
    _check_calls(spec)
    return spec


class _MechanismReader(GrammarReader):
    """
    Turns the parse tree into a spec.

    :ivar known: names that expressions anywhere may use: parameters of the mechanism, and lets
        outside of it.
    """

    grammar, words, what = MECHANISM_GRAMMAR, MECHANISM_WORDS, 'a grammar'
    start, others = 'mechanism', ('let', 'rule', 'material')

    def __init__(self, text: str, source: str, included: bool = False):
        super().__init__(text, source, included)
        self.known = tuple(self.parameters)

    def spec(self) -> MechanismSpec:
        node = self.trees['mechanism'][0]
        parameters: list[tuple[str, Expression]] = []
        for child in node.children[1:]:
            if child is not None and child.data == 'parameter':
                parameters.append(self.parameter(child, [name for name, _ in parameters]))
        definitions = self.definitions()
        body = [child for child in node.children[1:]
                if child is not None and child.data != 'parameter']
        spec = MechanismSpec(str(node.children[0]), tuple(parameters),
                             self.statements(body, self.known), self.place(node),
                             tuple(definitions))
        self.tables(spec)
        return spec

    def definitions(self) -> list[Definition]:
        """Read the lets outside of mechanism and rules, whose names are known from there on."""
        out = []
        for node in self.trees['let']:
            out.append(Definition(str(node.children[0]),
                                  self.expression(node.children[1], self.known)))
            self.known += (out[-1].name,)
        return out

    def tables(self, spec: MechanismSpec) -> None:
        """Read rules and materials into a spec."""
        for node in self.trees['rule']:
            rule = self.rule(node)
            spec.rules.setdefault(rule.name, []).append(rule)
        for node in self.trees['material']:
            name, place = str(node.children[0]), self.place(node)
            self.new(name, spec.materials, 'material', place)
            spec.materials[name] = self.entries(node.children[1:])
            spec.places[f'material {name}'] = place

    def rule(self, node: Node) -> MechanismRule:
        name, formals, condition, *body, weight = node.children
        parameters = tuple(str(c) for c in formals.children if c is not None)
        for twice in (p for i, p in enumerate(parameters) if p in parameters[:i]):
            raise self.place(node).error(f'the parameter "{twice}" is given twice')
        known = (*self.known, *parameters)

        def optional(part: Node) -> Expression | None:
            return self.expression(part.children[0], known) if part.children[0] else None

        return MechanismRule(str(name), parameters, optional(condition),
                             self.statements(body, known), optional(weight), self.place(node))

    def statements(self, nodes: Sequence[Node], known: Sequence[str],
                   depth: int = 0) -> tuple[Statement, ...]:
        if depth > _DEEPEST:
            raise self.place(nodes[0]).error(f'nested more than {_DEEPEST} deep; use a rule')
        out: list[Statement] = []
        for node in nodes:
            if node.data == 'let':
                name = str(node.children[0])
                out.append(Definition(name, self.expression(node.children[1], known)))
                known = (*known, name)
            elif node.data == 'repeat':
                variable = str(node.children[0])
                out.append(Repetition(
                    variable, self.expression(node.children[1], known),
                    self.statements(node.children[2:], (*known, variable), depth + 1)))
            elif node.data == 'apply':
                out.append(self.application(node, known))
            else:
                out.append(self.part(node, known))
        return tuple(out)

    def application(self, node: Node, known: Sequence[str]) -> Application:
        name, *arguments, block = node.children
        settings, inner = self.block(block, known) if block else ({}, [])
        if inner:
            raise self.place(inner[0]).error('what a rule writes takes no joints here; name it in '
                                             f'the rule (keys: {", ".join(RULE_KEYS)})')
        place = self.place(node)
        check_keys(settings, RULE_KEYS, (), 'rule', place)
        return Application(str(name), tuple(self.expression(a, known) for a in arguments
                                            if a is not None), settings, place)

    def part(self, node: Node, known: Sequence[str]) -> PartStatement:
        kind, name, block = node.children
        kind, place = str(kind), self.place(node)
        check_kind(kind, PART_KEYS, 'part', place)
        settings, inner = self.block(block, known, (*NAMES[:1],))
        check_keys(settings, PART_KEYS[kind], PART_NEEDS[kind], kind, place)
        return PartStatement(kind, self.name(name), settings,
                             tuple(self.joint(n, known) for n in inner), place)

    def joint(self, node: Node, known: Sequence[str]) -> JointStatement:
        kind, name, block = node.children
        kind, place = str(kind), self.place(node)
        check_kind(kind, JOINT_KEYS, 'joint', place)
        settings, inner = self.block(block, known)
        if inner:
            raise self.place(inner[0]).error('nothing stands inside a joint but keys')
        what = 'ball joint' if kind == 'ball' else kind
        check_keys(settings, JOINT_KEYS[kind], JOINT_NEEDS.get(kind, ()), what, place)
        return JointStatement(kind, self.name(name), settings, place)

    def name(self, token: Node) -> str:
        if token is not None and str(token) in _RESERVED:
            raise self.place(token).error(f'"{token}" names no part: {" and ".join(_RESERVED)} '
                                          'have a meaning of their own')
        return '' if token is None else str(token)

    def block(self, node: Node, known: Sequence[str],
              names: Sequence[str] = NAMES) -> tuple[Block, list[Node]]:
        """Read the keys of a block; return these, and the trees of what else is in it."""
        settings: dict[str, Setting] = {}
        for child in node.children:
            if child.data != 'entry':
                continue
            key, *values = child.children
            place = self.place(child)
            if str(key) in settings:
                raise place.error(f'"{key}" stands there twice')
            settings[str(key)] = self.setting(str(key), values, known, names, place)
        return settings, [child for child in node.children if child.data != 'entry']

    def setting(self, key: str, values: Sequence[Node], known: Sequence[str],
                names: Sequence[str], place: Place) -> Setting:
        if key in names:
            if len(values) != 1 or values[0].data != 'variable':
                raise place.error(f'"{key}:" takes one name')
            return Setting((), str(values[0].children[0]), place)
        if key in RANGES:
            counts = RANGES[key].counts
            if len(values) not in counts:
                raise place.error(f'"{key}:" takes {" or ".join(map(str, counts))} '
                                  f'number{"s" * (counts != (1,))} with commas between them, '
                                  f'found {len(values)}')
        return Setting(tuple(self.expression(value, known) for value in values), '', place)


def _check_calls(spec: MechanismSpec) -> None:
    """Check that applied rules exist and take the given number of arguments."""
    bodies = [spec.statements, *(rule.statements for rules in spec.rules.values()
                                 for rule in rules)]
    while bodies:
        for statement in bodies.pop():
            if isinstance(statement, Repetition):
                bodies.append(statement.statements)
            elif isinstance(statement, Application):
                _check_call(spec, statement)


def _check_call(spec: MechanismSpec, call: Application) -> None:
    if call.name not in spec.rules:
        raise call.place.error(f'unknown rule "{call.name}"{nearest_names(call.name, spec.rules)} '
                               f'(rules: {", ".join(spec.rules) or "none"})')
    counts = sorted({len(rule.parameters) for rule in spec.rules[call.name]})
    if len(call.arguments) not in counts:
        raise call.place.error(
            f'the rule "{call.name}" takes {" or ".join(map(str, counts))} arguments, '
            f'found {len(call.arguments)}')
