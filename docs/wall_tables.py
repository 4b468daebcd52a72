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
Write the tables of docs/wall_language.md that the code has: default materials, and textures.

Run: python docs/wall_tables.py
"""

from pathlib import Path
import re

import numpy as np

from procphys_ros.appearance.palette import LOOKS
from procphys_ros.wallgrammar.materials import DEFAULTS, NUMBERS

PAGE = Path(__file__).with_name('wall_language.md')


def materials() -> str:
    """Write what is known of each material that needs no declaration."""
    rows = [f'| `{name}` | ' + ' | '.join(_number(getattr(material, key)) for key in NUMBERS)
            + f' | `{material.texture}` |' for name, material in DEFAULTS.items()]
    return _table(('material', *NUMBERS, 'texture'), rows)


def textures() -> str:
    """Write the look of each texture name."""
    rows = []
    for name, look in LOOKS.items():
        red, green, blue = (round(255 * channel) for channel in look.rgba[:3])
        opacity = '' if look.rgba[3] == 1.0 else f', opacity {look.rgba[3]:g}'
        rows.append(f'| `{name}` | #{red:02x}{green:02x}{blue:02x}{opacity} | {look.pattern} | '
                    f'{look.variation:g} |')
    return _table(('texture', 'colour', 'pattern', 'variation of brightness'), rows)


def updated(page: str) -> str:
    """
    Replace the tables between the marks of a page.

    :param page: its text.
    """
    for table in (materials, textures):
        page = re.sub(rf'(<!-- {table.__name__} -->\n).*?(<!-- end -->)',
                      lambda found, table=table: f'{found[1]}\n{table()}\n{found[2]}', page,
                      flags=re.DOTALL)
    return page


def _number(value: float) -> str:
    return '–' if np.isinf(value) else f'{value:g}'.replace('e+0', 'e').replace('e+', 'e')


def _table(head: tuple[str, ...], rows: list[str]) -> str:
    return '\n'.join([f'| {" | ".join(head)} |', '|' + len(head) * '---|', *rows, ''])


if __name__ == '__main__':
    PAGE.write_text(updated(PAGE.read_text('utf-8')), 'utf-8')
