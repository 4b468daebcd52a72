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


"""Cues: timed events of a scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from procphys_ros.errors import nearest_names, ProcPhysError, SceneError
from procphys_ros.physics.wind import Gust, MeanWind
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.joint_drive import DriveJoint
from procphys_ros.scene.plants import Grow
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.schema import clip, declared, ParameterGroup, read_words

_LATEST = 1e6  # [s]
_FORM = '"<seconds> <verb> name=value …", such as "2.5 launch mass=300 velocity=0,20,0"'


@dataclass(frozen=True)
class Blow(ParameterGroup, group='impulse'):
    """Impulse on a part."""

    target: str = declared('', 'part that ~/apply_impulse hits, as oak_0/17 or an index')
    linear: Sequence[float] = declared(
        (0.0, 0.0, 0.0), 'impulse at its centre of mass', 'N·s')
    angular: Sequence[float] = declared((0.0, 0.0, 0.0), 'angular impulse', 'N·m·s')


_VERBS: dict[str, type[ParameterGroup]] = {
    'gust': Gust, 'wind': MeanWind, 'impulse': Blow, 'launch': Projectile, 'explode': Explosion,
    'demolish': Demolition, 'cut': Cut, 'earthquake': Earthquake, 'grow': Grow,
    'joint': DriveJoint, 'load': SnowLoad}


@dataclass(frozen=True)
class Cue:
    """
    Event at a simulated time.

    :ivar time: simulated [s].
    :ivar text: as written in the scene.
    :ivar what: a `Gust`, `MeanWind`, `Blow`, `Projectile`, `Explosion`, `Demolition`, `Cut`,
        `Earthquake`, `Grow`, `DriveJoint` or `SnowLoad`.
    """

    time: float
    text: str
    what: Any


def read_cues(parameters: Mapping[str, Any]) -> tuple[Cue, ...]:
    """
    Read `scene.cues`; values that a cue omits are those of `gust.*`, `projectile.*` etc.

    :param parameters: nested mapping as a ROS parameter file holds it.
    :returns: the cues in the order of their times.
    :raises SceneError: naming the cue, the fault and what is allowed.
    """
    scene = parameters.get('scene', {})
    texts = scene.get('cues', []) if isinstance(scene, Mapping) else []
    if isinstance(texts, str) or not isinstance(texts, Sequence) \
            or not all(isinstance(text, str) for text in texts):
        raise SceneError(f'scene.cues is {clip(repr(texts))}, it must be a list of texts, each '
                         f'{_FORM}')
    cues = [_read(text, number, parameters) for number, text in enumerate(texts) if text.strip()]
    return tuple(sorted(cues, key=lambda cue: cue.time))


def _read(text: str, number: int, parameters: Mapping[str, Any]) -> Cue:
    try:
        time, verb, *words = text.split() if len(text.split()) > 1 else (text, '')
        if verb not in _VERBS:
            near = nearest_names(verb[:99], _VERBS)
            raise SceneError(f'there is no verb "{clip(verb)}"{near} ({", ".join(_VERBS)}); the '
                             f'form is {_FORM}')
        kind = _VERBS[verb]
        base = parameters.get(kind.group)
        # Those of wind.* are not what it changes to.
        base = dict(base) if isinstance(base, Mapping) and kind is not MeanWind else {}
        return Cue(_seconds(time), text, kind(**{**base, **read_words(words, kind)}))
    except ProcPhysError as error:
        raise SceneError(f'scene.cues[{number}] "{clip(text)}": {error}') from error


def _seconds(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= _LATEST:
        raise SceneError(f'"{clip(word)}" is not a time from 0 to {_LATEST:g} s; the form is '
                         f'{_FORM}')
    return value
