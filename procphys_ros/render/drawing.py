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


"""Drawing: the pieces of a blueprint as batches that are kept from picture to picture."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from procphys_ros.appearance import joints, texture
from procphys_ros.appearance.closers import Closers, closers
from procphys_ros.appearance.palette import look
from procphys_ros.appearance.torn_wood import WoodJoints
from procphys_ros.appearance.unit_meshes import Kind
from procphys_ros.blueprint import Blueprint, GROUND, Law, Shape
from procphys_ros.blueprint.cut_bricks import first_pieces
from procphys_ros.geometry import rotation
from procphys_ros.physics.dust import Puffs
from procphys_ros.render import light
from procphys_ros.render.batches import Batch, MORE, SHARE, SIZE, THICKNESS, TONE
from procphys_ros.render.camera import View
from procphys_ros.render.program import Programs

_LEAF_SHARE = 0.5  # leaf area over size squared of a cluster, for shade only
SINGLE = 22.0  # [px] of length above which leaves are drawn singly
_MOST_BLADES = 80_000  # of these per picture and kind, the nearest: half a second on a core
_PRESSED = 0.1  # thickness of a lying cluster of leaves over that of a growing one
_CRACK_TONE = 0.12  # of a cracked joint, over that of a whole one


@dataclass(frozen=True)
class Moment:
    """
    The content of a picture at one time.

    :ivar blueprint: parts, bonds and leaves; those of an earlier moment come first.
    :ivar poses: of its parts, world, (N, 7); not finite for missing parts.
    :ivar leaf_poses: petioles of its leaves, world, (L, 7); None = on their parts.
    :ivar exists: parts to draw, (N,) bool; None = all.
    :ivar cracked: bonds that have cracked or broken, (K,).
    :ivar dust: puffs of dust.
    :ivar lying: whether each leaf has fallen and lies, (L,) bool; None = none does.
    :ivar snow: on open ground [kg/m²].
    """

    blueprint: Blueprint
    poses: np.ndarray
    leaf_poses: np.ndarray | None = None
    exists: np.ndarray | None = None
    cracked: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    dust: Puffs = field(default_factory=Puffs.none)
    lying: np.ndarray | None = None
    snow: float = 0.0

    def shown(self) -> np.ndarray:
        """Mark the parts to be drawn, (N,) bool."""
        finite = np.isfinite(self.poses).all(axis=1)
        return finite if self.exists is None else finite & np.asarray(self.exists, bool)

    def petioles(self) -> np.ndarray:
        """Return the poses of all leaves, world, (L, 7)."""
        if self.leaf_poses is not None:
            return self.leaf_poses
        leaves = self.blueprint.leaves
        return rotation.compose(self.poses[leaves.part], leaves.pose)


class SceneBatches:
    """
    Create batches from a blueprint, and move them.

    :param context: of OpenGL.
    :param first: moment whose leaves shade the scene from then on.
    :param towards: unit vector to the sun, (3,).
    """

    def __init__(self, context: Any, first: Moment, towards: np.ndarray = light.SUN):
        self._context, self._programs = context, Programs(context)
        self._towards = towards
        self._batches: dict[tuple, Batch] = {}
        self._rows: dict[tuple, np.ndarray] = {}  # part, leaf or triangle of each piece
        self._parts = self._leaves = self._triangles = self._bonds = 0  # drawn so far
        self._petioles: dict[tuple, np.ndarray] = {}  # of the leaves of each batch
        self._seats: list[tuple[tuple, joints.Seats]] = []
        self._closers: list[tuple[tuple, Closers]] = []
        self._sun, *self._sky = _shades(first, np.vstack([towards, light.SKY]))
        self._last = np.full((0, 7), np.nan)
        self._cracks = -1
        self._wood: WoodJoints | None = None
        self._blueprint: Blueprint | None = None
        self._torn: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # parts, bonds of pieces
        self._opened: dict[int, float] = {}  # bonds that are not fully open

    @property
    def batches(self) -> Iterator[Batch]:
        """Yield all batches, transparent ones last."""
        yield from sorted(self._batches.values(), key=lambda batch: batch.is_glass)

    def update(self, moment: Moment) -> None:
        """Draw new pieces, and move the others."""
        poses = np.where(moment.shown()[:, None], moment.poses, np.nan)
        petioles = moment.petioles()
        self._append(moment.blueprint, poses, petioles)
        if moment.blueprint is not self._blueprint:
            self._resize(moment, poses, petioles)
        petioles = np.where(np.isfinite(poses[moment.blueprint.leaves.part, :1]), petioles, np.nan)
        for key, rows in self._rows.items():
            if key[0] == 'leaf':
                self._petioles[key] = petioles[rows]
                if moment.lying is not None:
                    self._batches[key].update(THICKNESS, np.where(
                        moment.lying[rows, None], _PRESSED, 1.0))
                self._batches[key].move(petioles[rows])
            elif key[0] == 'triangle':
                self._batches[key].move(poses[moment.blueprint.ornaments.part[rows]])
            else:
                self._batches[key].move(poses[rows])
        self._move_torn(moment.blueprint, poses)
        self._move_joints(poses)
        self._mark_cracks(moment.cracked)

    def _resize(self, moment: Moment, poses: np.ndarray, petioles: np.ndarray) -> None:
        """Follow the growth of branches and leaves, and of the shade that these cast."""
        blueprint, grows = moment.blueprint, False
        self._blueprint, self._wood = blueprint, WoodJoints(blueprint)
        for key, rows in self._rows.items():
            if key[:2] == ('part', Kind.BRANCH):
                grows |= self._batches[key].update(SIZE, blueprint.visual_size[rows])
            elif key[0] == 'leaf':
                grows |= self._batches[key].update(SIZE, blueprint.leaves.size[rows, None])
        if not grows:
            return
        self._sun, *self._sky = _shades(moment, np.vstack([self._towards, light.SKY]))
        outward = _outward(blueprint)
        for key, rows in self._rows.items():
            if key[:2] == ('part', Kind.BRANCH):
                share = self._light_along(poses[rows], blueprint.visual_size[rows, 2])
            elif key[0] == 'part':
                share = self._light(poses[rows, :3])
            elif key[0] == 'leaf':
                share = self._light(_leaf_middles(petioles[rows], blueprint.leaves.size[rows]))
                self._batches[key].update(MORE, outward[rows])
            else:
                continue
            self._batches[key].update(SHARE, share)

    def single_out(self, view: View, height: int) -> None:
        """
        Draw the leaves near the camera singly, all others as clusters.

        :param view: of the camera.
        :param height: of the picture [px].
        """
        scale = height / (2.0 * np.tan(np.radians(view.angle) / 2.0))  # [px] at 1 m of 1 m
        for key, poses in self._petioles.items():
            clusters, pattern = self._batches[key], look(key[1]).pattern
            if pattern not in texture.CLUSTERS:
                continue
            count, length = texture.CLUSTERS[pattern][0], texture.CLUSTERS[pattern][3]
            size = clusters.lengths
            away = np.linalg.norm(_leaf_middles(poses, size) - view.eye, axis=1)
            near = np.flatnonzero(scale * length * size > SINGLE * away)
            near = np.sort(near[np.argsort(away[near], kind='stable')[:_MOST_BLADES // count]])
            own = 'spray', key[1]
            if not len(near) and own not in self._batches:
                continue
            self._batch(own, Kind.SPRAY, key[1]).show(clusters, near, poses[near])
            hidden = poses.copy()
            hidden[near] = np.nan
            clusters.move(hidden)

    def _append(self, blueprint: Blueprint, poses: np.ndarray, petioles: np.ndarray) -> None:
        """Make pieces of new parts, leaves, triangles and bonds."""
        self._append_parts(blueprint, poses)
        self._append_leaves(blueprint, poses, petioles)
        self._append_triangles(blueprint, poses)
        if self._bonds < len(blueprint.bonds):
            self._append_joints(blueprint, poses)

    def _append_parts(self, blueprint: Blueprint, poses: np.ndarray) -> None:
        new = np.arange(self._parts, len(blueprint))
        if not len(new):
            return
        self._parts = len(blueprint)
        ball = blueprint.balls[new]
        capsule = blueprint.shape[new] == Shape.CAPSULE
        along, stem = _paths(blueprint)
        first = first_pieces(blueprint)
        grain = 40.0 * np.random.default_rng(0).random(self._parts)[first]
        solids = blueprint.hexahedra.take(blueprint.hexahedra.part >= new[0])
        box = ~capsule
        box[solids.part - new[0]] = False
        corners = np.zeros((self._parts, 24 * bool(len(solids))))
        if len(solids):
            corners[solids.part] = solids.corners
        kinds = ((Kind.BALL, ball), (Kind.BRANCH, capsule & ~ball), (Kind.BOX, box),
                 (Kind.HEXAHEDRON, ~capsule & ~box))
        for kind, chosen in kinds:
            size = blueprint.size if kind is Kind.BALL else blueprint.visual_size
            offset = along if kind is Kind.BRANCH else grain
            alike = stem if kind is Kind.BRANCH else first
            for name, rows in _by_texture(blueprint, new[chosen], blueprint.texture):
                share = (self._light_along(poses[rows], size[rows, 2]) if kind is Kind.BRANCH
                         else self._light(poses[rows, :3]))
                self._add(('part', kind, name), kind, name, rows, size[rows], share, offset[rows],
                          corners[rows] if kind is Kind.HEXAHEDRON else None, alike[rows])

    def _append_leaves(self, blueprint: Blueprint, poses: np.ndarray,
                       petioles: np.ndarray) -> None:
        leaves = blueprint.leaves
        new = np.arange(self._leaves, len(leaves))
        if not len(new):
            return
        self._leaves = len(leaves)
        outward = _outward(blueprint)
        for name, rows in _by_texture(blueprint, new, leaves.texture):
            size = leaves.size[rows, None] * [1.0, 0.0, 0.0] + [0.0, look(name).aspect, 1.0]
            self._add(('leaf', name), Kind.LEAF, name, rows, size,
                      self._light(_leaf_middles(petioles[rows], leaves.size[rows])),
                      more=outward[rows])

    def _append_triangles(self, blueprint: Blueprint, poses: np.ndarray) -> None:
        ornaments = blueprint.ornaments
        new = np.arange(self._triangles, len(ornaments))
        self._triangles = len(ornaments)
        new = new[~blueprint.balls[ornaments.part[new]]]
        for name, rows in _by_texture(blueprint, new, ornaments.texture):
            self._add(('triangle', name), Kind.TRIANGLE, name, rows, 1.0,
                      self._light(poses[ornaments.part[rows], :3]), more=ornaments.triangle[rows])

    def _append_joints(self, blueprint: Blueprint, poses: np.ndarray) -> None:
        seats = joints.seats(blueprint, self._bonds)
        key = ('joint', self._bonds)
        fill = closers(blueprint, seats, self._bonds)
        self._bonds = len(blueprint.bonds)
        self._append_closers(blueprint, fill, poses)
        if not len(seats.bond):
            return
        self._seats.append((key, seats))
        self._batch(key, Kind.JOINT, joints.mortar_of(blueprint)).append(
            seats.bond, seats.size, self._light(poses[seats.first, :3]))
        self._last = np.full((0, 7), np.nan)

    def _append_closers(self, blueprint: Blueprint, fill: Closers, poses: np.ndarray) -> None:
        for name, rows in fill.by_texture(blueprint):
            key = 'closer', name, self._bonds
            mine, first = fill.take(rows), fill.first[rows]
            self._closers.append((key, mine))
            self._batch(key, Kind.HEXAHEDRON, name).append(
                first, 1.0, self._light(poses[first, :3]), more=mine.corners)
        self._last = np.full((0, 7), np.nan)

    def _batch(self, key: tuple, kind: Kind, name: str) -> Batch:
        """Return a batch of a texture, which is created if there is none."""
        if key not in self._batches:
            self._batches[key] = Batch(self._context, self._programs, kind, look(name))
        return self._batches[key]

    def _add(self, key: tuple, kind: Kind, name: str, rows: np.ndarray,
             size: np.ndarray | float, share: np.ndarray, offset: np.ndarray | float = 0.0,
             more: np.ndarray | None = None, first: np.ndarray | None = None) -> None:
        """
        Add pieces to a batch, see `Batch.append`.

        :param first: row that determines the colour of each, (K,); None = its own.
        """
        self._rows[key] = np.append(self._rows.get(key, np.zeros(0, int)), rows)
        self._batch(key, kind, name).append(rows if first is None else first, size, share, offset,
                                            more)

    def _light(self, places: np.ndarray) -> np.ndarray:
        """Return the shares of sun and sky light that leaves transmit to points, (K, 2)."""
        places = np.nan_to_num(places)
        return np.column_stack([self._sun.light(places), self._skylight(places)])

    def _skylight(self, places: np.ndarray) -> np.ndarray:
        return np.mean([shade.light(places) for shade in self._sky], axis=0)

    def _light_along(self, poses: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Return the shares of sky light at both ends of branches, (K, 2), for smooth shading."""
        half = rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 0.5])) * length[:, None]
        return np.column_stack([self._skylight(np.nan_to_num(poses[:, :3] + side * half))
                                for side in (-1.0, 1.0)])

    def _move_torn(self, blueprint: Blueprint, poses: np.ndarray) -> None:
        """Cover the ends of broken branches, and hide those of whole ones."""
        assert self._wood is not None
        apart = self._wood.apart(poses)
        known = [bonds for _, bonds in self._torn.values()]
        for bond in np.setdiff1d(apart, np.concatenate(known) if known else apart[:0]).tolist():
            for name, part, corners in self._wood.ends(bond):
                self._append_torn(name, part, bond, corners, poses)
        self._open_torn(apart, poses)
        frames = np.concatenate([poses, rotation.ORIGIN[None]])
        for name, (parts, bonds) in self._torn.items():
            there = np.isin(bonds, apart)[:, None]
            self._batches['torn', name].move(np.where(there, frames[parts], np.nan))

    def _open_torn(self, apart: np.ndarray, poses: np.ndarray) -> None:
        """Enlarge roots and pits while they leave the ground, so that they do not pop up."""
        assert self._wood is not None
        for bond, now in zip(apart.tolist(), self._wood.opened(apart, poses).tolist()):
            if self._opened.get(bond, 1.0) == now:
                continue
            self._opened[bond] = now
            for name, part, corners in self._wood.ends(bond, now):
                parts, bonds = self._torn[name]
                self._batches['torn', name].update(
                    MORE, corners, (parts == part) & (bonds == bond))

    def _append_torn(self, name: str, part: int, bond: int, corners: np.ndarray,
                     poses: np.ndarray) -> None:
        count, nothing = len(corners), np.zeros(0, int)
        parts, bonds = self._torn.get(name, (nothing, nothing))
        self._torn[name] = (np.append(parts, np.full(count, part)),
                            np.append(bonds, np.full(count, bond)))
        place = corners[:, :3] if part == GROUND else np.tile(poses[part, :3], (count, 1))
        self._batch(('torn', name), Kind.TRIANGLE, name).append(
            np.full(count, bond), 1.0, self._light(place), more=corners)

    def _move_joints(self, poses: np.ndarray) -> None:
        """Move the mortar between parts that have moved."""
        moved = np.ones(len(poses), bool)
        known = len(self._last)
        moved[:known] = (poses[:known] != self._last).any(axis=1)
        if known:
            moved[:known] &= ~(np.isnan(poses[:known, 0]) & np.isnan(self._last[:, 0]))
        self._last = poses
        shown = np.isfinite(poses[:, 0])
        for key, seats in self._seats:
            rows = np.flatnonzero(moved[seats.first] | moved[seats.second])
            if len(rows):
                self._batches[key].move(seats.boxes(poses, shown, rows), rows)
        for key, fill in self._closers:
            if (moved[fill.first] | moved[fill.second]).any():
                self._batches[key].move(fill.poses(poses, shown))

    def _mark_cracks(self, cracked: np.ndarray) -> None:
        """Darken the mortar of cracked joints."""
        if len(cracked) == self._cracks:
            return
        self._cracks = len(cracked)
        dark = np.zeros(self._bonds, bool)
        dark[cracked] = True
        for key, seats in self._seats:
            rows = np.flatnonzero(dark[seats.bond])
            if len(rows):
                batch = self._batches[key]
                batch.update(TONE, _CRACK_TONE * batch.tones(seats.bond[rows]), rows)


