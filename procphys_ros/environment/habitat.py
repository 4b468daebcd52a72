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

"""Habitat: answers to what growing plants ask of their place and of each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from procphys_ros.blueprint import Blueprint, chain, Shape
from procphys_ros.environment.nearest import nearest_boxes, nearest_others
from procphys_ros.environment.questions import Plant, Question, STORM
from procphys_ros.environment.sky import above_horizon, CELL, Cells, sky_directions
from procphys_ros.environment.statics import load, sag
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.gravity import GRAVITY
from procphys_ros.physics.terrain import FLAT, Terrain

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Habitat:
    """
    What plants grow among.

    :ivar standing: what stands there, world: boxes are opaque, other plants shade by their leaves.
    :ivar terrain: the surface of the ground.
    :ivar wind: steady wind that bends plants while they grow [m/s], (3,), world.
    :ivar storm: speed of the strongest wind of their lives, from any side [m/s].
    :ivar gravity: [m/s²], downwards.
    :ivar threads: largest number of threads; answers do not depend on it.
    """

    standing: Blueprint = field(default_factory=Blueprint)
    terrain: Terrain = FLAT
    wind: np.ndarray = field(default_factory=lambda: np.zeros(3))
    storm: float = STORM
    gravity: float = GRAVITY
    threads: int = 1

    def answer(self, plants: Sequence[Plant]) -> list[dict[str, np.ndarray]]:
        """
        Answer the queries of plants that grow together.

        :returns: by plant and kind one row per query, (Q, 4), (Q, 2) or (Q, 3), see `KINDS`;
            vectors in the frame of the plant.
        """
        out: list[dict[str, np.ndarray]] = [{} for _ in plants]
        for kind, of_place in (('light', self._light), ('space', self._space),
                               ('neighbour', lambda plants, owner, points:
                                nearest_others(points))):
            if asking := _asking(plants, kind):
                owner = np.repeat([n for n, _ in asking], [len(q.points) for _, q in asking])
                points = np.concatenate([_in_world(plants[n].root, q.points) for n, q in asking])
                answers = of_place(plants, owner, points)
                for n, _ in asking:
                    own = answers[owner == n]
                    own[:, 1:] = rotation.rotate(rotation.conjugate(plants[n].root[3:]),
                                                 own[:, 1:])
                    out[n][kind] = own
        for kind in ('load', 'sag'):
            asking = _asking(plants, kind)
            borne = self._bear(kind, [plants[n] for n, _ in asking])
            for n, question in asking:
                if plants[n].built is not None:
                    out[n][kind] = next(borne)[question.segments]
        return out

    def _light(self, plants: Sequence[Plant], owner: np.ndarray,
               points: np.ndarray) -> np.ndarray:
        """Compute the share of the sky that is seen, and the mean direction of its light."""
        ways = sky_directions()
        clear = np.array([above_horizon(self.terrain, plant.root[:3], ways) for plant in plants])
        wood = [_wood(self.standing, self.standing.poses)]
        wood += [_wood(plant.built, rotation.compose(plant.root, plant.built.poses))
                 for plant in plants if plant.built is not None]
        solid = np.flatnonzero(self.standing.shape == Shape.BOX)
        cells = Cells.around(np.concatenate([points, *(places for places, _ in wood)]),
                             self.standing.poses[solid], self.standing.size[solid])
        for places, area in wood:
            cells.spread(places, area)
        cells.fill(self.standing.poses[solid], self.standing.size[solid])
        seen = cells.seen(points, ways, clear[owner], self.threads)
        total = seen.sum(axis=1)
        mean = (seen[:, :, None] * ways).sum(axis=1)
        size = norm(mean, axis=1, keepdims=True)
        mean = np.where(size > 1e-9, mean / np.maximum(size, 1e-9), _UP)
        return np.column_stack([total / len(ways), mean])

    def _space(self, plants: Sequence[Plant], owner: np.ndarray,
               points: np.ndarray) -> np.ndarray:
        """Find what stands nearest."""
        parts = np.arange(len(self.standing))
        round_ = self.standing.shape == Shape.CAPSULE
        size = self.standing.solid_size(parts)
        radius = np.where(round_, 0.5 * size[:, 0], 0.0)
        size = np.where(round_[:, None], np.maximum(size - 2.0 * radius[:, None], 0.0), size)
        return nearest_boxes(points, self.standing.poses, size, radius)

    def _bear(self, kind: str, plants: Sequence[Plant]) -> Iterator[np.ndarray]:
        """Solve the statics of those plants that have wood, each in its own frame."""
        built = [(plant.built, rotation.rotate(rotation.conjugate(plant.root[3:]), self.wind))
                 for plant in plants if plant.built is not None]
        if not built:
            return
        every, sizes = chain([wood for wood, _ in built]), [len(wood) for wood, _ in built]
        if kind == 'load':
            values = load(every, self.storm, self.gravity, self.threads)
        else:
            winds = np.repeat([wind for _, wind in built], sizes, axis=0)
            values = sag(every, winds, self.gravity, self.threads)
        yield from np.split(values, np.cumsum(sizes)[:-1])


def _asking(plants: Sequence[Plant], kind: str) -> list[tuple[int, Question]]:
    """List the plants that ask for a kind, with their questions."""
    return [(n, question) for n, plant in enumerate(plants) for question in plant.questions
            if question.kind == kind and len(question.points)]


def _in_world(root: np.ndarray, points: np.ndarray) -> np.ndarray:
    return root[:3] + rotation.rotate(root[3:], points)


def _wood(blueprint: Blueprint, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Spread the wood of plants along their segments, with polygons, and leaves where they are.

    A cylinder of any direction hides π/4 of the product of diameter and length on average, as
    much as twice that area of leaves.

    :returns: points [m], (K, 3), and the area at each [m²], (K,).
    """
    leaves = blueprint.leaves
    frames = rotation.compose(poses[leaves.part], leaves.pose)
    middles = frames[:, :3] + 0.5 * leaves.size[:, None] * rotation.rotate(frames[:, 3:], _UP)
    foliage = leaves.size * leaves.size
    rows = np.flatnonzero(blueprint.shape == Shape.CAPSULE)
    length = blueprint.visual_size[rows, 2]
    area = (blueprint.leaf_area - np.bincount(leaves.part, foliage, len(blueprint)))[rows]
    area = (np.maximum(area, 0.0)
            + 0.5 * np.pi * length * blueprint.visual_size[rows, :2].mean(axis=1))
    count = np.maximum(np.ceil(length / CELL), 1.0).astype(np.intp)
    row = np.repeat(np.arange(len(rows)), count)
    number = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    along = ((number + 0.5) / count[row] - 0.5) * length[row]
    axis = rotation.rotate(poses[rows, 3:], _UP)
    places = poses[rows[row], :3] + along[:, None] * axis[row]
    return np.concatenate([places, middles]), np.concatenate([(area / count)[row], foliage])
