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


"""Random grammars, valid by their make: trees, walls and what hits them."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np


class Event(NamedTuple):
    """
    What hits one object, in shares of what it is.

    :ivar part: that the impulse hits, share of their number.
    :ivar speed: that the impulse would give this part alone [m/s].
    :ivar impulse_step: number of the step in which it comes.
    :ivar direction: of the impulse, share of a turn; upwards by the same share.
    :ivar ball: its density [kg/m³], 0 = none.
    :ivar diameter: of the ball [m].
    :ivar ball_speed: [m/s].
    :ivar height: at which it flies, share of the object's.
    """

    part: float
    speed: float
    impulse_step: int
    direction: float
    ball: float
    diameter: float
    ball_speed: float
    height: float


class Sample(NamedTuple):
    """
    One object: its kind, its text, the seed, and what hits it.

    The kind is 'lsys', 'wall', or 'house': a wall grammar that may have no room for what it asks.
    """

    language: str
    text: str
    seed: int
    event: Event


_Draw = Callable[[np.random.Generator], float]
_ENDS = 0.03  # share of the numbers that are drawn from each end of a range itself


def draw(seed: int, grown: int, built: int) -> tuple[list[Sample], float]:
    """Draw the trees and the walls of one scene, and its wind [m/s]."""
    rng = np.random.default_rng(seed)
    samples = [_tree(rng) for _ in range(grown)] + [_wall(rng) for _ in range(built)]
    return samples, rng.uniform(0.0, 50.0)


def _even(low: float, high: float) -> _Draw:
    """Draw evenly between two ends, and now and then an end itself."""
    def one(rng: np.random.Generator) -> float:
        share = rng.random() * (1.0 + 2.0 * _ENDS) - _ENDS
        return low + (high - low) * min(max(share, 0.0), 1.0)
    return one


def _log(low: float, high: float) -> _Draw:
    """Draw evenly in the logarithm; neither end is passed by rounding."""
    share = _even(0.0, 1.0)
    return lambda rng: min(max(low * (high / low) ** share(rng), low), high)


def _pick(rng: np.random.Generator, texts: Sequence[str]) -> str:
    return texts[rng.integers(len(texts))]


def _event(rng: np.random.Generator) -> Event:
    return Event(
        _even(0.0, 0.999)(rng), _even(0.0, 20.0)(rng), int(rng.integers(31)),
        _even(0.0, 1.0)(rng), _log(50.0, 8000.0)(rng) if rng.integers(2) else 0.0,
        _log(0.05, 1.0)(rng), _even(1.0, 40.0)(rng), _even(0.05, 1.0)(rng))


# Physics of the wood, set once in the axiom.
_ALWAYS = (('Density', _log(1.0, 20e3)), ('Modulus', _log(1e5, 2e12)),
           ('DampingRatio', _even(0.0, 1.0)))
_SELDOM = (  # each in one of three trees
    ('SwingForce', _log(1e-3, 1e9)), ('SwingDamper', _log(1e-6, 1e6)),
    ('SwingLimit', _log(0.1, 180.0)), ('TwistForce', _log(1e-3, 1e9)),
    ('StretchForce', _log(1e-3, 1e9)), ('Strength', _log(1e3, 1e9)),
    ('BreakForce', _log(1e-3, 1e6)), ('BreakTorque', _log(1e-3, 1e6)),
    ('WidthRate', _even(0.5, 1.2)), ('BoneRatio', _even(0.8, 0.95)),
    ('Tropism(0, 0, -1, 0.2) DensityRate', _even(0.8, 1.2)),
)
_ORGANS = ('Leaf(0.2, 1) ', 'G(0.3) ', '{ . f(0.1) +(120) . f(0.1) . } ', "' $ ")
_DEEPEST = (8, 4, 3, 2)  # derivation steps by number of side branches: at most 40 segments


def _organ(rng: np.random.Generator) -> str:
    if rng.integers(3):
        return ''
    return _pick(rng, _ORGANS) if rng.integers(2) else f'~({_log(0.01, 1.0)(rng):.6g}) '


def _tree(rng: np.random.Generator) -> Sample:
    """Draw an L-system of a tree of at most 40 segments."""
    given = [*_ALWAYS, *(pair for pair in _SELDOM if not rng.integers(3))]
    wood = ''.join(f'{name}({value(rng):.6g}) ' for name, value in given)
    sides = int(rng.integers(4))
    steps = rng.integers(1, _DEEPEST[sides] + 1)
    branches = ''.join(
        f'[ /({_even(0, 360)(rng):g}) &({_even(0, 150)(rng):g}) {_organ(rng)}'
        f'A(l * {_even(0.4, 1)(rng):g}, w * {_even(0.3, 1)(rng):g}) ] ' for _ in range(sides))
    weight = ' : 3' if rng.integers(2) else ''
    other = '\n  A(l, w) : l > 0 -> !(w) F(l) : 1' if weight else ''
    start = (f'&({_even(0, 60)(rng):g}) '
             f'A({_log(0.01, 5)(rng):.6g}, {_log(1e-3, 2)(rng):.6g})')
    text = f"""axiom: {wood}{start}
