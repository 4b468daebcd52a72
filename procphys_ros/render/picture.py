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


"""Pictures: any blueprint at any poses, drawn off-screen into an image file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint, GROUND, Shape
from procphys_ros.palette import Look, look
from procphys_ros.physics.dust import Puffs
from procphys_ros.render import camera as view
from procphys_ros.render import joints, light, mesh, particles, texture
from procphys_ros.render.backdrop import backdrop
from procphys_ros.render.canvas import Canvas

_LEAF_SHARE = 0.5  # leaf area over size squared of a cluster, for shade only
_NOTHING = np.zeros((1, 3))  # the origin: an empty scene has a place, too
_HANGING = 1e-6  # [m] a petiole stays this close to its place on the branch
_EMPTY_SCENE = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])  # [m] corners to look at


@dataclass(frozen=True)
class _Item:
    """One mesh to draw; `row` is the part, leaf or ornament behind each of its pieces."""

    mesh: mesh.Mesh
    look: Look
    row: np.ndarray
    small: bool  # pieces so small that one value of shade serves for all their vertices
    outward: np.ndarray | None = None  # of leaves, per vertex
    astray: bool = False  # leaves that came off, which may be far away


def draw(blueprint: Blueprint, poses: np.ndarray, path: str | Path, *,
         camera: Sequence[float] | None = None, size: tuple[int, int] = (1280, 720),
         exists: np.ndarray | None = None, leaf_poses: np.ndarray | None = None,
         dust: Puffs | None = None) -> None:
    """
    Draw a blueprint as a picture; needs no display.

    :param blueprint: what to draw.
    :param poses: where its parts are, world, (N, 7); not finite for parts that are no more.
    :param path: image file to write; its suffix chooses the format.
    :param camera: position and target x y z tx ty tz [m]; the whole scene when not given.
    :param size: width and height [px].
    :param exists: parts to draw, (N,) bool; all when not given.
    :param leaf_poses: petioles of all leaves, world, (L, 7); on their parts when not given.
    :param dust: puffs of dust; none when not given.
    :raises RenderUnavailableError: when PyVista or OpenGL is not installed.
    """
    poses = np.asarray(poses, float)
    shown = np.isfinite(poses).all(axis=1)
    if exists is not None:
        shown &= np.asarray(exists, bool)
    petioles, hangs = _petioles(blueprint, poses, leaf_poses)
    items = [item for item in _items(blueprint, poses, shown, petioles, hangs) if len(item.row)]
    canvas = Canvas(size)
    points = np.concatenate([_NOTHING, *(i.mesh.points for i in items if not i.astray)])
    leaves, area = _leaf_cloud(blueprint, petioles, hangs & shown[blueprint.leaves.part])
    shades = [light.Shade(leaves, area, towards) for towards in (light.SUN, light.ZENITH)]
    for item in items:
        image = texture.image(item.look.pattern)
        canvas.add(item.mesh, _colours(item, *shades), image, item.look.rgba[3])
        canvas.add_shadow(item.mesh, image)
    for surface, colours in backdrop(points):
        canvas.add(surface, colours)
    if camera is None:
        place = view.frame(points if items else _EMPTY_SCENE, size)
    else:
        place = tuple(camera[:3]), tuple(camera[3:]), (0.0, 0.0, 1.0)
    if dust is not None:
        discs, colours = particles.dust(dust.positions, dust.sizes, dust.opacity, place[0])
        if len(discs.points):
            canvas.add(discs, colours)
    canvas.write(path, place, view.FIELD_OF_VIEW)


def _petioles(blueprint: Blueprint, poses: np.ndarray,
              leaf_poses: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Give the poses of all leaves, world, (L, 7), and which hang on their parts, (L,) bool."""
    leaves = blueprint.leaves
    carried = rotation.compose(poses[leaves.part], leaves.pose)
    if leaf_poses is None:
        return carried, np.ones(len(leaves), bool)
    return leaf_poses, np.abs(leaf_poses[:, :3] - carried[:, :3]).max(axis=1) < _HANGING


def _items(blueprint: Blueprint, poses: np.ndarray, shown: np.ndarray, petioles: np.ndarray,
           hangs: np.ndarray) -> Iterator[_Item]:
    """Turn the parts, leaves and ornaments into one mesh per texture and kind."""
    held = blueprint.bonds[blueprint.bonds[:, 0] != GROUND]
    crowns = light.crown_middles(poses[:, :3], held, blueprint.leaves.part)
    for index, name in enumerate(blueprint.textures or ('',)):
        appearance = look(name)
        for shape, build in ((Shape.CAPSULE, mesh.branches), (Shape.BOX, mesh.boxes)):
            row = np.flatnonzero(
                shown & (blueprint.texture == index) & (blueprint.shape == shape))
            yield _Item(build(poses[row], blueprint.visual_size[row]), appearance, row,
                        small=shape == Shape.BOX)
        leaves = blueprint.leaves
        for some in (hangs, ~hangs):
            row = np.flatnonzero(some & shown[leaves.part] & (leaves.texture == index))
            quads = mesh.crossed_quads(petioles[row], leaves.size[row], appearance.aspect)
            away = quads.points - crowns[leaves.part[row]][quads.piece]
            away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
            yield _Item(quads, appearance, row, True, away, some is not hangs)
        ornaments = blueprint.ornaments
        row = np.flatnonzero(shown[ornaments.part] & (ornaments.texture == index))
        yield _Item(mesh.loose_triangles(poses[ornaments.part[row]], ornaments.triangle[row]),
                    appearance, row, True)

    place, size = joints.standing(blueprint, poses, shown)
    yield _Item(mesh.boxes(place, size), _mortar(blueprint.textures), np.arange(len(place)), True)


def _mortar(textures: tuple[str, ...]) -> Look:
    """Choose the look of joints: the scene's own texture of mortar if it has one."""
    return look(next((name for name in textures if 'mortar' in name), 'mortar'))


def _leaf_cloud(blueprint: Blueprint, petioles: np.ndarray,
                shown: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give centre [m] and area [m²] of every leaf that is shown."""
    frames, size = petioles[shown], blueprint.leaves.size[shown]
    along = rotation.rotate(frames[:, 3:], np.array([0.0, 0.0, 1.0]))
    return frames[:, :3] + 0.5 * size[:, None] * along, _LEAF_SHARE * size ** 2


def _colours(item: _Item, *shades: light.Shade) -> np.ndarray:
    """Give the lit colour of every vertex, (V, 3), each 0 to 1."""
    points = item.mesh.points
    if item.small:
        middle = points.reshape(len(item.row), -1, 3).mean(axis=1)
        sun, sky = (shade.light(middle)[item.mesh.piece] for shade in shades)
    else:
        sun, sky = (shade.light(points) for shade in shades)
    if item.outward is None:
        lit = light.on_surfaces(item.mesh.normals, sun, sky)
    else:
        lit = light.on_leaves(item.outward, sun, sky)
    rng = np.random.default_rng(1)
    last = int(item.row.max()) + 1  # numbered by row, so that a piece keeps its tone for life
    tone = 1.0 + item.look.variation * rng.uniform(-1.0, 1.0, (last, 1))
    warmth = 1.0 + 0.4 * item.look.variation * rng.uniform(-1.0, 1.0, (last, 1)) * [1, 0, -1]
    own = np.asarray(item.look.rgba[:3]) * tone * warmth / texture.mean_light(item.look.pattern)
    return np.clip(own[item.row[item.mesh.piece]] * lit, 0.0, 1.0)
