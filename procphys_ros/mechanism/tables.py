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

"""Tables: kinds of parts and joints, the keys that each takes, and the values of these."""

from typing import NamedTuple

from procphys_ros.errors import nearest_names
from procphys_ros.language import Place
from procphys_ros.mechanism.spec import Block
from procphys_ros.wallgrammar.materials import DEFAULTS, Material

_PLACED = ('at', 'turn', 'material', 'mass')
PART_KEYS = {
    'box': ('size', *_PLACED),
    'plate': ('size', 'area', *_PLACED),
    'rod': ('from', 'to', 'diameter', 'material', 'mass'),
    'ball': ('diameter', 'at', 'material', 'mass'),
    'wheel': ('diameter', 'width', *_PLACED),
}
PART_NEEDS = {'box': ('size',), 'plate': ('size',), 'rod': ('from', 'to', 'diameter'),
              'ball': ('diameter',), 'wheel': ('diameter', 'width')}
_ALONG = ('to', 'at', 'axis', 'limits', 'spring', 'damper', 'friction', 'motor', 'strength',
          'collides')
JOINT_KEYS = {
    'weld': ('to', 'at', 'strength'),
    'hinge': _ALONG,
    'slider': _ALONG,
    'ball': ('to', 'at', 'strength', 'collides'),
    'rope': ('to', 'at', 'end', 'length', 'strength', 'collides'),
}
JOINT_NEEDS: dict[str, tuple[str, ...]] = {'rope': ('end',)}
RULE_KEYS = ('at', 'turn', 'on')
NAMES = ('material', 'to', 'on')  # keys whose value is a name, but for a rod's `to`


class ValueRange(NamedTuple):
    """
    What the values of a key must be.

    :ivar counts: how many there may be.
    :ivar low, high: of each.
    :ivar unit: of each, for messages.
    """

    counts: tuple[int, ...]
    low: float
    high: float
    unit: str


_LONGEST, _HARDEST = 1e3, 1e12  # [m], [N] and [N·m], beyond any machine
_POINT = ValueRange((3,), -_LONGEST, _LONGEST, 'm')
_LENGTH = ValueRange((1,), 1e-3, _LONGEST, 'm')
RANGES = {
    'size': ValueRange((3,), 1e-3, _LONGEST, 'm'), 'diameter': _LENGTH, 'width': _LENGTH,
    'length': _LENGTH, 'at': _POINT, 'from': _POINT, 'to': _POINT, 'end': _POINT,
    'turn': ValueRange((3,), -1e4, 1e4, 'degrees'), 'axis': ValueRange((3,), -1e3, 1e3, ''),
    'mass': ValueRange((1,), 1e-6, 1e7, 'kg'), 'area': ValueRange((1,), 0.0, 1e6, 'm²'),
    'limits': ValueRange((2,), -1e5, 1e5, 'm or degrees'),
    'spring': ValueRange((1, 2), -_HARDEST, _HARDEST, 'N/m or N·m/rad'),
    'damper': ValueRange((1,), 0.0, _HARDEST, 'N·s/m or N·m·s/rad'),
    'friction': ValueRange((1,), 0.0, _HARDEST, 'N or N·m'),
    'motor': ValueRange((2, 3), -_HARDEST, _HARDEST, ''),
    'strength': ValueRange((1, 2), 0.0, _HARDEST, 'N and N·m'),
    'collides': ValueRange((1,), 0.0, 1.0, ''),
}

# Structural steel S235, EN 10025-2: 7850 kg/m³, 235 MPa, in shear 1/√3 of it, 210 GPa.
MATERIALS = {**DEFAULTS, 'steel': Material(7850.0, 235e6, 136e6, 0.4, 235e6, 210e9, 'steel')}


def check_kind(kind: str, known: dict[str, tuple[str, ...]], what: str, place: Place) -> None:
    """Check that a kind of part or joint is known."""
    if kind not in known:
        raise place.error(f'unknown kind "{kind}" of {what}{nearest_names(kind, known)} '
                          f'({what}s: {", ".join(known)})')


def check_keys(settings: Block, known: tuple[str, ...], needed: tuple[str, ...], what: str,
               place: Place) -> None:
    """Check that the keys of a block are known, and that none is missing."""
    for key, setting in settings.items():
        if key not in known:
            raise setting.place.error(f'unknown key "{key}" of a {what}'
                                      f'{nearest_names(key, known)} (keys: {", ".join(known)})')
    for key in needed:
        if key not in settings:
            raise place.error(f'a {what} needs "{key}:"')
