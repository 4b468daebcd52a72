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


"""Drawing: branches, leaves and ornaments from the turtle's records."""

from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Leaves, Ornaments
from procphys_ros.blueprint.skeleton import Branches
from procphys_ros.elementary import cos, sin
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.lsystem import walk
from procphys_ros.lsystem.modules import Modules
from procphys_ros.lsystem.symbols import ATTRIBUTE_INDEX, ATTRIBUTES

HEAD = 3           # columns of carrier, module and length before the state
TEXTURE = HEAD + walk.VALUES + ATTRIBUTE_INDEX['Texture']
_SIDES = 6         # of a boneless segment
_LEAF_TEXTURE = 1  # of `~` and `Leaf` without a number: the second name


class Drawing(NamedTuple):
    """
    Geometry recorded by the turtle; see `skeleton.build`.

    :ivar polygons: area of the polygons on each segment [m²], (S,).
    :ivar segment_rows, leaf_rows: module that drew each segment, (S,), and leaf, (L,).
    """

    branches: Branches
    leaves: Leaves
    ornaments: Ornaments
    textures: tuple[str, ...]
    polygons: np.ndarray
    segment_rows: np.ndarray
    leaf_rows: np.ndarray


def draw(modules: Modules, tables: tuple, textures: tuple[str, ...]) -> Drawing:
    """
    Make the drawing from the turtle's records.

    :param modules: the string that it followed.
    :param tables: rows of segments, boneless segments, leaves and triangles; see `walk.walk`.
    :param textures: their names.
    """
    segments, pieces, leaves, triangles = tables
    branches = _branches(segments)
    middle = branches.base + 0.5 * branches.length[:, None] * _axis(segments, walk.HEADING)
    frames = np.column_stack([middle, branches.attitude])
    return Drawing(branches, _leaves(modules, leaves, frames, len(textures)),
                   _ornaments(pieces, triangles, frames), textures,
                   _areas(triangles, len(frames)), segments[:, 1].astype(np.intp),
                   leaves[:, 1].astype(np.intp))


def _axis(table: np.ndarray, at: int) -> np.ndarray:
    return table[:, HEAD + at:HEAD + at + 3]


def _attitude(table: np.ndarray) -> np.ndarray:
    columns = [_axis(table, at) for at in (walk.LEFT, walk.UP, walk.HEADING)]
    return rotation.from_matrix(np.stack(columns, axis=-1))


def _branches(segments: np.ndarray) -> Branches:
    parent = segments[:, 0].astype(np.int32)
    lateral = segments[:, HEAD + walk.LATERAL] > 0.5
    bone = ATTRIBUTES[ATTRIBUTE_INDEX['BoneRatio']].allowed

    def value(name: str) -> np.ndarray:
        return segments[:, HEAD + walk.VALUES + ATTRIBUTE_INDEX[name]].copy()

    width = value('Width')
    tip = width * segments[:, HEAD + walk.RATES + ATTRIBUTE_INDEX['Width']]
    follows = np.flatnonzero((parent >= 0) & ~lateral)[::-1]  # of several the first counts
    tip[parent[follows]] = width[follows]
    return Branches(
        parent=parent, lateral=lateral, base=_axis(segments, walk.POSITION).copy(),
        attitude=_attitude(segments), length=segments[:, 2].copy(), width=width, tip_width=tip,
        density=value('Density'), modulus=value('Modulus'), strength=value('Strength'),
        yield_stress=value('Yield'), bone_ratio=np.clip(value('BoneRatio'), bone.low, bone.high),
        swing_limit=np.radians(value('SwingLimit')), swing_stiffness=value('SwingForce'),
        swing_damping=value('SwingDamper'), damping_ratio=value('DampingRatio'),
        twist_stiffness=value('TwistForce'), twist_damping=value('TwistDamper'),
        stretch_stiffness=value('StretchForce'), stretch_damping=value('StretchDamper'),
        break_force=value('BreakForce'), break_torque=value('BreakTorque'),
        root_stiffness=value('RootStiffness'), root_moment=value('RootMoment'),
        preload=value('Preload'), texture=value('Texture').astype(np.int16),
        cling=value('Cling'))


def leaf_textures(modules: Modules, leaves: np.ndarray, names: int) -> np.ndarray:
    """Look up the texture indices of leaves: written after the size, else the second name."""
    rows = leaves[:, 1].astype(np.int64)
    texture = np.full(len(rows), min(_LEAF_TEXTURE, names - 1), np.int16)
    numbered = modules.counts[rows] == 2
    texture[numbered] = modules.values[modules.starts[rows[numbered]] + 1]
    return texture


def _carriers(table: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Find the segments that carry rows of a table; the last one carries all that follow it."""
    return np.minimum(table[:, 0], len(frames) - 1).astype(np.int32)


def _leaves(modules: Modules, leaves: np.ndarray, frames: np.ndarray, names: int) -> Leaves:
    part = _carriers(leaves, frames)
    pose = np.column_stack([_axis(leaves, walk.POSITION), _attitude(leaves)])
    vogel, speed = (leaves[:, HEAD + walk.VALUES + ATTRIBUTE_INDEX[name]].copy()
                    for name in ('Vogel', 'SheddingSpeed'))
    return Leaves(part, rotation.relative(frames[part], pose), leaves[:, 2].copy(),
                  leaf_textures(modules, leaves, names), vogel, speed)


def _ornaments(pieces: np.ndarray, triangles: np.ndarray, frames: np.ndarray) -> Ornaments:
    carrier = np.concatenate([np.repeat(_carriers(pieces, frames), 2 * _SIDES),
                              _carriers(triangles, frames)])
    texture = np.concatenate([np.repeat(pieces[:, TEXTURE], 2 * _SIDES), triangles[:, 2]])
    corners = np.concatenate([_tubes(pieces), triangles[:, 3:].reshape(-1, 3, 3)])
    frame = frames[carrier][:, None]
    local = rotation.rotate(rotation.conjugate(frame[..., 3:]), corners - frame[..., :3])
    return Ornaments(carrier, local.reshape(-1, 9), texture.astype(np.int16))


def _areas(triangles: np.ndarray, count: int) -> np.ndarray:
    """Sum the areas of triangles by the segments that carry them [m²], (S,)."""
    first, second, third = triangles[:, 3:].reshape(-1, 3, 3).transpose(1, 0, 2)
    area = 0.5 * norm(np.cross(second - first, third - first), axis=1)
    return np.bincount(np.minimum(triangles[:, 0].astype(int), count - 1), area, count)


def _tubes(pieces: np.ndarray) -> np.ndarray:
    """Cover boneless segments with triangles, (12·P, 3, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)
    width = ATTRIBUTE_INDEX['Width']
    radius = 0.5 * pieces[:, HEAD + walk.VALUES + width]
    tip = radius * pieces[:, HEAD + walk.RATES + width]
    across = (cos(turn)[:, None] * _axis(pieces, walk.LEFT)[:, None]
              + sin(turn)[:, None] * _axis(pieces, walk.UP)[:, None])
    base = _axis(pieces, walk.POSITION)[:, None]
    low = base + radius[:, None, None] * across
    high = base + (pieces[:, 2:3] * _axis(pieces, walk.HEADING))[:, None] \
        + tip[:, None, None] * across
    next_low, next_high = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    return np.stack([np.stack([low, next_low, high], axis=2),
                     np.stack([next_low, next_high, high], axis=2)], axis=2).reshape(-1, 3, 3)
