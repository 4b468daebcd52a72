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

"""A small scene for tests of the page: a tree, and a wall some metres to the east of it."""

from functools import cache
import socket

from masonry_walls import wall
import numpy as np

from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation
from procphys_ros.view.source import Frame, PageContent

DOWN, NORTH = np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0])
TREE = """
axiom: Width(0.1) Density(700) Modulus(8e9) DampingRatio(0.05) F(1) F(1) [ +(60) F(1) Leaf(0.3) ]
"""


@cache
def simulation_at_rest() -> Simulation:
    """Set the scene up, once for all tests: who steps it takes a fork."""
    scene = Scene()
    scene.add(LSystem.parse(TREE).build(), name='tree')
    scene.add(wall(4, 10), (5.0, 0.0, 0.0), name='wall')
    return Simulation(scene)


def free_port() -> int:
    """Find a TCP port without a listener."""
    with socket.socket() as probe:
        probe.bind(('localhost', 0))
        return probe.getsockname()[1]


def frame_of(simulation: Simulation) -> Frame:
    """Take a frame."""
    content = PageContent.of(simulation.blueprint, simulation.names.name, 0,
                             simulation.model.terrain)
    return Frame(content, simulation.poses.copy(), simulation.leaf_poses().copy())
