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


"""
First step of a body in Bullet: it uses the inertia of its shape, not the one it is given.

Bullet takes over the inertia that a body is given only at the end of its first step.
"""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.physics.touch import piece_bounds
from procphys_ros.physics.world.body_table import BodyTable
from procphys_ros.physics.world.pieces import solid_inertia

_AS_SOLID = 2.0  # times the inertia of a solid: a plain body with more is made as a compound
_LEAST_AS_BOX, _MOST_AS_BOX = 1.0 / 3.0, 1.5  # inertia over that of a box of the same extents


def turn_as_their_shapes(table: BodyTable, ids: np.ndarray) -> np.ndarray:
    """
    Tell of which plain bodies the inertia is about that of their shapes, (K,) bool.

    That of a disc of wood is not, whose shape is the sphere inside of it. The first contact would
    turn it as that sphere, thousands of times too fast, and its own inertia would then make energy
    of that spin.
    """
    piece = table.first_piece[ids]
    round_ = np.flatnonzero(table.piece_shape[piece] != Shape.BOX)
    turns = np.ones(len(ids), bool)
    for place in round_.tolist():
        body = ids[place]
        solid = solid_inertia(Shape.CAPSULE, table.piece_size[piece[place]],
                              float(table.mass[body]))
        turns[place] = (table.inertia[body] < _AS_SOLID * solid).all()
    return turns


def turns_as_the_box_about_it(table: BodyTable, body: int) -> bool:
    """
    Return whether the inertia of a compound is about what Bullet takes it for in its first step.

    With less inertia than that, first contacts turn it too little.
    """
    pieces = table.pieces(body)
    each = piece_bounds(pieces.shapes, pieces.local_poses, pieces.sizes,
                        np.zeros((len(pieces.shapes), 3)), 0.0, 0.0)
    extent = each[:, 3:].max(axis=0) - each[:, :3].min(axis=0)
    solid = solid_inertia(Shape.BOX, extent, float(table.mass[body]))
    ratio = table.inertia[body] / solid
    return bool(ratio.min() > _LEAST_AS_BOX and ratio.max() < _MOST_AS_BOX)
