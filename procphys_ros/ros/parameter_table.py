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


"""The table of parameters: each stands here once, with all that is said about it anywhere."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
import re
from textwrap import wrap
from typing import Any

from procphys_ros.errors import SceneError
from procphys_ros.physics.foliage import SHEDDING_SPEED
from procphys_ros.scene.solids import SHAPES

_FASTEST = 150.0  # [m/s] above every wind measured on the ground
_NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*\Z')
_LARGEST = 1e9  # [any unit] beyond it a value is a mistake


@dataclass(frozen=True)
class Parameter:
    """
    One parameter of the node.

    :ivar name: dotted; of an object's parameter the part behind `<name>.`.
    :ivar default: also says the type: bool, int, float, str, list of floats or of str.
    :ivar description: for `ros2 param describe` and the README.
    :ivar unit: '' where there is none.
    :ivar low, high: least and largest number allowed.
    :ivar choices: texts allowed; () = any.
    :ivar read_only: fixed once the node runs.
    :ivar takes_effect: 'now', 'reload' (at ~/reload_scene) or 'use' (when next used).
    :ivar optional: the default stands for "not given".
    :ivar any_length: a list of numbers may be of any length, and one number is a list of one.
    """

    name: str
    default: Any
    description: str
    unit: str = ''
    low: float = -_LARGEST
    high: float = _LARGEST
    choices: tuple[str, ...] = ()
    read_only: bool = False
    takes_effect: str = 'now'
    optional: bool = False
    any_length: bool = False

    @property
    def takes_any_length(self) -> bool:
        """Say whether it is a list that may be of any length."""
        return isinstance(self.default, list) and (self.any_length or not self.default)

    def read(self, value: Any, name: str = '') -> Any:
        """
        Check a value and give it the parameter's own type; integers pass for doubles.

        :param value: what was given.
        :param name: full name for messages, when it is an object's parameter.
        :raises SceneError: naming the parameter, the value and what is allowed.
        """
        name = name or self.name
        if isinstance(self.default, bool):
            if not isinstance(value, bool):
                raise SceneError(f'{name} is {value!r}, it must be true or false')
            return value
        if isinstance(self.default, (int, float)):
            return self._number(value, name)
        if isinstance(self.default, str):
            return self._text(value, name)
        items = list(value) if _is_sequence(value) else None
        if value is None and self.takes_any_length:  # as ROS reads an empty list of a file
            items = []
        if self.any_length:
            return [self._number(item, name) for item in ([value] if items is None else items)]
        if not self.takes_any_length:
            if items is None or len(items) != len(self.default):
                raise SceneError(f'{name} is {_short(value)}, it must be a list of '
                                 f'{len(self.default)} numbers')
            return [self._number(item, name) for item in items]
        if items is None or not all(isinstance(item, str) for item in items):
            raise SceneError(f'{name} is {_short(value)}, it must be a list of texts')
        return [item for item in items if item]

    def _number(self, value: Any, name: str) -> Any:
        whole = isinstance(self.default, int)
        wanted = int if whole else (int, float)
        kind = 'whole number' if whole else 'number'
        if isinstance(value, bool) or not isinstance(value, wanted):
            raise SceneError(f'{name} is {_short(value)}, it must be a {kind}')
        if not math.isfinite(value) or not self.low <= value <= self.high:
            raise SceneError(f'{name} is {value:g}, it must be a {kind} from {self.low:g} to '
                             f'{self.high:g}' + (f' {self.unit}' if self.unit else ''))
        return int(value) if whole else float(value)

    def _text(self, value: Any, name: str) -> str:
        if not isinstance(value, str):
            raise SceneError(f'{name} is {_short(value)}, it must be a text')
        if self.choices and value not in self.choices:
            raise SceneError(f'{name} is {_short(value)}, it must be one of '
                             f'{", ".join(self.choices)}')
        return value


def _is_sequence(value: Any) -> bool:
    return not isinstance(value, (str, Mapping)) and hasattr(value, '__len__')


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f'{text[:57]}...'


GLOBAL = (
    Parameter('scene.objects', [], 'names of the objects that the scene holds',
              takes_effect='reload'),
    Parameter('scene.cues', [], 'what happens by itself: "<seconds> <verb> name=value …" with the '
              'verbs gust, impulse, launch, explode, demolish; names as in gust.*, impulse.*, '
              'projectile.*, explosion.*, demolition.*, which hold for all that is not said',
              takes_effect='reload'),
    Parameter('seed', 0, 'seed of everything random', low=0, high=2**62, takes_effect='reload'),
    Parameter('time_step', 1.0 / 60.0, 'length of one simulation step', 's', 1e-4, 0.1,
              takes_effect='reload'),
    Parameter('gravity', 9.81, 'downward acceleration', 'm/s²', 0.0, 100.0,
              takes_effect='reload'),
    Parameter('engine', 'bullet', 'library that moves rigid bodies',
              choices=('bullet', 'rapier'), takes_effect='reload'),
    Parameter('world_frame', 'world', 'frame of everything published', read_only=True),
    Parameter('shard.index', 0, 'which share of the objects this node simulates', '', 0, 1000,
              read_only=True),
    Parameter('shard.count', 1, 'number of nodes that share the scene, each with another '
              'shard.index', '', 1, 1000, read_only=True),
    Parameter('publish_clock', True, 'whether simulation time goes out on /clock', read_only=True),
    Parameter('status_line', 'auto', 'a line each second on the standard output; auto = on a '
              'terminal only', choices=('auto', 'on', 'off'), read_only=True),
    Parameter('publish_rate', 30.0, 'rate of ~/poses, ~/wind_info and /clock', 'Hz', 0.1, 240.0),
    Parameter('marker_rate', 30.0, 'highest rate of ~/markers', 'Hz', 0.1, 240.0),
    Parameter('marker_triangles', 40_000, 'most triangles of leaves and twigs in ~/markers; of a '
              'scene that has more, fewer and larger leaves are drawn', '', 0, 10_000_000),
    Parameter('marker_mesh', 'package://procphys_ros/config/meshes/brick.dae',
              'mesh of a unit cube for bricks that have moved; empty = plain cubes, for viewers '
              'that cannot load it'),
    Parameter('real_time_factor', 1.0,
              'simulated seconds per second; 0 = as fast as possible', '', 0.0, 1000.0),
    Parameter('service_deadline', 0.15, 'how long a service waits for the simulation to come to '
              'it; then it is refused, and nothing is done', 's', 0.01, 3600.0),
    Parameter('wind.velocity', [0.0, 0.0, 0.0],
              'mean air velocity at wind.reference_height, the direction it blows to', 'm/s',
              -_FASTEST, _FASTEST),
    Parameter('wind.turbulence_intensity', 0.15,
              'standard deviation along the wind over mean speed', '', 0.0, 1.0),
    Parameter('wind.profile', 'log', 'growth of the mean wind with height',
              choices=('log', 'power', 'uniform')),
    Parameter('wind.roughness_length', 0.03,
              'of the log profile; grass 0.03, forest about 1', 'm', 1e-6, 5.0),
    Parameter('wind.exponent', 0.2, 'of the power profile', '', 0.0, 1.0),
    Parameter('wind.reference_height', 10.0, 'height at which wind.velocity holds', 'm',
              0.5, 300.0),
    Parameter('wind.spectrum', 'kaimal', 'spectrum of the turbulence',
              choices=('kaimal', 'von_karman')),
    Parameter('gust.amplitude', 10.0, 'change of the wind at the peak of ~/gust', 'm/s',
              -_FASTEST, _FASTEST, takes_effect='use'),
    Parameter('gust.duration', 5.0, 'from the first change to the last', 's', 0.05, 3600.0,
              takes_effect='use'),
    Parameter('gust.rise', 0.0, 'time a cosine gust takes to rise, and to fall; 0 = half of '
              'gust.duration', 's', 0.0, 1800.0, takes_effect='use', optional=True),
    Parameter('gust.direction', [0.0, 0.0, 0.0],
              'where the gust blows to; all 0 = along the mean wind', takes_effect='use',
              optional=True),
    Parameter('gust.kind', 'cosine', 'cosine (rise, hold, fall) or eog (IEC 61400-1 extreme '
              'operating gust)', choices=('eog', 'cosine'), takes_effect='use'),
    Parameter('gust.upwind', 30.0, 'distance of the gust front from the origin when it starts',
              'm', 0.0, 10000.0, takes_effect='use'),
    Parameter('leaves.flutter', True, 'whether leaves move finely about their petioles',
              takes_effect='reload'),
    Parameter('leaves.shedding', True, 'whether strong wind tears leaves off',
              takes_effect='reload'),
    Parameter('leaves.shedding_speed', SHEDDING_SPEED, 'least local wind that takes a leaf', 'm/s',
              0.5, 150.0, takes_effect='reload'),
    Parameter('dust.enabled', True, 'whether mortar and impacts raise dust',
              takes_effect='reload'),
    Parameter('dust.capacity', 20_000, 'puffs of dust; beyond it the oldest are forgotten', '',
              1, 1_000_000, takes_effect='reload'),
    Parameter('culling.distance', 0.0, 'trees further from ~/observer stand still; 0 = none do',
              'm', 0.0, 1e6, takes_effect='reload'),
    Parameter('culling.frustum', False, 'whether trees outside the widened view stand still',
              takes_effect='reload'),
    Parameter('culling.field_of_view', 1.0, 'vertical opening of the view', 'rad', 0.01, 3.13,
              takes_effect='reload'),
    Parameter('culling.aspect', 16.0 / 9.0, 'width over height of the picture', '', 0.1, 10.0,
              takes_effect='reload'),
    Parameter('culling.widening', 0.15, 'by which the view is opened on each side', 'rad',
              0.0, 1.57, takes_effect='reload'),
    Parameter('culling.sleeping', False, 'whether trees at rest in still air stop being stepped',
              takes_effect='reload'),
    Parameter('culling.far_distance', 40.0, 'where trees count as far', 'm', 1.0, 1e6,
              takes_effect='reload'),
    Parameter('culling.far_interval', 1, 'far trees go on once in so many steps; 1 = in every one',
              '', 1, 4, takes_effect='reload'),
    Parameter('culling.debris_distance', 0.0, 'what falls further from ~/observer breaks '
              'into few large pieces; 0 = nowhere', 'm', 0.0, 1e6, takes_effect='reload'),
    Parameter('intruder.shape', 'box', 'of the body that ~/intruder moves', choices=SHAPES,
              takes_effect='reload'),
    Parameter('intruder.size', [1.0, 1.0, 1.0], 'its diameter, or three edges', 'm', 1e-3, 50.0,
              takes_effect='reload', any_length=True),
    Parameter('state.file', '', 'that ~/save_state writes and ~/restore_state reads',
              takes_effect='use'),
    Parameter('impulse.target', '', 'part that ~/apply_impulse hits, as oak_0/17 or an index',
              takes_effect='use'),
    Parameter('impulse.linear', [0.0, 0.0, 0.0], 'impulse at its centre of mass', 'N·s',
              takes_effect='use'),
    Parameter('impulse.angular', [0.0, 0.0, 0.0], 'angular impulse', 'N·m·s',
              takes_effect='use'),
    Parameter('projectile.shape', 'sphere', 'of what ~/launch_projectile throws', choices=SHAPES,
              takes_effect='use'),
    Parameter('projectile.size', [0.3], 'its diameter, or three edges', 'm', 1e-3, 20.0,
              takes_effect='use', any_length=True),
    Parameter('projectile.mass', 30.0, 'its mass', 'kg', 1e-4, 1e6, takes_effect='use'),
    Parameter('projectile.position', [0.0, -10.0, 2.0], 'where its centre starts', 'm', -1e5, 1e5,
              takes_effect='use'),
    Parameter('projectile.velocity', [0.0, 20.0, 0.0], 'how fast it starts, in all at most 400',
              'm/s', -400.0, 400.0, takes_effect='use'),
    Parameter('explosion.position', [0.0, -5.0, 1.0], 'where ~/explode sets off its charge', 'm',
              -1e5, 1e5, takes_effect='use'),
    Parameter('explosion.charge', 10.0, 'mass of TNT of ~/explode and ~/explosion', 'kg', 1e-6,
              1e4, takes_effect='use'),
    Parameter('demolition.delays', [], 'when each charge of ~/demolish goes off; no charges = '
              'along the ground-floor walls, from the middle outwards', 's', 0.0, 3600.0,
              takes_effect='use', any_length=True),
    Parameter('demolition.positions', [], 'x y z of one charge after the other', 'm', -1e5, 1e5,
              takes_effect='use', any_length=True),
    Parameter('demolition.radii', [], 'in which each charge turns masonry to dust', 'm', 1e-3,
              100.0, takes_effect='use', any_length=True),
)

OBJECT = (
    Parameter('grammar', '', 'file in grammars/, a path, or package://procphys_ros/…',
              takes_effect='reload'),
    Parameter('grammar_text', '', 'the grammar itself, instead of a file',
              takes_effect='reload'),
    Parameter('defines', [], 'values that override the grammar\'s own, as "name=number"',
              takes_effect='reload'),
    Parameter('count', 0, 'instances, called oak_0, oak_1, …; 0 = one, called oak', '',
              0, 100_000, takes_effect='reload'),
    Parameter('layout', 'grid', 'how instances are placed', choices=('row', 'grid', 'scatter'),
              takes_effect='reload'),
    Parameter('spacing', 8.0, 'distance between instances', 'm', 1e-3, 1e5,
              takes_effect='reload'),
    Parameter('origin', [0.0, 0.0, 0.0], 'where the layout is centred', 'm', -1e6, 1e6,
              takes_effect='reload'),
    Parameter('yaw', 0.0, 'heading of every instance about the vertical', 'rad', -1e3, 1e3,
              takes_effect='reload'),
    Parameter('seed', -1, 'seed of the first instance; -1 = from the seed of the scene', '',
              -1, 2**62, takes_effect='reload'),
    Parameter('variants', 0, 'different individuals among the instances; 0 = all differ', '',
              0, 100_000, takes_effect='reload'),
)

_GLOBAL = {p.name: p for p in GLOBAL}
_OBJECT = {p.name: p for p in OBJECT}
_GROUPS = {name.split('.')[0] for name in _GLOBAL}


def find(name: str, objects: list[str]) -> Parameter | None:
    """
    Find the row of the table that describes a parameter; None when there is none.

    :param name: full name, as `wind.velocity` or `oak.count`.
    :param objects: names of the objects that have parameters.
    """
    owner, _, key = name.partition('.')
    return _GLOBAL.get(name) or (_OBJECT.get(key) if owner in objects else None)


def is_of_an_object(name: str) -> bool:
    """Say whether a full name is one that a parameter of some object could have."""
    owner, _, key = name.partition('.')
    return owner not in _GROUPS and key in _OBJECT


def check_object_names(names: list[str]) -> None:
    """Raise SceneError for a name that cannot head parameters, or would hide the node's own."""
    for name in names:
        if not _NAME.match(name):
            raise SceneError(f'scene.objects: {_short(name)} cannot name an object; use letters, '
                             'digits and _, beginning with a letter')
        if name in _GROUPS:
            raise SceneError(f'scene.objects: "{name}" cannot name an object, parameters of the '
                             f'node begin with it (taken: {", ".join(sorted(_GROUPS))})')


