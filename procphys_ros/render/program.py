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


"""Programs: shaders put together from the files in `shaders/`."""

from functools import cache
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).with_name('shaders')
_LIT = ('instance.vert', 'surface.frag', 'ground.frag', 'paving.frag', 'sky.frag',
        'dust.frag')  # use the sky


class Programs:
    """
    Compile shaders, each pair once.

    :param context: of OpenGL.
    """

    def __init__(self, context: Any):
        self._context = context
        self._compiled: dict[tuple[str, ...], Any] = {}

    def get(self, vertex: str, fragment: str, *names: str) -> Any:
        """
        Return the program of a vertex and a fragment shader, a `moderngl.Program`.

        :param vertex, fragment: names of files.
        :param names: defined in both, such as 'KIND_BOX'.
        """
        key = vertex, fragment, *names
        if key not in self._compiled:
            head = '#version 400\n' + ''.join(f'#define {name}\n' for name in names)
            sky = _source('sky.glsl')
            self._compiled[key] = self._context.program(
                vertex_shader=head + (sky if vertex in _LIT else '') + _source(vertex),
                fragment_shader=head + (sky if fragment in _LIT else '') + _source(fragment))
        return self._compiled[key]


def set_uniforms(target: Any, values: dict[str, Any]) -> None:
    """Set the uniforms that a program has."""
    for name, value in values.items():
        if name in target:
            target[name].value = value


@cache
def _source(name: str) -> str:
    return (_FOLDER / name).read_text('utf-8')
