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


"""
Draw the moving picture of the README: palms in a gust, and a ball that goes through a wall.

Run: python bench/moving_picture.py [FILE.gif] (needs PyVista and Pillow; some 30 s of CPU time)
"""

from pathlib import Path
import sys
from tempfile import TemporaryDirectory

from PIL import Image

from procphys_ros.physics.wind import Gust
from procphys_ros.render.picture import draw
from procphys_ros.scene import Scene
from procphys_ros.scene.sources import load_grammar
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

_PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'images' / 'gust_and_ball.gif'
_SIZE = (480, 270)  # [px]
_CAMERA = (-1.5, -14.0, 2.2, 0.5, 0.0, 2.3)  # position and target [m]
_FRAMES, _EVERY = 40, 6  # frames, and steps of 1/60 s from one to the next
_COLOURS = 112
_BALL = Projectile(size=0.7, mass=600.0, position=(-1.2, -9.0, 1.4), velocity=(0.0, 13.0, 1.5))
_GUST = Gust(amplitude=28.0, duration=3.5, upwind=12.0, direction=(1.0, 0.0, 0.0))


def main(path: Path) -> None:
    """
    Simulate, draw and write.

    :param path: of the picture, *.gif.
    """
    simulation = Simulation(_scene())
    simulation.set_wind((8.0, 0.0, 0.0))
    simulation.step(180)
    simulation.gust(_GUST)
    with TemporaryDirectory() as folder:
        frames = []
        for number in range(_FRAMES):
            if number == _FRAMES // 4:
                simulation.launch(_BALL)
            simulation.step(_EVERY)
            frames.append(_frame(simulation, Path(folder) / f'{number}.png'))
    palette = frames[_FRAMES // 2].quantize(_COLOURS)
    shown = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    shown[0].save(path, save_all=True, append_images=shown[1:], loop=0, optimize=True,
                  duration=round(1e3 * _EVERY * simulation.time_step))
    print(f'{path}: {_FRAMES} frames, {path.stat().st_size / 1e6:.2f} MB, '
          f'{simulation.bonds_broken} bonds broken')


def _scene() -> Scene:
    scene = Scene()
    for name, height, place in (('near', 4.2, (2.6, 1.5, 0.0)), ('far', 5.4, (-4.6, 4.0, 0.0))):
        palm = load_grammar('palm.lsys', 'grammar').build(seed=len(name), height=height)
        scene.add(palm, place, name=f'palm_{name}')
    wall = load_grammar('garden_wall.wall', 'grammar').build()
    scene.add(wall, (-3.4, 0.0, 0.0), name='wall')
    return scene


def _frame(simulation: Simulation, path: Path) -> Image.Image:
    draw(simulation.blueprint, simulation.poses, path, camera=_CAMERA, size=_SIZE,
         leaf_poses=simulation.leaf_poses(), dust=simulation.dust)
    with Image.open(path) as picture:
        return picture.convert('RGB')


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else _PICTURE)
