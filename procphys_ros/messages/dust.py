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

"""Dust as rows of a point cloud."""

import numpy as np

from procphys_ros.physics.dust import Puffs

DUST = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('size', '<f4'),
                 ('age', '<f4')])


def dust_rows(puffs: Puffs) -> np.ndarray:
    """
    Turn puffs of dust into rows of a point cloud: `intensity` is their opacity, 0 to 1.

    :param puffs: the dust there is.
    :returns: rows of dtype `DUST`; sizes are diameters [m], ages in [s], (K,).
    """
    rows = np.empty(len(puffs.positions), DUST)
    rows['x'], rows['y'], rows['z'] = puffs.positions.T
    rows['intensity'], rows['size'], rows['age'] = puffs.opacity, puffs.sizes, puffs.ages
    return rows
