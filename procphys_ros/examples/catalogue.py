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


"""Catalogue: the scenes and programs that come with the package, as they describe themselves."""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from procphys_ros.errors import nearest_names, ProcPhysError
from procphys_ros.files.resources import shared_folder

_NO_PROGRAMS = ('__init__', '__main__', 'catalogue', 'command')  # modules that are not programs


class UnknownExampleError(ProcPhysError):
    """A name without an example."""


@dataclass(frozen=True)
class Example:
    """
    A scene file, or a program of this package.

    :ivar name: of its file, without the suffix.
    :ivar path: of the file.
    :ivar title: the first paragraph of its own description.
    :ivar cues: scheduled commands, `<time [s]> <command>` each.
    """

    name: str
    path: Path
    title: str
    cues: tuple[str, ...] = ()

    @property
    def is_scene(self) -> bool:
        """Return whether it is a scene file; else it is a Python program."""
        return self.path.suffix == '.yaml'


def examples() -> dict[str, Example]:
    """Read all shipped examples, by name: scenes first, then programs."""
    scenes = sorted((shared_folder() / 'config').glob('*.yaml'))
    programs = sorted(path for path in Path(__file__).parent.glob('*.py')
                      if path.stem not in _NO_PROGRAMS)
    return {example.name: example for example in (*map(_scene, scenes), *map(_program, programs))}


def find(name: str) -> Example:
    """
    Return the example of a name.

    :param name: with or without the suffix of its file.
    :raises UnknownExampleError: with the nearest names.
    """
    known = examples()
    stem = name.removesuffix('.yaml').removesuffix('.py')
    if stem not in known:
        raise UnknownExampleError(f'no example is called "{name}"{nearest_names(stem, known)} '
                                  f'(examples: {", ".join(known)})')
    return known[stem]


def _scene(path: Path) -> Example:
    text = path.read_text('utf-8')
    title = []
    for line in text.splitlines():
        words = line.removeprefix('#').strip()
        if not line.startswith('#') or not words:
            break
        title.append(words)
    parameters: Mapping[str, Any] = yaml.safe_load(text)
    settings = next(iter(parameters.values()))['ros__parameters']
    return Example(path.stem, path, ' '.join(title),
                   tuple(settings['scene'].get('cues', ())))


def _program(path: Path) -> Example:
    description = ast.get_docstring(ast.parse(path.read_text('utf-8'))) or ''
    return Example(path.stem, path, ' '.join(description.split('\n\n')[0].split()))
