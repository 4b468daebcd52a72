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

"""Command `map`: tell what a scene takes of a map, and write a scene that shows it."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
import sys

from procphys_ros.errors import ProcPhysError
from procphys_ros.files.output_files import write_beside
from procphys_ros.maps.features import MAPS, read_map
from procphys_ros.maps.houses import House, houses_of
from procphys_ros.terminal.argument_parser import OneLineParser

_SCENE = """\
# {title}
/**:
  ros__parameters:
    engine: native
    scene:
      objects: [block]
    block:
      grammar: {path}
"""


def main(words: Sequence[str] | None = None) -> int:
    """
    Read a map, and write a scene of its houses, trees and roads.

    :param words: after the command's name; None = the process's own.
    :returns: exit code: 0 done, 1 the map cannot be read, 2 invalid usage.
    """
    said = _parser().parse_args(sys.argv[1:] if words is None else list(words))
    path = Path(said.file)
    try:
        if not path.name.endswith(MAPS):
            raise ProcPhysError(f'{path}: maps end in {", ".join(MAPS)}')
        for line in told(path):
            print(line)
        out = Path(said.out or Path(path.name.split('.')[0] + '.yaml'))
        if out.exists() and not said.force:
            raise ProcPhysError(f'{out} exists; --force replaces it, --out names another one')
        text = _SCENE.format(title=f'The map {path.name}.', path=path.resolve())
        write_beside(out, lambda part: part.write_text(text, 'utf-8'))
    except (ProcPhysError, OSError) as error:
        print(f'map: {error}', file=sys.stderr)
        return 1
    print(f'{out} is written; look at it with: render {out} --out {out.stem}.png')
    return 0


def told(path: Path) -> list[str]:
    """List what a scene takes of a map, and what it leaves out, as lines of text."""
    found = read_map(path)
    features = found.in_metres()
    kinds = Counter(feature.kind for feature in features)
    lines = [f'{kinds["building"]} buildings, {kinds["road"]} roads, {kinds["tree"]} trees']
    notes: Counter[str] = Counter()
    for _, house in houses_of(features):
        if isinstance(house, House):
            notes.update(house.notes)
            notes['wide ones have no floors and roofs'] += house.wide
        else:
            notes[house] += 1
    lines += [f'  {count} of {kinds["building"]}: {note}' for note, count in notes.items()
              if count]
    return lines + [f'  left out: {count} {kind}' for kind, count in found.left_out.items()]


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog='map', allow_abbrev=False,
        description='Tell what a scene takes of a map, and write a scene that shows it.')
    parser.add_argument('file', help=f'map that ends in {", ".join(MAPS)}')
    parser.add_argument('--out', help='scene file; the name of the map with .yaml if not given')
    parser.add_argument('--force', action='store_true', help='replace an existing file')
    return parser


if __name__ == '__main__':
    sys.exit(main())
