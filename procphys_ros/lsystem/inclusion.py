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


"""Inclusion: the statements of an L-system and of those that it includes."""

from pathlib import Path

from procphys_ros.language import Place, read_include, shorten, TRANSLATED
from procphys_ros.lsystem.statements import RULE_SECTIONS, split_statements, Statement

_TAKEN = ('module', 'define', 'curve', *RULE_SECTIONS)


def gather_statements(text: str, source: str, folder: Path | None = None,
                      seen: set[Path] | None = None) -> list[Statement]:
    """
    Cut a text into statements, and add modules, defines and rules of included files.

    Those of the text itself come first, so that its rules win.

    :param text: of the whole L-system.
    :param source: its name, for errors.
    :param folder: searched first for included files; None = the shipped ones only.
    :param seen: files read already; None = this one.
    :raises GrammarError: for text outside any section, misspelt headers and missing files.
    """
    seen = {Path(shorten(source)).resolve()} if seen is None else seen
    own = _statements(text, source, folder)
    result = list(own)
    for statement in own:
        if statement.section != 'include':
            continue
        for name in statement.text.replace('\n', ',').split(','):
            found = name.strip() and read_include(
                name.strip(), folder, Place(source, statement.line, 1), seen)
            if found:
                path, inner = found
                seen.add(path)
                result += [s for s in gather_statements(inner, str(path), path.parent, seen)
                           if s.section in _TAKEN]
    return result


def _statements(text: str, source: str, folder: Path | None) -> list[Statement]:
    """Cut a text into statements, in the language that its name ends in."""
    if source.endswith(TRANSLATED):
        from procphys_ros.lsystem.translation import translate
        return translate(text, source, folder)
    return split_statements(text, source)