derivation length: {steps}
production:
  A(l, w) : l > 0 -> !(w) F(l) {_organ(rng)}{branches}A(l * {_even(0.5, 1)(rng):g}, w * {
      _even(0.5, 1)(rng):g}){weight}{other}
decomposition:
  A(l, w) : l < 0.01 -> A(0.01, w)
  A(l, w) : w < 0.001 -> A(l, 0.001)
interpretation:
  A(l, w) -> !(w) F(l)
"""
    return Sample('lsys', text, int(rng.integers(100)), _event(rng))


_MATERIAL = (('density', _log(1.0, 25e3)), ('tension', _log(1.0, 1e9)),
             ('cohesion', _log(1.0, 1e9)), ('friction', _even(0.0, 2.0)),
             ('compression', _log(1e3, 1e9)), ('modulus', _log(1e6, 1e11)))
_FRONTS = (
    'wall', 'split(x) { ~1: wall | 0.9: opening | ~1: wall }', 'border(0.25) { wall | wall }',
    'split(y) { ~1: wall | ~1: other }', 'split(x) { { ~0.8: wall }* }',
    "split(x) { 0.45: wall | ~1: other | '0.3: wall }", 'grid(1, 1) { wall }',
)
_OPENINGS = ('split(y) { ~1: wall | 0.9: window | 0.2: lintel | ~0.6: wall }',
             'split(y) { 0.8: door | 0.2: lintel | ~1: wall }', 'wall')
_PLANS = ('(0, 0) (length, 0)', '(0, 0) (length, 0) (length, 2) (0, 2)')


def _wall(rng: np.random.Generator) -> Sample:
    """Draw a wall grammar of a free wall or a hut of at most some 300 parts."""
    plan = int(rng.integers(2))
    bond = _pick(rng, ('running', 'stack', 'english', 'flemish'))
    joint, width = _even(0.0, 0.02)(rng), _even(0.1, 0.25)(rng)
    length = (2 * width + joint if bond in ('english', 'flemish') else _even(0.25, 0.6)(rng))
    roof = _pick(rng, ('none', 'none', 'gable(40)', 'hip(35)', 'flat')) if plan else ''
    floors = _pick(rng, ('floors: timber', 'floors: slab(0.15)', '')) if plan else ''
    material = ' '.join(f'{key}: {value(rng):.6g}' for key, value in _MATERIAL)
    joists = 'timber' in floors or (roof == 'flat' and not floors)  # these need wall to lie in
    text = f"""building b(length = {_even(2.5, 3.2)(rng):g})
  footprint: {_PLANS[plan]}
  facades: front
  storey_height: {_even(1.2, 2.0)(rng):g}
  {f'roof: {roof}' if roof else ''}
  {floors}
rule front -> {_pick(rng, _FRONTS)}
rule opening -> {'wall' if 'slab' in floors else _pick(rng, _OPENINGS[2 * joists:])}
material stone {{ {material} }}
layout laid {{ bond: {bond} unit: {length:.4f} {width:.4f} {_even(0.18, 0.3)(rng):.4f}
  joint: {joint:.4f} offset: {_pick(rng, ('0.5', '0.25', '0.33'))} material: stone }}
