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
Environment: what plants ask of the place where they grow.

Open L-systems (Měch and Prusinkiewicz 1996, SIGGRAPH 96, 397-410): between the steps of a
derivation the environment answers the queries in the strings of all plants that grow together.
`questions` names the queries; `site` answers them, from the sky (`sky`), from what stands
near (`nearest`), and from the statics of the plants themselves (`statics`).
"""

from procphys_ros.environment.questions import KINDS, Plant, Question, STORM

__all__ = ['KINDS', 'Plant', 'Question', 'STORM']
