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

"""Tiles: rows of tiles between two lines of a roof, cut at the ends of its face."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from procphys_ros.wallgrammar.roof_plan import Strip

BATTEN = (0.05, 0.025)  # [m] width and depth (BS 5534)
TILE = (0.40, 0.02)     # [m] width and thickness of a body that stands for a few tiles
APART = 0.001           # [m] tiles do not touch each other
_LEAST = 0.05           # [m] least length of a tile on a batten
_SMALLEST = 0.004       # [m²] twice the least tile beside a long slanting end
LEVEL = 1e-9            # [m] ends closer than this are one
_HELD = 0.05            # [m] least length of a batten below a tile that is nailed to it

Span = tuple[float, float]
Corners = list[tuple[float, float]]  # of a tile: -x -y, +x -y, -x +y, +x +y [m]; y is -place


class RowPiece(NamedTuple):
    """
    Part of a row of tiles between two places along the eaves.

    :ivar start, end: along the eaves [m].
    :ivar low, high: along the slope, at both ends [m], (2,) each.
    """

    start: float
    end: float
    low: tuple[float, float]
    high: tuple[float, float]


def clipped(strip: Strip, foot: Sequence[float], head: Sequence[float], low: float, high: float,
            without: Sequence[Span] = ()) -> list[RowPiece]:
    """
    Clip a strip by two lines along the eaves.

    :param foot, head: its ends at both its sides [m], (2,) each.
    :param low, high: the lines [m].
    :param without: stretches along the eaves to leave out.
    """
    lines = [(foot[0], foot[1] - foot[0]), (head[0], head[1] - head[0])]
    shares = [0.0, 1.0]
    for (start, rise), (other, other_rise) in ((lines[0], (low, 0.0)), (lines[0], (high, 0.0)),
                                               (lines[1], (low, 0.0)), (lines[1], (high, 0.0)),
                                               lines):
        if rise != other_rise:
            shares.append((other - start) / (rise - other_rise))
    length = strip.end - strip.start
    shares += [(end - strip.start) / length for span in without for end in span]
    shares = sorted({share for share in shares if 0.0 <= share <= 1.0})
    found: list[RowPiece] = []
    for a, b in zip(shares, shares[1:]):
        places = [{0.0: strip.start, 1.0: strip.end}.get(share, strip.start + share * length)
                  for share in (a, b)]
        bottom, top = ([start + share * rise for share in (a, b)] for start, rise in lines)
        middle = 0.5 * sum(places)
        if ((b - a) * length < LEVEL or sum(top) < sum(bottom) or sum(top) <= 2.0 * low
                or sum(bottom) > 2.0 * high or any(x < middle < y for x, y in without)):
            continue
        bottom = [max(low, x) for x in bottom]
        found.append(RowPiece(places[0], places[1], (bottom[0], bottom[1]), (
            max(bottom[0], min(high, top[0])), max(bottom[1], min(high, top[1])))))
    return found


def divide(run: list[RowPiece], width: float) -> list[Corners]:
    """
    Divide pieces of a row into tiles.

    Where the row is whole tiles are square, those at its ends slanting. Beside long slanting ends
    the sides of all tiles run up the slope.

    :param run: pieces side by side.
    :param width: of whole tiles [m].
    """
    low, high = min(min(p.low) for p in run), max(max(p.high) for p in run)
    slants = {(k, side): slant for k, piece in enumerate(run) for side in (0, 1)
              if (slant := _slant(piece, low, high, width, side)) is not None}
    found, k = [], 0
    while k < len(run):
        last = k
        while last < len(run) and _is_whole(run[last], low, high):
            last += 1
        if last > k:
            before, after = (slants.get((k - 1, 0)), slants.get((last, 1)))
            found += _row(low, high, np.array(before or [run[k].start] * 2),
                          np.array(after or [run[last - 1].end] * 2), width)
        elif not ((k, 1) in slants and k and _is_whole(run[k - 1], low, high)
                  or (k, 0) in slants and k + 1 < len(run) and _is_whole(run[k + 1], low, high)):
            found += _upright(run[k], width)
        k = max(last, k + 1)
    return found


def ends_at(piece: RowPiece, start: float, end: float, top: float) -> bool:
    """Return whether a piece is below a ridge, or below the hip at its end."""
    return (start - APART < piece.start and piece.end < end + APART) or min(
        piece.high) < top - APART


def _is_whole(piece: RowPiece, low: float, high: float) -> bool:
    """Return whether a piece reaches from the low to the high side of its row."""
    return (max(piece.low) - low < LEVEL) and (high - min(piece.high) < LEVEL)


def _slant(piece: RowPiece, low: float, high: float, width: float, side: int
           ) -> list[float] | None:
    """
    Return the slanting end of a row: its place at the low and the high side [m].

    :param side: at which of the piece it ends; 0 or 1.
    :returns: None where the end is longer than a tile, or not straight from side to side.
    """
    inner = 1 - side
    ends = (piece.start, piece.end)
    if piece.end - piece.start > width or piece.high[side] - piece.low[side] > LEVEL:
        return None
    if abs(piece.low[inner] - low) > LEVEL or abs(piece.high[inner] - high) > LEVEL:
        return None
    if max(piece.low) - low < LEVEL:
        return [ends[side], ends[inner]]
    return [ends[inner], ends[side]] if high - min(piece.high) < LEVEL else None


def _row(low: float, high: float, start: np.ndarray, end: np.ndarray, width: float
         ) -> list[Corners]:
    """Divide a row between two straight ends, see `divide`."""
    first, last = float(start.mean()), float(end.mean())
    slants = np.ptp(start) + np.ptp(end) > LEVEL
    count = int(np.ceil((last - first) / width)) if slants else round((last - first) / width)
    marks = np.linspace(first, last, max(count, 1) + 1)
    marks[1:-1] = np.clip(marks[1:-1], start.max(), end.min())
    lefts, rights = (np.column_stack([m, m]) for m in (marks[:-1], marks[1:]))
    lefts[0], rights[-1] = start, end
    return [[(low, -b[0]), (high, -b[1]), (low, -a[0]), (high, -a[1])]
            for a, b in zip(lefts + APART, rights - APART) if float((b - a).sum()) > _LEAST]


def _upright(piece: RowPiece, width: float) -> list[Corners]:
    """Divide a piece of a row into tiles that touch and so hold each other, see `divide`."""
    shares = np.linspace(0.0, 1.0, max(round((piece.end - piece.start) / width), 1) + 1)
    sides = [[float(line[0] + share * (line[1] - line[0])) for share in shares]
             for line in ((piece.start, piece.end), piece.low, piece.high)]
    found = []
    for a, b, low, below, high, above in zip(sides[0], sides[0][1:], sides[1], sides[1][1:],
                                             sides[2], sides[2][1:]):
        if (b - a) * (high - low + above - below) > _SMALLEST:
            found.append([(below - APART, -b), (above + APART, -b), (low - APART, -a),
                          (high + APART, -a)])
    return found


def rests(corners: np.ndarray, battens: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """Count the battens that tiles reach from side to side, (n, 4, 2), (n,)."""
    low, high = corners[:, 0, 0], corners[:, 1, 0]
    upright = (low == corners[:, 2, 0]) & (high == corners[:, 3, 0])
    count = np.zeros(len(corners), int)
    for x, start, end in battens:
        share = np.clip((x - low) / (high - low), 0.0, 1.0)[:, None]
        sides = corners[:, [0, 2], 1] * (1.0 - share) + corners[:, [1, 3], 1] * share
        count += ((low - x < 0.5 * BATTEN[0]) & (x - high < 0.5 * BATTEN[0])
                  & (np.minimum(-start, sides[:, 1]) - np.maximum(-end, sides[:, 0]) > _HELD))
    return np.where(upright, count, 0)
