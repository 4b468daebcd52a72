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
Blueprint: parts and bonds, written by every grammar and read by all of the physics.

`blueprint` has the arrays; `skeleton` fills them from explicit branches, `cut_bricks` finds the
pieces of one brick.
"""

from procphys_ros.blueprint.blueprint import (
    BALLS,
    Blueprint,
    box_inertia,
    chain,
    cylinder_inertia,
    FASTEST,
    GROUND,
    Hexahedra,
    Hinges,
    Joints,
    JointType,
    Law,
    Leaves,
    Mortar,
    Ornaments,
    Plates,
    Shape,
)

__all__ = [
    'BALLS',
    'Blueprint',
    'box_inertia',
    'chain',
    'cylinder_inertia',
    'FASTEST',
    'GROUND',
    'Hexahedra',
    'Hinges',
    'Joints',
    'JointType',
    'Law',
    'Leaves',
    'Mortar',
    'Ornaments',
    'Plates',
    'Shape',
]
