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

"""Surfaces: everything that a scene shows, as meshes by object and texture."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procphys_ros.appearance import joints, mesh
from procphys_ros.appearance.closers import closers
from procphys_ros.appearance.mesh import Mesh
from procphys_ros.appearance.palette import look
from procphys_ros.appearance.paving import Paving
from procphys_ros.blueprint.cut_bricks import first_pieces
from procphys_ros.export.content import Content
from procphys_ros.geometry import rotation
from procphys_ros.physics.terrain import Terrain

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Surface:
    """
    One mesh of one texture.

    :ivar owner: name of the object, or 'mortar'.
    :ivar texture: name of the texture.
    :ivar mesh: triangles, world.
    :ivar tone: brightness of each vertex over that of the texture, (V,).
    :ivar leaf: whether it is two-sided.
    """

    owner: str
    texture: str
    mesh: Mesh
    tone: np.ndarray
    leaf: bool = False


def surfaces(content: Content) -> Iterator[Surface]:
    """Build the meshes of all existing parts by object, then the mortar between bricks."""
    blueprint = content.blueprint
    first = first_pieces(blueprint)
    leaf_owner = content.owner[blueprint.leaves.part]
    drawn = (content.exists & ~content.balls)[blueprint.ornaments.part]
    twig_owner = content.owner[blueprint.ornaments.part]
    for number, owner in enumerate(content.objects):
        parts = np.arange(owner.first, owner.first + owner.count)
        parts = parts[content.exists[parts]]
        leaves = np.flatnonzero((leaf_owner == number)
                                & np.isfinite(content.petioles).all(axis=1))
        twigs = np.flatnonzero((twig_owner == number) & drawn)
        yield from _solids(content, owner.name, parts, first)
        for texture, rows, built in foliage(content, leaves, twigs):
            yield _surface(owner.name, texture, built, rows, leaf=True)
    yield from _mortar(content)
    if not content.terrain.is_flat:
        hills = ground(content.terrain)
        yield Surface('ground', 'ground', hills, np.ones(len(hills.points)))
    for one in content.paving:
        yield Surface('paving', one.texture, paved(one), np.ones(len(one.points)))


def _solids(content: Content, owner: str, parts: np.ndarray, first: np.ndarray
            ) -> Iterator[Surface]:
    """Build parts; all pieces of a brick with the same `first` one have one tone."""
    blueprint = content.blueprint
    for index in np.unique(blueprint.texture[parts]):
        mine = parts[blueprint.texture[parts] == index]
        for rows, built in mesh.solids(blueprint, content.poses, mine):
            yield _surface(owner, content.textures[index], built, first[rows])


def _mortar(content: Content) -> Iterator[Surface]:
    """Build the mortar between bricks, and the fill of wall corners."""
    blueprint = content.blueprint
    place, size = joints.standing(blueprint, content.poses, content.exists)
    if len(place):
        yield _surface('mortar', joints.mortar_of(blueprint), mesh.boxes(place, size),
                       np.arange(len(place)))
    fill = closers(blueprint, joints.seats(blueprint))
    poses = fill.poses(content.poses, content.exists)
    for texture, rows in fill.by_texture(blueprint):
        rows = rows[np.isfinite(poses[rows, 0])]
        if len(rows):
            yield _surface('mortar', texture, mesh.hexahedra(poses[rows], fill.corners[rows]),
                           fill.first[rows])


def foliage(content: Content, leaves: np.ndarray, twigs: np.ndarray,
            part: int | None = None) -> Iterator[tuple[str, np.ndarray, Mesh]]:
    """
    Build leaves and twigs by texture: its name, their rows, and their mesh.

    :param leaves, twigs: rows of leaves and ornaments, (K,) each.
    :param part: that carries all of them, in whose frame they are built; None = in the world.
    """
    blueprint = content.blueprint
    for index in np.unique(blueprint.leaves.texture[leaves]):
        name, rows = content.textures[index], leaves[blueprint.leaves.texture[leaves] == index]
        petioles = content.petioles[rows]
        if part is not None:
            petioles = rotation.relative(content.poses[part], petioles)
        yield name, rows, mesh.crossed_quads(petioles, blueprint.leaves.size[rows],
                                             look(name).aspect)
    ornaments = blueprint.ornaments
    for index in np.unique(ornaments.texture[twigs]):
        rows = twigs[ornaments.texture[twigs] == index]
        carriers = (content.poses[ornaments.part[rows]] if part is None
                    else np.broadcast_to(rotation.ORIGIN, (len(rows), 7)))
        yield content.textures[index], rows, mesh.loose_triangles(carriers,
                                                                  ornaments.triangle[rows])


def foliage_of(content: Content, part: int) -> Iterator[tuple[str, np.ndarray, Mesh]]:
    """Build the leaves and twigs on a part in its frame, see `foliage`."""
    blueprint = content.blueprint
    leaves = np.flatnonzero(blueprint.leaves.part == part)
    leaves = leaves[np.isfinite(content.petioles[leaves]).all(axis=1)]
    twigs = np.flatnonzero((blueprint.ornaments.part == part) & ~content.balls[part])
    return foliage(content, leaves, twigs, part)


def _surface(owner: str, texture: str, built: Mesh, rows: np.ndarray,
             leaf: bool = False) -> Surface:
    """Assign every piece a tone by its row, constant over time."""
    variation = look(texture).variation
    tone = 1.0 + variation * np.random.default_rng(1).uniform(-1.0, 1.0, int(rows.max()) + 1)
    length = np.linalg.norm(built.normals, axis=1, keepdims=True)
    unit = np.where(length > 0.5, built.normals / np.maximum(length, 0.5), _UP)
    whole = Mesh(built.points, built.triangles, unit, built.uv, built.piece)
    return Surface(owner, texture, whole, tone[rows][built.piece], leaf)


def ground(terrain: Terrain) -> Mesh:
    """Build the mesh of a terrain, lit smoothly; its texture repeats every metre."""
    points, triangles = terrain.mesh()
    return _lying(points, triangles, terrain.vertex_normals())


def paved(paving: Paving) -> Mesh:
    """Build the mesh of a paving; its texture repeats every metre."""
    return _lying(paving.points, paving.faces, paving.vertex_normals())


def _lying(points: np.ndarray, triangles: np.ndarray, normals: np.ndarray) -> Mesh:
    return Mesh(points, triangles, normals, points[:, :2].copy(), np.zeros(len(points), int))


def local_part(content: Content, part: int) -> Mesh:
    """Build the mesh of one part in its own frame, without leaves."""
    poses = np.broadcast_to(rotation.ORIGIN, (len(content.blueprint), 7))
    (_, built), = mesh.solids(content.blueprint, poses, np.array([part]))
    return built
