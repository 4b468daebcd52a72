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

"""Bodies: what is known of each body, as columns whose row is the body's id."""

from enum import IntEnum

import numpy as np


class State(IntEnum):
    """What a body is doing."""

    GONE = 0      # no such body
    GROUND = 1    # the plane z = 0
    HELD = 2      # immovable until it is thawed by a command: a standing brick
    RESTING = 3   # debris that came to rest: immovable until it is hit or loses its support
    LOOSE = 4     # moves freely
    DRIVEN = 5    # follows a prescribed motion and pushes what is in its way


class Bodies:
    """
    Columns that grow with the largest id.

    :ivar state: `State`, (B,) uint8.
    :ivar mass: [kg], also while held, (B,).
    :ivar inertia: principal moments in the body's axes [kg·m²], (B, 3).
    :ivar radius: of the bounding sphere about the centre of mass [m], (B,).
    :ivar least: least extent of a plain body [m], 0 for compounds, (B,).
    :ivar swept: whether its moves are swept against what stands in between, (B,) bool.
    :ivar toothed: whether it has corners that only the ground meets, (B,) bool.
    :ivar poses: centre of mass and attitude, world axes, (B, 7).
    :ivar velocities: linear and angular, world axes, (B, 6).
    :ivar quiet: how long the body has been slow [s], (B,).
    :ivar mark: pose in which it began to be slow, (B, 7).
    :ivar anchor: pose that the body has stayed near, (B, 7).
    :ivar stay: how long it has [s], (B,).
    :ivar bounds: axis-aligned bounds of bodies at rest [m], (B, 6).
    """

    _WIDTHS = {'mass': 0, 'inertia': 3, 'radius': 0, 'least': 0, 'poses': 7, 'velocities': 6,
               'quiet': 0, 'mark': 7, 'anchor': 7, 'stay': 0, 'bounds': 6}

    mass: np.ndarray
    inertia: np.ndarray
    radius: np.ndarray
    least: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    quiet: np.ndarray
    mark: np.ndarray
    anchor: np.ndarray
    stay: np.ndarray
    bounds: np.ndarray

    def __init__(self) -> None:
        self.state = np.zeros(0, np.uint8)
        self.swept = np.zeros(0, bool)
        self.toothed = np.zeros(0, bool)
        for name, width in self._WIDTHS.items():
            setattr(self, name, np.zeros((0, width) if width else 0))

    def enter(self, ids: np.ndarray, state: State, mass: np.ndarray | float,
              inertia: np.ndarray, radius: np.ndarray | float, least: np.ndarray | float,
              poses: np.ndarray) -> None:
        """Fill the rows of new bodies, at rest; see the class for the columns."""
        self._reserve(int(np.max(ids)) + 1)
        self.state[ids] = state
        self.mass[ids] = mass
        self.inertia[ids] = inertia
        self.radius[ids] = radius
        self.least[ids] = least
        self.swept[ids] = False
        self.toothed[ids] = False
        self.poses[ids] = poses
        self.velocities[ids] = 0.0
        self.restart(ids, 0.0)

    def restart(self, ids: np.ndarray, stay: float) -> None:
        """Start the clocks that tell when bodies have come to rest, see `stay` [s]."""
        self.quiet[ids] = 0.0
        self.stay[ids] = stay
        self.mark[ids] = self.anchor[ids] = self.poses[ids]

    def _reserve(self, count: int) -> None:
        size = len(self.state)
        if count <= size:
            return
        more = max(count, 2 * size) - size
        self.state = np.concatenate([self.state, np.zeros(more, np.uint8)])
        self.swept = np.concatenate([self.swept, np.zeros(more, bool)])
        self.toothed = np.concatenate([self.toothed, np.zeros(more, bool)])
        for name in self._WIDTHS:
            column = getattr(self, name)
            setattr(self, name, np.concatenate(
                [column, np.zeros((more, *column.shape[1:]))]))
