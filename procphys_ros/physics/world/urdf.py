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

"""URDF text of a rigid body made of boxes, hexahedra and capsules."""

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Shape
from procphys_ros.elementary import atan2, hypot
from procphys_ros.hexahedron import FACES
from procphys_ros.physics.world.pieces import Pieces

# One line per shape: PyBullet reads files line by line into 1024 characters.
_HEAD = ('<robot name="f">\n<link name="b">\n'
         '<visual><geometry><box size="0.01 0.01 0.01"/></geometry></visual>\n'
         '<inertial><mass value="%.17g"/><inertia ixx="%.17g" ixy="0" ixz="0" iyy="%.17g" '
         'iyz="0" izz="%.17g"/></inertial>\n')
_ORIGIN = '<collision><origin xyz="%.12g %.12g %.12g" rpy="%.12g %.12g %.12g"/><geometry>'
_BOX = _ORIGIN + '<box size="%.9g %.9g %.9g"/></geometry></collision>'
_CAPSULE = _ORIGIN + '<capsule radius="%.9g" length="%.9g"/></geometry></collision>'
_MESH = '<collision><geometry><mesh filename="%s"/></geometry></collision>'
_TAIL = '\n</link>\n</robot>\n'
SHORTEST = 1e-4  # [m], cylinder between the round ends of a capsule that is nearly a sphere


def write_urdf(mass: float, inertia: np.ndarray, pieces: Pieces, mesh: str = '') -> str:
    """
    Write a rigid body in its principal frame as URDF.

    :param mass: [kg].
    :param inertia: principal moments [kg·m²], (3,).
    :param pieces: in the principal frame.
    :param mesh: file with the hexahedra among them, see `write_hulls`.
    """
    turns = roll_pitch_yaw(pieces.local_poses[:, 3:])
    rows = np.column_stack([pieces.local_poses[:, :3], turns]).tolist()
    lines = []
    cut = set(pieces.hexahedra.part.tolist())
    if cut:
        lines.append(_MESH % mesh)
    is_box = (pieces.shapes == Shape.BOX).tolist()
    for piece, (box, size, row) in enumerate(zip(is_box, pieces.sizes.tolist(), rows)):
        if piece in cut:
            continue
        if box:
            lines.append(_BOX % (*row, *size))
        else:
            lines.append(_CAPSULE % (*row, 0.5 * size[0], max(size[2] - size[0], SHORTEST)))
    return _HEAD % (mass, *inertia) + '\n'.join(lines) + _TAIL


def write_hulls(corners: np.ndarray) -> str:
    """
    Write hexahedra as Wavefront OBJ, an object each: Bullet makes a convex hull of every object.

    :param corners: [m], (H, 8, 3).
    """
    quads = [' '.join(str(corner - 8) for corner in face) for face in FACES.tolist()]
    faces = ''.join(f'f {quad}\n' for quad in quads)  # counted back from the last corner
    return ''.join(f'o {number}\n' + ''.join(f'v {x:.9g} {y:.9g} {z:.9g}\n'
                                             for x, y, z in solid) + faces
                   for number, solid in enumerate(corners.tolist()))


def roll_pitch_yaw(quaternions: np.ndarray) -> np.ndarray:
    """Give the turns about fixed x, then y, then z [rad], (P, 3), as URDF has them."""
    m = rotation.to_matrix(quaternions)
    flat = hypot(m[:, 0, 0], m[:, 1, 0])
    upright = flat < 1e-7  # pitch ±90°: only roll ∓ yaw is determined, so yaw is set to zero
    roll = np.where(upright, atan2(-m[:, 1, 2], m[:, 1, 1]),
                    atan2(m[:, 2, 1], m[:, 2, 2]))
    yaw = np.where(upright, 0.0, atan2(m[:, 1, 0], m[:, 0, 0]))
    return np.column_stack([roll, atan2(-m[:, 2, 0], flat), yaw])
