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


"""Objects of a running simulation as entities: where they are, what they are made of."""

from collections import Counter

import numpy as np

from procphys_ros.errors import CommandError, nearest_names
from procphys_ros.geometry import rotation
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import Owner


class Entities:
    """
    Read objects and parts of a simulation; in the simulation thread.

    :param simulation: in its present state.
    :ivar names: of its objects, including launched ones, without removed ones.
    """

    def __init__(self, simulation: Simulation):
        self._simulation = simulation
        removed = set(simulation.removed)
        self._objects = {o.name: range(o.first, o.first + o.count) for o in simulation.objects
                         if o.name not in removed}
        self.names = list(self._objects)

    def state(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """
        Return pose (7,) and twist (6,) of a part, or of the first remaining part of an object.

        :raises CommandError: if there is no such object or part, or nothing remains of it.
        """
        poses = self._simulation.poses
        for part in self._parts(name):
            if np.isfinite(poses[part, 0]):
                return poses[part], self._simulation.velocities[part]
        raise CommandError(f'nothing is left of {name}')

    def is_left(self, name: str) -> bool:
        """Return whether any part of an object remains."""
        return bool(np.isfinite(self._simulation.poses[self._parts(name), 0]).any())

    def movable(self, name: str) -> int:
        """
        Return the part by which an object, or a part, can be moved in one piece.

        :raises CommandError: if there is no such object or part, or it is in several pieces.
        """
        state, exists = self._simulation.state.parts, self._simulation.exists
        parts = [part for part in self._parts(name) if exists[part]]
        if not parts:
            raise CommandError(f'nothing is left of {name}')
        bodies = np.unique(state.body[parts])
        if len(bodies) > 1 and (state.owner[parts] == Owner.BODY).all():
            raise CommandError(f'{name} is in {len(bodies)} pieces; name a part of one, such as '
                               f'{self._simulation.names.name(parts[0])}')
        return parts[0]

    def kinds(self, name: str) -> list[str]:
        """List the kinds of parts of an object, such as brick and pane."""
        source = self._simulation.blueprint
        return [source.kinds[k] for k in np.unique(source.kind[self._parts(name)])]

    def describe(self, name: str) -> str:
        """Describe an object: the numbers of its parts by kind, and their mass."""
        source = self._simulation.blueprint
        parts = self._parts(name)
        counts = Counter(source.kinds[k] for k in source.kind[parts])
        content = ', '.join(f'{count} {kind}' for kind, count in counts.most_common())
        return f'{content}; {source.mass[parts].sum():.1f} kg'

    def bounds(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the corners of a box around an object, in the frame of its state [m], 2 of (3,).

        :raises CommandError: as `state`.
        """
        pose, _ = self.state(name)
        centre, reach = self._balls(name)
        own = rotation.rotate(rotation.conjugate(pose[3:]), centre - pose[:3])
        return (own - reach[:, None]).min(axis=0), (own + reach[:, None]).max(axis=0)

    def near(self, name: str, centre: np.ndarray, radius: float) -> bool:
        """Return whether the box around an object comes within a radius [m] of a point (3,)."""
        low, high = self._box(name)
        return bool(np.linalg.norm(np.clip(centre, low, high) - centre) <= radius)

    def overlaps(self, name: str, low: np.ndarray, high: np.ndarray) -> bool:
        """Return whether the box around an object overlaps a box between two corners [m], (3,)."""
        lower, upper = self._box(name)
        return bool(np.all(lower <= high) and np.all(upper >= low))

    def _box(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners of the box around the bounding spheres of remaining parts."""
        centre, reach = self._balls(name)
        low, high = centre - reach[:, None], centre + reach[:, None]
        return low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)

    def _balls(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return centres (K, 3) and radii (K,) of the bounding spheres of remaining parts."""
        parts = np.asarray(self._parts(name))
        centre = self._simulation.poses[parts, :3]
        there = np.isfinite(centre[:, 0])
        return centre[there], 0.5 * np.linalg.norm(
            self._simulation.blueprint.size[parts[there]], axis=1)

    def _parts(self, name: str) -> list[int]:
        if name in self._objects:
            return list(self._objects[name])
        if '/' in name:
            return [self._simulation.names.index(name)]
        raise CommandError(f'there is no entity "{name}"{nearest_names(name, self.names)}')
