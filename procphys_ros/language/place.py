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


"""Place: a position in a grammar text, named in errors."""

from typing import NamedTuple
import warnings

from lark import Token, Tree

from procphys_ros.errors import GrammarError, GrammarWarning


class Place(NamedTuple):
    """
    Position in a grammar text.

    :ivar source: name of the file or parameter.
    :ivar line: 1-based.
    :ivar column: 1-based.
    """

    source: str = '<text>'
    line: int = 0
    column: int = 0

    @classmethod
    def of(cls, node: Tree | Token, source: str, first_line: int = 1) -> 'Place':
        """
        Find the start of a parsed node.

        :param node: tree with positions, or token.
        :param source: name of the file or parameter.
        :param first_line: line of the file on which the parsed text began.
        """
        spot = node if isinstance(node, Token) else node.meta
        line = getattr(spot, 'line', None)
        if line is None:  # an empty piece has no position of its own
            return cls(source, first_line, 0)
        return cls(source, line + first_line - 1, spot.column)

    def warn(self, message: str) -> None:
        """Warn of a construct at this place that is legal, but probably a mistake."""
        text = str(GrammarError(message, self.source, self.line, self.column))
        warnings.warn(GrammarWarning(text), stacklevel=2)

    def error(self, message: str) -> GrammarError:
        """Make the error that names this place."""
        return GrammarError(message, self.source, self.line, self.column)
