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

"""Tests of looks: what a picture must show beside the right shapes."""

import numpy as np
import pytest

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.dust import Puffs
from procphys_ros.render.camera import View
from procphys_ros.render.drawing import Moment
from procphys_ros.render.picture import Renderer

_SIZE = (160, 100)


def _picture(moment: Moment, view: View, **how) -> np.ndarray:
    renderer = Renderer(moment, _SIZE, **how)
    try:
        return renderer.draw(moment, view).astype(int)
    finally:
        renderer.close()


@pytest.mark.parametrize('count', [50, 3000])
def test_many_thin_puffs_look_like_a_thick_one(count):
    """Add up puffs fainter than a step of eight bits, without a change of hue or an edge."""
    view = View(np.array([0.0, -8.0, 2.0]), np.array([0.0, 0.0, 2.0]))
    depth, ones = 1.5, np.ones(count)

    def dusty(number: int) -> np.ndarray:
        opacity = np.full(number, -np.expm1(-depth / number))
        puffs = Puffs(np.tile([0.0, 0.0, 2.0], (number, 1)), 4.0 * ones[:number], opacity,
                      ones[:number])
        return _picture(Moment(Blueprint(), np.zeros((0, 7)), dust=puffs), view)

    assert np.abs(dusty(count) - dusty(1)).max() <= 2
