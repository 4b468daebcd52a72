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


"""Source: what a page shows, and where it sends commands."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from procphys_ros.appearance.joints import Seats, seats
from procphys_ros.appearance.paving import Paving
from procphys_ros.appearance.torn_wood import Wood, WoodJoints
from procphys_ros.blueprint import Blueprint, Hexahedra, Leaves
from procphys_ros.blueprint.cut_bricks import first_pieces
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.terrain import FLAT, Terrain

_NAMED = 3  # objects listed in a line


@dataclass(frozen=True)
class PageContent:
    """
    The parts of a scene; later contents of the same scene only append rows.

    :ivar scene: number of the scene; another number means an unrelated scene.
    :ivar name: returns the name of a part by its index.
    :ivar shape: `Shape` of each part, (N,).
    :ivar size: drawn extents [m], (N, 3), as `Blueprint.visual_size`; balls have three diameters.
    :ivar mass: [kg], (N,).
    :ivar ball: parts that are balls, (N,) bool.
    :ivar texture: index into `textures`, (N,).
    :ivar material: returns the material's name by the index of a part.
    :ivar textures: names.
    :ivar leaves: leaves on the parts.
    :ivar first_piece: first piece of the brick that a part was cut from, (N,).
    :ivar hexahedra: corners of non-rectangular boxes.
    :ivar terrain: the surface of the ground.
    :ivar paving: of the ground.
    :ivar wood: joints where trees have broken; None = not known.
    :ivar mortar: seats of mortar between parts; None = not known.
    """

    scene: int
    name: Callable[[int], str]
    shape: np.ndarray
    size: np.ndarray
    mass: np.ndarray
    ball: np.ndarray
    texture: np.ndarray
    material: Callable[[int], str]
    textures: Sequence[str]
    leaves: Leaves
    first_piece: np.ndarray
    hexahedra: Hexahedra = field(default_factory=Hexahedra)
    terrain: Terrain = FLAT
    paving: Sequence[Paving] = ()
    wood: Wood | None = None
    mortar: Seats | None = None

    def __len__(self) -> int:
        return len(self.shape)

    @classmethod
    def of(cls, blueprint: Blueprint, name: Callable[[int], str], scene: int,
           terrain: Terrain = FLAT, paving: Sequence[Paving] = (),
           before: 'PageContent | None' = None) -> 'PageContent':
        """
        Describe a blueprint.

        :param blueprint: parts and leaves.
        :param name: returns the name of a part by its index.
        :param scene: number of the scene.
        :param terrain: the surface of the ground.
        :param paving: of the ground.
        :param before: an earlier content of the same scene, with the same bonds.
        """
        ball = blueprint.balls
        return cls(scene, name, blueprint.shape,
                   np.where(ball[:, None], blueprint.size, blueprint.visual_size),
                   blueprint.mass, ball, blueprint.texture,
                   lambda part: blueprint.materials[blueprint.material[part]],
                   blueprint.textures, blueprint.leaves, first_pieces(blueprint),
                   blueprint.hexahedra, terrain, paving, WoodJoints(blueprint),
                   seats(blueprint) if before is None else before.mortar)


@dataclass(frozen=True)
class Frame:
    """
    The state of a scene at one moment.

    :ivar content: parts of the scene.
    :ivar poses: of its parts, world, (N, 7); NaN = the part is gone.
    :ivar leaf_poses: petioles of its leaves, world, (L, 7).
    :ivar dust: puffs in the air.
    :ivar broken: parts of the broken bonds, in pairs, oldest first, (K, 2); -1 = ground.
    """

    content: PageContent
    poses: np.ndarray
    leaf_poses: np.ndarray
    dust: Puffs = field(default_factory=Puffs.none)
    broken: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))


@dataclass(frozen=True)
class Status:
    """
    The status of a source.

    :ivar alive: whether it answers.
    :ivar text: one line about it.
    :ivar time: simulated time [s].
    :ivar paused: whether the simulation is paused.
    :ivar factor: requested real-time factor; 0 = as fast as possible.
    :ivar wind: mean wind at the reference height [m/s], (3,).
    :ivar scene: name of the running scene, or of its objects.
    """

    alive: bool = False
    text: str = ''
    time: float = 0.0
    paused: bool = False
    factor: float = 1.0
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scene: str = ''


def shortened(names: Iterable[str]) -> str:
    """List the objects of a scene in a line, only the first if there are many."""
    known = list(names)
    return ', '.join([*known[:_NAMED], *['…'] * (len(known) > _NAMED)]) or 'an empty scene'


class Source(Protocol):
    """
    A running scene: a simulation of this process, or a node.

    :ivar watched: set by the page: whether it has viewers, so that frames are needed.
    :ivar can_undo: whether it supports `Undo`.
    """

    watched: bool
    can_undo: bool

    def frame(self) -> Frame | None:
        """Return the newest frame, the same object while nothing has changed."""

    def status(self) -> Status:
        """Return the status."""

    def say(self, command: Any) -> None:
        """
        Queue a command for execution; return at once.

        :param command: of `view.commands`, or a `SetWind`, `Impulse`, `Projectile`, `Explosion`
            or `Cut`.
        """

    def answer(self) -> str:
        """Return the answer to the last executed or refused command."""

    def close(self) -> None:
        """Close the source."""
