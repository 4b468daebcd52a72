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


"""Settings of a simulated lidar or depth camera."""

from dataclasses import dataclass
import math

from procphys_ros.errors import SceneError
from procphys_ros.schema import declared, ParameterGroup

_MOST_RAYS = 1_000_000


@dataclass(frozen=True)
class LidarSettings(ParameterGroup, group='lidar'):
    """Range sensor."""

    rate: float = declared(0.0, 'scans on ~/lidar per simulated second; 0 = none', 'Hz', 0.0,
                           240.0)
    pattern: str = declared('spherical', 'of the rays: as of a lidar, or of a depth camera',
                            choices=('spherical', 'pinhole'))
    rows: int = declared(64, 'rays one above the other', '', 1, 4096)
    columns: int = declared(512, 'rays side by side', '', 1, 16384)
    vertical_field: float = declared(math.pi / 4.0, 'field of view', 'rad', 1e-3, math.pi)
    horizontal_field: float = declared(2.0 * math.pi, 'field of view', 'rad', 1e-3, 2.0 * math.pi)
    range: float = declared(100.0, 'longest', 'm', 1e-3, 1e4)
    position: tuple[float, ...] = declared(
        (0.0, 0.0, 1.5), 'in the world, or on what it is attached to', 'm', -1e6, 1e6)
    rotation: tuple[float, ...] = declared(
        (0.0, 0.0, 0.0), 'roll, pitch and yaw; at 0 it looks along x', 'rad', -1e3, 1e3)
    attached_to: str = declared('', 'name of the intruder that carries it; empty = it stands')
    frame: str = declared('', 'frame_id of its points, which are then given in its own frame; '
                          'empty = in world_frame')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rows * self.columns > _MOST_RAYS:
            raise SceneError(f'lidar.rows x lidar.columns is {self.rows * self.columns} rays, it '
                             f'must not exceed {_MOST_RAYS}')
        if self.pattern == 'pinhole' and max(self.vertical_field, self.horizontal_field) > 3.0:
            raise SceneError('lidar.vertical_field and lidar.horizontal_field of a pinhole must '
                             'not exceed 3 rad')
