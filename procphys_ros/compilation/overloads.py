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


"""The overloads of kernels that simulations call, so that they can be compiled beforehand."""

from dataclasses import dataclass
import hashlib
from importlib import import_module
import json
from pathlib import Path
from typing import Any

from numba.core.errors import NumbaError

from procphys_ros.compilation.folders import environment_folder, module_folder
from procphys_ros.compilation.signatures import from_text, Text

SHIPPED = Path(__file__).with_name('overloads.json')
GROUPS = ('poses', 'markers', 'rest')


class StaleOverload(Exception):
    """The list of overloads is older than a kernel."""


@dataclass(frozen=True)
class Overload:
    """
    A kernel with the types of its arguments.

    :ivar module: dotted name of the module.
    :ivar name: of the kernel in it.
    :ivar arguments: types as `signatures.to_text` gives them.
    """

    module: str
    name: str
    arguments: Text

    def __str__(self) -> str:
        return f'{self.module.partition(".")[2]}.{self.name}'

    def compile(self) -> bool:
        """
        Compile and cache the overload unless it is cached; return whether that was necessary.

        :raises StaleOverload: when there is no such kernel, or it takes other arguments.
        """
        try:
            dispatcher: Any = getattr(import_module(self.module), self.name)
            dispatcher.compile(tuple(from_text(argument) for argument in self.arguments))
        except (ImportError, LookupError, AttributeError, TypeError, NumbaError) as error:
            raise StaleOverload(str(error).partition('\n')[0]) from error
        return bool(dispatcher.stats.cache_misses)


def shipped() -> tuple[list[Overload], ...]:
    """
    List the overloads that simulations call from Python; callees are compiled with them.

    `bench/overloads.py` records the list.

    :returns: overloads for the motion of trees and for their markers, each in the order of
        their use; and the rest.
    """
    content = json.loads(SHIPPED.read_text('utf-8'))
    return tuple([Overload(*row) for row in content[group]] for group in GROUPS)


def is_complete() -> bool:
    """Return whether all overloads have been compiled for these sources and this machine."""
    return _mark().is_file()


def mark_complete() -> None:
    """Record that all overloads have been compiled."""
    try:
        _mark().touch()
    except OSError:
        pass  # nothing can be kept here, as a warning has said


def _mark() -> Path:
    """Return the file that marks a complete cache."""
    modules = sorted({overload.module for group in shipped() for overload in group})
    known = [module_folder(module).name for module in modules] + [SHIPPED.read_text('utf-8')]
    digest = hashlib.sha256('\n'.join(known).encode()).hexdigest()[:16]
    return environment_folder() / f'complete-{digest}'
