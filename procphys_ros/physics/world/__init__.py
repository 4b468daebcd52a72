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

"""Rigid-body world: collisions and sleeping of ground, fragments, bricks and projectiles."""

from procphys_ros.physics.rigid.joints import JointKind
from procphys_ros.physics.world.assembly import expand, rigid_sum, RigidSum
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.contacts import Contacts
from procphys_ros.physics.world.engine import DEFAULT_ENGINE, ENGINES, installed_engines
from procphys_ros.physics.world.joint_table import JointOptions
from procphys_ros.physics.world.kinematic import velocity_between
from procphys_ros.physics.world.loose_bodies import fragment, FRICTION, LooseBody, plain
from procphys_ros.physics.world.merging import merge_boxes
from procphys_ros.physics.world.pieces import Pieces, solid_inertia
from procphys_ros.physics.world.world import World

__all__ = ['BodyState', 'BodyTable', 'Contacts', 'DEFAULT_ENGINE', 'ENGINES', 'expand',
           'fragment', 'FRICTION', 'installed_engines', 'JointKind', 'JointOptions', 'LooseBody',
           'merge_boxes', 'Pieces', 'plain', 'rigid_sum', 'RigidSum', 'solid_inertia',
           'velocity_between', 'World']
