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

"""Walls: a derived facade becomes masonry with openings, cut where something else needs room."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.wallgrammar import arching, hinged, piers
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.boxes import Joint
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.derivation import FacadeScope, Piece
from procphys_ros.wallgrammar.footprint import Facade
from procphys_ros.wallgrammar.openings import beam, door, glazing, Wall
from procphys_ros.wallgrammar.regions import courses, EMPTY, paint, Regions, snap_level
from procphys_ros.wallgrammar.spec import Panel
from procphys_ros.wallgrammar.tiling import lay, Leaf, Runs

_BEARING = 150_000        # [µm] of a lintel at each side; UK practice (NHBC 6.1.8)
_LEAST_BEARING = 100_000  # [µm] BS 5977-1
_DEEPEST = 0.5            # of the thickness: how far a panel may stand in or out
_MASONRY = 0              # classes from 0 up are masonry; below are beams, openings and nothing
_OPENING = -2
_BEAM = -3
_ARCH = -4   # until the masonry around it is known
_FIRST_BEAM = -5  # from here down each beam is a class of its own, while their bearings are sought


def gauge_pieces(pieces: Sequence[Piece], layout: Layout) -> list[Piece]:
    """Move level edges of panels onto near course lines; panels that vanish are dropped."""
    moved = [p._replace(scope=p.scope._replace(bottom=int(snap_level(p.scope.bottom, layout)),
                                               top=int(snap_level(p.scope.top, layout))))
             for p in pieces]
    return [p for p in moved if p.scope.top > p.scope.bottom]


@dataclass
class Elevation:
    """
    Derived wall before it is built, in which floors and roofs reserve room.

    :ivar facade: where it stands.
    :ivar pieces: panels, level edges on the courses.
    :ivar panels: definitions by name.
    :ivar layouts: by name.
    :ivar layout: the one that sets thickness and courses.
    :ivar unit: kind of its bricks.
    :ivar rows: parts of its masonry, once built.
    """

    facade: Facade
    pieces: Sequence[Piece]
    panels: dict[str, Panel]
    layouts: dict[str, Layout]
    layout: Layout
    unit: str = 'brick'

    def __post_init__(self) -> None:
        self._classes = _classes(self.pieces, self.panels, self.layouts)
        owners = np.array([_owner(p, self.panels, self._classes) for p in self.pieces], int)
        owners = _surrounded(self.pieces, owners)
        self._thick = {owner: layout for (name, _), owner in self._classes.items()
                       if (layout := self.layouts[self.panels[name].kind]).thickness
                       != self.layout.thickness}
        scopes = np.array([p.scope[:4] for p in self.pieces], int).reshape(-1, 4)
        _check(self, owners, self._thick)
        bare = self._paint(scopes, owners)
        self._check_units(bare)
        self._walls_beside = piers.walls_beside(self.pieces, owners, self._thick)
        each = np.where(owners == _BEAM, _FIRST_BEAM - np.arange(len(owners)), owners)
        apart = self._paint(scopes, each)  # beams that adjoin have a line between them here
        self._bearings = {i: _bear(self.pieces[i], apart, self.facade, list(self._thick))
                          for i in np.flatnonzero(owners == _BEAM).tolist()}
        beams = np.array([s[:4] for s, _ in self._bearings.values()], int).reshape(-1, 4)
        self._scopes = np.concatenate([scopes, beams])
        self._owners = np.concatenate([owners, np.full(len(beams), _BEAM)])
        self._walls_beside = np.concatenate([self._walls_beside, np.full(len(beams), _BEAM)])
        self._regions = self._paint(self._scopes, self._owners)
        self._arches = self._plan_arches(bare)
        self._pockets: list[tuple[int, int, int, int]] = []
        self.rows: list[int] = []

    def _paint(self, rectangles: np.ndarray, owners: np.ndarray) -> Regions:
        regions = paint(rectangles, owners)
        if regions is None:
            raise self.pieces[0].place.error('a facade is divided too finely; use fewer panels')
        return regions

    def _check_units(self, regions: Regions) -> None:
        """Check that units fit into at least one stretch of their panel type."""
        for (name, _), owner in self._classes.items():
            unit = self.layouts[self.panels[name].kind].unit
            _, left, right = regions.runs_of(owner)
            _, bottom, top = regions.turned().runs_of(owner)
            found = [int((regions.x[right] - regions.x[left]).max(initial=0)),
                     int((regions.z[top] - regions.z[bottom]).max(initial=0))]
            for what, size, room in (('long', unit[0], found[0]), ('high', unit[2], found[1])):
                if room and size > room:
                    place = next(p.place for p in self.pieces if p.panel == name)
                    raise place.error(f'a unit {size / 1e6:g} m {what} is larger than the panel '
                                      f'"{name}", which has {room / 1e6:g} m')

    def obstacle(self, left: int, bottom: int, right: int, top: int) -> str | None:
        """Return the name of the first panel in a rectangle [µm] that is not masonry, or None."""
        for arch in self._arches:
            low, foot, high, crown = arch.bounds
            if low < right and high > left and foot < top and crown > bottom:
                return arch.piece.panel
        return self._opening(left, bottom, right, top, _MASONRY)

    def covers(self, left: int, bottom: int, right: int, top: int) -> bool:
        """Return whether all of a rectangle [µm] is masonry."""
        grid = self._regions
        x, z = np.clip(grid.x, left, right), np.clip(grid.z, bottom, top)
        filled = np.diff(z)[:, None] * np.diff(x) * (grid.owner >= _MASONRY)
        return int(filled.sum()) == (right - left) * (top - bottom)

    def _opening(self, left: int, bottom: int, right: int, top: int, below: int) -> str | None:
        """Return the name of the first panel in a rectangle [µm] of a class below one, or None."""
        for scope, owner, i in zip(self._scopes, self._owners, range(len(self._scopes))):
            inside = (scope[0] < right and scope[2] > left and scope[1] < top
                      and scope[3] > bottom)
            if inside and (owner < below or owner in self._thick):
                return self.pieces[i].panel if i < len(self.pieces) else 'lintel'
        return None

    def _plan_arches(self, bare: Regions) -> list[arching.Arch]:
        """Divide the arches into stones; those over masonry or a beam are filled."""
        found: list[arching.Arch] = []
        for piece in self.pieces:
            panel = self.panels[piece.panel]
            if panel.kind != 'arch':
                continue
            row = np.searchsorted(bare.z, piece.scope.bottom) - 1
            middle = (piece.scope.left + piece.scope.right) // 2
            below = bare.owner[row, np.searchsorted(bare.x, middle) - 1] if row >= 0 else EMPTY
            arch = arching.plan(piece, panel, self.layout, below >= _MASONRY or below == _BEAM)
            self._check_room(arch, found)
            found.append(arch)
        return found

    def _check_room(self, arch: arching.Arch, others: Sequence[arching.Arch]) -> None:
        """Check that arches keep clear of each other, of corners and of openings."""
        left, bottom, right, _ = arch.bounds
        scope, name = arch.piece.scope, arch.piece.panel
        low = max(-self.facade.start.yielded, 0)
        high = self.facade.length - max(-self.facade.end.yielded, 0)
        aside = None if left >= low and right <= high else 'the corner'
        for end, start, foot, crown in (
                (left, scope.left, bottom, arch.shoulder),
                (scope.right, right, bottom, arch.shoulder),
                (scope.left, scope.right, scope.top, arch.bounds[3])):
            met = self._opening(end, foot, start, crown, EMPTY)
            aside = aside or (met and f'the panel "{met}"')
        for other in others:
            its_left, foot, its_right, _ = other.bounds
            if its_left < right and its_right > left and foot < arch.shoulder and (
                    other.shoulder > bottom):
                aside = aside or f'the arch "{other.piece.panel}" beside it'
        if aside:
            raise arch.piece.place.error(
                f'the arch "{name}" reaches {(scope.left - left) / 1e6:.3f} m into the wall at '
                f'its sides, and there is {aside}: leave more wall around it')

    def piers_above(self, level: int) -> bool:
        """Return whether a pier that stands out of the wall is higher than a level [µm]."""
        return any(owner in self._thick and piece.scope.depth < 0 and piece.scope.top > level
                   for piece, owner in zip(self.pieces, self._owners.tolist()))

    def set_back(self) -> list[FacadeScope]:
        """List the scopes of panels that are set back, and so project inside."""
        return [piece.scope for piece, owner in zip(self.pieces, self._owners.tolist())
                if piece.scope.depth > 0 and owner != EMPTY and owner not in self._thick]

    def check_inside(self) -> None:
        """Check that no piers project into rooms, where floors and partitions go."""
        for piece, owner in zip(self.pieces, self._owners.tolist()):
            if owner in self._thick and (piece.scope.depth + self._thick[owner].thickness
                                         > self.layout.thickness):
                most = (self._thick[owner].thickness - self.layout.thickness) / 1e6
                raise piece.place.error(
                    f'the panel "{piece.panel}", thicker than the wall, stands out inside, where '
                    f'floors and partitions go; extrude it by {most:g} m')

    def cut(self, left: int, bottom: int, right: int, top: int) -> None:
        """Leave a rectangle [µm] free of masonry."""
        self._pockets.append((left, bottom, right, top))

    def build(self, site: Site) -> None:
        """
        Lay the masonry and fill the openings.

        :param site: takes the parts.
        """
        pockets = np.array(self._pockets, int).reshape(-1, 4)
        cut = np.full(len(pockets), EMPTY)
        scopes = np.concatenate([self._scopes, pockets])
        covered = self._paint(scopes, np.concatenate([self._owners, cut]))
        laps = self._walls_beside != self._owners
        lapped = self._paint(scopes, np.concatenate([self._walls_beside, cut]))
        faced = self._paint(scopes, np.concatenate([np.where(laps, self._owners, EMPTY), cut]))
        for (name, depth), owner in self._classes.items():
            layout = self.layouts[self.panels[name].kind]
            runs = courses(covered, owner, depth, layout, self.facade)
            if laps.any():  # every other course of the walls runs on through their piers
                through = courses(lapped, owner, depth, layout, self.facade)
                runs = Runs.stack([runs.take(runs.course % 2 == 1),
                                   through.take(through.course % 2 == 0)])
            self._lay(site, runs, layout, None)
            if owner in self._thick:
                runs = courses(faced, owner, depth, layout, self.facade)
                for leaf in piers.facings(depth, layout, self.layout):
                    self._lay(site, runs.take(runs.course % 2 == 0), layout, leaf)
        self._fill(Wall(site, self.facade, self.layout.thickness, self.layout.joint))

    def _lay(self, site: Site, runs: Runs, layout: Layout, leaf: Leaf | None) -> None:
        site.expect((runs.right - runs.left).sum() / layout.pitch * layout.pieces)
        kind, joint = unit_of(layout, self.unit)
        bricks = arching.cut_bricks(site, self.facade, lay(
            runs, layout, site.kind(kind), joint, site.next_member, site.generator, leaf),
            self._arches, layout)
        rows = site.add(self.facade.place(bricks))
        self.rows += range(rows.start, rows.stop)

    def _fill(self, wall: Wall) -> None:
        for arch in self._arches:
            wall.add(arching.stones(wall.site, self.facade, arch, self.layout))
        for i, piece in enumerate(self.pieces):
            panel = self.panels[piece.panel]
            if panel.kind == 'glazing':
                glazing(wall, piece, *panel.arguments)
            elif panel.kind == 'boards':
                door(wall, piece, *panel.arguments)
            elif panel.kind == 'door':
                hinged.door(wall, piece, panel.arguments[0], panel.shape)
            elif panel.kind == 'shutters':
                hinged.shutters(wall, piece, *panel.arguments)
            elif panel.kind == 'beam':
                scope, kind = self._bearings[i]
                beam(wall, piece._replace(scope=scope), panel.arguments[0], kind)


def unit_of(layout: Layout, brick: str) -> tuple[str, Joint]:
    """
    Return kind and joint of the units of a layout: bricks laid, or boards nailed.

    :param layout: of the wall.
    :param brick: kind of its bricks.
    """
    return (brick, Joint.MORTAR) if layout.pieces == 1 else ('board', Joint.FIXING)


def _classes(pieces: Sequence[Piece], panels: dict[str, Panel],
             layouts: dict[str, Layout]) -> dict[tuple[str, int], int]:
    """Index the tiled panel types; the same type at another depth is another one."""
    classes: dict[tuple[str, int], int] = {}
    for piece in pieces:
        if panels[piece.panel].kind in layouts:
            classes.setdefault((piece.panel, piece.scope.depth), len(classes))
    return classes


def _owner(piece: Piece, panels: dict[str, Panel], classes: dict[tuple[str, int], int]) -> int:
    kind = panels[piece.panel].kind
    if kind == 'none':
        return EMPTY
    if kind == 'beam':
        return _BEAM
    if kind == 'arch':
        return _ARCH
    return classes.get((piece.panel, piece.scope.depth), _OPENING)


def _surrounded(pieces: Sequence[Piece], owners: np.ndarray) -> np.ndarray:
    """Assign to arches the masonry above them, or else beside them."""
    scopes = np.array([piece.scope[:4] for piece in pieces], int).reshape(-1, 4)
    found = owners.copy()
    for i in np.flatnonzero(owners == _ARCH).tolist():
        left, bottom, right, top = scopes[i]
        across = np.minimum(scopes[:, 2], right) - np.maximum(scopes[:, 0], left)
        upright = np.minimum(scopes[:, 3], top) - np.maximum(scopes[:, 1], bottom)
        beside = (scopes[:, 2] == left) | (scopes[:, 0] == right)
        for length in (across * (scopes[:, 1] == top), upright * beside):
            shared = np.where(owners >= _MASONRY, length, 0)
            if shared.max() > 0:
                found[i] = owners[int(np.argmax(shared))]
                break
        else:
            found[i] = EMPTY
    return found


def _check(elevation: Elevation, owners: np.ndarray, thick: dict[int, Layout]) -> None:
    """Check that no windows stand in corners, and no panels off the wall."""
    facade, layout = elevation.facade, elevation.layout
    low = max(-facade.start.yielded, 0)
    high = facade.length - max(-facade.end.yielded, 0)
    for piece, owner in zip(elevation.pieces, owners):
        scope = piece.scope
        at_corner = scope.left < low or scope.right > high
        if at_corner and owner in (_OPENING, _BEAM):
            raise piece.place.error(
                f'the panel "{piece.panel}" reaches into the corner, where the neighbouring wall '
                f'stands; leave at least {layout.thickness / 1e6:g} m of wall')
        if owner in thick:
            piers.check(piece, thick[owner], layout, facade)
        elif abs(scope.depth) > _DEEPEST * layout.thickness:
            raise piece.place.error(
                f'the panel "{piece.panel}" is extruded by {-scope.depth / 1e6:g} m; at most half '
                f'the wall, {_DEEPEST * layout.thickness / 1e6:g} m, keeps it bonded')
        if scope.depth > 0 and at_corner and owner >= _MASONRY:
            raise piece.place.error(f'the panel "{piece.panel}" is set back into the corner, '
                                    f'where the neighbouring wall stands')


def _bear(piece: Piece, regions: Regions, facade: Facade,
          thick: Sequence[int]) -> tuple[FacadeScope, str]:
    """
    Lengthen a beam into the wall at both sides.

    :param regions: of the wall, each beam a class of its own.
    :param thick: classes of piers, which beams do not enter.
    :returns: the beam with its bearings, and whether it is a 'lintel' or only a 'beam'.
    """
    scope = piece.scope
    bottom, top = np.searchsorted(regions.z, [scope.bottom, scope.top])
    left, right = np.searchsorted(regions.x, [scope.left, scope.right])
    rows = regions.owner[bottom:top]
    below = regions.owner[bottom - 1, left:right] if bottom else np.zeros(1, int)
    spans = bool((below < _MASONRY).any())
    solid: np.ndarray = np.all((rows >= _MASONRY) & ~np.isin(rows, thick), axis=0)
    first = left
    while first > 0 and solid[first - 1]:
        first -= 1
    last = right
    while last < len(solid) and solid[last]:
        last += 1
    shared = (first > 0 and bool((rows[:, first - 1] <= _FIRST_BEAM).any()),
              last < len(solid) and bool((rows[:, last] <= _FIRST_BEAM).any()))
    room = (scope.left - max(int(regions.x[first]), max(-facade.start.yielded, 0)),
            min(int(regions.x[last]), facade.length + min(facade.end.yielded, 0)) - scope.right)
    grown = [max(min(_BEARING, r // 2 if s else r), 0) for r, s in zip(room, shared)]
    ends = (below[0], below[-1])
    for length, under, side in zip(grown, ends, ('left', 'right')):
        if spans and under < _MASONRY and length < _LEAST_BEARING:
            raise piece.place.error(
                f'the beam "{piece.panel}" bears only {length / 1e6:g} m on the wall at its '
                f'{side} side, at least {_LEAST_BEARING / 1e6:g} m are needed: leave a wider pier')
    return (scope._replace(left=scope.left - grown[0], right=scope.right + grown[1]),
            'lintel' if spans else 'beam')
