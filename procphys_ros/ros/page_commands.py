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


"""Page commands: send what is done on a page to the node, in order."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from queue import Empty, Queue
from threading import Event, Thread
from time import monotonic
from typing import Any

from rclpy.executors import ExternalShutdownException

from procphys_ros.errors import ProcPhysError
from procphys_ros.ros.remote import NoNodeError, Remote
from procphys_ros.scene.named import shipped_scenes
from procphys_ros.scene.parameter_table import GLOBAL, OBJECT
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.scene.strikes import Cut, Explosion, Projectile
from procphys_ros.scene.unused import flat
from procphys_ros.scene.yaml_file import read_yaml
from procphys_ros.schema import ParameterGroup
from procphys_ros.simulation.commands import Impulse, SetWind
from procphys_ros.view.commands import (
    CLICKS,
    drop_clicks,
    Inspect,
    LoadScene,
    Reset,
    SetPause,
    SetSpeed,
    StartEarthquake,
    StartGust,
    Step,
)
from procphys_ros.view.source import shortened

_TURN = 0.1      # [s] between checks for its end
_TIMEOUT = 3.0   # [s] to look for the node
_LONG_PATIENCE = 600.0  # [s] for a scene to be built
_LOOK = 1.0      # [s] between reads of the node's wind
# Parameters that a scene has besides those of a reload: its wind and snow, and the groups of cues.
_OF_SCENES = ('wind.', 'gust.', 'impulse.', 'projectile.', 'explosion.', 'demolition.', 'cut.',
              'earthquake.', 'load.')


class PageCommands:
    """
    Send commands to a node in a separate thread, because each waits for its answer.

    :param name: of the node.
    :param patience: time to wait for an answer [s]; a node that dies gives none.
    :ivar answer: to the last command.
    :ivar known: last known mean wind of the node [m/s], (3,).
    :ivar scene: name of the node's scene; '' = not known yet.
    """

    def __init__(self, name: str, patience: float):
        self._name, self._patience = name, patience
        self.answer = ''
        self.known: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self.scene = ''
        self._is_new = True  # so that the name of the scene has to be found
        self._queue: Queue[Any] = Queue()
        self._ended = Event()
        self._thread = Thread(target=self._work, name='commands', daemon=True)
        self._remote: Remote | None = None
        self._next_look = 0.0

    def start(self) -> None:
        """Begin to execute commands."""
        self._thread.start()

    def close(self) -> None:
        """End, without waiting for an answer: a thread left inside ROS would abort the process."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def put(self, command: Any) -> None:
        """Queue a command."""
        self._queue.put(command)

    def find_scene(self) -> None:
        """Find the name of the node's scene at the next turn."""
        self._is_new = True

    def _work(self) -> None:
        try:
            while not self._ended.is_set():
                self._turn()
            if self._remote is not None:
                self._remote.close()
        except (ExternalShutdownException, RuntimeError):  # ROS was shut down meanwhile
            if not self._ended.is_set():
                raise

    def _turn(self) -> None:
        waiting = self._take()
        try:
            if self._remote is None:
                self._remote = Remote(self._name, _TIMEOUT, self._patience, self._ended)
            if waiting:
                self.answer = self._answer_to(self._remote, waiting)
            if monotonic() > self._next_look:
                self._next_look = monotonic() + _LOOK
                self._remote.patience = self._patience
                (x, y, z), objects = self._remote.values(['wind.velocity', 'scene.objects'])
                self.known = (x, y, z)
                if self._is_new:
                    self._is_new = False
                    self.scene = scene_of(self._remote, objects or [])
        except NoNodeError as error:
            self.answer = str(error) if waiting else self.answer
            if self._remote is not None:
                self._remote.close()
                self._remote = None
        except ProcPhysError as error:
            self.answer = str(error)

    def _answer_to(self, remote: Remote, commands: Sequence[Any]) -> str:
        """Execute commands; return the refusals, which stop no others, or the answer."""
        refusals, answer, is_new = [], '', False
        for command in commands:
            if is_new and isinstance(command, CLICKS):
                continue
            remote.patience = (_LONG_PATIENCE if isinstance(command, LoadScene)
                               else self._patience)
            try:
                answer = carry_out(remote, command)
            except ProcPhysError as error:
                refusals.append(str(error))
            else:
                if isinstance(command, LoadScene):
                    is_new = True
                    drop_clicks(self._queue)
        return '; '.join(refusals) or answer

    def _take(self) -> list[Any]:
        """Wait a moment for commands; keep only the last position of each slider."""
        waiting = []
        try:
            waiting.append(self._queue.get(timeout=_TURN))
            while True:
                waiting.append(self._queue.get_nowait())
        except Empty:
            pass
        last = {type(command): i for i, command in enumerate(waiting)}
        return [command for i, command in enumerate(waiting)
                if not isinstance(command, SetWind | SetSpeed) or last[type(command)] == i]


