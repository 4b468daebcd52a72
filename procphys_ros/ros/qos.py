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


"""Quality of service of every topic, in one place."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Large arrays go out reliable: best effort loses most messages above some 0.8 MB, even on one
# machine, because a single lost fragment loses the whole message.
ARRAYS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)

# What is said once and not again: also a subscriber that stalls for seconds must get all of it.
CHANGES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)

# What a late joiner must still get.
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)

# Only the newest counts.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)

# Commands wait here while a step is being computed: deep enough for a second's worth of the
# busiest sender that is answered for (1000 per second).
COMMANDS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
