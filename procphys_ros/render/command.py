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


"""Command `render`: draw a scene or a grammar, at rest or after some simulated time."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys
from typing import NoReturn

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import ProcPhysError, SceneError
from procphys_ros.physics.dust import Puffs
from procphys_ros.render.backend import RenderUnavailableError
from procphys_ros.render.picture import draw
from procphys_ros.scene import Scene
from procphys_ros.scene.sources import load_grammar

_GRAMMARS = ('.lsys', '.wall')
_SCENES = ('.yaml', '.yml')
_PICTURES = ('.png', '.jpg', '.jpeg')
_LARGEST_SIDE = 8192  # [px], what OpenGL in software still allocates with oversampling


class _Parser(argparse.ArgumentParser):
    """Parser whose complaints are one line and exit code 1, as all of ours are."""

    def error(self, message: str) -> NoReturn:
        self.exit(1, f'{self.prog}: {message}\n')


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command.

    :param arguments: words after the command's name; the process's own when not given.
    :returns: exit code, 1 for a mistake of the user.
    """
    options = _parser().parse_args(arguments)
    try:
        _check_picture(options.out)
        scene = _scene(options)
        blueprint, poses, leaf_poses, dust = _state_at(scene, options.time)
        draw(blueprint, poses, options.out, camera=options.camera, size=options.size,
             leaf_poses=leaf_poses, dust=dust)
    except (ProcPhysError, RenderUnavailableError, OSError) as error:
        print(f'render: {error}', file=sys.stderr)
        return 1
    print(f'{options.out}: {len(blueprint)} parts at {options.time:g} s')
    return 0


def _parser() -> _Parser:
    parser = _Parser(prog='render', description='Draw a scene as a picture, without a display.')
    parser.add_argument('scene', help='scene file (.yaml) or grammar (.lsys, .wall)')
    parser.add_argument('--out', required=True, type=Path, help='picture to write (.png, .jpg)')
    parser.add_argument('--time', type=_seconds, default=0.0,
                        help='simulated time to wait before the picture [s]')
    parser.add_argument('--size', type=_size, default=(1280, 720), metavar='WxH',
                        help='width and height [px]')
    parser.add_argument('--camera', type=_camera, metavar='x,y,z,tx,ty,tz',
                        help='position and target [m]; the whole scene when not given')
    parser.add_argument('--seed', type=int, default=0, help='of a grammar')
    parser.add_argument('--define', type=_define, action='append', default=[],
                        metavar='name=value', help='of a grammar, may be repeated')
    return parser


def _scene(options: argparse.Namespace) -> Scene:
    """Read the scene, or put one instance of a grammar on empty ground."""
    suffix = Path(options.scene).suffix
    if suffix in _SCENES:
        return Scene.from_yaml(options.scene)
    if suffix not in _GRAMMARS:
        raise SceneError(f'"{options.scene}" is neither a scene ({", ".join(_SCENES)}) nor a '
                         f'grammar ({", ".join(_GRAMMARS)})')
    grammar = load_grammar(options.scene, 'scene')
    scene = Scene()
    scene.add(grammar.build(seed=options.seed, **dict(options.define)), (0.0, 0.0, 0.0), 0.0,
              name=Path(options.scene).stem)
    return scene


def _state_at(scene: Scene, time: float) -> tuple[Blueprint, np.ndarray, np.ndarray | None, Puffs]:
    """Simulate from rest; give all parts, their poses (N, 7), those of leaves (L, 7), and dust."""
    if time == 0.0:
        return scene.blueprint, scene.blueprint.poses, None, Puffs.none()
    # Late, because PyBullet greets on import, which is noise before a one-line error.
    from procphys_ros.simulation import Simulation

    simulation = Simulation(scene)
    simulation.step(max(1, round(time / simulation.time_step)))
    return simulation.blueprint, simulation.poses, simulation.leaf_poses(), simulation.dust


def _check_picture(path: Path) -> None:
    """Refuse a picture that could not be written, before minutes of simulation."""
    if path.suffix.lower() not in _PICTURES:
        raise SceneError(f'--out: "{path}" must end in {", ".join(_PICTURES)}')
    if not path.parent.is_dir():
        raise SceneError(f'--out: there is no folder "{path.parent}"')


def _numbers(text: str, separator: str, count: int, like: str) -> list[float]:
    try:
        values = [float(word) for word in text.split(separator)]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(value) < 1e9 for value in values):
        raise argparse.ArgumentTypeError(f'"{text}" is not like {like}')
    return values


def _seconds(text: str) -> float:
    value = _numbers(text, ' ', 1, '3.0')[0]
    if value < 0.0:
        raise argparse.ArgumentTypeError(f'{text} lies before the start')
    return value


def _size(text: str) -> tuple[int, int]:
    width, height = (int(value) for value in _numbers(text, 'x', 2, '1280x720'))
    if not (1 <= width <= _LARGEST_SIDE and 1 <= height <= _LARGEST_SIDE):
        raise argparse.ArgumentTypeError(f'{text} is not within 1 to {_LARGEST_SIDE} pixels')
    return width, height


def _camera(text: str) -> list[float]:
    values = _numbers(text, ',', 6, '20,-30,10,0,0,5')
    if values[:3] == values[3:]:
        raise argparse.ArgumentTypeError(f'"{text}": the camera stands where it looks')
    return values


def _define(text: str) -> tuple[str, float]:
    name, _, value = text.partition('=')
    if not name.isidentifier():
        raise argparse.ArgumentTypeError(f'"{text}" is not like height=15')
    return name, _numbers(value, ' ', 1, 'height=15')[0]


if __name__ == '__main__':
    sys.exit(main())
