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


"""Masonry: rigid parts on mortar bonds, their stresses and their fracture."""

from procphys_ros.physics.masonry.capacity import Resistance
from procphys_ros.physics.masonry.fracture import Failures, Fracture
from procphys_ros.physics.masonry.free_body import Breakage, FreeBodies
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.punching import punched, together
from procphys_ros.physics.masonry.solver import StressSolver
from procphys_ros.physics.masonry.vibration import first_modes, Modes

__all__ = ['BondGraph', 'Breakage', 'Failures', 'first_modes', 'Fracture', 'FreeBodies', 'Modes',
           'punched', 'Resistance', 'StressSolver', 'together']
