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


"""Parts that join a scene while it runs: projectiles, shards, broken bricks."""

import numpy as np

from procphys_ros.appearance.unit_meshes import round_skin
from procphys_ros.blueprint import Blueprint, Hexahedra, Ornaments, Shape
from procphys_ros.elementary import power
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import solids, volumes
from procphys_ros.physics.world import solid_inertia
from procphys_ros.scene.strikes import Projectile

SHARD = 'shard'  # kind of the pieces of panes
_TEXTURE = 'concrete'
_CORE = 0.55  # of a ball's diameter, edge of the box drawn inside its round skin
_INNER = 0.35    # of a pane's edges: cracks start no farther from its middle
_WIDENING = 1.3  # exponent by which rings of cracks are closer near the middle
_MIRRORED = np.array([4, 5, 6, 7, 0, 1, 2, 3])  # corners with the low and high z swapped


def projectile_part(projectile: Projectile) -> Blueprint:
    """
    Make the one part of a projectile.

    Blueprints have no balls: a ball is a capsule as long as wide, with a skin of triangles.

    :param projectile: as launched.
    """
    ball = projectile.shape == 'sphere'
    size = projectile.edges
    shape = Shape.CAPSULE if ball else Shape.BOX
    volume = np.pi / 6.0 * size[0] * size[0] * size[0] if ball else size.prod()
    skin = Ornaments()
    if ball:
        triangles = 0.5 * size[0] * round_skin()
        skin = Ornaments(np.zeros(len(triangles), np.int32), triangles,
                         np.zeros(len(triangles), np.int16))
    pose = np.concatenate([np.asarray(projectile.position, float), rotation.from_yaw(0.0)])
    return Blueprint(
        shape=np.array([shape], np.uint8), size=size[None],
        visual_size=(_CORE if ball else 1.0) * size[None],
        density=np.array([projectile.mass / volume]), mass=np.array([float(projectile.mass)]),
        inertia=solid_inertia(shape, size, projectile.mass)[None], poses=pose[None],
        kind=np.zeros(1, np.int16), material=np.zeros(1, np.int16),
        texture=np.zeros(1, np.int16), leaf_area=np.zeros(1), ornaments=skin,
        kinds=('projectile',), materials=('concrete',), textures=(_TEXTURE,))


def shards(size: np.ndarray, density: float, pose: np.ndarray, texture: str, material: str,
           rings: int, rng: np.random.Generator, point: np.ndarray | None = None,
           kind: str = SHARD) -> Blueprint:
    """
    Cut a pane or a brick into pieces along radial and circular cracks around a point.

    :param size: full extents of the pane [m], (3,); the smallest is its thickness.
    :param density: [kg/m³].
    :param pose: of the pane, (7,), world.
    :param texture, material: names, as of the pane.
    :param rings: of eight shards each around the middle four.
    :param rng: of the cracks.
    :param point: of their origin, in the pane's frame [m], (3,); None = random.
    :param kind: name of the pieces.
    """
    thin, u, v = np.argsort(size, kind='stable')
    plane = _star(rings, rng, None if point is None else point[[u, v]] / size[[u, v]])
    corners = np.zeros((len(plane), 2, 2, 2, 3))  # high side along thin, u and v
    order = np.array([[0, 3], [1, 2]])  # of a shard's corners: low and high along u, then v
    flat = plane[:, order] * size[[u, v]]
    for side in (0, 1):
        corners[:, side, :, :, u], corners[:, side, :, :, v] = flat[..., 0], flat[..., 1]
        corners[:, side, :, :, thin] = (side - 0.5) * size[thin]
    corners = corners.reshape(-1, 8, 3)[:, _corner_order(int(thin), int(u), int(v))]
    corners = np.where((volumes(corners)[0] < 0.0)[:, None, None], corners[:, _MIRRORED], corners)
    made = solids(corners)
    zero, mass = np.zeros(len(made.size), np.int16), density * made.volume
    return Blueprint(
        shape=np.full(len(zero), Shape.BOX, np.uint8), size=made.size, visual_size=made.size,
        density=np.full(len(zero), density), mass=mass, inertia=density * made.inertia,
        poses=rotation.compose(pose, made.poses), kind=zero, material=zero, texture=zero,
        leaf_area=np.zeros(len(zero)), kinds=(kind,), materials=(material,),
        textures=(texture,),
        hexahedra=Hexahedra(np.arange(len(zero), dtype=np.int32), made.corners))


def _star(rings: int, rng: np.random.Generator, point: np.ndarray | None) -> np.ndarray:
    """
    Cut the unit square about zero into convex quadrilaterals around a point.

    Cracks run to its corners and near the closest point on each edge: no angle reaches 180°.

    :returns: their corners in turn, (4 + 8 · rings, 4, 2).
    """
    if point is None:
        point = rng.uniform(-0.2, 0.2, 2)
    middle = np.clip(point, -_INNER, _INNER)
    on = middle[[0, 1, 0, 1]] + rng.uniform(-0.1, 0.1, 4)
    ends = np.array([[-0.5, -0.5], [on[0], -0.5], [0.5, -0.5], [0.5, on[1]], [0.5, 0.5],
                     [on[2], 0.5], [-0.5, 0.5], [-0.5, on[3]]])
    share = power(np.linspace(0.0, 1.0, rings + 2)[1:], _WIDENING)
    share[:-1] *= rng.uniform(0.8, 1.2, rings)
    inner = middle + share[0] * (ends - middle)
    found = [[middle, inner[i - 1], inner[i], inner[(i + 1) % 8]] for i in range(0, 8, 2)]
    for low, high in zip(share[:-1], share[1:]):
        a, b = (middle + s * (ends - middle) for s in (low, high))
        found += [[a[i - 1], b[i - 1], b[i], a[i]] for i in range(8)]
    return np.array(found)


def _corner_order(thin: int, u: int, v: int) -> np.ndarray:
    """Return the rows of corners numbered along thin, u, v, in the order along x, y, z."""
    number = np.arange(8)
    bits = {axis: (number >> axis) & 1 for axis in range(3)}
    return 4 * bits[thin] + 2 * bits[u] + bits[v]
