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


"""Random scenes of arches and climbers, on hills, that objects join and leave; and saved ones."""

import pytest
from random_changes import faults


@pytest.mark.parametrize('seed', [2, 8])  # with either engine
def test_random_changes_leave_everything_finite_and_repeatable(seed):
    """Let 40 steps pass in a scene that changes, half of them twice from a saved state."""
    found = list(faults(seed))
    assert not found, '\n'.join(found)
