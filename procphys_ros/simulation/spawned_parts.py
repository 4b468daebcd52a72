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


"""Parts that join a scene while it runs: projectiles and shards."""

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint, box_inertia, Ornaments, Shape
from procphys_ros.physics.world import solid_inertia
from procphys_ros.scene.strikes import Projectile

_TEXTURE = 'concrete'
_CORE = 0.55  # of a ball's diameter, edge of what is drawn inside of its round skin
_GOLDEN = 0.5 * (1.0 + 5.0 ** 0.5)


def projectile_part(projectile: Projectile) -> Blueprint:
    """
    Make the one part of a projectile.

    Blueprints know no balls: a ball is a capsule as long as wide, with a skin of triangles.

    :param projectile: as launched.
    """
    ball = projectile.shape == 'sphere'
    size = projectile.edges
    shape = Shape.CAPSULE if ball else Shape.BOX
    volume = np.pi / 6.0 * size[0] ** 3 if ball else size.prod()
    skin = Ornaments()
    if ball:
        triangles = 0.5 * size[0] * _round_skin()
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
           columns: int, rows: int, rng: np.random.Generator) -> Blueprint:
    """
    Cut a pane into small rectangles by uneven lines.

    :param size: full extents of the pane [m], (3,); its least is its thickness.
    :param density: [kg/m³].
    :param pose: of the pane, (7,), world.
    :param texture, material: names, as of the pane.
    :param columns, rows: number of pieces along the longer sides.
    :param rng: places the cuts.
    """
    thin, u, v = np.argsort(size, kind='stable')
    lows: list[tuple[float, float]] = []
    highs: list[tuple[float, float]] = []
    edges = _cuts(columns, rng)
    for left, right in zip(edges[:-1], edges[1:]):
        across = _cuts(rows, rng)
        lows += [(left, a) for a in across[:-1]]
        highs += [(right, b) for b in across[1:]]
    low, high = np.array(lows), np.array(highs)
    sizes, centres = np.full((len(low), 3), size[thin]), np.zeros((len(low), 3))
    sizes[:, [u, v]] = (high - low) * size[[u, v]]
    centres[:, [u, v]] = (0.5 * (low + high) - 0.5) * size[[u, v]]
    mass = density * sizes.prod(axis=1)
    local = np.column_stack([centres, np.tile([0.0, 0.0, 0.0, 1.0], (len(low), 1))])
    zero = np.zeros(len(low), np.int16)
    return Blueprint(
        shape=np.full(len(low), Shape.BOX, np.uint8), size=sizes, visual_size=sizes,
        density=np.full(len(low), density), mass=mass, inertia=box_inertia(mass, sizes),
        poses=rotation.compose(pose, local), kind=zero, material=zero, texture=zero,
        leaf_area=np.zeros(len(low)), kinds=('shard',), materials=(material,),
        textures=(texture,))


def _cuts(count: int, rng: np.random.Generator) -> np.ndarray:
    """Give where count uneven pieces of a unit length begin and end, (count + 1,)."""
    lengths = rng.uniform(0.6, 1.4, count)
    return np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])


def _round_skin() -> np.ndarray:
    """Give a unit sphere as 80 triangles, an icosahedron refined once, (80, 9)."""
    corners = np.array([[s, t * _GOLDEN, 0.0] for s in (-1, 1) for t in (-1, 1)])
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)])
    faces = [(a, b, c) for a in range(12) for b in range(a + 1, 12) for c in range(b + 1, 12)
             if max(np.linalg.norm(corners[i] - corners[j])
                    for i, j in ((a, b), (b, c), (a, c))) < 2.01]
    out = []
    for face in faces:
        p = corners[list(face)]
        if np.dot(np.cross(p[1] - p[0], p[2] - p[0]), p[0]) < 0.0:
            p = p[::-1]
        m = 0.5 * (p + np.roll(p, -1, axis=0))
        out += [(p[0], m[0], m[2]), (m[0], p[1], m[1]), (m[2], m[1], p[2]), tuple(m)]
    points = np.array(out)
    return (points / np.linalg.norm(points, axis=2, keepdims=True)).reshape(-1, 9)
