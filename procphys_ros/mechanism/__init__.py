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

"""
Mechanism grammar: rules write parts and the joints between them.

`parser` reads the text into a `spec`, `derivation` applies its rules, `assembly` makes a blueprint
of what they write. `urdf` reads robots from elsewhere, which `robot` writes as mechanisms.
"""

from procphys_ros.mechanism.mechanism import MechanismGrammar
from procphys_ros.mechanism.robot import RobotGrammar

__all__ = ['MechanismGrammar', 'RobotGrammar']
