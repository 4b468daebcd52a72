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

"""Elements of XML with their places in the text; no document type, so no entities, is read."""

from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import numpy as np

from procphys_ros.errors import nearest_names
from procphys_ros.language import Place, shorten

_DEEPEST = 100  # elements inside each other
_LARGEST = 1e12  # [any unit] of numbers, beyond any machine


@dataclass
class Element:
    """An element: its tag, attributes, the text in it, and the elements in it."""

    tag: str
    attributes: dict[str, str]
    place: Place
    text: str = ''
    children: 'list[Element]' = field(default_factory=list)

    def error(self, message: str) -> Exception:
        """Make the error that names the element and its place."""
        name = self.attributes.get('name')
        shown = f' name="{shorten(name, 80)}"' if name else ''
        return self.place.error(f'<{shorten(self.tag, 80)}{shown}>: {message}')

    def all(self, tag: str) -> 'list[Element]':
        """List the elements of a tag in it."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> 'Element | None':
        """Return the only element of a tag in it; None = there is none."""
        found = self.all(tag)
        if len(found) > 1:
            raise found[1].error(f'stands twice in this <{self.tag}>')
        return found[0] if found else None

    def need(self, tag: str) -> 'Element':
        """Return the only element of a tag in it, which must be there."""
        if (found := self.first(tag)) is None:
            raise self.error(f'needs <{tag}>')
        return found

    def word(self, key: str) -> str:
        """Return an attribute that must be there."""
        word = self.attributes.get(key, '').strip()
        if not word or not word.isprintable():
            raise self.error(f'needs {key}="…"')
        return word

    def choice(self, key: str, known: Any, what: str) -> str:
        """Return an attribute that must be one of some words."""
        word = self.word(key)
        if word not in known:
            raise self.error(f'{key}="{shorten(word, 80)}" is not {what}'
                             f'{nearest_names(word, known)} ({", ".join(list(known)[:20])})')
        return word

    def numbers(self, key: str, count: int, default: Any = None) -> np.ndarray:
        """Return an attribute of some numbers; without default it must be there."""
        if default is not None and key not in self.attributes:
            return np.full(count, default, float)
        word = self.word(key)
        try:
            values = np.array(word.split(), float)
        except ValueError:
            values = np.zeros(0)
        if len(values) != count or not (np.abs(values) <= _LARGEST).all():
            raise self.error(f'{key}="{shorten(word, 80)}" must be {count} finite '
                             f'number{"s" * (count > 1)}')
        return values

    def number(self, key: str, low: float, high: float, default: Any = None) -> float:
        """Return an attribute that is a number within bounds."""
        value = float(self.numbers(key, 1, default)[0])
        if not low <= value <= high:
            raise self.error(f'{key}="{value:g}" must be from {low:g} to {high:g}')
        return value


def read_xml(text: str, source: str) -> Element:
    """
    Read a document.

    :param source: name for errors.
    :raises GrammarError: where it is no XML, or has a document type.
    """
    parser = expat.ParserCreate('utf-8')
    stack = [Element('', {}, Place(source))]

    def place() -> Place:
        return Place(source, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > _DEEPEST:
            raise place().error(f'more than {_DEEPEST} elements inside each other')
        stack[-1].children.append(Element(tag, attributes, place()))
        stack.append(stack[-1].children[-1])

    def words(more: str) -> None:
        stack[-1].text += more

    def refuse(*_: Any) -> None:
        raise place().error('a document type (<!DOCTYPE …>) is not read; take it out')

    parser.StartElementHandler, parser.CharacterDataHandler = begin, words
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = refuse
    parser.buffer_text = True
    try:
        parser.Parse(text.encode('utf-8', 'replace'), True)
    except expat.ExpatError as problem:
        where = Place(source, problem.lineno, problem.offset + 1)
        raise where.error(f'this is no XML: {expat.ErrorString(problem.code)}') from None
    return stack[0].children[0]
