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

"""Meanings: what the symbols of other programs are in our language."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

_NO_FORMS: Mapping[int, str] = MappingProxyType({})


@dataclass(frozen=True)
class Meaning:
    """
    Meaning of a symbol of another program.

    :ivar alias: name of its modules here, where no symbol of ours means the same.
    :ivar same: numbers of parameters with which a symbol of ours means the same.
    :ivar ours: that symbol; '' = it is written alike.
    :ivar forms: modules that draw it, by the least number of parameters; a0, a1, … are these.
    :ivar told: what is said of it where it stays without a meaning.
    """

    alias: str
    same: tuple[int, ...] = ()
    ours: str = ''
    forms: Mapping[int, str] = field(default_factory=lambda: _NO_FORMS)
    told: str = ''

    def form(self, arity: int) -> str | None:
        """Return the modules that draw it with a number of parameters, None = nothing does."""
        least = max((n for n in self.forms if n <= arity), default=-1)
        return self.forms.get(least)


_COLOUR = "colours are left out; write Texture(n), or ' for the next texture"
_CURVED = 'surfaces, generalized cylinders and their outlines are left out'
_BODY = 'spheres, circles and other bodies that are only drawn are left out'
_PLACE = 'jumps to a place are left out; branches begin where the turtle stands'
_BENT = 'tropisms are left out; write Tropism(x, y, z, e)'
_SCALE = 'scales of lengths are left out; write a parameter: A(l) -> F(l) A(0.9 * l)'
_ASKED = 'queries are not answered; write ?P, ?H, ?L, ?U or ?E(kind; …) in a .lsys file'
_WIDTH = 'changes of width by a step that the file does not state are left out; write its width'


def _turn(alias: str, ours: str) -> Meaning:
    return Meaning(alias, (0, 1), ours, {1: f'{ours}(a0)'})


def _marks(told: str, *symbols: str) -> dict[str, Meaning]:
    """List symbols that stay without a meaning: `@Gs` is named AtGs."""
    return {symbol: Meaning(symbol.replace('@', 'At').replace('?', 'Ask').replace('#', 'Hash')
                            .replace('!', 'Sides').replace(',', 'Less').replace(';', 'More'),
                            told=told) for symbol in symbols}


_COMMON = {
    'F': Meaning('Segment', (0, 1), 'F', {1: 'F(a0)'}),
    'f': Meaning('Move', (0, 1), 'f', {1: 'f(a0)'}),
    '+': _turn('Left', '+'), '-': _turn('Right', '-'),
    '&': _turn('Down', '&'), '^': _turn('Up', '^'),
    '|': Meaning('TurnAround', (0,), '|', {1: '|'}),
    '%': Meaning('Cut', (0,), '%', told='cuts with parameters are left out'),
    '@v': Meaning('RollToVertical', (0,), '@v', {1: '@v'}),
    '{': Meaning('StartPolygon', (0,), '{', told=_CURVED),
    '}': Meaning('EndPolygon', (0,), '}', told=_CURVED),
    '.': Meaning('Corner', (0,), '.', {1: '.'}),
    '~': Meaning('Surface'),
    ';': Meaning('NextColour', told=_COLOUR), ',': Meaning('LastColour', told=_COLOUR),
    '"': Meaning('Scale', told=_SCALE), "'": Meaning('Prime', told=_COLOUR),
    **_marks(_ASKED, '?P', '?H', '?L', '?U', '?E', '?'),
    **_marks(_CURVED, '@Gs', '@Gc', '@Ge', '@Gt', '@Gr', '@#', '@!', '@PS', '@PC', '@PD'),
    **_marks(_BODY, '@O', '@o', '@c', '@b', '@bo', '@bc', '@B', '@L', '@I', '@J', '@g'),
    **_marks(_BENT, '@Ts', '@Tp', '@Tx', '@Tf', '@Ti', '@Td'),
    **_marks(_SCALE, '@D', '@Di', '@Dd', '@S'),
    **_marks(_PLACE, '@M'), **_marks(_COLOUR, '@,', '@;'),
}

# cpfg 6 and its manual (Prusinkiewicz, Měch and Hanan 1997): y is up, and left is -x at first;
# `!` and `#` set the diameter.
CPFG = {
    **_COMMON,
    '\\': _turn('RollLeft', '\\'), '/': _turn('RollRight', '/'),
    'G': Meaning('PlainSegment', forms={0: 'F', 1: 'F(a0)'}),
    'g': Meaning('PlainMove', forms={0: 'f', 1: 'f(a0)'}),
    '!': Meaning('Thinner', (0, 1), '!', {1: '!(a0)'}),
    '#': Meaning('Thicker', (), '', {1: 'Width(a0)'}, _WIDTH),
    '_': Meaning('Elasticity', told=_BENT), '$': Meaning('RollToHorizontal', (0,), '$', {1: '$'}),
    '@R': Meaning('SetHeading', (), '', {3: '@R(-a0, a2, a1)',
                                         6: '@R(-a0, a2, a1, -a3, a5, a4)'}),
}

# L-Py 3 and the turtle of PlantGL: z is up, left is -y and up x at first; widths are radii; `/`
# rolls to the left.
LPY = {
    **_COMMON,
    '\\': _turn('RollRight', '/'), '/': _turn('RollLeft', '\\'),
    'F': Meaning('Segment', (0, 1), 'F', {2: 'F(a0) Width(2 * a1)'}),
    '!': Meaning('DecWidth', (0,), '!', {1: 'Width(2 * a0)'}),
    '_': Meaning('IncWidth', (), '', {1: 'Width(2 * a0)'}, _WIDTH),
    'SetWidth': Meaning('SetRadius', (), '', {1: 'Width(2 * a0)'}, _WIDTH),
    '$': Meaning('GetModule', told=_ASKED), '@h': Meaning('RollToHorizontal', told=_PLACE),
    '@R': Meaning('SetHeading', (), '', {3: '@R(-a1, a0, a2)',
                                         6: '@R(-a1, a0, a2, -a4, a3, a5)'}),
    **_marks(_ASKED, '?R', '?F', '?I'),
    **_marks(_CURVED, 'Sweep', 'SetContour', 'SectionResolution', 'SetGuide', 'EndGuide',
             'PositionOnGuide', 'nF'),
    **_marks(_BODY, 'Frame', 'Arrow', '@2D', '@3D'),
    **_marks(_PLACE, 'MoveRel', 'LineTo', 'OLineTo', 'LineRel', 'OLineRel', 'Pinpoint',
             'PinpointRel', 'EulerAngles', 'iRollL', 'iRollR', 'LeftReflection', 'UpReflection',
             'HeadingReflection'),
    **_marks(_COLOUR, 'SetColor', 'InterpolateColors', 'TextureBaseColor',
             'InterpolateTextureBaseColors', 'TextureScale', 'TextureUScale', 'TextureVScale',
             'TextureVCoeff', 'TextureTranslation', 'TextureRotation', 'TextureTransformation'),
}
# Names of several letters that L-Py has for symbols.
LPY_NAMES = {
    'SB': '[', 'EB': ']', 'BP': '{', 'EP': '}', 'PP': '.', 'Left': '+', 'Right': '-', 'Up': '^',
    'Down': '&', 'RollL': '/', 'RollR': '\\', 'TurnAround': '|', 'RollToVert': '@v',
    'RollToHorizontal': '@h', 'IncWidth': '_', 'DecWidth': '!', 'IncColor': ';', 'DecColor': ',',
    'DivScale': '@Dd', 'MultScale': '@Di', 'SetScale': '@D', 'StartGC': '@Gc', 'EndGC': '@Ge',
    'MoveTo': '@M', 'SetHead': '@R', 'Sphere': '@O', 'Box': '@B', 'Quad': '@b', 'Circle': '@o',
    'Label': '@L', 'PglShape': '@g', 'Elasticity': '@Ts', 'Tropism': '@Tp', 'Cut': '%',
    'GetPos': '?P', 'GetHead': '?H', 'GetLeft': '?L', 'GetUp': '?U', 'GetRight': '?R',
    'GetFrame': '?F', 'GetIterator': '?I', 'GetModule': '$', 'StartScreenProjection': '@2D',
    'EndScreenProjection': '@3D',
}

_RADIAN = '57.29577951308232'  # [degrees]
CPFG_FUNCTIONS = {
    'ran': (1, 'rand(0, a0)'), 'fabs': (1, 'abs(a0)'), 'trunc': (1, 'floor(a0 + 0.5)'),
    'sign': (1, '(a0 > 0) - (a0 < 0)'), 'atan': (1, 'atan2(a0, 1)'),
}
LPY_FUNCTIONS = {
    **{name: (1, f'{name}(a0 * {_RADIAN})') for name in ('sin', 'cos', 'tan')},
    **{name: (1, f'{name}(a0) / {_RADIAN}') for name in ('asin', 'acos')},
    'atan': (1, f'atan2(a0, 1) / {_RADIAN}'), 'atan2': (2, f'atan2(a0, a1) / {_RADIAN}'),
    'radians': (1, f'a0 / {_RADIAN}'), 'degrees': (1, f'a0 * {_RADIAN}'),
    'random': (0, 'rand(0, 1)'), 'uniform': (2, 'rand(a0, a1)'), 'gauss': (2, 'nran(a0, a1)'),
    'randint': (2, 'floor(rand(a0, a1 + 1))'), 'fabs': (1, 'abs(a0)'), 'float': (1, 'a0'),
    'int': (1, '(a0 < 0) * ceil(a0) + (a0 >= 0) * floor(a0)'),
}
LPY_RANDOM = frozenset(name for name, (_, text) in LPY_FUNCTIONS.items()
                       if 'rand(' in text or 'nran(' in text)
LPY_CONSTANTS = {'pi': '3.141592653589793', 'True': '1', 'False': '0'}
