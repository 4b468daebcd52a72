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


"""Stresses of whole buildings under their own weight: as exact as they are told to be."""

from pathlib import Path

import numpy as np

from procphys_ros.physics.masonry import BondGraph, StressSolver
from procphys_ros.wallgrammar import WallGrammar

WALLS = sorted((Path(__file__).parents[1] / 'grammars').glob('*.wall'))


def test_tolerance_leaves_utilisations_right_to_one_percent():
    """Compare the default tolerance with one a thousand times tighter on a real building."""
    plan = WallGrammar.load(WALLS[0].with_stem('office')).build(seed=0)
    coarse, fine = StressSolver(BondGraph(plan)), StressSolver(BondGraph(plan))
    fine.tolerance *= 1e-3
    coarse.iterate(5000)
    fine.iterate(5000)
    assert coarse.converged and fine.converged
    difference = np.abs(coarse.utilisation()[0] - fine.utilisation()[0])
    assert difference.max() < 0.01
