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


"""Digest of the sources that decide what a kernel does."""

from functools import cache
import hashlib
import os
import re
import sys

HOME = 'procphys_ros'
# Both forms of an import statement; names in parentheses may go on over several lines.
_IMPORT = re.compile(r'^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]*(\([^)]*\)|[^\n]*)'
                     r'|import[ \t]+([^\n]*))', re.MULTILINE)
_NAME = re.compile(r'([\w.]+)(?:\s+as\s+\w+)?')
_COMMENT = re.compile(r'#[^\n]*')


@cache
def source_digest(module: str) -> str:
    """
    Hash the source of a module and of all that it imports from its package, transitively.

    A kernel contains its callees and the constants that it reads, wherever they come from. Files
    that it cannot reach by imports (those of the node, say) do not concern it.

    :param module: dotted name of an imported module; this package is always followed too.
    """
    followed = {HOME, module.partition('.')[0]}
    digests: dict[str, str] = {}
    waiting = {HOME, module}
    while waiting:
        name = waiting.pop()
        known = _known(name) if name.partition('.')[0] in followed else None
        if known is not None:
            digests[name], imported = known
            waiting |= imported - digests.keys()
    lines = '\n'.join(f'{name} {digests[name]}' for name in sorted(digests))
    return hashlib.sha256(lines.encode()).hexdigest()[:16]


def imported_names(source: str) -> set[str]:
    """List the dotted names that a source imports: modules, and names that may be modules."""
    found: set[str] = set()
    for origin, members, modules in _IMPORT.findall(source):
        names = _NAME.findall(_COMMENT.sub('', members or modules))
        found |= {origin, *(f'{origin}.{name}' for name in names)} if origin else set(names)
    return found


@cache
def _known(module: str) -> tuple[str, set[str]] | None:
    """Return the hash of a module's source and its imports; None = there is no module."""
    source = _source(module)
    if source is None:
        return None
    return hashlib.sha256(source.encode()).hexdigest(), imported_names(source)


def _source(module: str) -> str | None:
    """Read the source of a module; None = there is no such module."""
    top, *inner = module.split('.')
    package = sys.modules.get(top)
    folders = getattr(package, '__path__', None)
    if folders is None:
        file = getattr(package, '__file__', None)
        paths = [file] if file and not inner else []
    else:
        stems = [os.path.join(folder, *inner) for folder in folders]
        paths = [path for stem in stems
                 for path in (f'{stem}.py', os.path.join(stem, '__init__.py'))]
    for path in paths:
        if os.path.isfile(path):
            with open(path, encoding='utf-8') as file:
                return file.read()
    return None
