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

"""Ledges: stretches over an arch where the next course replaces a course of slivers."""

from collections.abc import Iterator

import numpy as np

from procphys_ros.wallgrammar import cutting
from procphys_ros.wallgrammar.courses import Courses, Ledge

_EVEN = 1e-6  # [m]


def find(courses: Courses, left: np.ndarray, right: np.ndarray, outline: np.ndarray, up: bool,
         inside: bool) -> Iterator[Ledge]:
    """
    Find ledges over an arch, under the skewbacks of an arch, or inside one.

    :param left, right: ends of the bricks [m], (n,).
    :param outline: region that bricks stay clear of, or inside of.
    :param up: whether over it.
    :param inside: whether inside of it.
    """
    turn = 1.0 if up else -1.0
    edges, others = ((courses.tops, courses.bottoms) if up
                     else (courses.bottoms, courses.tops))
    foot, head = outline[:, 1].min(), outline[:, 1].max()
    found = np.unique(edges)
    room = courses.joint + 0.05
    for edge in found[(found > 1e6 * (foot - room)) & (found < 1e6 * (head + room))].tolist():
        short, tall = np.flatnonzero(edges == edge), np.flatnonzero(others == edge)
        if not len(tall):
            continue
        # Bricks end at the level if they are below a bed, and a joint above it if over it.
        level = turn * (1e-6 * edge + (0.0 if up else courses.joint))
        least = courses.least(short)
        starts = []
        for sign in (1.0, -1.0):
            chain = _chain(outline, turn, sign, up, inside)
            starts.append(None if chain is None else _start(
                chain, level, _ranges(left, right, short, sign),
                _ranges(left, right, tall, sign), courses.joint, least))
        yield from _stretches(outline, starts, 1e-6 * edge, up, inside)


def _ranges(left: np.ndarray, right: np.ndarray, rows: np.ndarray, sign: float) -> np.ndarray:
    rows = rows[right[rows] > left[rows]]
    ends = np.column_stack([left[rows], right[rows]])
    return ends if sign > 0.0 else -ends[:, ::-1]


def _chain(outline: np.ndarray, turn: float, sign: float, up: bool, inside: bool
           ) -> np.ndarray | None:
    """Return the side of an outline that rises to the right, mirrored if necessary, (n, 2)."""
    points = outline * [sign, turn]
    if sign * turn < 0.0:
        points = points[::-1]  # counter-clockwise again
    ways = np.roll(points, -1, axis=0) - points
    if inside:  # masonry below a falling line, with none left of it, is now over a rising one
        chosen = (ways[:, 0] > 0.0) & (ways[:, 1] >= 0.0)
    else:
        chosen = (ways[:, 0] < 0.0) & (ways[:, 1] <= 0.0)
    if not up and not inside:  # skewbacks only: there is no masonry between them
        chosen &= ways[:, 1] < -_EVEN
    rows = np.flatnonzero(chosen)
    if not len(rows):
        return None
    both = np.unique(np.concatenate([rows, (rows + 1) % len(points)]))
    chain = points[both]
    return chain[np.argsort(chain[:, 0], kind='stable')]


def _start(chain: np.ndarray, level: float, short: np.ndarray, tall: np.ndarray, joint: float,
           least: float) -> float | None:
    """
    Find where a course becomes a sliver over a line that rises to the right [m].

    :param chain: the line, (n, 2).
    :param level: top of the course.
    :param short: left and right ends of its bricks, (k, 2).
    :param tall: those of the next course, (m, 2).
    """
    foot = level - least
    if foot > chain[-1, 1] or level + joint < chain[0, 1]:
        return None
    start = chain[0, 0]
    if foot > chain[0, 1]:
        k = int(np.searchsorted(chain[:, 1], foot)) - 1
        way = chain[k + 1] - chain[k]
        if cutting.is_steep(way):
            return None
        start = chain[k, 0] + way[0] * (foot - chain[k, 1]) / way[1] + joint
    after = tall[(tall[:, 0] > start) & (tall[:, 0] <= start + joint + _EVEN), 0]
    if len(after):
        start = float(after.min())
    near = tall[(tall[:, 1] > start) & (tall[:, 1] < start + least), 1]
    if len(near):
        start = float(near.min()) - least
    edge = short[np.abs(short[:, 0] - start + 0.5 * least) < joint + 0.5 * least, 0]
    if len(edge):
        start = float(edge.min())
    start = max(start, float(chain[0, 0]))
    tip = chain[-1, 0] if level > chain[-1, 1] else float(
        np.interp(level, chain[:, 1], chain[:, 0]))
    reach = min(tip, float(short[:, 1].max())) if len(short) else tip
    covered = start
    for a, b in tall[np.argsort(tall[:, 0], kind='stable')]:
        if a <= covered + 2.0 * joint + _EVEN:
            covered = max(covered, float(b))
    return start if covered + joint + _EVEN >= reach else None


def _stretches(outline: np.ndarray, starts: list[float | None], level: float, up: bool,
               inside: bool) -> Iterator[Ledge]:
    """Convert the starts of ledges, from the left and from the right, into stretches."""
    a, b = starts
    ends = [outline[:, 0].min(), outline[:, 0].max()]
    middle = 0.5 * (ends[0] + ends[1])
    limit = float(outline[:, 1].max() if not up else outline[:, 1].min())
    if up:
        if a is not None or b is not None:
            yield Ledge(level, up, middle if a is None else a, middle if b is None else -b, limit)
        return
    # From below, or inside, there is one at each end.
    if inside:
        if b is not None:
            yield Ledge(level, up, ends[0], -b, limit)
        if a is not None:
            yield Ledge(level, up, a, ends[1], limit)
        return
    foot = np.sort(outline[outline[:, 1] < outline[:, 1].min() + _EVEN, 0])
    if a is not None:
        yield Ledge(level, up, a, float(foot[0]), limit)
    if b is not None:
        yield Ledge(level, up, float(foot[-1]), -b, limit)
