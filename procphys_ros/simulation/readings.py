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


"""Readings: what can be read of a simulation at a moment."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.foliage import Flutter
from procphys_ros.physics.wind import Wind
from procphys_ros.scene import SceneObject
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.simulation import foliage, intruder, part_loads
from procphys_ros.simulation.events import EventLog
from procphys_ros.simulation.ledger import Impact, MomentumLedger
from procphys_ros.simulation.lidar import Scan, scan
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.naming import PartNames
from procphys_ros.simulation.part_loads import PartLoad
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State


class Readings:
    """
    Read access to a simulation at its present time; reading changes nothing.

    Arrays are copies: later steps do not change them, and they are read-only.

    :ivar model: the compiled scene; constant.
    :ivar state: everything that changes.
    """

    model: Model
    state: State
    _flutter: Flutter | None = None

    @property
    def time_step(self) -> float:
        """Length of a step [s]."""
        return self.model.time_step

    @property
    def time(self) -> float:
        """Return the simulated time [s]."""
        return self.state.time

    @property
    def blueprint(self) -> Blueprint:
        """All parts and bonds, in the order of every array; parts that join are appended."""
        return self.state.blueprint

    @property
    def objects(self) -> list[SceneObject]:
        """Owners of the parts, in part order."""
        return list(self.state.objects)

    @property
    def names(self) -> PartNames:
        """Names of the parts."""
        return self.state.names

    @property
    def poses(self) -> np.ndarray:
        """
        Centres of mass and attitudes, world, (N, 7); NaN = the part is gone.

        They are the present ones, and read-only: `set_body_state` moves loose parts. Stages use
        `state.parts.poses`, which the next step overwrites.
        """
        return _value(self.state.shown_poses())

    @property
    def velocities(self) -> np.ndarray:
        """Linear and angular velocities [m/s], [rad/s], world, (N, 6), as `poses`."""
        return _value(self.state.parts.velocities)

    @property
    def exists(self) -> np.ndarray:
        """Parts that were neither pulverised nor broken into new ones, (N,) bool."""
        return self.state.parts.owner != Owner.GONE

    @property
    def added(self) -> tuple[str, ...]:
        """Names of the objects that were added and not removed."""
        return tuple(self.state.added)

    @property
    def removed(self) -> tuple[str, ...]:
        """Names of the objects that were removed; their parts no longer exist."""
        return tuple(self.state.removed)

    @property
    def wind(self) -> Wind:
        """Return the wind."""
        return self.state.wind

    @property
    def log(self) -> EventLog:
        """Break events not taken yet."""
        return self.state.log

    @property
    def events(self) -> np.ndarray:
        """Broken bonds not taken from `log` yet, of dtype `EVENT`, (K,)."""
        return _value(self.state.log.rows)

    @property
    def bonds_broken(self) -> int:
        """Return the number of bonds broken since the start or the last reset."""
        return self.state.log.total

    @property
    def awake_bodies(self) -> int:
        """Return the number of loose bodies that are moving."""
        return len(self.state.world.awake)

    @property
    def impacts(self) -> list[Impact]:
        """List the last blows of projectiles to standing parts, oldest first."""
        return list(self.state.ledger.recent)

    @property
    def ledger(self) -> MomentumLedger:
        """Return the momentum balance of all blows since the start or the last reset."""
        return self.state.ledger

    @property
    def dust(self) -> Puffs:
        """Return the dust in the air and on the ground."""
        cloud = self.state.dust.cloud
        return Puffs.none() if cloud is None else cloud.puffs

    @property
    def intruder_pose(self) -> np.ndarray | None:
        """Pose of the intruder, (7,), world; None before it is placed."""
        return self.pose_of_intruder(INTRUDER)

    @property
    def intruder_wrench(self) -> np.ndarray:
        """Force and moment on the intruder in the last step [N], [N·m], world, (6,)."""
        return _value(self.state.intruders[INTRUDER].wrench)

    @property
    def intruders(self) -> tuple[str, ...]:
        """Names of all externally moved bodies."""
        return tuple(self.state.intruders)

    def pose_of_intruder(self, name: str) -> np.ndarray | None:
        """Return the pose of an intruder, (7,), world; None before it is placed."""
        path = intruder.named(self.state, name).path
        return _value(path.pose) if path.placed else None

    def wrench_on_intruder(self, name: str) -> np.ndarray:
        """Return force and moment on an intruder [N], [N·m], world, smoothed, (6,)."""
        return _value(intruder.named(self.state, name).smooth_wrench)

    def load(self, part: int | str) -> PartLoad:
        """
        Return the joint load of a part, and its share of the strength.

        :param part: its name or index.
        :returns: zeros for loose or gone parts; NaN for trees before their first step.
        :raises CommandError: if there is no such part.
        """
        return part_loads.load_of(self.state, self.names.index(part))

    def loads(self, parts: Sequence[int | str] | None = None) -> np.ndarray:
        """
        Return the loads of many parts, as `load` for one.

        :param parts: names or indices, (K,); None = all.
        :returns: force [N], moment [N·m] and share of the strength, (K, 3).
        :raises CommandError: if there is no such part.
        """
        return part_loads.loads_of(self.state, self.names.indices(parts))

    def scan(self, lidar: LidarSettings) -> Scan | None:
        """
        Measure ranges like a lidar or a depth camera.

        :param lidar: its rays and pose.
        :returns: None if it is attached to an intruder that is not placed yet.
        """
        return scan(self.model, self.state, lidar)

    def leaf_poses(self) -> np.ndarray:
        """Compute the poses of all petioles, fluttering, flying or fallen, world, (L, 7)."""
        if self._flutter is None and self.model.settings.leaves.flutter:
            self._flutter = foliage.make_flutter(self.model)
        return foliage.poses(self.model, self.state, self._flutter)


def _value(array: np.ndarray) -> np.ndarray:
    """Return a read-only copy of an array that a later step may overwrite."""
    copied = array.copy()
    copied.flags.writeable = False
    return copied
