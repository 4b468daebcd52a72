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

"""Translation: grammars written for cpfg (`.l`) and L-Py (`.lpy`), read as those of our own."""

from pathlib import Path
import warnings

from procphys_ros.language import check_length, read_text
from procphys_ros.lsystem.compiler import compile_grammar
from procphys_ros.lsystem.statements import Statement
from procphys_ros.lsystem.translation.cpfg import read_cpfg
from procphys_ros.lsystem.translation.lpy import read_lpy
from procphys_ros.lsystem.writing import write_statements

__all__ = ['translate', 'translated_text']


def translate(text: str, source: str, folder: Path | None = None) -> list[Statement]:
    """
    Translate a whole text; what is left out is warned of, with its place.

    :param text: for cpfg or L-Py, as the name of its source ends.
    :param source: its name, for errors.
    :param folder: searched first for included files; None = there is none.
    :raises GrammarError: for what cannot be read, and for programs in Python or C++.
    """
    check_length(text, source)
    if source.endswith('.lpy'):
        return read_lpy(text, source)
    return read_cpfg(text, source, folder)


def translated_text(path: Path) -> str:
    """
    Translate a file into a text of our language.

    :param path: of a grammar for cpfg (`.l`) or L-Py (`.lpy`).
    :raises GrammarError: for what cannot be read.
    """
    text, source, folder = read_text(path), str(path), path.absolute().parent
    compile_grammar(text, source, 1, folder)  # tells what cannot be read in the words of the file
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        statements = translate(text, source, folder)
    return write_statements(statements, f'translated from {path.name}')
