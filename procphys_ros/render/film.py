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


"""Film: one simulation run, drawn at regular times."""

from collections.abc import Callable
from dataclasses import dataclass
from math import floor

import numpy as np

from procphys_ros.render.drawing import Moment
from procphys_ros.render.motion import CameraMotion
from procphys_ros.render.picture import Renderer, scene_points
from procphys_ros.render.writers import PictureWriter
from procphys_ros.scene import Scene
from procphys_ros.scene.scenery import CameraSettings
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import PartNames

_ROUNDING = 1e-6  # of a number of steps


@dataclass(frozen=True)
class Shot:
    """
    Times, size and camera of pictures.

    :ivar start: of the film in simulated time [s].
    :ivar count: number of pictures.
    :ivar rate: pictures per simulated second.
    :ivar size: width and height [px].
    :ivar camera: position and motion.
    """

    start: float
    count: int
    rate: float
    size: tuple[int, int]
    camera: CameraSettings

    def times(self) -> list[float]:
        """Return the times of the pictures [s]."""
        return [self.start + number / self.rate for number in range(self.count)]

    def steps(self, time_step: float) -> list[int]:
        """Return the number of steps before each picture; halves are rounded up, all alike."""
        return [floor(time / time_step + 0.5 + _ROUNDING) for time in self.times()]


def moment_of(simulation: Simulation) -> Moment:
    """Return the present content of a simulation for drawing."""
    fallen = simulation.state.leaves.fallen
    lying = np.zeros(len(simulation.blueprint.leaves), bool)
    lying[fallen.leaf[~fallen.flying]] = True
    return Moment(simulation.blueprint, simulation.state.shown_poses(), simulation.leaf_poses(),
                  simulation.exists, simulation.log.bonds, simulation.dust, lying,
                  simulation.snow_on_ground)


def check_camera(scene: Scene, camera: CameraSettings) -> None:
    """
    Validate the part that the camera follows.

    :raises CommandError: with the nearest names, if the scene has no such part.
    """
    if camera.motion == 'follow':
        PartNames(scene.objects, scene.blueprint).index(camera.part)


def shoot(scene: Scene, shot: Shot, writer: PictureWriter,
          tell: Callable[[int], None] = lambda number: None) -> Simulation:
    """
    Simulate a scene from the start, and draw it at the times of a shot.

    :param scene: to simulate.
    :param shot: times and camera.
    :param writer: receives the pictures; it is neither finished nor discarded.
    :param tell: called with the number of finished pictures.
    :returns: the simulation at the time of the last picture.
    :raises CommandError: if the camera follows a part that does not exist.
    """
    check_camera(scene, shot.camera)
    simulation = Simulation(scene)
    follows = (simulation.names.index(shot.camera.part) if shot.camera.motion == 'follow'
               else None)
    renderer: Renderer | None = None
    made = 0
    for number, (time, steps) in enumerate(zip(shot.times(), shot.steps(simulation.time_step))):
        if steps > made:
            simulation.step(steps - made)
            made = steps
        moment = moment_of(simulation)
        place = None if follows is None else moment.poses[follows, :3].copy()
        if renderer is None:
            settings = scene.settings
            motion = CameraMotion(shot.camera, scene_points(moment), shot.size, place)
            renderer = Renderer(moment, shot.size, settings.sun, settings.sky,
                                settings.terrain, scene.paving)
        writer.add(renderer.draw(moment, motion.view(time - shot.start, place)))
        tell(number + 1)
    if renderer is not None:
        renderer.close()
    return simulation
