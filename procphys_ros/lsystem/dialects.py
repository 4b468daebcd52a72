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

"""Dialects: syntax of other L-system programs, with hints on the syntax used here."""

import re

from procphys_ros.language import Place

_MODULES = re.compile(r'^\s*module\s*:(.*)', re.IGNORECASE | re.MULTILINE)
_LINES = (
    (re.compile(r'\s*#\s*define\s+(?P<name>[A-Za-z_]\w*)\s+(?P<value>[^\s/]\S*)'),
     'a "#" begins a comment; write "define: {name} = {value}"'),
    (re.compile(r'\s*#\s*define\s+[A-Za-z_]\w*\('),
     'there are no macros, and a "#" begins a comment; write a module with parameters'),
    (re.compile(r'\s*#\s*include\s*["<](?P<name>[^">]*)'),
     'a "#" begins a comment; write "include: {name}", of a file of modules, defines and rules'),
    (re.compile(r'\s*#\s*(ifdef|ifndef|endif|undef)\b'),
     'there is no preprocessor, and a "#" begins a comment; rules have conditions'),
    (re.compile(r'\s*(?P<name>p\d+)\s*:'),
     'rules have no labels; leave "{name}:" out, and begin them with a line "production:"'),
    (re.compile(r'\s*endlsystem\b', re.IGNORECASE), 'a text ends by itself; leave this line out'),
    (re.compile(r'\s*(?P<name>homomorphism|interpretation|decomposition|production)s?\s*$',
                re.IGNORECASE), 'a section is begun with a colon, "{name}:"'),
)
SYMBOLS = {
    '"': 'a length is scaled by a parameter: A(l) -> F(l) A(0.9 * l)',
    ';': "colours are textures: Texture(n), or ' for the next one",
    ',': 'colours are textures: Texture(n)',
}  # hints for modules of other programs


def check_line(line: str, text: str, place: Place) -> None:
    """
    Check a line for syntax of other programs that means nothing or something else here.

    :param line: with its comment.
    :param text: the whole text, which may declare a module that looks like a label.
    :param place: of the line.
    :raises GrammarError: saying what to write instead.
    """
    for pattern, answer in _LINES:
        found = pattern.match(line)
        if found and not _declares(text, found.groupdict().get('name')):
            raise place.error(answer.format(**found.groupdict()))


def _declares(text: str, name: str | None) -> bool:
    return name is not None and any(
        name in re.findall(r'\w+', names) for names in _MODULES.findall(text))
