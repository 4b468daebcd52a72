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

"""Protocol of rigid-body engines, and their selection."""

from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module, util
import logging
from typing import Protocol, runtime_checkable

import numpy as np

from procphys_ros.errors import nearest_names, SceneError
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.joint_table import JointTable

_LOG = logging.getLogger(__name__)

# Engines and the libraries that they need.
ENGINES = {'bullet': 'pybullet', 'native': 'numba'}
DEFAULT_ENGINE = 'auto'  # the first one that is installed

TERRAIN_MARGIN = 50.0  # [m] of ground beyond the grid of a terrain that bodies collide with

# Collision groups and masks: two bodies collide when the mask of each has the group of the other.
# Immovable bodies do not collide with each other, and kinematic bodies pass through them.
#                       awake immovable kinematic
#   awake (1)             x       x         x
#   immovable (2)         x       -         -      ground, fixed, resting
#   kinematic (4)         x       -         -
_AWAKE, _IMMOVABLE, _KINEMATIC = 1, 2, 4
COLLISION_FILTERS = {
    BodyState.AWAKE: (_AWAKE, _AWAKE | _IMMOVABLE | _KINEMATIC),
    BodyState.GROUND: (_IMMOVABLE, _AWAKE),
    BodyState.FIXED: (_IMMOVABLE, _AWAKE),
    BodyState.RESTING: (_IMMOVABLE, _AWAKE),
    BodyState.KINEMATIC: (_KINEMATIC, _AWAKE),
}


Looked = Callable[[np.ndarray, np.ndarray, np.ndarray, float], None]
"""Takes the contacts of a look, as `Engine.contacts` gives them but with the mean forces of this
look, which it may lower in place, poses (B, 7) and velocities (B, 6) of all bodies when it began,
and how long it was [s]. It may set velocities, and add, thaw and remove bodies."""


class Engine(Protocol):
    """
    Rigid-body engine that moves the bodies of a `BodyTable`, identified by their ids there.

    Except for caches, such as contact impulses for warm starting, an engine has no state that
    cannot be rebuilt from the table: after `clear` and `add` with all ids an engine continues
    from the table, deterministically.

    :ivar threads: largest number of threads; results do not depend on it, to the last bit.
    """

    name: str
    has_joints: bool
    threads: int

    def clear(self) -> None:
        """Remove all bodies."""

    def close(self) -> None:
        """Free the memory; the engine cannot be used afterwards."""

    def add(self, table: BodyTable, ids: np.ndarray) -> None:
        """Add bodies, (K,) ids, with the shapes, states, poses and velocities of the table."""

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies, (K,) ids."""

    def hand_on(self, former: np.ndarray, heirs: np.ndarray, bounds: np.ndarray) -> None:
        """Hand contacts of the last step on to bodies in the place of others; see `hand_on`."""

    def freeze(self, ids: np.ndarray) -> None:
        """Make bodies immovable, at no cost per step, (K,) ids."""

    def thaw(self, table: BodyTable, ids: np.ndarray) -> None:
        """Make immovable bodies movable, with masses and inertias of the table, (K,) ids."""

    def set_poses(self, ids: np.ndarray, poses: np.ndarray) -> None:
        """Set centres of mass and principal axes, world, (K, 7)."""

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set linear [m/s] and angular velocities [rad/s], world axes, (K, 6)."""

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Set the acceleration of awake bodies [m/s²], (3,)."""

    def set_excluded(self, pairs: np.ndarray, excluded: bool) -> None:
        """Exclude pairs of bodies from collision, or include them again, (K, 2) ids."""

    def set_joints(self, joints: JointTable) -> None:
        """Set the joints between bodies, if supported; the engine writes their state there."""

    def respond(self, change: np.ndarray) -> np.ndarray:
        """Return changes of velocity, by id, (B, 6), with what joints add, if supported."""

    def step(self, time_step: float, looked: Looked | None = None) -> None:
        """
        Advance time [s]; write poses and velocities of the table.

        :param looked: called each time the engine has found and solved contacts, once or several
            times in a step.
        """

    def contacts(self) -> np.ndarray:
        """
        Return the contact points of the last step; those without force may be left out.

        Contacts of bodies removed since are left out.

        :returns: (C, 13): two ids, point on the second, unit normal towards the first, distance,
            mean force of the step on the first in world axes [N], (3,), its normal part [N].
        """


@runtime_checkable
class SavableEngine(Engine, Protocol):
    """Engine that can be saved: it goes on as if it had never been."""

    def save(self) -> dict[str, np.ndarray]:
        """Copy what it keeps from step to step."""

    def restore(self, table: BodyTable, saved: Mapping[str, np.ndarray]) -> None:
        """Add bodies to an empty engine, with what `save` gave."""


def installed_engines() -> list[str]:
    """List the engines whose libraries are installed, the default first."""
    return [name for name, library in ENGINES.items() if util.find_spec(library)]


def make_engine(name: str, gravity: np.ndarray, terrain: Terrain = FLAT) -> Engine:
    """
    Create an engine.

    :param name: of `ENGINES`, or 'auto' for the first whose library is installed; a warning is
        logged once when that is not the first of all.
    :param gravity: acceleration of awake bodies [m/s²], (3,).
    :param terrain: the surface of the ground.
    :raises SceneError: when there is no such engine, or its library is not installed.
    """
    if name not in (DEFAULT_ENGINE, *ENGINES):
        raise SceneError(f'engine is "{name}"{nearest_names(name, ENGINES)} '
                         f'(known: {", ".join((DEFAULT_ENGINE, *ENGINES))})')
    found = installed_engines()
    if name == DEFAULT_ENGINE:
        name, first = found[0], next(iter(ENGINES))
        if name != first:
            _log_once(f'{ENGINES[first]} is not installed: engine is {name}')
    if name not in found:
        raise SceneError(f'engine is "{name}", but {ENGINES[name]} is not installed: pip install '
                         f'{ENGINES[name]}, or take one that is there: {", ".join(found)}')
    return _class_of(name)(gravity, terrain)


def _class_of(name: str) -> Callable[[np.ndarray, Terrain], Engine]:
    """Import the class of an engine on demand, as each takes time and memory."""
    module = import_module(f'procphys_ros.physics.world.{name}')
    return getattr(module, f'{name.capitalize()}Engine')


@cache
def _log_once(message: str) -> None:
    _LOG.warning(message)
