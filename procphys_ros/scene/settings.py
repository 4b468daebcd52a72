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

"""Settings of the world that a scene stands in."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, MISSING
from typing import Any

from procphys_ros.blueprint import Shape
from procphys_ros.physics.gravity import GRAVITY
from procphys_ros.physics.ground_motion import GroundRecord
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.wind import Gust, Record, WindSettings
from procphys_ros.physics.wind.zones import MapRows
from procphys_ros.physics.world import DEFAULT_ENGINE, ENGINES, Pieces
from procphys_ros.physics.world.pieces import single
from procphys_ros.scene.cues import Cue, read_cues
from procphys_ros.scene.culling import CullingSettings
from procphys_ros.scene.earthquake import Earthquake, GroundSettings
from procphys_ros.scene.intruder import IntruderSettings
from procphys_ros.scene.intruders import INTRUDER, IntrudersSettings
from procphys_ros.scene.particles import DustSettings, LeafSettings
from procphys_ros.scene.scenery import CameraSettings, SkySettings, SunSettings
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.scene.terrain import TerrainSettings
from procphys_ros.scene.trees import TreeSettings
from procphys_ros.schema import declared, ParameterGroup
from procphys_ros.schema import parameters as declarations


@dataclass(frozen=True)
class Settings(ParameterGroup):
    """
    Settings of the whole scene.

    :ivar wind: mean wind and turbulence.
    :ivar wind_record: content of `wind.file`; () = there is none.
    :ivar wind_map: content of `wind.map`; () = there is none.
    :ivar gust: default values of gusts.
    :ivar cues: timed events.
    :ivar trees: whether their crowns touch.
    :ivar leaves: flutter and shedding.
    :ivar dust: of bursting mortar and impacts.
    :ivar culling: level of detail far from the observer.
    :ivar intruder: shape and size of a body moved from outside.
    :ivar intruders: further ones, by name.
    :ivar camera, sun, sky: of pictures and films.
    :ivar ground: settings of the ground.
    :ivar terrain: its surface, made from `ground`.
    :ivar motion: how it can move.
    :ivar ground_record: content of `motion`; () = earthquakes are synthetic.
    :ivar earthquake: default values of earthquakes.
    :ivar load: snow and ice that lie on it.
    """

    seed: int = declared(0, 'seed of everything random', '', 0, 2**62)
    time_step: float = declared(1.0 / 60.0, 'length of one simulation step', 's', 1e-4, 0.1)
    gravity: float = declared(GRAVITY, 'downward acceleration', 'm/s²', 0.0, 100.0)
    engine: str = declared(
        DEFAULT_ENGINE, 'library that moves rigid bodies; auto: the first that is installed',
        choices=(DEFAULT_ENGINE, *ENGINES))
    threads: int = declared(0, 'threads that compute trees, wind, leaves, stresses and markers; '
                            '0 = one per core, or NUMBA_NUM_THREADS; results do not depend on it',
                            '', 0, 1024)
    debris_bodies: int = declared(240, 'moving bodies aimed at: the more there are, the coarser '
                                  'is what breaks', '', 1, 100_000)
    wind: WindSettings = field(default_factory=WindSettings)
    wind_record: Record = ()
    wind_map: MapRows = ()
    gust: Gust = field(default_factory=Gust)
    cues: tuple[Cue, ...] = ()
    trees: TreeSettings = field(default_factory=TreeSettings)
    leaves: LeafSettings = field(default_factory=LeafSettings)
    dust: DustSettings = field(default_factory=DustSettings)
    culling: CullingSettings = field(default_factory=CullingSettings)
    intruder: IntruderSettings = field(default_factory=IntruderSettings)
    intruders: IntrudersSettings = field(default_factory=IntrudersSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    sun: SunSettings = field(default_factory=SunSettings)
    sky: SkySettings = field(default_factory=SkySettings)
    ground: TerrainSettings = field(default_factory=TerrainSettings)
    terrain: Terrain = field(default=FLAT, compare=False)
    motion: GroundSettings = field(default_factory=GroundSettings)
    ground_record: GroundRecord = ()
    earthquake: Earthquake = field(default_factory=Earthquake)
    load: SnowLoad = field(default_factory=SnowLoad)

    @property
    def saws(self) -> dict[str, float]:
        """Return how fast intruders saw, by name [m/s]; those that do only."""
        known = {INTRUDER: self.intruder.cuts, **dict(zip(self.intruders.names,
                                                          self.intruders.cuts))}
        return {name: speed for name, speed in known.items() if speed > 0.0}

    def intruder_pieces(self) -> dict[str, Pieces]:
        """
        Make the collision shapes of all intruders, by name.

        :raises SceneError: when the file of a mesh cannot be read.
        """
        shape = Shape.BOX if self.intruder.shape == 'box' else Shape.CAPSULE
        return {INTRUDER: single(shape, self.intruder.edges), **self.intruders.pieces()}


def read_settings(parameters: Mapping[str, Any]) -> Settings:
    """
    Read the settings of a scene.

    :param parameters: nested mapping as a ROS parameter file holds it.
    :raises SceneError: naming the key, the value and what is allowed.
    """
    own = {p.name: parameters[p.name] for p in declarations(Settings) if p.name in parameters}
    kinds: dict[str, Any] = {f.name: f.default_factory for f in fields(Settings)
                             if f.default_factory is not MISSING}
    groups = {name: kind.read(parameters) for name, kind in kinds.items()}
    return Settings(**own, **groups, cues=read_cues(parameters))
