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


"""How contact forces of a body are put on its parts."""

import numpy as np

from procphys_ros.physics.masonry.contact_forces import BodyContacts, spread


def test_a_contact_without_a_normal_presses_nothing():
    """Put the weight on two bricks as if a contact that has no normal were not there."""
    poses = np.array([[0.0, 0, 0, 0, 0, 0, 1], [0.3, 0, 0, 0, 0, 0, 1]])
    sizes = np.full((2, 3), 0.2)
    points = np.array([[0.15, 0.0, -0.1], [0.2, 0.0, 0.0]])
    normals, forces = np.array([[0.0, 0, 1], [0, 0, 0]]), np.array([[0.0, 0, 50.0], [0, 0, 0]])
    wanted = spread(BodyContacts(points[:1], normals[:1], forces[:1], np.zeros(1, np.int64)),
                    poses, sizes, poses)
    assert wanted[:, 2].sum() > 49.0
    for order in ([0, 1], [1, 0]):
        found = spread(BodyContacts(points[order], normals[order], forces[order],
                                    np.zeros(2, np.int64)), poses, sizes, poses)
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)
