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

"""Parser: from the text of a wall grammar to its spec."""

from collections.abc import Collection, Sequence
from pathlib import Path

from procphys_ros.errors import nearest_names
from procphys_ros.language import Expression, GrammarReader, Node, Place
from procphys_ros.wallgrammar import arches
from procphys_ros.wallgrammar.grammar import WALL_GRAMMAR, WALL_WORDS
from procphys_ros.wallgrammar.spec import (
    Building,
    Call,
    Division,
    KINDS_OF_PANELS,
    Panel,
    Part,
    Repeat,
    Rule,
    Spec,
    Split,
    Successor,
)

SCOPE_NAMES = ('scope_x', 'scope_y')  # size of the present scope [m], known inside rules
_PROPERTIES = ('footprint', 'facades', 'storey_height', 'storeys', 'floors', 'roof', 'partitions')
_DEEPEST = 32  # nesting of divisions
_SIZES = {'border': 1, 'grid': 2, 'extrude': 1, 'insert': 2}  # numbers of lengths
_PANEL_KINDS = {'boards': 1, 'glazing': 2, 'beam': 1, 'none': 0, 'arch': 3}


def parse(text: str, source: str, folder: Path | None = None) -> Spec:
    """
    Read a grammar text.

    :param text: the grammar.
    :param source: name for errors.
    :param folder: searched first for included files; None = the shipped ones only.
    :raises GrammarError: where the text does not fit the language.
    """
    reader = _SpecReader(text, source)
    spec = reader.spec()
    for inner in reader.included(folder):  # existing materials, layouts and panels win
        other = Spec(spec.building)
        inner.tables(other)
        for name, panel in other.panels.items():
            if name not in spec.rules:
                spec.panels.setdefault(name, panel)
        spec.materials.update({**other.materials, **spec.materials})
        spec.layouts.update({**other.layouts, **spec.layouts})
        spec.places.update({**other.places, **spec.places})
    return spec