def nested(values: Mapping[str, Any], objects: list[str]) -> dict[str, Any]:
    """
    Give parameters as the nested mapping that a scene is built from.

    :param values: by full name.
    :param objects: names of the objects.
    """
    tree: dict[str, Any] = {}
    for name, value in values.items():
        parameter = find(name, objects)
        if parameter is None or parameter.optional and value == parameter.default:
            continue
        *groups, last = name.split('.')
        target = tree
        for group in groups:
            target = target.setdefault(group, {})
        target[last] = value
    return tree


def markdown(parameters: Sequence[Parameter], prefix: str = '') -> str:
    """
    Write rows of the table for the README.

    :param prefix: stands before each name.
    """
    lines = ['| parameter | default | unit | range | effect | meaning |',
             '|---|---|---|---|---|---|']
    for p in parameters:
        lines.append(f'| `{prefix}{p.name}` | {_shown(p.default)} | {p.unit} | {_range(p)} | '
                     f'{_effect(p)} | {p.description} |')
    return '\n'.join(lines)


def listing(parameters: Sequence[Parameter], prefix: str = '') -> str:
    """Write rows of the table for the docstring of the node's class; else as `markdown`."""
    lines = []
    for p in parameters:
        about = [_shown(p.default), p.unit, _range(p), _effect(p)]
        lines += wrap(f'{prefix}{p.name} ({"; ".join(filter(None, about))}): {p.description}',
                      width=99, initial_indent=8 * ' ', subsequent_indent=12 * ' ')
    return '\n'.join(lines)


def _effect(parameter: Parameter) -> str:
    if parameter.read_only:
        return 'fixed'
    return {'use': 'at use'}.get(parameter.takes_effect, parameter.takes_effect)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:.6g}'
    if isinstance(value, list):
        return f'[{", ".join(map(_shown, value))}]'
    return f'"{value}"' if isinstance(value, str) else str(value)


def _range(parameter: Parameter) -> str:
    if parameter.choices:
        return ', '.join(parameter.choices)
    if abs(parameter.high) >= _LARGEST and parameter.low <= -_LARGEST:
        return ''
    high = '' if parameter.high >= _LARGEST else f'{parameter.high:g}'
    return f'{parameter.low:g} … {high}'.strip()
