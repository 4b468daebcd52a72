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


"""Argument types of kernels as text, to name overloads before anything has called them."""

from importlib import import_module
from typing import Any

from numba import types

Text = str | list

# The names that every version of numba prints; not every one has `types.bool`.
_SCALARS = {str(kind): kind for kind in (types.boolean, *types.number_domain)}


def to_text(kind: Any) -> Text:
    """
    Describe a type by a name, or by a list that begins with its family.

    :raises ValueError: for a type that no kernel of this package takes.
    """
    if isinstance(kind, types.Array):
        return ['array' if kind.mutable else 'constant array', str(kind.dtype), kind.ndim,
                kind.layout]
    if isinstance(kind, types.BaseNamedTuple):
        made = kind.instance_class
        return ['named tuple', f'{made.__module__}:{made.__qualname__}', *map(to_text, kind)]
    if isinstance(kind, types.BaseTuple):
        return ['tuple', *map(to_text, kind)]
    if isinstance(kind, types.Omitted):
        return ['default', kind.value]
    if _SCALARS.get(str(kind)) == kind:
        return str(kind)
    raise ValueError(f'no text for arguments of type {kind}')


def from_text(text: Text) -> Any:
    """Reconstruct the type that `to_text` described."""
    if isinstance(text, str):
        return _SCALARS[text]
    family, *rest = text
    if family in ('array', 'constant array'):
        dtype, dimensions, layout = rest
        return types.Array(_SCALARS[dtype], dimensions, layout, readonly=family != 'array')
    if family == 'named tuple':
        module, _, name = rest[0].partition(':')
        made = getattr(import_module(module), name)
        members = [from_text(member) for member in rest[1:]]
        if len(set(members)) == 1:
            return types.NamedUniTuple(members[0], len(members), made)
        return types.NamedTuple(members, made)
    if family == 'tuple':
        return types.BaseTuple.from_types([from_text(member) for member in rest])
    return types.Omitted(rest[0])
