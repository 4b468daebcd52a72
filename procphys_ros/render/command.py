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


"""Command `render`: draw a scene or a grammar as a picture, a series of pictures or a film."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
import signal
import sys
from threading import current_thread, main_thread

from procphys_ros.errors import ProcPhysError, SceneError
from procphys_ros.render.backend import RenderUnavailableError
from procphys_ros.render.drawing import Moment
from procphys_ros.render.motion import CameraMotion
from procphys_ros.render.picture import LARGEST_SIDE, Renderer, scene_points
from procphys_ros.render.writers import check_output, FILMS, is_series, open_writer
from procphys_ros.scene import Scene
from procphys_ros.scene.named import open_scene
from procphys_ros.scene.scenery import CameraSettings
from procphys_ros.terminal.argument_parser import add_grammar_options, OneLineParser
from procphys_ros.terminal.interruption import raising
from procphys_ros.terminal.progress_bar import ProgressBar
from procphys_ros.terminal.warning_lines import print_warning, told_to

_MOST_FRAMES = 100_000
_INTERRUPTED = 130  # exit code after SIGINT


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command.

    :param arguments: words after the command's name; default the process's own.
    :returns: exit code: 0 done, 1 it cannot be done, 2 invalid usage, 130 interrupted.
    """
    options = _parser().parse_args(arguments)
    try:
        check_output(options.out)
        with told_to(print_warning):
            scene = open_scene(options.scene, options.seed, dict(options.define))
            return _draw(scene, options)
    except (ProcPhysError, RenderUnavailableError) as error:
        print(f'render: {error}', file=sys.stderr)
        return 1
    except OSError as error:  # of the output file; errors of input files are clear by themselves
        print(f'render: --out: "{options.out}" cannot be written: {error.strerror or error}',
              file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('render: interrupted', file=sys.stderr)
        return _INTERRUPTED


def _draw(scene: Scene, options: argparse.Namespace) -> int:
    """Draw a picture or a film; return the exit code."""
    camera = _camera_settings(scene, options)
    if options.out.suffix.lower() in FILMS or is_series(options.out):
        if options.time:
            raise SceneError('--time: a film lasts from --from to --to')
        return _film(scene, camera, options)
    for name, value in (('--from', options.start), ('--to', options.end)):
        if value:
            raise SceneError(f'{name}: "{options.out}" is one picture, at --time; a series is '
                             'called frames/%04d.png')
    _picture(scene, camera, options)
    return 0


def _picture(scene: Scene, camera: CameraSettings, options: argparse.Namespace) -> None:
    """Draw the scene at one time."""
    writer = open_writer(options.out, options.size, 1.0)
    count = len(scene.blueprint)
    if options.time == 0.0 and camera.motion != 'follow':
        moment = Moment(scene.blueprint, scene.blueprint.poses)
        motion = CameraMotion(camera, scene_points(moment), options.size)
        renderer = Renderer(moment, options.size, scene.settings.sun, scene.settings.sky,
                            scene.settings.terrain, scene.paving)
        writer.add(renderer.draw(moment, motion.view(0.0)))
        renderer.close()
    else:
        # Import late: PyBullet prints a banner, which is noise before a one-line error.
        from procphys_ros.render.film import shoot, Shot

        shot = Shot(options.time, 1, 1.0, options.size, camera)
        count = len(shoot(scene, shot, writer).blueprint)
    print(f'{options.out}: {count} parts at {options.time:g} s')


def _film(scene: Scene, camera: CameraSettings, options: argparse.Namespace) -> int:
    """Draw the scene repeatedly; after an interruption the file is valid."""
    from procphys_ros.render.film import check_camera, shoot, Shot

    if options.end is None or options.end <= options.start:
        raise SceneError(f'a film needs --to, after --from ({options.start:g} s)')
    count = max(1, round((options.end - options.start) * options.fps))
    if count > _MOST_FRAMES:
        raise SceneError(f'--to: {count} pictures are more than {_MOST_FRAMES}')
    check_camera(scene, camera)
    shot = Shot(options.start, count, options.fps, options.size, camera)
    writer = open_writer(options.out, options.size, options.fps)
    interrupted = False
    try:
        with ProgressBar(f'render {options.out.name}', sys.stderr) as bar, _terminable():
            shoot(scene, shot, writer, lambda number: bar.show(number, count))
    except KeyboardInterrupt:
        interrupted = True
    except BaseException:
        writer.discard()
        raise
    done = writer.count
    if not done:
        writer.discard()
        print('render: interrupted before the first picture', file=sys.stderr)
        return _INTERRUPTED
    writer.finish()
    print(f'{options.out}: {done} pictures from {options.start:g} s to '
          f'{options.start + done / options.fps:g} s{", interrupted" if interrupted else ""}')
    return _INTERRUPTED if interrupted else 0


@contextmanager
def _terminable() -> Iterator[None]:
    """Handle SIGTERM in a block like Ctrl-C."""
    if current_thread() is not main_thread():
        yield
        return

    before = signal.signal(signal.SIGTERM, raising(KeyboardInterrupt))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _camera_settings(scene: Scene, options: argparse.Namespace) -> CameraSettings:
    """Return the camera of the scene file, overridden by the options."""
    camera = replace(scene.settings.camera, **(options.camera or {}))
    return camera if options.view is None else replace(camera, position=options.view)


def _parser() -> OneLineParser:
    parser = OneLineParser(prog='render', description=(
        'Draw a scene as a picture, a series of pictures or a film, without a display.'))
    parser.add_argument('scene', help='scene file (.yaml), name of a shipped scene, or '
                        'grammar (.lsys, .wall, .mech, .urdf, .l, .lpy) or scanned tree (.csv, '
                        '.mtg, .ply)')
    parser.add_argument('--out', required=True, type=Path,
                        help='what to write: picture.png (.jpg), film.mp4, loop.gif, '
                        'frames/%%04d.png')
    parser.add_argument('--time', type=_seconds, default=0.0,
                        help='simulated time to wait before the picture [s]; at 0 trees stand as '
                        'drawn, later as the wind bends them')
    parser.add_argument('--size', type=_size, default=(1280, 720), metavar='WxH',
                        help='width and height [px]')
    parser.add_argument('--from', dest='start', type=_seconds, default=0.0,
                        help='simulated time at which a film begins [s]')
    parser.add_argument('--to', dest='end', type=_seconds,
                        help='simulated time at which a film ends [s]')
    parser.add_argument('--fps', type=_rate, default=30.0,
                        help='pictures per simulated second')
    parser.add_argument('--camera', type=_camera, metavar='HOW',
                        help='fixed, orbit, follow=PART, or position and target '
                        'x,y,z,tx,ty,tz [m]; as in the scene file when not given')
    parser.add_argument('--view', type=_coordinate, nargs=3, metavar=('X', 'Y', 'Z'),
                        help='where the camera stands at first [m]; where it sees the whole '
                        'scene when not given')
    add_grammar_options(parser)
    return parser


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
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE):
        raise argparse.ArgumentTypeError(f'{text} is not within 1 to {LARGEST_SIDE} pixels')
    return width, height


def _rate(text: str) -> float:
    value = _numbers(text, ' ', 1, '30')[0]
    if not 0.01 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f'{text} is not within 0.01 to 1000 per second')
    return value


def _coordinate(text: str) -> float:
    return _numbers(text, ' ', 1, '20')[0]


def _camera(text: str) -> dict[str, object]:
    """Read the camera option as fields of its settings."""
    how, _, part = text.partition('=')
    if text in ('fixed', 'orbit'):
        return {'motion': text}
    if how == 'follow' and part:
        return {'motion': how, 'part': part}
    if ',' not in text:
        raise argparse.ArgumentTypeError(
            f'"{text}" is none of fixed, orbit, follow=PART, x,y,z,tx,ty,tz')
    values = _numbers(text, ',', 6, '20,-30,10,0,0,5')
    if values[:3] == values[3:]:
        raise argparse.ArgumentTypeError(f'"{text}": the camera stands where it looks')
    return {'motion': 'fixed', 'position': values[:3], 'target': values[3:]}
