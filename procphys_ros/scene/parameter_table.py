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


"""The table of parameters: those of the node itself, and those that settings declare."""

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

from procphys_ros.errors import SceneError
from procphys_ros.physics.wind import Gust, WindSettings
from procphys_ros.scene.cues import Blow
from procphys_ros.scene.culling import CullingSettings
from procphys_ros.scene.earthquake import Earthquake, GroundSettings
from procphys_ros.scene.intruder import Downwash, IntruderSettings
from procphys_ros.scene.intruders import IntrudersSettings
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.objects import ObjectSpec
from procphys_ros.scene.particles import DustSettings, LeafSettings
from procphys_ros.scene.plants import Grow
from procphys_ros.scene.scenery import CameraSettings, SkySettings, SunSettings
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.shards import Shard
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.scene.spawn import Spawn
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.scene.terrain import TerrainSettings
from procphys_ros.scene.trees import TreeSettings
from procphys_ros.schema import LARGEST, NAME, Parameter, parameters, short

_SCENE = (
    Parameter('scene.objects', [], 'names of the objects that the scene holds',
              takes_effect='reload'),
    Parameter('scene.cues', [], 'what happens by itself: "<seconds> <verb> name=value …" with the '
              'verbs gust, wind, impulse, launch, explode, demolish, cut, earthquake, grow, '
              'joint, load; names as in gust.*, impulse.*, projectile.*, explosion.*, '
              'demolition.*, cut.*, earthquake.*, grow.*, load.*, which hold for all that is not '
              'said',
              takes_effect='reload'),
)
NODE = (
    Parameter('publish_clock', True, 'whether simulation time goes out on /clock', read_only=True),
    Parameter('publish_tf', False, 'whether /tf has a frame per object, named as it is, at the '
              'first part that is left of it; needs tf2_msgs', read_only=True),
    Parameter('status_line', 'auto', 'a line each second on the standard output; auto = on a '
              'terminal only', choices=('auto', 'on', 'off'), read_only=True),
    Parameter('publish_rate', 30.0, 'rate of ~/poses, ~/wind_info and /clock', 'Hz', 0.1, 240.0),
    Parameter('marker_rate', 30.0, 'highest rate of ~/markers', 'Hz', 0.1, 240.0),
    Parameter('marker_triangles', 40_000, 'most triangles of leaves and twigs in ~/markers; of a '
              'scene that has more, fewer and larger leaves are drawn', '', 0, 10_000_000),
    Parameter('marker_mesh', 'package://procphys_ros/config/meshes/brick.dae',
              'mesh of a unit cube for bricks that have moved; empty = plain cubes, for viewers '
              'that cannot load it'),
    Parameter('files.root', [], 'folders below which parameters may name files that are set after '
              'the start, besides those of this package; empty = the folders of the parameter '
              'files and of state.file', read_only=True),
    Parameter('real_time_factor', 1.0,
              'simulated seconds per second; 0 = as fast as possible', '', 0.0, 1000.0),
    Parameter('service_deadline', 0.15, 'how long a service waits for the simulation to come to '
              'it; then it is refused, and nothing is done', 's', 0.01, 3600.0),
)
GLOBAL = (
    *_SCENE,
    *parameters(Settings, takes_effect='reload'),
    Parameter('world_frame', 'world', 'frame of everything published', read_only=True),
    *parameters(Shard, read_only=True),
    *NODE,
    *parameters(WindSettings),
    *parameters(Gust, takes_effect='use'),
    *parameters(SnowLoad),
    *parameters(TreeSettings, takes_effect='reload'),
    *parameters(LeafSettings, takes_effect='reload'),
    *parameters(DustSettings, takes_effect='reload'),
    *parameters(CullingSettings, takes_effect='reload'),
    *parameters(IntruderSettings, takes_effect='reload'),
    *parameters(IntrudersSettings, read_only=True),
    *parameters(Downwash, takes_effect='use'),
    *parameters(TerrainSettings, takes_effect='reload'),
    Parameter('state.file', '', 'that ~/save_state writes and ~/restore_state reads; a mere name '
              'is one in the first of the folders of files.root', takes_effect='use'),
    *parameters(Blow, takes_effect='use'),
    *parameters(Projectile, takes_effect='use'),
    *parameters(Explosion, takes_effect='use'),
    *parameters(Demolition, takes_effect='use'),
    *parameters(Cut, takes_effect='use'),
    *parameters(GroundSettings),
    *parameters(Earthquake, takes_effect='use'),
    *parameters(Grow, takes_effect='use'),
    *parameters(Spawn, takes_effect='use'),
    Parameter('inspect.part', '', 'name or index of the part that ~/inspect describes',
              takes_effect='use'),
    *parameters(LidarSettings),
    *parameters(CameraSettings, takes_effect='use'),
    *parameters(SunSettings, takes_effect='use'),
    *parameters(SkySettings, takes_effect='use'),
)
OBJECT = parameters(ObjectSpec, takes_effect='reload')

_GLOBAL = {p.name: p for p in GLOBAL}
_OBJECT = {p.name: p for p in OBJECT}
GROUPS = frozenset(name.split('.')[0] for name in _GLOBAL)
"""What parameters of the node begin with."""


def find(name: str, objects: list[str]) -> Parameter | None:
    """
    Find the row of the table that describes a parameter; None when there is none.

    :param name: full name, as `wind.velocity` or `oak.count`.
    :param objects: names of the objects that have parameters.
    """
    owner, _, key = name.partition('.')
    return _GLOBAL.get(name) or (_OBJECT.get(key) if owner in objects else None)


def is_of_an_object(name: str) -> bool:
    """Return whether a full name is one that a parameter of some object could have."""
    owner, _, key = name.partition('.')
    return owner not in GROUPS and key in _OBJECT


def check_object_names(names: list[str]) -> None:
    """Raise SceneError for a name that cannot begin parameters, or would hide the node's own."""
    for name in names:
        if not NAME.match(name):
            raise SceneError(f'scene.objects: {short(name)} cannot name an object; use letters, '
                             'digits and _, beginning with a letter')
        if name in GROUPS:
            raise SceneError(f'scene.objects: "{name}" cannot name an object, parameters of the '
                             f'node begin with it (taken: {", ".join(sorted(GROUPS))})')


def nested(values: Mapping[str, Any], objects: list[str]) -> dict[str, Any]:
    """
    Convert parameters to the nested mapping that a scene is built from.

    :param values: by full name.
    :param objects: names of the objects.
    """
    tree: dict[str, Any] = {}
    for name, value in values.items():
        parameter = find(name, objects)
        if parameter is None or parameter.optional and value == parameter.default:
            continue
        put(tree, name, value)
    return tree


def put(tree: dict[str, Any], name: str, value: Any) -> None:
    """Set a value in nested parameters by its full name."""
    *groups, last = name.split('.')
    for group in groups:
        tree = tree.setdefault(group, {})
    tree[last] = value


def markdown(parameters: Sequence[Parameter], prefix: str = '') -> str:
    """
    Write rows of the table for docs/parameters.md.

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
    if abs(parameter.high) >= LARGEST and parameter.low <= -LARGEST:
        return ''
    high = '' if parameter.high >= LARGEST else f'{parameter.high:g}'
    return f'{parameter.low:g} … {high}'.strip()
