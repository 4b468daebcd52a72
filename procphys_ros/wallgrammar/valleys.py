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

"""Valleys: gable roofs over a bar and its stems, whose slopes meet at valleys."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.elementary import cos, sin, tan
from procphys_ros.wallgrammar.bodies import Neighbour
from procphys_ros.wallgrammar.boxes import MICRO, micro, split_along
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.gables import EDGE, GableRoof, RIDGE_ROOM
from procphys_ros.wallgrammar.roofs import PIECE, RIDGE, TIE
from procphys_ros.wallgrammar.slopes import BATTEN, RAFTER, RAFTER_SPACING
from procphys_ros.wallgrammar.stems import Division, Stem, stretch_of
from procphys_ros.wallgrammar.valley_slopes import (
    bar_fields,
    Edge,
    shape,
    stem_field,
    ValleySlope,
)
from procphys_ros.wallgrammar.walls import Elevation

STEEP = (20.0, 60.0)  # [degrees] pitches of roofs with valleys
_HEAD = 0.5 * RIDGE + 0.005  # [m] from the middle of the ridge to the rafters
_BESIDE = 20_000      # [µm] between the outermost tie of a stem and the bar
_EVERYWHERE = (-1.0, 1e3)    # [m] along a verge, all of which is taken


def build(site: Site, walls: Sequence[Elevation], height: int, pitch: float, division: Division,
          neighbours: Sequence[Neighbour]) -> None:
    """
    Roof a bar and its stems: the bar as if it stood alone, the stems onto its rafters.

    The planes of both have one pitch, one level of eaves and rafters of one depth, so that they
    meet over the diagonals of the plan.

    :param site: takes the parts.
    :param walls: of the whole plan.
    :param height: of the walls [µm].
    :param pitch: [degrees].
    :param division: of the plan.
    :param neighbours: other bodies of the building.
    :raises GrammarError: for roofs that have no room.
    """
    bar = BarRoof(site, walls, height, pitch, division, neighbours)
    bar.build()
    for stem in division.stems:
        StemRoof(site, walls, height, pitch, division, stem, bar, neighbours).build()


class _PartRoof(GableRoof):
    """A gable roof over a rectangle of a larger plan."""

    def gable(self, place: int, seat: int, top: int) -> None:
        """Continue the wall at one end of the ridge up to the roof."""
        across = 1 - self.axis
        for wall in self.walls:
            found = stretch_of(wall.facade, across, place, int(self.low[across]),
                               int(self.high[across]))
            if found is not None:
                self._gable_wall(wall, seat, top, micro(0.5 * RIDGE) + RIDGE_ROOM, *found)
                return
        raise self.site.place.error('a gable must stand on one edge of the footprint')

    def set_slope(self, slope: ValleySlope, place: np.ndarray, ridge: np.ndarray,
                  plates: np.ndarray, taken: list[list[tuple[float, float]]]) -> int:
        """Build one slope; return the index of its frame."""
        frame = self._frame(slope)
        head = (slope.span - _HEAD) / float(cos(self.pitch))
        rafters = slope.set_rafters(self.site, frame, place, head)
        full = slope.beyond(rafters.place) <= 0.5 * RAFTER
        self._seat(slope, type(rafters)(*(column[full] for column in rafters)), plates)
        self._head(slope, rafters, ridge, self._square_end(slope, rafters))
        slope.cover(self.site, frame, rafters)
        slope.verges(self.site, frame, taken)
        return frame

    def along_eaves(self, side: int, edge: int) -> float:
        """Convert a coordinate to the distance along the eaves, on the low or high side [m]."""
        first = int(self.low[self.axis] if side == self.axis else self.high[self.axis])
        return abs(edge - first) / MICRO


class BarRoof(_PartRoof):
    """The roof of the bar, which runs on over the mouths of its stems."""

    def __init__(self, site: Site, walls: Sequence[Elevation], height: int, pitch: float,
                 division: Division, neighbours: Sequence[Neighbour]):
        axis, across = division.axis, 1 - division.axis
        own = [w for w in walls if w.facade.quarter % 2 == across or w.facade.origin[across] in (
            division.low[across], division.high[across])]
        super().__init__(site, own, height, pitch, axis, neighbours,
                         (division.low, division.high))
        self.stems = division.stems

    def build(self) -> None:
        """Build plates, gables, ridge, slopes and ties."""
        axis, across, thickness = self.axis, 1 - self.axis, self.layout.thickness
        ends = (int(self.low[axis]) + thickness, int(self.high[axis]) - thickness)
        plates = [self._timber(axis, ends, (edge, edge + self.plate), self.height,
                               self.height + self.gauge, 5_000) for edge in
                  (int(self.low[across]), int(self.high[across]) - self.plate)]
        bottom, top = self._ridge_levels(self.span)
        for end in (int(self.low[axis]), int(self.high[axis])):
            self.gable(end, bottom, top)
        middle, half = int(self.low[across] + self.high[across]) // 2, micro(0.5 * RIDGE)
        ridge = self._timber(axis, (int(self.low[axis]), int(self.high[axis])),
                             (middle - half, middle + half), bottom, top, 0, 'ridge')
        length = float(self.size[axis])
        edge = thickness / MICRO + EDGE
        place = np.linspace(edge, length - edge, max(int(np.ceil(
            (length - 2.0 * edge) / RAFTER_SPACING)), 1) + 1)
        for side, plain in enumerate(self._opposite(axis, self.span, length, False)):
            stems = [s for s in self.stems if s.upwards == bool(side)]
            mouths = sorted((min(m), max(m)) for m in (
                [self.along_eaves(side, e) for e in s[:2]] for s in stems))
            slope = ValleySlope(
                **vars(plain), fields=bar_fields(length, self.span, mouths),
                mouths=tuple(mouths), yields=any(
                    abs(0.5 * (b - a) - self.span) < 0.01 for a, b in mouths))
            taken = self.abutments(slope)
            for row, there in ((0, any(b > length - 1e-3 for _, b in mouths)),
                               (1, any(a < 1e-3 for a, _ in mouths))):
                taken[row] += [(-1.0, 0.0)] if there else []
            frame = self.set_slope(slope, place, ridge, np.concatenate(plates), taken)
            slope.sleepers(self.site, frame)
        self.tie(axis)


class StemRoof(_PartRoof):
    """The roof of a stem: one gable, and beyond its mouth rafters that lie on those of the bar."""

    def __init__(self, site: Site, walls: Sequence[Elevation], height: int, pitch: float,
                 division: Division, stem: Stem, bar: BarRoof, neighbours: Sequence[Neighbour]):
        across = 1 - division.axis
        low, high = np.zeros(2, np.int64), np.zeros(2, np.int64)
        low[division.axis], high[division.axis] = stem.low, stem.high
        low[across], high[across] = sorted((stem.mouth, stem.end))
        own = [w for w in walls if w.facade.quarter % 2 == across and w.facade.origin[
            division.axis] in (stem.low, stem.high) or stretch_of(
                w.facade, division.axis, stem.end, stem.low, stem.high)]
        super().__init__(site, own, height, pitch, across, neighbours, (low, high))
        self.stem, self.bar, self.depth = stem, bar, bar.depth

    def build(self) -> None:
        """Build plates, gable, ridge, slopes and ties."""
        axis, across, stem = self.axis, 1 - self.axis, self.stem
        inner = self.layout.thickness
        ends = ((stem.mouth, stem.end - inner) if stem.upwards else (stem.end + inner,
                                                                     stem.mouth))
        plates = [self._timber(axis, ends, (edge, edge + self.plate), self.height,
                               self.height + self.gauge, 5_000)
                  for edge in (int(self.low[across]), int(self.high[across]) - self.plate)]
        bottom, top = self._ridge_levels(self.span)
        self.gable(stem.end, bottom, top)
        ridge = self._ridge(bottom, top)
        # The slopes go on over the bar, up to where the ridges meet or this one ends.
        reach = micro(self.span)
        mouth = int(self.low[axis] if stem.upwards else self.high[axis])
        if stem.upwards:
            self.low = self.low.copy()
            self.low[axis] -= reach
        else:
            self.high = self.high.copy()
            self.high[axis] += reach
        length = float(self.high[axis] - self.low[axis]) / MICRO
        for side, plain in enumerate(self._opposite(axis, self.span, length, False)):
            foot = self.along_eaves(side, mouth)
            first = foot < self.along_eaves(side, stem.end)  # the eaves start over the bar
            slope = ValleySlope(
                **{**vars(plain), 'depth': self.depth}, fields=stem_field(length, foot, first),
                mouths=((foot, foot),), valley=Edge(foot, -1 if first else 1))
            taken = self.abutments(slope)
            taken[1 if first else 0] = [_EVERYWHERE]
            self.set_slope(slope, self._places(length, foot, first), ridge,
                           np.concatenate(plates), taken)
        if stem.upwards:
            self.low[axis] += reach
        else:
            self.high[axis] -= reach
        self.tie(axis)

    def _tie_places(self, axis: int) -> list[int]:
        """Space ties as elsewhere, and lay one beside the girder that bears the eaves."""
        stem = self.stem
        beside = stem.mouth + _BESIDE if stem.upwards else stem.mouth - _BESIDE - TIE[0]
        others = [place for place in super()._tie_places(axis)
                  if abs(place - beside) > TIE[0] + _BESIDE]
        return [*others, beside]

    def _places(self, length: float, foot: float, first: bool) -> np.ndarray:
        """Space rafters evenly from the gable to the mouth, and on over the bar."""
        wall = self.layout.thickness / MICRO + EDGE
        room = length - foot if first else foot
        last = room - self.depth * float(sin(self.pitch)) - RAFTER
        count = max(int(np.ceil((last - wall) / RAFTER_SPACING)), 1)
        near = np.linspace(wall, last, count + 1)
        over = np.arange(room + 0.5 * RAFTER + 0.01, length, RAFTER_SPACING)
        place = np.concatenate([near, over])
        return length - place[::-1] if first else place

    def _ridge(self, bottom: int, top: int) -> np.ndarray:
        """Set the ridge board from the gable to the slope of the bar, where it is bevelled."""
        axis, stem = self.axis, self.stem
        bed = (self.depth + BATTEN[1]) / float(cos(self.pitch))
        way = -1 if stem.upwards else 1

        def end(z: np.ndarray) -> np.ndarray:
            return np.asarray(stem.mouth / MICRO + way * (z - self.eaves - bed) / tan(
                self.pitch))

        reach = end(np.array([bottom, top]) / MICRO)
        if way * (reach[0] - stem.mouth / MICRO) < 0.0:
            raise self.site.place.error(
                f'the wing from {stem.low / MICRO:g} to {stem.high / MICRO:g} m is too narrow for '
                f'its roof to reach the one beside it; make it wider or the roof steeper')
        middle, half = (stem.low + stem.high) // 2, micro(0.5 * RIDGE)
        along = sorted((stem.end, micro(reach[1])))
        pieces = split_along(self._box(axis, (along[0], along[1]), (middle - half, middle + half),
                                       bottom, top, 0, 'ridge'), PIECE, self.site.next_member)
        row = 0 if stem.upwards else len(pieces) - 1
        shape(self.site, pieces, row, axis, not stem.upwards, lambda p: end(p[:, 2]))
        rows = self.site.add(pieces)
        return np.arange(rows.start, rows.stop)
