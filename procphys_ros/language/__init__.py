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


"""Language: arithmetic, places and error messages that the grammar languages share."""

from procphys_ros.language.arithmetic import Value
from procphys_ros.language.curves import ControlCurve
from procphys_ros.language.defines import check_overrides, generator_of, resolve_defines
from procphys_ros.language.expressions import compile_expression, Expression
from procphys_ros.language.grammar import EXPRESSION_GRAMMAR, EXPRESSION_WORDS
from procphys_ros.language.includes import (
    find_grammar,
    GrammarFile,
    read_include,
    TRANSLATED,
)
from procphys_ros.language.place import Place
from procphys_ros.language.reader import Entry, GrammarReader, Node
from procphys_ros.language.syntax import (
    check_length,
    read_regular,
    read_text,
    shorten,
    syntax_error,
)

__all__ = [
    'EXPRESSION_GRAMMAR',
    'EXPRESSION_WORDS',
    'Entry',
    'Expression',
    'GrammarFile',
    'GrammarReader',
    'Node',
    'Place',
    'TRANSLATED',
    'Value',
    'check_length',
    'check_overrides',
    'compile_expression',
    'ControlCurve',
    'find_grammar',
    'generator_of',
    'read_include',
    'read_regular',
    'read_text',
    'resolve_defines',
    'shorten',
    'syntax_error',
]
