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

"""Putting bodies into a world."""

import numpy as np

from procphys_ros.blueprint import box_inertia, cylinder_inertia, Shape
from procphys_ros.physics.world import compound
from procphys_ros.physics.world.bodies import State
from procphys_ros.physics.world.driven import MASS
from procphys_ros.physics.world.merging import merge_boxes, TOOTHING
from procphys_ros.physics.world.pieces import Pieces, single
from procphys_ros.physics.world.registry import FILTERS, FRICTION, Registry
from procphys_ros.physics.world.teeth import corners_out


class Population(Registry):
    """Bodies over the ground, and all the kinds that can be added."""

    def add_body(self, shape: int, size: np.ndarray, mass: float, pose: np.ndarray,
                 velocity: np.ndarray | None = None, inertia: np.ndarray | None = None,
                 friction: float = FRICTION, restitution: float = 0.0) -> int:
        """
        Add one loose box or capsule (a capsule no longer than wide is a sphere).

        :param size: as in `Blueprint.size` [m], (3,).
        :param mass: [kg].
        :param pose: of its centre of mass, (7,).
        :param velocity: world axes, (6,); None = at rest.
        :param inertia: principal moments in its axes [kg·m²], (3,); None = of a solid.
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind; against the ground its root.
        """
        size, pose = np.asarray(size, float), np.asarray(pose, float)
        outline = (self._engine.box(size) if shape == Shape.BOX
                   else self._engine.capsule(float(size[0]), float(size[2])))
        body = self._engine.add_same(outline, pose[None, :3], pose[3:])[0]
        if inertia is None:
            inertia = solid_inertia(shape, size, mass)
        self._enter_loose(body, mass, inertia, single(shape, size), pose)
        self._bodies.least[body] = size.min()
        self._engine.set_surface(body, friction, restitution)
        self._start(body, velocity)
        return body

    def add_fragment(self, shapes: np.ndarray, sizes: np.ndarray, local_poses: np.ndarray,
                     mass: float, inertia: np.ndarray, pose: np.ndarray,
                     velocity: np.ndarray | None = None, friction: float = FRICTION,
                     restitution: float = 0.0, tolerance: float = TOOTHING) -> int:
        """
        Add a loose rigid body made of boxes and capsules; `assembly.rigid_sum` gives the values.

        :param shapes: `Shape` of each part, (P,).
        :param sizes: as in `Blueprint.size` [m], (P, 3).
        :param local_poses: of the parts in the principal frame, (P, 7).
        :param mass: [kg].
        :param inertia: principal moments [kg·m²], (3,).
        :param pose: of centre of mass and principal axes in the world, (7,).
        :param velocity: world axes, (6,); None = at rest.
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind.
        :param tolerance: how far ends may be apart that `merge_boxes` makes one [m].
        """
        pieces = _merged(Pieces(np.asarray(shapes, np.int64), np.asarray(sizes, float),
                                np.asarray(local_poses, float)), tolerance)
        body = self._engine.add_compound(compound.describe(mass, inertia, pieces), pose)
        self._enter_loose(body, mass, inertia, pieces, pose)
        self._engine.set_surface(body, friction, restitution)
        self._start(body, velocity)
        return body

    def add_bricks(self, poses: np.ndarray, sizes: np.ndarray, mass: np.ndarray,
                   friction: float = FRICTION, restitution: float = 0.0) -> np.ndarray:
        """
        Add boxes that stand still until they are thawed.

        :param poses: (K, 7).
        :param sizes: full extents [m], (K, 3).
        :param mass: [kg], (K,).
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind.
        :returns: ids, (K,).
        """
        ids = np.empty(len(poses), np.intp)
        keys = np.round(np.column_stack([sizes, poses[:, 3:]]), 6)
        _, kind = np.unique(keys, axis=0, return_inverse=True)
        order = np.argsort(kind, kind='stable')
        for same in np.split(order, np.flatnonzero(np.diff(kind[order])) + 1):
            ids[same] = self._engine.add_same(self._engine.box(sizes[same[0]]),
                                              poses[same, :3], poses[same[0], 3:])
        self._bodies.enter(ids, State.LOOSE, mass, box_inertia(np.asarray(mass), sizes),
                           0.5 * np.linalg.norm(sizes, axis=1), sizes.min(axis=1), poses)
        for body, size in zip(ids.tolist(), sizes):
            self._pieces[body] = single(Shape.BOX, size)
            self._engine.set_surface(body, friction, restitution)
        self._hold(ids, State.HELD)
        return ids

    def add_projectile(self, shape: int, size: np.ndarray, mass: float, pose: np.ndarray,
                       velocity: np.ndarray, friction: float = FRICTION,
                       restitution: float = 0.3) -> int:
        """Add a loose body that flies without numerical drag; see `add_body`."""
        body = self.add_body(shape, size, mass, pose, velocity, friction=friction,
                             restitution=restitution)
        self._engine.set_free_of_drag(body)
        return body

    def add_driven(self, shape: int, size: np.ndarray, pose: np.ndarray,
                   friction: float = FRICTION) -> int:
        """
        Add a body that goes where `drive` says, whatever is in its way but the fixed.

        :param size: as in `Blueprint.size` [m], (3,).
        :param pose: (7,).
        :param friction: against a body of the same kind.
        """
        body = self.add_projectile(shape, size, MASS, pose, np.zeros(6), friction, 0.0)
        self._bodies.state[body] = State.DRIVEN
        self._engine.set_filter(body, *FILTERS[State.DRIVEN])
        self._courses.enter(body, pose)
        return body


def solid_inertia(shape: int, size: np.ndarray, mass: float) -> np.ndarray:
    """
    Give the principal moments of a solid box, cylinder or sphere [kg·m²], (3,).

    :param size: as in `Blueprint.size` [m], (3,).
    :param mass: [kg].
    """
    if shape == Shape.BOX:
        return box_inertia(np.array([mass]), np.asarray(size)[None])[0]
    if size[2] <= size[0]:
        return np.full(3, 0.1 * mass * size[0] ** 2)
    return cylinder_inertia(np.array([mass]), np.array([size[0]]), np.array([size[2]]))[0]


def _merged(pieces: Pieces, tolerance: float) -> Pieces:
    """Join boxes where they lie end to end; capsules stay as they are."""
    box = pieces.shapes == Shape.BOX
    if np.count_nonzero(box) < 2:
        return pieces
    poses, sizes = merge_boxes(pieces.local_poses[box], pieces.sizes[box], tolerance)
    return Pieces(np.concatenate([np.full(len(poses), Shape.BOX, np.int64), pieces.shapes[~box]]),
                  np.concatenate([sizes, pieces.sizes[~box]]),
                  np.concatenate([poses, pieces.local_poses[~box]]),
                  corners_out(pieces.local_poses[box], pieces.sizes[box], poses, sizes))