panel wall: laid
panel other: laid
panel door: boards(oak)
panel window: glazing(timber, glass)
panel lintel: beam(concrete)
"""
    return Sample('wall', text, int(rng.integers(100)), _event(rng))


def draw_house(seed: int) -> tuple[Sample, float]:
    """Draw a house, what hits it, and its wind [m/s]."""
    rng = np.random.default_rng(seed)
    return Sample('house', house(rng), seed, _event(rng)), rng.uniform(0.0, 50.0)


_HOUSES = {
    'free': '(0, 0) (length, 0)',
    'box': '(0, 0) (length, 0) (length, depth) (0, depth)',
    'L': '(0, 0) (depth + 1.5, 0) (depth + 1.5, depth) (depth, depth) (depth, depth + reach) '
         '(0, depth + reach)',
    'T': '(0, 0) (depth + 2, 0) (depth + 2, depth) (depth + 1, depth) (depth + 1, depth + reach) '
         '(1, depth + reach) (1, depth) (0, depth)',
}
_ARCHES = (('round', 0.5), ('flat', 0.0), ('pointed', 0.87), ('segmental(0.2)', 0.2))
_PIERED = ('split(x) {{ ~1: wall | {pier}: pier | ~1: wall }}',
           'split(x) {{ {end}: wall | {pier}: pier | ~1: wall | {pier}: pier | ~1: wall }}',
           'split(x) {{ ~1: wall | {span}: bay | ~1: wall }}',
           'split(x) {{ ~1: wall | {pier}: pier | ~1: wall | {span}: bay | ~1: wall }}')


def house(rng: np.random.Generator) -> str:
    """
    Draw a building of two thicknesses: piers and buttresses, arches, a chimney, valleys, spires.

    Some have no room for what they ask for, and are refused.
    """
    def even(low: float, high: float, digits: int = 3) -> float:
        return round(float(rng.uniform(low, high)), digits)

    plan = _pick(rng, tuple(_HOUSES))
    joint, width, height = even(0.0, 0.015, 4), even(0.1, 0.3, 4), even(0.06, 0.25, 4)
    bond, thick = _pick(rng, ('running', 'stack', 'english', 'flemish', 'rubble')), even(0.15, 0.7)
    crossed = bond in ('english', 'flemish')
    length = round(2.0 * width + joint, 4) if crossed else even(0.25, 0.65, 4)
    room = round(thick - (length if crossed else width), 4)
    out = _pick(rng, ('0', f'{max(room, 0.0)}', f'{max(0.5 * room, 0.0):.4f}'))
    shape, rise = _ARCHES[rng.integers(len(_ARCHES))]
    span, rings, storey = even(0.6, 1.3), int(rng.integers(1, 3)), even(2.4, 3.2)
    front = _pick(rng, _PIERED).format(pier=even(0.35, 0.9), end=even(0.3, 0.8), span=span)
    roof = 'none' if plan == 'free' else _pick(rng, (
        'none', f'gable({even(20, 60)})', f'hip({even(15, 60)})', 'flat',
        f'spire({even(60, 80)})'))
    floors = 'none' if plan == 'free' else _pick(rng, ('none', 'timber', 'slab(0.15)'))
    place, wide = even(0.3, 1.2), even(0.8, 1.2)
    chimney = '' if plan != 'box' or rng.integers(2) else f"""wing chimney
  footprint: ({-wide}, {place}) (0, {place}) (0, {place + wide}) ({-wide}, {place + wide})
  facades: {_pick(rng, ('plain', 'heavy'))}
  storey_height: {even(1.0, 2.5) * storey:.3f}
  roof: {_pick(rng, ('none', 'spire(70)', 'hip(40)', 'flat'))}
"""
    return f"""building b(length = {even(4, 6)}, depth = {even(2.5, 4.5)}, reach = {even(1.5, 3)})
  footprint: {_HOUSES[plan]}
  facades: {_pick(rng, ('front plain', 'front', 'front plain front plain'))}
  storey_height: {storey}
  roof: {roof}
  floors: {floors}
{chimney}rule front -> {front}
rule pier -> split(y) {{ {even(0.3, 0.9) * storey:.3f}: extrude({out}) {{ thick }} | ~1: wall }}
rule bay -> split(y) {{ {even(0.4, 0.9)}: {_pick(rng, ('hole', 'wall'))} | {
    rise * span + rings * length + 0.1:.3f}: arch | ~1: wall }}
