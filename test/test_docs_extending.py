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


"""An engine of another module is found by its name, as docs/extending.md says."""

import sys
from types import ModuleType

import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.physics.world import engine, World
from procphys_ros.physics.world.bullet import BulletEngine


def test_an_engine_is_a_class_in_a_module_and_a_row_of_the_table(monkeypatch):
    """Add an engine that counts its steps, and let a body fall with it."""
    class CountingEngine(BulletEngine):
        steps = 0

        def step(self, *arguments) -> None:
            CountingEngine.steps += 1
            super().step(*arguments)

    module = ModuleType('procphys_ros.physics.world.counting')
    module.CountingEngine = CountingEngine
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(engine.ENGINES, 'counting', 'pybullet')
    assert 'counting' in engine.installed_engines()
    with World(engine='counting') as world:
        body = world.add_body(Shape.BOX, [0.2, 0.1, 0.1], 4.0, np.array([0, 0, 30, 0, 0, 0, 1.0]))
        for _ in range(30):
            world.step(1.0 / 60.0)
        fallen = 30.0 - world.poses([body])[0, 2]
    assert CountingEngine.steps >= 30
    assert fallen == pytest.approx(0.5 * 9.81 * 0.5 ** 2, rel=0.002)
