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

"""Piers: panels thicker than their wall, and the bond of their courses with it."""

from collections.abc import Mapping, Sequence

import numpy as np

from procphys_ros.elementary import tan
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.derivation import Piece
from procphys_ros.wallgrammar.footprint import Corner, Facade
from procphys_ros.wallgrammar.regions import EMPTY
from procphys_ros.wallgrammar.tiling import Leaf, LEAST


def check(piece: Piece, layout: Layout, wall: Layout, facade: Facade) -> None:
    """
    Check that a pier stays on its wall, and clear of the next wall.

    :param piece: a panel thicker than the wall.
    :param layout: of the panel.
    :param wall: layout of the wall.
    :param facade: where they stand.
    """
    scope, name = piece.scope, piece.panel
    outside, inside = -scope.depth, scope.depth + layout.thickness - wall.thickness
    if outside < 0 or inside < 0:
        most = layout.thickness - wall.thickness
        raise piece.place.error(
            f'the panel "{name}" is {layout.thickness / 1e6:g} m thick and extruded by '
            f'{outside / 1e6:g} m; extrude it by 0 to {most / 1e6:g} m, so that the wall, which '
            f'is {wall.thickness / 1e6:g} m thick, runs through it')
    least = LEAST + wall.joint
    for side in (outside, inside):
        if 0 < side < least:
            raise piece.place.error(
                f'the panel "{name}" stands out from the wall by {side / 1e6:g} m; leave it '
                f'flush, or let it stand out by at least {least / 1e6:g} m')
    for corner, room in ((facade.start, scope.left), (facade.end, facade.length - scope.right)):
        wanted = _clearance(corner, outside, inside + wall.thickness)
        if room < wanted:
            raise piece.place.error(
                f'the panel "{name}", thicker than the wall, is {max(room, 0) / 1e6:g} m from the '
                f'corner; leave at least {wanted / 1e6:g} m of wall')


def _clearance(corner: Corner, outside: int, depth: int) -> int:
    """
    Compute the distance from a corner at which piers of two walls cannot meet [µm].

    :param outside: how far a pier stands out from the facade [µm].
    :param depth: how far it reaches inwards from the facade [µm].
    """
    if corner.turn == 0.0:
        return 0
    half = tan(0.5 * (np.pi - abs(corner.turn)))
    reach = depth if corner.turn > 0.0 else outside
    return max(round(reach / half), -corner.yielded, 0)


def walls_beside(pieces: Sequence[Piece], owners: np.ndarray,
                 thick: Mapping[int, Layout]) -> np.ndarray:
    """
    Find the class of wall that runs on through each pier in every other course.

    :param owners: class of each panel, (n,).
    :param thick: layouts of the classes that are piers.
    :returns: class for each panel that is a pier with wall beside it, else its own, (n,).
    """
    scopes = np.array([piece.scope[:4] for piece in pieces], int).reshape(-1, 4)
    wall = (owners > EMPTY) & ~np.isin(owners, list(thick))
    found = owners.copy()
    for i in np.flatnonzero(np.isin(owners, list(thick))).tolist():
        left, bottom, right, top = scopes[i]
        upright = np.minimum(scopes[:, 3], top) - np.maximum(scopes[:, 1], bottom)
        beside = (scopes[:, 2] == left) | (scopes[:, 0] == right)
        shared = np.where(wall & beside, upright, 0)
        if shared.max() > 0:
            found[i] = owners[int(np.argmax(shared))]
    return found


def facings(depth: int, layout: Layout, wall: Layout) -> list[Leaf]:
    """
    List the leaves in front of and behind a wall that runs on through a pier.

    :param depth: of the pier's outer face, inwards from the facade plane [µm].
    :param layout: of the pier.
    :param wall: layout of the wall.
    """
    found = []
    if depth < 0:
        found.append(Leaf(0, -depth, 0, layout.joint))
    if depth + layout.thickness > wall.thickness:
        found.append(Leaf(wall.thickness - depth, layout.thickness, layout.joint, 0))
    return found
