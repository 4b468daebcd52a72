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


"""L-systems: grammars that grow trees (Prusinkiewicz and Lindenmayer 1990, with physics)."""

from procphys_ros.lsystem.growth import grow, Growth
from procphys_ros.lsystem.modules import Module, Modules
from procphys_ros.lsystem.system import LSystem, MAX_MODULES

__all__ = ['grow', 'Growth', 'LSystem', 'MAX_MODULES', 'Module', 'Modules']