rule plain -> wall
rule heavy -> thick
layout laid {{ bond: {bond}  unit: {length} {width} {height}  joint: {joint}  material: brick }}
layout stout {{ bond: running  unit: 0.34 {thick} {height}  joint: {joint}  material: brick }}
panel wall: laid
panel thick: stout
panel hole: none
panel arch: arch({shape}, {rings})
"""


class RandomRule(NamedTuple):
    """
    One production, apart from any notation.

    :ivar left, right: contexts, name and parameters; '' = none.
    :ivar name, formals: of the module that is replaced.
    :ivar condition: in signs that all notations share; '' = none.
    :ivar successor: modules, name and expressions.
    :ivar weight: 0 = none.
    """

    left: str
    name: str
    formals: str
    right: str
    condition: str
    successor: tuple[tuple[str, str], ...]
    weight: int


_NUMBERS = ('0.5', '1', '2', '0.25', 'K')


def _term(rng: np.random.Generator, names: str, depth: int = 2) -> str:
    """Draw an expression of names and numbers that no notation reads differently."""
    if not depth or not rng.integers(3):
        return _pick(rng, (*names, *_NUMBERS))
    left, right = (_term(rng, names, depth - 1) for _ in range(2))
    return f'({left}{_pick(rng, ("+", "-", "*"))}{right})'


def _modules(rng: np.random.Generator, names: str, branches: int) -> list[tuple[str, str]]:
    result: list[tuple[str, str]] = []
    for _ in range(rng.integers(1, 4)):
        letter = _pick(rng, ('A', 'B', 'C', 'F', '+', '&', '/', '\\'))
        count = 2 if letter == 'B' else letter != 'C'
        result.append((letter, ','.join(_term(rng, names) for _ in range(count))))
    if branches and rng.integers(2):
        inner = _modules(rng, names, branches - 1)
        result = [*result, ('[', ''), *inner, (']', ''), *_modules(rng, names, 0)]
    return result


def draw_productions(rng: np.random.Generator, weighted: bool) -> list[RandomRule]:
    """
    Draw the productions of an L-system with the modules A(a), B(a, b), C and F(l).

    :param weighted: whether some are drawn by weight.
    """
    rules = []
    for _ in range(rng.integers(3, 7)):
        name = _pick(rng, ('A', 'B', 'C'))
        formals = {'A': 'x', 'B': 'xy', 'C': ''}[name]
        left = _pick(rng, (*[''] * 6, 'A(p)', 'C', 'F(p)'))
        right = _pick(rng, (*[''] * 6, 'A(q)', 'C', 'F(q)'))
        known = formals + 'p' * ('(' in left) + 'q' * ('(' in right)
        condition = ''
        if known and rng.integers(2):
            condition = f'{known[0]}{_pick(rng, ("<", ">", "<=", "!="))}{_term(rng, known)}'
        again = rng.integers(1, 3) if weighted else 1
        for weight in range(again):
            rules.append(RandomRule(left, name, formals, right, condition,
                                    tuple(_modules(rng, known, 1)), (weight + 1) * (again > 1)))
    return rules


def _string(modules: Sequence[tuple[str, str]], names: dict[str, str]) -> str:
    return ''.join(names.get(name, name) + (f'({given})' if given else '')
                   for name, given in modules)


def _head(rule: RandomRule) -> str:
    own = f'{rule.name}({",".join(rule.formals)})' if rule.formals else rule.name
    return (f'{rule.left} < ' if rule.left else '') + own + (
        f' > {rule.right}' if rule.right else '')


AXIOM = (('A', '1'), ('F', '2'), ('[', ''), ('B', '1,K'), ('C', ''), (']', ''), ('C', ''),
         ('A', '0.5'))


def as_lsys(rules: Sequence[RandomRule], steps: int) -> str:
    """Write productions in our language, without wood."""
    lines = [f'{_head(rule)}{rule.condition and " : " + rule.condition} -> '
             f'{_string(rule.successor, {})}{f" : {rule.weight}" if rule.weight else ""}'
             for rule in rules]
    return '\n'.join(['define: K = 3', f'derivation length: {steps}', 'ignore: + & / \\',
                      f'axiom: {_string(AXIOM, {})}', 'production:', *lines])


def as_cpfg(rules: Sequence[RandomRule], steps: int) -> str:
    """Write productions for cpfg, with labels, comments and successors over two lines."""
    lines = [f'p{number}: {_head(rule)}{rule.condition and " : " + rule.condition} --> /* to */\n'
             f'\t{_string(rule.successor, {})}{f" : {rule.weight}" if rule.weight else ""}'
             for number, rule in enumerate(rules, 1)]
    return '\n'.join(['#define K 3 // a number', f'#define STEPS {steps}', 'Lsystem: 1',
                      'derivation length: STEPS', 'ignore: +&/\\',
                      f'Axiom: {_string(AXIOM, {})}', *lines, 'endlsystem', ''])


def as_lpy(rules: Sequence[RandomRule], steps: int) -> str:
    """Write productions without weights for L-Py, where rolls turn the other way."""
    rolls, lines = {'/': '\\', '\\': '/'}, []
    for rule in rules:
        successor = _string(rule.successor, rolls)
        lines += [f'{_head(rule)}:', f'  if {rule.condition}:', f'    produce {successor}'] \
            if rule.condition else [f'{_head(rule)} --> {successor}']
    return '\n'.join(['K = 3', f'Axiom: {_string(AXIOM, rolls)}', f'derivation length: {steps}',
                      'ignore: +&/\\', 'production:', *lines, 'endlsystem', ''])