def _by_texture(blueprint: Blueprint, rows: np.ndarray,
                texture: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Group rows by the names of their textures."""
    for index in np.unique(texture[rows]):
        name = blueprint.textures[index] if blueprint.textures else ''
        yield name, rows[texture[rows] == index]


def _paths(blueprint: Blueprint) -> tuple[np.ndarray, np.ndarray]:
    """Return path lengths from the roots to the middles of branches [m], and the roots, (N,)."""
    hinged = blueprint.bonds[blueprint.bond_law == Law.HINGE]
    hinged = hinged[hinged[:, 0] != GROUND]
    length = blueprint.visual_size[:, 2]
    parent = np.arange(len(blueprint))
    way = np.zeros(len(blueprint))
    parent[hinged[:, 1]] = hinged[:, 0]
    way[hinged[:, 1]] = 0.5 * (length[hinged[:, 0]] + length[hinged[:, 1]])
    while (parent != parent[parent]).any():
        way += way[parent]
        parent = parent[parent]
    return way, parent


def _outward(blueprint: Blueprint) -> np.ndarray:
    """Return unit vectors out of the crown at leaves, in their frames, (L, 3)."""
    leaves = blueprint.leaves
    held = blueprint.bonds[blueprint.bonds[:, 0] != GROUND]
    crowns = light.crown_middles(blueprint.poses[:, :3], held, leaves.part)
    rest = rotation.compose(blueprint.poses[leaves.part], leaves.pose)
    outward = _leaf_middles(rest, leaves.size) - crowns[leaves.part]
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    return rotation.rotate(rotation.conjugate(rest[:, 3:]), outward)


def _leaf_middles(petioles: np.ndarray, size: np.ndarray) -> np.ndarray:
    along = rotation.rotate(petioles[:, 3:], np.array([0.0, 0.0, 1.0]))
    return petioles[:, :3] + 0.5 * size[:, None] * along


def _shades(moment: Moment, towards: np.ndarray) -> list[light.Shade]:
    """Compute the shade of the leaves for light from some directions, (D, 3)."""
    leaves = moment.blueprint.leaves
    petioles = moment.petioles()
    there = moment.shown()[leaves.part] & np.isfinite(petioles[:, 0])
    middles = _leaf_middles(petioles[there], leaves.size[there])
    area = _LEAF_SHARE * leaves.size[there] ** 2
    return [light.Shade(middles, area, one) for one in towards]