class _SpecReader(GrammarReader):
    """
    Turns the parse tree into a spec.

    :ivar known: names that expressions in rules may use beside the rule's own parameters.
    """

    grammar, words, what = WALL_GRAMMAR, WALL_WORDS, 'a wall grammar'
    start, others = 'building', ('wing', 'rule', 'panel', 'material', 'layout')

    def __init__(self, text: str, source: str, included: bool = False):
        super().__init__(text, source, included)
        self.known = set() if included else {*self.parameters, 'storey_height', 'storeys'}

    def spec(self) -> Spec:
        wings: dict[str, Building] = {}
        for node in self.trees['wing']:
            wing = self.building(node)
            self.new(wing.name, wings, 'wing', wing.place)
            wings[wing.name] = wing
        spec = Spec(self.building(self.trees['building'][0]), tuple(wings.values()))
        for node in self.trees['rule']:
            rule = self.rule(node)
            spec.rules.setdefault(rule.name, []).append(rule)
        self.tables(spec)
        return spec

    def tables(self, spec: Spec) -> None:
        """Read panels, materials and layouts into a spec."""
        for node in self.trees['panel']:
            panel = self.panel(node)
            self.new(panel.name, {**spec.panels, **spec.rules}, 'panel or rule', panel.place)
            spec.panels[panel.name] = panel
        for kind, table in (('material', spec.materials), ('layout', spec.layouts)):
            for node in self.trees[kind]:
                name, place = str(node.children[0]), self.place(node)
                self.new(name, table, kind, place)
                table[name] = self.entries(node.children[1:])
                spec.places[f'{kind} {name}'] = place

    def properties(self, node: Node) -> tuple[list[tuple[str, Expression]], dict[str, Node]]:
        """Read parameters with their defaults, and the entries by key."""
        parameters: list[tuple[str, Expression]] = []
        entries: dict[str, Node] = {}
        for child in node.children[1:]:
            if child is None:
                continue
            key, place = str(child.children[0]), self.place(child)
            if child.data == 'parameter':
                parameters.append(self.parameter(child, [name for name, _ in parameters]))
                continue
            if key not in _PROPERTIES:
                raise place.error(f'unknown property "{key}"{nearest_names(key, _PROPERTIES)} '
                                  f'(properties: {", ".join(_PROPERTIES)})')
            self.new(key, entries, 'property', place)
            entries[key] = child
        return parameters, entries

    def building(self, node: Node) -> Building:
        """Read the building, or a wing."""
        parameters, entries = self.properties(node)
        known = self.parameters
        place = self.place(node)
        points = entries['footprint'].children[1:] if 'footprint' in entries else []
        for point in points:
            if point.data != 'point':
                raise self.place(point).error('a footprint is a list of corners "(x, y)"; the '
                                              'next key needs a ":"')
        for key in ('footprint', 'facades', 'storey_height'):
            if key not in entries:
                raise place.error(f'the {node.data} needs "{key}:"')
        for key in ('footprint', 'facades'):
            if len(entries[key].children) == 1:
                raise self.place(entries[key]).error(f'nothing stands behind "{key}:"')
        calls = {key: self.call(self.single(entries[key])) if key in entries else None
                 for key in ('floors', 'roof', 'partitions')}
        storeys = entries.get('storeys')
        return Building(
            name=str(node.children[0]), parameters=tuple(parameters),
            footprint=tuple((self.expression(point.children[0], known),
                             self.expression(point.children[1], known)) for point in points),
            corners=tuple(self.place(point) for point in points),
            facades=tuple(self.call(c) for c in entries['facades'].children[1:]),
            storey_height=self.expression(self.single(entries['storey_height']), known),
            storeys=self.expression(self.single(storeys), known) if storeys else None,
            floors=calls['floors'], roof=calls['roof'], partitions=calls['partitions'],
            place=place)

    def single(self, entry: Node) -> Node:
        if len(entry.children) != 2:
            raise self.place(entry).error(f'"{entry.children[0]}" takes one value, found '
                                          f'{len(entry.children) - 1}')
        return entry.children[1]

    def call(self, node: Node) -> Call:
        """Read a name, with or without arguments."""
        if node.data not in ('variable', 'call'):
            raise self.place(node).error('expected a name here')
        arguments = tuple(self.expression(c, self.known) for c in node.children[1:]
                          if c is not None)
        return Call(str(node.children[0]), arguments, self.place(node))

    def panel(self, node: Node) -> Panel:
        name, value = node.children
        place = self.place(node)
        if value.data not in ('variable', 'call'):
            raise place.error(f'a panel is the name of a layout, or {KINDS_OF_PANELS}')
        kind, *arguments = (c for c in value.children if c is not None)
        kind = str(kind)
        if kind == 'arch':
            return self.arch(str(name), arguments, place)
        if kind in ('door', 'shutters'):
            return self.hung(str(name), kind, arguments, place)
        # Any other name may be a layout, of this file or of another: see `check_panel`.
        wanted = _PANEL_KINDS.get(kind, len(arguments))
        if len(arguments) != wanted:
            names = 'one name of a material' if wanted == 1 else (
                f'{wanted or "no"} names of materials')
            raise place.error(f'"{kind}" takes {names}, found {len(arguments)} '
                              f'(kinds: {KINDS_OF_PANELS})')
        if kind in _PANEL_KINDS:
            return Panel(str(name), kind, self.names(arguments, 'the name of a material'), place)
        return Panel(str(name), kind, tuple(str(a.children[0]) for a in arguments), place)

    def names(self, nodes: Sequence[Node], what: str) -> tuple[str, ...]:
        """Read bare names."""
        for node in nodes:
            if node.data != 'variable':
                raise self.place(node).error(f'expected {what}')
        return tuple(str(node.children[0]) for node in nodes)

    def arch(self, name: str, arguments: list[Node], place: Place) -> Panel:
        """Read shape, rings and material of an arch."""
        shapes = ', '.join(f'{shape}(rise)' if count else shape
                           for shape, count in arches.SHAPES.items())
        if not 2 <= len(arguments) <= 3:
            raise place.error(f'an arch is arch(shape, rings) or arch(shape, rings, material), '
                              f'found {len(arguments)} of them (shapes: {shapes})')
        shape, rings, *materials = arguments
        if shape.data not in ('variable', 'call') or str(
                shape.children[0]) not in arches.SHAPES:
            found = str(shape.children[0]) if shape.data in ('variable', 'call') else 'a number'
            raise self.place(shape).error(
                f'unknown shape "{found}" of an arch{nearest_names(found, arches.SHAPES)} '
                f'(shapes: {shapes})')
        form, *numbers = (c for c in shape.children if c is not None)
        wanted = arches.SHAPES[str(form)]
        if len(numbers) != wanted:
            raise self.place(shape).error(
                f'"{form}" takes {"one number, its rise" if wanted else "no number"}, found '
                f'{len(numbers)} (shapes: {shapes})')
        known = {*self.known, *SCOPE_NAMES}
        return Panel(name, 'arch', self.names(materials, 'the name of a material'), place,
                     str(form), tuple(self.expression(n, known) for n in (*numbers, rings)))

    def hung(self, name: str, kind: str, arguments: list[Node], place: Place) -> Panel:
        """Read materials, the side of the hinges and the range of a door or of shutters."""
        names = 2 if kind == 'door' else 3
        if len(arguments) not in (names, names + 2):
            raise place.error(f'"{kind}" takes {names} names, and two numbers or none, found '
                              f'{len(arguments)} arguments (kinds: {KINDS_OF_PANELS})')
        words, side = list(self.names(arguments[:names], 'a name here')), ''
        if kind == 'door':
            side = words.pop()
            if side not in ('left', 'right'):
                raise self.place(arguments[1]).error(
                    f'a door hangs on its left or its right side, found "{side}"')
        known = {*self.known, *SCOPE_NAMES}
        return Panel(name, kind, tuple(words), place, side, tuple(
            self.expression(number, known) for number in arguments[names:]))

    def rule(self, node: Node) -> Rule:
        name, formals, condition, successor, weight = node.children
        parameters = tuple(str(c) for c in formals.children if c is not None)
        known = {*self.known, *parameters, *SCOPE_NAMES}

        def optional(part: Node) -> Expression | None:
            return self.expression(part.children[0], known) if part.children[0] else None

        return Rule(str(name), parameters, optional(condition), self.successor(successor, known),
                    optional(weight), self.place(node))

    def successor(self, node: Node, known: Collection[str], depth: int = 0) -> Successor:
        if depth > _DEEPEST:
            raise self.place(node).error(f'nested more than {_DEEPEST} deep; use another rule')
        if node.data == 'split':
            axis = str(node.children[0])
            if axis not in ('x', 'y'):
                raise self.place(node).error(f'split({axis}) is unknown, use split(x) or split(y)')
            return Split(axis, self.parts(node.children[1:], known, depth), self.place(node))
        if node.data in _SIZES:
            count = _SIZES[node.data]
            return Division(
                node.data, tuple(self.expression(c, known) for c in node.children[:count]),
                tuple(self.successor(c, known, depth + 1) for c in node.children[count:]))
        arguments = tuple(self.expression(c, known) for c in node.children[1:] if c is not None)
        return Call(str(node.children[0]), arguments, self.place(node))

    def parts(self, nodes: list[Node], known: Collection[str],
              depth: int) -> tuple[Part | Repeat, ...]:
        if depth > _DEEPEST:
            raise self.place(nodes[0]).error(f'nested more than {_DEEPEST} deep')
        return tuple(
            Repeat(self.parts(n.children, known, depth + 1), self.place(n)) if n.data == 'repeat'
            else Part(str(n.data), self.expression(n.children[0], known),
                      self.successor(n.children[1], known, depth + 1)) for n in nodes)
