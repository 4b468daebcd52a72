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

"""Scenes that the tests of exporters share, and how they are written."""

from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.export import Content, export
from procphys_ros.files.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.scene.sources import load_grammar
from procphys_ros.simulation import Simulation

PLACE, YAW = (3.0, -2.0, 0.0), 0.4  # where objects stand, away from the origin


def scene_of(**objects: Blueprint) -> Scene:
    """Place blueprints ten metres apart."""
    scene = Scene()
    for number, (name, blueprint) in enumerate(objects.items()):
        scene.add(blueprint, np.add(PLACE, (0.0, 10.0 * number, 0.0)), YAW, name)
    return scene


def grown(grammar: str, seed: int = 1, **defines: float) -> Blueprint:
    """Build a shipped grammar."""
    return load_grammar(str(shared_folder() / 'grammars' / grammar), 'test').build(seed, **defines)


def small_wall() -> Blueprint:
    """Build a wall of few bricks."""
    return grown('garden_wall.wall', length=0.89, height=0.6)


def bent_in_wind(scene: Scene, steps: int = 60) -> Simulation:
    """Bend the trees of a scene by a storm."""
    simulation = Simulation(scene)
    simulation.set_wind((14.0, 6.0, 0.0))
    simulation.step(steps)
    return simulation


def written(source: Scene | Simulation, path: Path) -> tuple[Path, Content]:
    """Export, and give what the file should hold."""
    export(source, path)
    content = Content.of(source) if isinstance(source, Simulation) else Content.at_rest(source)
    return path, content
