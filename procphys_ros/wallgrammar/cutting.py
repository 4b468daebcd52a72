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

"""Cutting: bricks beside and under arches, cut to the outline of what stands there."""

from typing import NamedTuple

import numpy as np

from procphys_ros.wallgrammar.polygons import moments

_LOSS = 0.06     # of a piece: what may be lost so that it has four corners
_CLOSE = 0.10    # of what a brick keeps: what may be lost so that it is cut only once
_GAP = 0.001     # [m²] of gaps that large stones may leave: what a brick would
_NARROW = 0.010  # [m] thinner pieces are left out: mortar fills their place
_LEAST = 0.04    # [m] width of pieces that a brick is parted into
_NOTHING = 1e-7  # [m²] smaller overlaps are none


class Gap(NamedTuple):
    """
    A place that bricks make room for.

    :ivar keep_out: half planes whose intersection stays clear, rows a b c of a·x + z·b <= c [m],
        (n, 3).
    :ivar keep_in: half planes that bricks inside of it stay in, (m, 3); None = there are none.
    :ivar lines: where bricks over it are parted [m], (k,).
    """

    keep_out: np.ndarray
    keep_in: np.ndarray | None
    lines: np.ndarray


def rectangles(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Give the outlines of boxes, counter-clockwise, (n, 4, 2), of corners (n, 2)."""
    return np.stack([low, np.column_stack([high[:, 0], low[:, 1]]), high,
                     np.column_stack([low[:, 0], high[:, 1]])], axis=1)


def touched(outlines: np.ndarray, gap: Gap) -> np.ndarray:
    """Say which outlines (n, 4, 2) a gap may change, (n,) bool; never less than all of them."""
    side = outlines @ gap.keep_out[:, :2].T - gap.keep_out[:, 2]
    return ~(side.min(axis=1) > -1e-9).any(axis=1)


def cut(outline: np.ndarray, gap: Gap) -> list[np.ndarray] | None:
    """
    Cut the outline of a brick, (4, 2), to a gap.

    :returns: pieces with four corners each (some may coincide), or None if it stays as it is.
    """
    inside = _within(outline, gap.keep_out)
    if _area(inside) < _NOTHING:
        return None
    pieces = _outside(outline, gap, _area(outline) - _area(inside))
    if gap.keep_in is not None:
        pieces.append(_within(outline, gap.keep_in))
    return [quad for piece in pieces for quad in quads(piece)]


def _outside(outline: np.ndarray, gap: Gap, free: float) -> list[np.ndarray]:
    """Keep what lies outside, cut once, or parted first where that keeps more."""
    if free < _NOTHING:
        return []
    whole = _best(outline, gap.keep_out)
    if _area(whole) > free - min(_CLOSE * free, _GAP):
        return [whole]
    low, high = outline[:, 0].min(), outline[:, 0].max()
    lines = [low]
    for line in np.sort(gap.lines):
        if line - lines[-1] > _LEAST and high - line > _LEAST:
            lines.append(float(line))
    lines.append(high)
    strips = []
    for a, b in zip(lines, lines[1:]):
        strip = _within(outline, np.array([[-1.0, 0.0, -a], [1.0, 0.0, b]]))
        inside = _area(_within(strip, gap.keep_out)) >= _NOTHING
        strips.append(_best(strip, gap.keep_out) if inside else strip)
    return strips if sum(map(_area, strips)) > _area(whole) else [whole]


def _best(outline: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Cut an outline along the one plane that leaves most of it outside."""
    return max((_within(outline, -plane[None]) for plane in planes), key=_area)


def _within(outline: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Clip a convex outline by half planes, (n, 2)."""
    for a, b, c in planes:
        side = outline @ np.array([a, b]) - c
        points = []
        for i, point in enumerate(outline):
            j = (i + 1) % len(outline)
            if side[i] <= 0.0:
                points.append(point)
            if (side[i] < 0.0 < side[j]) or (side[i] > 0.0 > side[j]):
                points.append(point + (outline[j] - point) * side[i] / (side[i] - side[j]))
        if len(points) < 3:
            return np.zeros((0, 2))
        outline = np.array(points)
    return outline


def _area(outline: np.ndarray) -> float:
    return moments(outline)[0] if len(outline) > 2 else 0.0


def quads(outline: np.ndarray) -> list[np.ndarray]:
    """
    Part a convex outline into pieces with four corners, and leave out what is too thin to lay.

    :param outline: counter-clockwise, (n, 2).
    :returns: outlines of four corners each; the last one twice for a triangle.
    """
    outline = _without(outline, 1e-6)
    area = _area(outline)
    if not area or 2.0 * area / _girth(outline) < 0.5 * _NARROW or _thinnest(outline) < _NARROW:
        return []
    if len(outline) == 3:
        return [np.concatenate([outline, outline[-1:]])]
    if len(outline) == 4:
        return [outline]
    lost = [area - _area(np.delete(outline, i, axis=0)) for i in range(len(outline))]
    if min(lost) < min(_LOSS * area, _GAP):
        return quads(np.delete(outline, int(np.argmin(lost)), axis=0))
    inner = np.sort(outline[:, 0])[1:-1]
    middle = inner[np.argmin(np.abs(inner - 0.5 * (outline[:, 0].min() + outline[:, 0].max())))]
    return [quad for way in (1.0, -1.0)
            for quad in quads(_within(outline, np.array([[way, 0.0, way * middle]])))]


def _without(outline: np.ndarray, distance: float) -> np.ndarray:
    """Drop corners that lie on others, or on the line between their neighbours."""
    kept = outline
    changed = True
    while changed and len(kept) > 2:
        before, after = np.roll(kept, 1, axis=0), np.roll(kept, -1, axis=0)
        way = after - before
        length = np.maximum(np.hypot(*way.T), 1e-12)
        off = np.abs(way[:, 0] * (kept - before)[:, 1] - way[:, 1] * (kept - before)[:, 0])
        flat = (off / length < distance) | (np.hypot(*(after - kept).T) < distance)
        changed = bool(flat.any())
        kept = np.delete(kept, np.flatnonzero(flat)[:1], axis=0)
    return kept


def _girth(outline: np.ndarray) -> float:
    return float(np.hypot(*(np.roll(outline, -1, axis=0) - outline).T).sum())


def _thinnest(outline: np.ndarray) -> float:
    """Give the least width across any of the sides."""
    way = np.roll(outline, -1, axis=0) - outline
    normal = np.column_stack([-way[:, 1], way[:, 0]]) / np.hypot(*way.T)[:, None]
    return float(np.ptp(outline @ normal.T, axis=0).min())
