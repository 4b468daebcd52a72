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

"""Division: sharing of a length among sizes, with the semantics of CGA's split."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from procphys_ros.language import Place

_MOST_REPEATS = 100_000
_LARGEST = 1e6  # [m], share or weight: more than the longest facade


_ROUNDING = 1e-4  # [m] by which parts may exceed the length that they fill


@dataclass(frozen=True)
class Share:
    """
    Part of a division, with its requested size.

    :ivar kind: 'absolute' [m], 'relative' (fraction of the whole) or 'floating' (weight).
    :ivar size: amount.
    :ivar content: of the part.
    :ivar place: in the text.
    """

    kind: str
    size: float
    content: Any
    place: Place = Place()


@dataclass(frozen=True)
class Repeated:
    """Parts that are repeated to the nearest whole count."""

    shares: 'tuple[Share | Repeated, ...]'
    place: Place = Place()


def nominal(shares: 'tuple[Share | Repeated, ...]', length: float) -> float:
    """Sum the requested sizes of parts [m]; a repeat counts once."""
    total = 0.0
    for share in shares:
        if isinstance(share, Repeated):
            total += nominal(share.shares, length)
        else:
            total += _size(share, length)
    return total


def _size(share: Share, length: float) -> float:
    """Compute the requested size of a part in a scope: a weight, or a length [m]."""
    if not 0.0 <= share.size <= _LARGEST:
        raise share.place.error(f'a size must be from 0 to {_LARGEST:g}, found {share.size:g}')
    return share.size * length if share.kind == 'relative' else share.size


def unroll(shares: 'tuple[Share | Repeated, ...]', length: float) -> list[Share]:
    """
    Expand repeats, each to the count that best fills the length left by the other parts.

    :param shares: parts, in order.
    :param length: of the scope [m].
    :raises GrammarError: for an empty repeat, or one of too many parts.
    """
    fixed = nominal(tuple(s for s in shares if not isinstance(s, Repeated)), length)
    repeats = [s for s in shares if isinstance(s, Repeated)]
    room = (length - fixed) / max(len(repeats), 1)
    out: list[Share] = []
    for share in shares:
        if isinstance(share, Share):
            out.append(share)
            continue
        body = nominal(share.shares, length)
        if body <= 0.0:
            raise share.place.error('a repeat needs parts of a size greater than 0')
        count = room / body
        if count > _MOST_REPEATS:
            raise share.place.error(f'{count:.3g} repeats are too many, at most {_MOST_REPEATS}')
        # Floating parts stretch, so the nearest count fits; others must not stick out.
        count = np.rint(count) if _floats(share.shares) else np.floor(count + 1e-9)
        inner = unroll(share.shares, body)
        out.extend(inner * max(int(count), 1 if room > 0.0 else 0))
    return out


def _floats(shares: 'tuple[Share | Repeated, ...]') -> bool:
    return any(_floats(s.shares) if isinstance(s, Repeated) else s.kind == 'floating'
               for s in shares)


def divide(shares: 'tuple[Share | Repeated, ...]', length: int) -> list[tuple[int, int, Any]]:
    """
    Cut a length into parts.

    Absolute and relative parts come first; floating parts share the rest by weight, and are
    dropped when nothing is left. An excess within rounding is clipped.

    :param shares: parts, in order.
    :param length: of the scope [µm].
    :returns: start, end [µm] and content of each part that has a size.
    :raises GrammarError: when the absolute and relative parts do not fit, and for sizes out of
        range.
    """
    metres = length * 1e-6
    parts = unroll(shares, metres)
    sizes = np.array([_size(p, metres) for p in parts], float)
    floating = np.array([p.kind == 'floating' for p in parts], bool)
    taken = sizes[~floating].sum()
    if taken > metres + _ROUNDING:
        raise parts[int(np.argmax(~floating))].place.error(
            f'the parts of this split need {taken:g} m and do not fit into {metres:g} m')
    left = max(metres - taken, 0.0)
    weight = sizes[floating].sum()
    if weight > 0.0:
        sizes[floating] *= left / weight
    ends = np.rint(np.minimum(np.cumsum(sizes), 2.0 * metres) * 1e6).astype(np.int64)
    starts = np.concatenate([[0], ends[:-1]]).astype(np.int64)
    out = []
    for part, size, start, end in zip(parts, sizes, starts.tolist(), ends.tolist()):
        if start >= length and size > 1e-6:
            raise part.place.error(f'a part of {size:g} m does not fit: the parts before it fill '
                                   f'the whole scope of {metres:g} m')
        if abs(end - length) <= 1:
            end = length
        if min(end, length) - start > 1:
            out.append((start, min(end, length), part.content))
    return out
