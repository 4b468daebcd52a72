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

"""Bearing: objects that stand on others, bonded to the faces under their feet."""

from dataclasses import replace

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Law, Shape
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners, faces
from procphys_ros.geometry.linear import norm, product

_UPRIGHT = 0.999      # least z of the unit normal of a bearing face
_REACH = 0.02         # [m] largest gap between a foot and its bearing face
_LEAST_AREA = 1e-4    # [m²] smaller overlaps are ignored


def bear(base: Blueprint, placed: Blueprint, name: str, on: str) -> tuple[Blueprint, np.ndarray]:
    """
    Place an object on another: its heights count from the highest face under its feet.

    :param base: the object that bears, in the world.
    :param placed: the object over the ground.
    :param name, on: of the two, for messages.
    :returns: the object with a bond for each face that a foot lies on, and for each of its bonds
        the part of the base that is its first part, -1 = as the bond says, (M,).
    :raises SceneError: for objects that are not built, or have nothing under them.
    """
    ground = placed.bonds[:, 0] == GROUND
    if not len(placed) or (placed.bond_law != Law.MORTAR).any() or not ground.any():
        raise SceneError(f'{name}.on: only what is built by a wall grammar can stand on another '
                         f'object')
    feet = np.flatnonzero(ground)
    outlines = _outlines(placed, feet)
    tops, owners = _tops(base)
    pairs = _near(outlines, tops)
    if not len(pairs):
        x, y = outlines.mean(axis=(0, 1))
        raise SceneError(f'{name}.on: nothing of "{on}" is under it, at ({x:.2f}, {y:.2f}) m; '
                         f'move {name}.origin')
    level = max(float(tops[top][0, 2]) for _, top in pairs)
    lift = np.array([0.0, 0.0, level, 0.0, 0.0, 0.0, 0.0])
    raised = replace(placed, poses=placed.poses + lift, bond_frame=placed.bond_frame + lift)
    made = [(foot, int(owners[top]), patch) for foot, top in pairs
            if abs(float(tops[top][0, 2]) - raised.bond_frame[feet[foot], 2]) < _REACH
            and (patch := _patch(outlines[foot], tops[top])) is not None]
    if not made:
        side = 'below' if raised.bond_frame[feet, 2].min() < level else 'above'
        raise SceneError(f'{name}.on: its feet are more than {_REACH:g} m {side} the top of '
                         f'"{on}", which is at {level:.2f} m there; set the z of {name}.origin '
                         f'to 0')
    kept = int(np.count_nonzero(~ground))
    rows = np.concatenate([np.flatnonzero(~ground), feet[[foot for foot, _, _ in made]]])
    carriers = np.full(len(rows), -1)
    carriers[kept:] = [owner for _, owner, _ in made]
    frame, extent = raised.bond_frame[rows], raised.bond_extent[rows]
    area = raised.bond_area[rows]
    for row, (_, _, (middle, sides, size)) in enumerate(made, kept):
        frame[row, :2], extent[row], area[row] = middle, sides, size
    return replace(raised, bonds=raised.bonds[rows], bond_law=raised.bond_law[rows],
                   bond_frame=frame, bond_extent=extent, bond_area=area,
                   mortar=raised.mortar.take(rows)), carriers


def _outlines(placed: Blueprint, rows: np.ndarray) -> np.ndarray:
    """Compute the corners of level patches, counter-clockwise [m], (K, 4, 2)."""
    corners = np.zeros((len(rows), 4, 3))
    corners[..., :2] = 0.5 * placed.bond_extent[rows, None] * np.array(
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    frame = placed.bond_frame[rows, None]
    return (frame[..., :3] + rotation.rotate(frame[..., 3:], corners))[..., :2]


def _tops(base: Blueprint) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the faces that look up, counter-clockwise [m], (4, 3) each, and their parts."""
    box = np.flatnonzero(base.shape == Shape.BOX)
    half = 0.5 * base.size[box]
    pose = base.poses[box, None]
    corners = pose[..., :3] + rotation.rotate(pose[..., 3:], box_corners(-half, half))
    place = np.searchsorted(box, base.hexahedra.part)
    corners[place] = base.hexahedra.points(base.poses)
    points, normals, _ = faces(corners)
    row, face = np.nonzero(normals[..., 2] > _UPRIGHT)
    return list(points[row, face]), box[row]


def _near(outlines: np.ndarray, tops: list[np.ndarray]) -> list[tuple[int, int]]:
    """Pair feet and faces whose bounds overlap in plan."""
    if not tops:
        return []
    flat = np.array(tops)[..., :2]
    close = ((outlines.min(axis=1)[:, None] < flat.max(axis=1))
             & (outlines.max(axis=1)[:, None] > flat.min(axis=1))).all(axis=2)
    return [(int(foot), int(top)) for foot, top in np.argwhere(close)]


def _patch(outline: np.ndarray, top: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Compute middle, extents along the foot's sides [m] and area of a foot on a face [m²]."""
    from procphys_ros.wallgrammar.polygons import clip, moments  # few scenes need it
    shared = clip(outline, top[:, :2])
    if len(shared) < 3:
        return None
    area, middle, _ = moments(shared)
    if area < _LEAST_AREA:
        return None
    along = (outline[1] - outline[0]) / norm(outline[1] - outline[0])
    axes = np.array([[along[0], -along[1]], [along[1], along[0]]])
    sides = np.ptp(product(shared, axes), axis=0)
    return middle, sides * np.sqrt(area / sides.prod()), area