def carry_out(remote: Remote, command: Any) -> str:
    """
    Send a command of a page to a node.

    :param remote: the node.
    :param command: see `Source.say`.
    :returns: the answer of the node.
    :raises CommandError: if it refuses.
    :raises SceneError: if a scene file cannot be read.
    :raises NoNodeError: if it does not answer.
    """
    return _ACTIONS[type(command)](remote, command) or ''


def scene_of(remote: Remote, objects: Sequence[str]) -> str:
    """
    Return the name of the shipped scene with the objects and parameters of a node.

    :param remote: the node.
    :param objects: their names.
    :returns: the names of the objects if there is none.
    """
    for name, given in _shipped().items():
        own = [key for key in given if key.partition('.')[0] in objects]
        if list(given.get('scene.objects', [])) == list(objects) and (
                remote.values(own) == [given[key] for key in own]):
            return name
    return shortened(objects)


@cache
def _shipped() -> Mapping[str, Mapping[str, Any]]:
    """Read the parameters of the shipped scenes, by their names."""
    return {name: dict(flat(read_yaml(path))) for name, path in shipped_scenes().items()}


def _described(service: str) -> Callable[[Remote, ParameterGroup], str]:
    """Set the parameters that a command declares, and call the service that reads them."""
    def act(remote: Remote, command: Any) -> str:
        return remote.trigger(service, {f'{command.group}.{name}': value
                                        for name, value in asdict(command).items()})
    return act


def _load(remote: Remote, scene: LoadScene) -> str:
    """Set the parameters of a scene file on the node; reset missing ones to their defaults."""
    given = dict(flat(read_yaml(scene.path)))
    objects = list(given.get('scene.objects', []))
    wanted = {p.name: p.default for p in GLOBAL if _belongs_to_scene(p)}
    wanted |= {f'{name}.{p.name}': p.default for name in objects for p in OBJECT}
    wanted |= {name: value for name, value in given.items() if name in wanted}
    remote.change(wanted)
    return remote.trigger('reload_scene')


def _belongs_to_scene(parameter: Any) -> bool:
    name = parameter.name
    return not parameter.read_only and (
        parameter.takes_effect == 'reload' or name.startswith(_OF_SCENES))


_ACTIONS: dict[type, Callable[[Remote, Any], str | None]] = {
    SetPause: lambda remote, c: remote.switch('set_pause', c.paused),
    Step: lambda remote, c: remote.trigger('step_simulation'),
    Reset: lambda remote, c: remote.trigger('reset_simulation'),
    SetSpeed: lambda remote, c: remote.change({'real_time_factor': c.factor}),
    SnowLoad: lambda remote, c: remote.change({'load.snow': c.snow, 'load.ice': c.ice}),
    SetWind: lambda remote, c: remote.change({'wind.velocity': list(c.velocity)}),
    Impulse: lambda remote, c: remote.push('impulse', str(c.part), c.linear, c.angular),
    Inspect: lambda remote, c: remote.trigger('inspect', {'inspect.part': str(c.part)}),
    StartGust: lambda remote, c: remote.trigger('gust', {'gust.amplitude': c.amplitude}),
    StartEarthquake: lambda remote, c: remote.trigger('earthquake', {'earthquake.peak': c.peak}),
    Projectile: _described('launch_projectile'), Explosion: _described('explode'),
    Cut: _described('cut'), LoadScene: _load,
}
