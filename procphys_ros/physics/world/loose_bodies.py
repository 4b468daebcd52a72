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

"""Loose bodies: mass, inertia and shapes of free bodies."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Hexahedra, Shape
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.world.merging import LEVEL
from procphys_ros.physics.world.pieces import merge_pieces, Pieces, single, solid_inertia

FRICTION = 0.7  # dry brick on brick, broken mortar; also wood on earth


class LooseBody(NamedTuple):
    """
    A body before it has an id; the values are those of the columns of `BodyTable`.

    :ivar pieces: its collision shapes.
    :ivar mass: [kg].
    :ivar inertia: principal moments [kg·m²], (3,).
    :ivar pose: of centre of mass and principal axes in the world, (7,).
    :ivar velocity: world axes, (6,); None = at rest.
    :ivar friction: against a body of the same kind.
    :ivar restitution: against a body of the same kind; against the ground its root.
    :ivar least: least extent of a plain body [m], which is one piece in the body's own frame;
        0 for compounds.
    """

    pieces: Pieces
    mass: float
    inertia: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray | None
    friction: float = FRICTION
    restitution: float = 0.0
    least: float = 0.0


def plain(shape: int, size: np.ndarray, mass: float, pose: np.ndarray,
          velocity: np.ndarray | None = None, inertia: np.ndarray | None = None,
          friction: float = FRICTION, restitution: float = 0.0,
          hexahedra: Hexahedra | None = None) -> LooseBody:
    """
    Describe one box or capsule (a capsule no longer than wide is a sphere).

    :param size: as in `Blueprint.size` [m], (3,).
    :param inertia: principal moments in its axes [kg·m²], (3,); None = of a solid.
    :param hexahedra: corners of a box that is not rectangular.
    """
    size = np.asarray(size, float)
    if inertia is None:
        inertia = solid_inertia(shape, size, mass)
    return LooseBody(single(shape, size, hexahedra), mass, inertia, pose, velocity, friction,
                     restitution, float(size.min()))


def fragment(shapes: np.ndarray, sizes: np.ndarray, local_poses: np.ndarray, mass: float,
             inertia: np.ndarray, pose: np.ndarray, velocity: np.ndarray | None = None,
             friction: float = FRICTION, restitution: float = 0.0, tolerance: float = LEVEL,
             hexahedra: Hexahedra | None = None) -> LooseBody:
    """
    Describe a body made of boxes and capsules; `assembly.rigid_sum` computes the values.

    :param shapes: `Shape` of each part, (P,).
    :param sizes: as in `Blueprint.size` [m], (P, 3).
    :param local_poses: of the parts in the principal frame, (P, 7).
    :param tolerance: largest offset of ends that `merge_boxes` merges [m].
    :param hexahedra: corners of the boxes that are not rectangular.
    """
    pieces = Pieces(np.asarray(shapes, np.int64), np.asarray(sizes, float),
                    np.asarray(local_poses, float), hexahedra=hexahedra or Hexahedra())
    return LooseBody(merge_pieces(pieces, tolerance), mass, inertia, pose, velocity, friction,
                     restitution)


def radii(bodies: Sequence[Pieces]) -> np.ndarray:
    """Compute the radii of bounding spheres about the frames of bodies [m], (K,)."""
    shapes, sizes, poses = (np.concatenate([getattr(body, name) for body in bodies])
                            for name in ('shapes', 'sizes', 'local_poses'))
    own = np.where(shapes == Shape.BOX, 0.5 * norm(sizes, axis=1),
                   0.5 * np.maximum(sizes[:, 0], sizes[:, 2]))
    count = np.array([len(body.shapes) for body in bodies])
    out = np.maximum.reduceat(norm(poses[:, :3], axis=1) + own,
                              np.cumsum(count) - count)
    for k, body in enumerate(bodies):
        if len(body.ground_points):
            out[k] = max(out[k], norm(body.ground_points, axis=1).max())
    return out
