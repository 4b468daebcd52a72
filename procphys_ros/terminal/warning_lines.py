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


"""Print warnings of the library, of grammars and of scenes as one line each."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import logging
import sys
from typing import Any
import warnings

from procphys_ros.errors import GrammarWarning


class _Handler(logging.Handler):
    """Forwards records of Python's logging."""

    def __init__(self, tell: Callable[[str], None]):
        super().__init__(logging.WARNING)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


@contextmanager
def told_to(tell: Callable[[str], None]) -> Iterator[None]:
    """
    Forward the library's warnings, one line each, during a block.

    Other warnings of Python are unchanged.

    :param tell: called with each line; one about a grammar begins with file and line.
    """
    logger, handler = logging.getLogger('procphys_ros'), _Handler(tell)
    with warnings.catch_warnings():
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any,
                 **more: Any) -> None:
            if issubclass(category, GrammarWarning):
                tell(str(message))
            else:
                others(message, category, *place, **more)

        warnings.showwarning = show
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)


def print_warning(line: str) -> None:
    """Print a warning to the standard error output, as commands do."""
    print(f'warning: {line}', file=sys.stderr, flush=True)
