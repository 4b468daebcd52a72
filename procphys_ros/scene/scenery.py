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


"""Settings of pictures and films: camera, sun and sky."""

from collections.abc import Sequence
from dataclasses import dataclass

from procphys_ros.errors import SceneError
from procphys_ros.schema import declared, ParameterGroup

MOTIONS = ('fixed', 'orbit', 'follow')


@dataclass(frozen=True)
class CameraSettings(ParameterGroup, group='camera'):
    """Camera of `render`: its place, and its motion in a film."""

    motion: str = declared('fixed', 'how the camera of `render` moves', choices=MOTIONS)
    part: str = declared('', 'name of the part that it follows')
    position: Sequence[float] | None = declared(
        None, 'where it stands at first; all 0 = where the whole scene is seen', 'm',
        shown=(0.0, 0.0, 0.0))
    target: Sequence[float] | None = declared(
        None, 'what it looks at; all 0 = the middle of the scene, or the part that it follows',
        'm', shown=(0.0, 0.0, 0.0))
    field_of_view: float = declared(32.0, 'vertical angle that it sees', '°', 1.0, 120.0)
    period: float = declared(20.0, 'time of one round of an orbit', 's', 0.1, 1e6)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('position', 'target'):
            value = getattr(self, name)
            if value is not None and not any(value):
                object.__setattr__(self, name, None)
        if self.position is not None and self.position == self.target:
            raise SceneError(f'camera.position and camera.target are both '
                             f'{list(self.position)}; the camera must not stand where it looks')
        if self.motion == 'follow' and not self.part:
            raise SceneError('camera.motion is follow, and camera.part does not say whom')


@dataclass(frozen=True)
class SunSettings(ParameterGroup, group='sun'):
    """Sun of `render`."""

    azimuth: float = declared(
        216.0, 'where the sun of `render` stands, clockwise from north, which is +y', '°',
        0.0, 360.0)
    elevation: float = declared(40.0, 'its height above the horizon', '°', 3.0, 90.0)
    strength: float = declared(1.0, 'its light; 1 = a clear day', '', 0.0, 2.0)


@dataclass(frozen=True)
class SkySettings(ParameterGroup, group='sky'):
    """Sky of `render`."""

    clouds: float = declared(
        0.3, 'share of the sky of `render` that is covered; clouds dim the sun', '', 0.0, 1.0)
    visibility: float = declared(
        2500.0, 'distance at which haze leaves 37 % of what is seen', 'm', 5.0, 1e6)
