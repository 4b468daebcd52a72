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

"""Causes of failure of bonds, for trees and masonry, numbered as in `~/breaks`."""

from procphys_ros.elementary.array_enum import ArrayEnum


class Cause(ArrayEnum):
    """Cause of the failure of a bond."""

    FORCE = 0        # transmitted force above the limit of a branch's or a mechanism's joint
    TWIST = 1        # twisting moment above the limit of a branch's joint, any of a mechanism's
    BENDING = 2      # bending stress above the strength of the wood
    TENSION = 3      # mortar pulled apart, or part of a mechanism without equilibrium
    SHEAR = 4        # mortar sheared off
    COMPRESSION = 5  # mortar or unit crushed
    IMPACT = 6       # struck by a projectile or by debris
    BLAST = 7        # torn out by an explosion
    DEMOLITION = 8   # cut by a timed charge
    UPROOTING = 9    # root plate turned out of the ground
    PULLED_OFF = 10  # climbing plant pulled off its host, or its host gave way
    CUT = 11         # sawn through
