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


"""Wind: mean profile, turbulence with a real spectrum, discrete gusts."""

from procphys_ros.physics.wind.settings import (
    FASTEST,
    Gust,
    GUST_KINDS,
    MeanWind,
    PROFILES,
    Record,
    SPECTRA,
    velocity_of,
    WindSettings,
)
from procphys_ros.physics.wind.shelter import Shelter
from procphys_ros.physics.wind.wind import Reference, Wind

__all__ = ['FASTEST', 'Gust', 'GUST_KINDS', 'MeanWind', 'PROFILES',
           'Record', 'Reference', 'Shelter', 'SPECTRA', 'velocity_of', 'Wind', 'WindSettings']
