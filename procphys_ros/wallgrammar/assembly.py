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

"""Assembly: boxes and their contacts become the parts and bonds of a blueprint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procphys_ros.blueprint import (
    Blueprint,
    box_inertia,
    cut_bricks,
    GROUND,
    Hexahedra,
    Law,
    Mortar,
    Shape,
)
from procphys_ros.blueprint.column_table import ColumnTable
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners, solids
from procphys_ros.wallgrammar.boxes import Boxes, Joint, MICRO
from procphys_ros.wallgrammar.contacts import FaceContacts
from procphys_ros.wallgrammar.materials import Material, NAIL_AREA, texture_numbers, weakest

_SHEAR_SHARE = 0.4     # of the normal stiffness: G/E = 1/(2(1+ν)) of masonry, EN 1996-1-1 3.7.3
_THINNEST = 0.001      # [m] joint assumed for dry contacts, which are never perfectly even
_STRENGTHS = ('tension', 'cohesion', 'friction', 'compression', 'reinforcement')

# Rotation from part (x along its length) to frame, for a length along the frame's x, y, z.
_TURNS = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)],
                   [0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)]])
_ORDER = np.array([[0, 1, 2], [1, 0, 2], [2, 1, 0]])  # extents of the frame in part order
# Bond frame for a normal along x, y, z: its x and y are the next two axes of the frame.
_BOND_TURNS = np.array([[0.5, 0.5, 0.5, 0.5], [-0.5, -0.5, -0.5, 0.5], [0.0, 0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Patches(ColumnTable):
    """
    Bonds between parts, in the building's frame.

    :ivar pair: first and second part, (m, 2).
    :ivar pose: centroid and attitude of the patch, z from the first to the second [m], (m, 7).
    :ivar extent: along the patch's x and y [m], (m, 2).
    :ivar area: [m²], (m,).
    :ivar gap: thickness of the joint [m], (m,).
    :ivar reach: half of each part's size along the normal [m], (m, 2).
    """

    pair: np.ndarray
    pose: np.ndarray
    extent: np.ndarray
    area: np.ndarray
    gap: np.ndarray
    reach: np.ndarray


def from_contacts(contacts: FaceContacts, boxes: Boxes, frames: np.ndarray) -> Patches:
    """
    Turn face contacts into patches; each lies in the middle of its joint.

    :param contacts: pairs of boxes.
    :param boxes: the boxes.
    :param frames: pose of each frame in the building [m], (f, 7).
    """
    pair = np.column_stack([contacts.first, contacts.second])
    found = _patches(pair, contacts.axis, contacts.low, contacts.high, boxes, frames)
    return _nailed(found, _by_one_nail(pair, boxes))


def fastened(patches: Patches, boxes: Boxes) -> Patches:
    """Drop patches between mortared and nailed parts; shrink those held by a single nail."""
    joint = np.sort(boxes.joint[patches.pair], axis=1)
    rows = (joint != [Joint.MORTAR, Joint.NAIL]).any(axis=1)
    kept = patches.take(rows)
    return _nailed(kept, _by_one_nail(kept.pair, boxes))


def without(patches: Patches, others: Sequence[Patches]) -> Patches:
    """Drop patches between parts that other patches bond."""
    bonded = {tuple(sorted(pair)) for other in others for pair in other.pair.tolist()}
    rows = np.array([tuple(sorted(pair)) not in bonded for pair in patches.pair.tolist()], bool)
    return patches.take(rows)


def _nailed(patches: Patches, rows: np.ndarray) -> Patches:
    """Shrink the masked patches to the area that a single nail in their middle holds."""
    narrow = np.minimum(patches.extent.min(axis=1), np.sqrt(NAIL_AREA))
    extent = np.minimum(patches.extent, (NAIL_AREA / narrow)[:, None])
    area = np.where(rows, extent.prod(axis=1), patches.area)
    return replace(patches, extent=np.where(rows[:, None], extent, patches.extent), area=area)


def on_ground(boxes: Boxes, frames: np.ndarray, upright: int) -> Patches:
    """
    Make patches between the ground and the boxes at level zero.

    :param boxes: all boxes.
    :param frames: pose of each frame [m], (f, 7).
    :param upright: number of leading frames whose z is up.
    """
    rows = np.flatnonzero((boxes.cells[0][:, 2] == 0) & (boxes.frame < upright)
                          & (boxes.form < 0))
    low, high = boxes.low[rows], boxes.high[rows]
    high = np.column_stack([high[:, :2], low[:, 2]])
    low = np.column_stack([low[:, :2], np.zeros(len(rows), np.int64)])
    pair = np.column_stack([np.full(len(rows), GROUND), rows])
    return _patches(pair, np.full(len(rows), 2), low, high, boxes, frames)


def _patches(pair: np.ndarray, axis: np.ndarray, low: np.ndarray, high: np.ndarray, boxes: Boxes,
             frames: np.ndarray) -> Patches:
    row = np.arange(len(pair))
    size = (high - low) / MICRO
    extent = np.column_stack([size[row, (axis + 1) % 3], size[row, (axis + 2) % 3]])
    local = np.column_stack([(low + high) / (2.0 * MICRO), _BOND_TURNS[axis]])
    reach = 0.5 * (boxes.high - boxes.low)[pair, axis[:, None]] / MICRO
    reach[pair == GROUND] = 0.0
    return Patches(pair, rotation.compose(frames[boxes.frame[pair[:, 1]]], local), extent,
                   extent.prod(axis=1), size[row, axis], reach)


def corners_of(boxes: Boxes, forms: Sequence[np.ndarray], frames: np.ndarray) -> np.ndarray:
    """
    Return the corners of parts in the building [m], (n, 8, 3).

    :param boxes: the parts.
    :param forms: see `Site.forms`.
    :param frames: pose of each frame [m], (f, 7).
    """
    corners = box_corners(boxes.low / MICRO, boxes.high / MICRO)
    rows = np.flatnonzero(boxes.form >= 0)
    if len(rows):
        corners[rows] = np.array(forms)[boxes.form[rows]]
    frame = frames[boxes.frame, None]
    return frame[..., :3] + rotation.rotate(frame[..., 3:], corners)


def assemble(boxes: Boxes, patches: Sequence[Patches], frames: np.ndarray,
             materials: dict[str, Material], kinds: Sequence[str],
             corners: np.ndarray) -> Blueprint:
    """
    Assemble the blueprint of a building.

    :param boxes: parts, in part order.
    :param patches: bonds, in bond order.
    :param frames: pose of each frame in the building [m], (f, 7).
    :param materials: by name, in the order of the indices `Boxes.material`.
    :param kinds: names, indexed by `Boxes.kind`.
    :param corners: of the parts that are hexahedra, in part order [m], (h, 8, 3).
    """
    names = tuple(materials)
    table = list(materials.values())
    textures, texture = texture_numbers(materials)
    extents = (boxes.high - boxes.low) / MICRO
    size = np.take_along_axis(extents, _ORDER[boxes.axis], axis=1)
    density = np.array([m.density for m in table])[boxes.material]
    mass = density * size.prod(axis=1)
    centre = (boxes.low + boxes.high) / (2.0 * MICRO)
    poses = rotation.compose(frames[boxes.frame], np.column_stack([centre, _TURNS[boxes.axis]]))
    inertia = box_inertia(mass, size)
    cut = np.flatnonzero(boxes.form >= 0)
    made = solids(corners)
    size[cut], poses[cut], mass[cut] = made.size, made.poses, density[cut] * made.volume
    inertia[cut] = density[cut, None] * made.inertia
    bonds = Patches.stack(patches)
    return Blueprint(
        shape=np.full(len(boxes), Shape.BOX, np.uint8), size=size, visual_size=size.copy(),
        density=density, mass=mass, inertia=inertia, poses=poses,
        kind=boxes.kind.astype(np.int16), material=boxes.material.astype(np.int16),
        texture=texture[boxes.material], leaf_area=np.zeros(len(boxes)),
        bonds=bonds.pair.astype(np.int32), bond_law=np.full(len(bonds.pair), Law.MORTAR, np.uint8),
        bond_frame=bonds.pose, bond_extent=bonds.extent, bond_area=bonds.area,
        mortar=_mortar(bonds, boxes, materials),
        hexahedra=Hexahedra(cut.astype(np.int32), made.corners), kinds=tuple(kinds),
        materials=names, textures=textures)


def _mortar(bonds: Patches, boxes: Boxes, materials: dict[str, Material]) -> Mortar:
    """
    Assign each bond the lowest strengths among its two materials and its joiner.

    Along the normal the two half units and the joint are springs in series.
    """
    names = list(materials)
    joiner = _joiners(bonds.pair, boxes, names)
    pair = np.where(bonds.pair == GROUND, bonds.pair[:, ::-1], bonds.pair)
    material = boxes.material[pair]
    modulus = np.array([m.modulus for m in materials.values()])
    compliance = ((bonds.reach / modulus[material]).sum(axis=1)
                  + np.maximum(bonds.gap, _THINNEST) / modulus[joiner])
    strengths = np.array([[getattr(m, name) for name in _STRENGTHS]
                          for m in materials.values()])
    lowest = weakest(strengths, np.column_stack([material, joiner]))
    # Strengths of bricks in a grammar are those of their joints; pieces of one are stronger.
    cut = _grain(pair, boxes) & (boxes.form[pair] >= 0).all(axis=1)
    cut &= (boxes.joint[pair] == Joint.MORTAR).all(axis=1)
    lowest[cut, :2] = np.maximum(lowest[cut, :2], [cut_bricks.TENSION, cut_bricks.COHESION])
    return Mortar(**{name: lowest[:, i] for i, name in enumerate(_STRENGTHS)},
                  normal_stiffness=1.0 / compliance,
                  shear_stiffness=_SHEAR_SHARE / compliance)


def _joiners(pair: np.ndarray, boxes: Boxes, names: list[str]) -> np.ndarray:
    """Look up the joiner of each pair: mortar, fixing, bearing, or one member's own grain."""
    mortar, fixing, nail, lap, halving, bearing = (
        names.index(n) for n in ('mortar', 'fixing', 'nail', 'lap', 'halving', 'bearing'))
    first, second = pair.T
    first = np.where(first == GROUND, second, first)
    joints = np.sort(np.column_stack([boxes.joint[first], boxes.joint[second]]), axis=1)
    joiner = np.full(len(pair), mortar)
    joiner[joints[:, 1] != Joint.MORTAR] = fixing
    joiner[(joints[:, 1] == Joint.BEARING) & (joints[:, 0] == Joint.MORTAR)] = bearing
    joiner[(joints[:, 1] >= Joint.LAP) & (joints[:, 0] != Joint.MORTAR)] = lap
    joiner[(joints[:, 1] == Joint.HALVED) & (joints[:, 0] != Joint.MORTAR)] = halving
    joiner[_by_one_nail(pair, boxes)] = nail
    grain = _grain(pair, boxes)
    joiner[grain] = boxes.material[first][grain]
    return joiner


def _by_one_nail(pair: np.ndarray, boxes: Boxes) -> np.ndarray:
    """Mark the pairs that a single nail joins, (m,) bool."""
    nailed = (boxes.joint[pair] == Joint.NAIL).all(axis=1) & (pair[:, 0] != GROUND)
    return nailed & ~_grain(pair, boxes)


def _grain(pair: np.ndarray, boxes: Boxes) -> np.ndarray:
    """Mark the pairs that are pieces of one member, (m,) bool."""
    first, second = boxes.member[pair[:, 0]], boxes.member[pair[:, 1]]
    return (first >= 0) & (first == second) & (pair[:, 0] != GROUND)
