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

"""Command `export`: a scene as a file that another program reads."""

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys

from procphys_ros.errors import ExportError, ProcPhysError
from procphys_ros.files.output_files import obstacle, write_whole
from procphys_ros.language import TRANSLATED
from procphys_ros.scene.named import open_scene
from procphys_ros.scene.sources import locate, TREE_GRAMMAR
from procphys_ros.terminal.argument_parser import add_grammar_options, number, OneLineParser
from procphys_ros.terminal.progress_bar import ProgressBar
from procphys_ros.terminal.warning_lines import print_warning, told_to

_FPS = 30.0


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command.

    :param arguments: words after the command's name; default the process's own.
    :returns: exit code: 0 done, 1 it cannot be done, 2 invalid usage, 130 interrupted.
    """
    options = _parser().parse_args(arguments)
    # Import late: PyBullet prints a banner, which is noise before a one-line error.
    from procphys_ros.export.formats import check_target, export, export_animation

    try:
        if options.out.suffix == TREE_GRAMMAR:
            return _write_grammar(options)
        check_target(options.out)
        with told_to(print_warning):
            scene = open_scene(options.scene, options.seed, dict(options.define))
            with ProgressBar(f'export {options.out.name}', sys.stderr) as bar:
                if options.animate is None:
                    export(scene, options.out, options.time, bar.show)
                else:
                    start, end = options.animate
                    export_animation(scene, options.out, start, end, options.fps, bar.show)
    except ProcPhysError as error:
        print(f'export: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('export: interrupted', file=sys.stderr)
        return 130
    print(f'{options.out}: a scene of {len(scene.blueprint)} parts, {_size(options.out)}')
    return 0


def _write_grammar(options: argparse.Namespace) -> int:
    """Write a grammar for cpfg or L-Py in the language of L-systems."""
    from procphys_ros.lsystem.translation import translated_text

    given = options.seed is not None or options.define or options.animate or options.time
    if not options.scene.endswith(TRANSLATED) or given:
        raise ExportError(f'"{options.out}": what is written as {TREE_GRAMMAR} is a grammar '
                          f'({", ".join(TRANSLATED)}), without any option')
    if reason := obstacle(options.out):
        raise ExportError(f'"{options.out}" cannot be written: {reason}')
    with told_to(print_warning):
        text = translated_text(locate(options.scene, 'scene', Path()))
    write_whole(options.out, text.encode())
    print(f'{options.out}: a grammar of {text.count(chr(10))} lines, {_size(options.out)}')
    return 0


def _parser() -> OneLineParser:
    parser = OneLineParser(prog='export', description=(
        'Write a scene as a file for other programs: USD (.usda, .usdc), MuJoCo (.xml), '
        'URDF (.urdf), Gazebo (.sdf), glTF (.glb); or a grammar of cpfg or L-Py as .lsys.'))
    parser.add_argument('scene', help='scene file (.yaml), name of a shipped scene, or '
                        'grammar (.lsys, .wall, .mech, .urdf, .l, .lpy) or scanned tree (.csv, '
                        '.mtg, .ply)')
    parser.add_argument('--out', required=True, type=Path,
                        help='file to write; its suffix chooses the format')
    when = parser.add_mutually_exclusive_group()
    when.add_argument('--time', type=number, default=0.0,
                      help='simulated time to wait before [s]; at 0 trees stand as drawn, later '
                      'as the wind bends them')
    when.add_argument('--animate', type=number, nargs=2, metavar=('FROM', 'TO'),
                      help='write a simulated run between two times [s], USD only')
    parser.add_argument('--fps', type=number, default=_FPS,
                        help=f'moments per second of a run (default {_FPS:g})')
    add_grammar_options(parser)
    return parser


def _size(path: Path) -> str:
    size = path.stat().st_size
    return f'{size / 1e6:.1f} MB' if size >= 1e5 else f'{size / 1e3:.1f} kB'
