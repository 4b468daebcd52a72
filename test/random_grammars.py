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


"""Random grammars for `hypothesis`, valid by their make: trees, walls and what hits them."""

from typing import NamedTuple

from hypothesis import strategies as st

_FINE = 1000  # steps between the ends of a range: two bytes per number, so that many fit


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
    """One object: its language, 'lsys' or 'wall', its text, the seed, and what hits it."""

    language: str
    text: str
    seed: int
    event: Event


def even(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw evenly between two ends."""
    return st.integers(0, _FINE).map(lambda n: low + (high - low) * n / _FINE)


def log(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw evenly in the logarithm; neither end is passed by rounding."""
    return st.integers(0, _FINE).map(
        lambda n: min(max(low * (high / low) ** (n / _FINE), low), high))


def seldom(strategy: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Draw a text in one of three cases, else nothing."""
    return st.one_of(st.just(''), st.just(''), strategy)


def _symbol(name: str, value: st.SearchStrategy[float]) -> st.SearchStrategy[str]:
    return value.map(lambda x: f'{name}({x:.6g}) ')


_EVENTS = st.builds(
    Event, even(0.0, 0.999), even(0.0, 20.0), st.integers(0, 30), even(0.0, 1.0),
    st.one_of(st.just(0.0), log(50.0, 8000.0)), log(0.05, 1.0), even(1.0, 40.0), even(0.05, 1.0))

# Physics of the wood, set once in the axiom; the first three always.
_WOOD = (
    _symbol('Density', log(1.0, 20e3)), _symbol('Modulus', log(1e5, 2e12)),
    _symbol('DampingRatio', even(0.0, 1.0)),
    seldom(_symbol('SwingForce', log(1e-3, 1e9))),
    seldom(_symbol('SwingDamper', log(1e-6, 1e6))),
    seldom(_symbol('SwingLimit', log(0.1, 180.0))),
    seldom(_symbol('TwistForce', log(1e-3, 1e9))),
    seldom(_symbol('StretchForce', log(1e-3, 1e9))),
    seldom(_symbol('Strength', log(1e3, 1e9))),
    seldom(_symbol('BreakForce', log(1e-3, 1e6))),
    seldom(_symbol('BreakTorque', log(1e-3, 1e6))),
    seldom(_symbol('WidthRate', even(0.5, 1.2))),
    seldom(_symbol('BoneRatio', even(0.8, 0.95))),
    seldom(_symbol('Tropism(0, 0, -1, 0.2) DensityRate', even(0.8, 1.2))),
)
_ORGANS = seldom(_symbol('~', log(0.01, 1.0)) | st.sampled_from(
    ['Leaf(0.2, 1) ', 'G(0.3) ', '{ . f(0.1) +(120) . f(0.1) . } ', "' $ "]))
_DEEPEST = (8, 4, 3, 2)  # derivation steps by number of side branches: at most 40 segments


@st.composite
def trees(draw: st.DrawFn) -> Sample:
    """Draw an L-system of a tree of at most 40 segments."""
    wood = ''.join(draw(part) for part in _WOOD)
    sides = draw(st.integers(0, 3))
    steps = draw(st.integers(1, _DEEPEST[sides]))
    branches = ''.join(
        f'[ /({draw(even(0, 360)):g}) &({draw(even(0, 150)):g}) {draw(_ORGANS)}'
        f'A(l * {draw(even(0.4, 1)):g}, w * {draw(even(0.3, 1)):g}) ] ' for _ in range(sides))
    weight = ' : 3' if draw(st.booleans()) else ''
    other = '\n  A(l, w) : l > 0 -> !(w) F(l) : 1' if weight else ''
    start = f'&({draw(even(0, 60)):g}) A({draw(log(0.01, 5)):.6g}, {draw(log(1e-3, 2)):.6g})'
    text = f"""axiom: {wood}{start}
derivation length: {steps}
production:
  A(l, w) : l > 0 -> !(w) F(l) {draw(_ORGANS)}{branches}A(l * {draw(even(0.5, 1)):g}, w * {
      draw(even(0.5, 1)):g}){weight}{other}
decomposition:
  A(l, w) : l < 0.01 -> A(0.01, w)
  A(l, w) : w < 0.001 -> A(l, 0.001)
interpretation:
  A(l, w) -> !(w) F(l)
"""
    return Sample('lsys', text, draw(st.integers(0, 99)), draw(_EVENTS))


_MATERIAL = (('density', log(1.0, 25e3)), ('tension', log(1.0, 1e9)), ('cohesion', log(1.0, 1e9)),
             ('friction', even(0.0, 2.0)), ('compression', log(1e3, 1e9)),
             ('modulus', log(1e6, 1e11)))
_FRONTS = (
    'wall', 'split(x) { ~1: wall | 0.9: opening | ~1: wall }', 'border(0.25) { wall | wall }',
    'split(y) { ~1: wall | ~1: other }', 'split(x) { { ~0.8: wall }* }',
    "split(x) { 0.45: wall | ~1: other | '0.3: wall }", 'grid(1, 1) { wall }',
)
_OPENINGS = ('split(y) { ~1: wall | 0.9: window | 0.2: lintel | ~0.6: wall }',
             'split(y) { 0.8: door | 0.2: lintel | ~1: wall }', 'wall')
_PLANS = ('(0, 0) (length, 0)', '(0, 0) (length, 0) (length, 2) (0, 2)')


@st.composite
def walls(draw: st.DrawFn) -> Sample:
    """Draw a wall grammar of a free wall or a hut of at most some 300 parts."""
    plan = draw(st.integers(0, 1))
    bond = draw(st.sampled_from(['running', 'stack', 'english', 'flemish']))
    joint = draw(even(0.0, 0.02))
    width = draw(even(0.1, 0.25))
    length = 2 * width + joint if bond in ('english', 'flemish') else draw(even(0.25, 0.6))
    roof = draw(st.sampled_from(['none', 'none', 'gable(40)', 'hip(35)', 'flat'])) if plan else ''
    floors = draw(st.sampled_from(['floors: timber', 'floors: slab(0.15)', ''])) if plan else ''
    material = ' '.join(f'{key}: {draw(value):.6g}' for key, value in _MATERIAL)
    text = f"""building b(length = {draw(even(2.5, 3.2)):g})
  footprint: {_PLANS[plan]}
  facades: front
  storey_height: {draw(even(1.2, 2.0)):g}
  {f'roof: {roof}' if roof else ''}
  {floors}
rule front -> {draw(st.sampled_from(_FRONTS))}
rule opening -> {'wall' if 'slab' in floors else draw(st.sampled_from(_OPENINGS))}
material stone {{ {material} }}
layout laid {{ bond: {bond} unit: {length:.4f} {width:.4f} {draw(even(0.18, 0.3)):.4f}
  joint: {joint:.4f} offset: {draw(st.sampled_from([0.5, 0.25, 0.33]))} material: stone }}
panel wall: laid
panel other: laid
panel door: boards(oak)
panel window: glazing(timber, glass)
panel lintel: beam(concrete)
"""
    return Sample('wall', text, draw(st.integers(0, 99)), draw(_EVENTS))
