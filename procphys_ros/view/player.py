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


"""Player: a simulation of this process, in its own thread at its own pace."""

from collections.abc import Callable
from dataclasses import replace
from queue import Empty, Queue
from threading import Event, Thread
from time import perf_counter
from typing import Any

import numpy as np

from procphys_ros.errors import ProcPhysError
from procphys_ros.scene import Scene
from procphys_ros.simulation import readings, Simulation
from procphys_ros.view.commands import (
    drop_clicks,
    Inspect,
    LoadScene,
    Reset,
    SetPause,
    SetSpeed,
    StartEarthquake,
    StartGust,
    Step,
    Undo,
    UNDONE,
)
from procphys_ros.view.source import Frame, PageContent, shortened, Status

_TURN = 0.01        # [s] between checks of the clock
_LONGEST = 0.05     # [s] of steps before commands and frames get a turn
_MOST_BEHIND = 0.1  # [s] of wall time that is caught up; a longer delay is dropped
_NONE_BROKEN = np.zeros((0, 2), int)
FRAME_PERIOD = 0.05  # [s] between frames


class Player:
    """
    Run a simulation and execute commands between its steps.

    :param simulation: must not be used elsewhere while it is played.
    :param name: of its scene; '' = the names of its objects.
    :ivar simulation: the present one.
    :ivar watched: whether frames are needed.
    """

    can_undo = True

    def __init__(self, simulation: Simulation, name: str = ''):
        self.simulation = simulation
        self.watched = True
        self._name = name or shortened(placed.name for placed in simulation.objects)
        self._before: bytes | None = None  # the state that `Undo` restores
        self._queue: Queue[Any] = Queue()
        self._ended = Event()
        self._paused, self._factor, self._scene = False, 1.0, 0
        self._answer, self._activity = '', ''
        self._known_breaks, self._broken = 0, _NONE_BROKEN
        self._bonds = 0  # of the content
        self._content = self._describe()
        self._frame = self._take_frame()
        self._last_frame, self._last_turn = -np.inf, np.nan
        self._behind = 0.0
        self._has_news = False
        self._thread = Thread(target=self._play, name='player', daemon=True)
        self._actions: dict[type, Callable[[Any], str]] = {
            SetPause: self._set_pause, Step: self._step_once, Reset: self._reset,
            Undo: self._undo, SetSpeed: self._set_speed, StartGust: self._gust,
            StartEarthquake: self._shake,
            Inspect: self._inspect, LoadScene: self._load}

    def start(self) -> None:
        """Start playing."""
        self._thread.start()

    def close(self) -> None:
        """Stop playing and wait for the present step."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def frame(self) -> Frame | None:
        """Return the newest frame."""
        return self._frame

    def status(self) -> Status:
        """Describe the state of the simulation."""
        simulation = self.simulation
        text = self._activity or (f'{simulation.time:.1f} s, {len(simulation.poses)} parts, '
                                  f'{simulation.bonds_broken} bonds broken')
        wind = simulation.wind.mean_velocity(simulation.time)
        return Status(True, text, simulation.time, self._paused, self._factor,
                      (float(wind[0]), float(wind[1]), float(wind[2])), self._name)

    def say(self, command: Any) -> None:
        """Queue a command for execution between two steps."""
        self._queue.put(command)

    def answer(self) -> str:
        """Return the answer to the last command."""
        return self._answer

    def turn(self, now: float) -> None:
        """
        Execute waiting commands, run the steps that are due, and keep the newest frame.

        :param now: any clock [s].
        """
        while True:
            try:
                command = self._queue.get_nowait()
            except Empty:
                break
            self._carry_out(command)
        elapsed = 0.0 if np.isnan(self._last_turn) else now - self._last_turn
        self._last_turn = now
        if not self._paused:
            self._run(elapsed)
        if self._has_news and self.watched and now - self._last_frame >= FRAME_PERIOD:
            self._frame, self._last_frame, self._has_news = self._take_frame(), now, False

    def _play(self) -> None:
        while not self._ended.wait(0.0 if self._is_late() else _TURN):
            try:
                self.turn(perf_counter())
            except Exception as error:  # a page that stands still must show the reason
                self._paused = True
                self._answer = f'stopped: {type(error).__name__}: {error}'

    def _is_late(self) -> bool:
        return not self._paused and (self._factor == 0.0
                                     or self._behind >= self.simulation.time_step)

    def _run(self, elapsed: float) -> None:
        step, end = self.simulation.time_step, perf_counter() + _LONGEST
        self._behind = min(self._behind + elapsed * self._factor,
                           max(_MOST_BEHIND * self._factor, step))
        while self._is_late() and perf_counter() < end:
            self.simulation.step()
            self._has_news = True
            self._behind -= step if self._factor else 0.0

    def _carry_out(self, command: Any) -> None:
        before = self.simulation.save() if isinstance(command, UNDONE) else None
        try:
            action = self._actions.get(type(command))
            if action is None:
                self.simulation.apply(command)
                self._answer = ''
            else:
                self._answer = action(command)
            self._has_news = True
            if isinstance(command, UNDONE):
                self._before = before
        except ProcPhysError as error:
            self._answer = str(error)

    def _set_pause(self, command: SetPause) -> str:
        self._paused, self._behind = command.paused, 0.0
        return ''

    def _step_once(self, command: Step) -> str:
        if not self._paused:
            return 'pause first'
        self.simulation.step()
        return ''

    def _reset(self, command: Reset) -> str:
        self.simulation.reset()
        self._follow()  # before an equal number of parts may have joined again
        self._known_breaks, self._broken = 0, _NONE_BROKEN
        return ''

    def _undo(self, command: Undo) -> str:
        if self._before is None:
            return 'nothing to undo'
        self.simulation.restore(self._before)
        self._before = None
        self._follow()
        self._known_breaks, self._broken = 0, _NONE_BROKEN
        return f'back at {self.simulation.time:.1f} s'

    def _set_speed(self, command: SetSpeed) -> str:
        self._factor, self._behind = command.factor, 0.0
        return ''

    def _gust(self, command: StartGust) -> str:
        self.simulation.gust(replace(self.simulation.model.settings.gust,
                                     amplitude=command.amplitude))
        return '' if self.simulation.wind.enabled else 'the wind is off: no gust is felt'

    def _shake(self, command: StartEarthquake) -> str:
        self.simulation.shake(replace(self.simulation.model.settings.earthquake,
                                      peak=command.peak))
        return ''

    def _inspect(self, command: Inspect) -> str:
        part = self.simulation.names.index(command.part)
        return readings.describe_load(self.simulation.state, part)

    def _load(self, command: LoadScene) -> str:
        self._activity = f'loading {command.path.stem}'
        try:
            simulation = Simulation(Scene.from_yaml(command.path))
            self.simulation.close()
            self.simulation = simulation
            self._scene += 1
            self._name, self._before = command.path.stem, None
            self._known_breaks, self._broken = 0, _NONE_BROKEN
            self._content = self._describe()
            drop_clicks(self._queue)
        finally:
            self._activity = ''
        return ''

    def _describe(self, before: PageContent | None = None) -> PageContent:
        blueprint = self.simulation.state.blueprint  # plants as they are at the end of the year
        bonds, self._bonds = self._bonds, len(blueprint.bonds)
        made = PageContent.of(blueprint, self.simulation.names.name, self._scene,
                              self.simulation.model.terrain, self.simulation.scene.paving,
                              before if self._bonds == bonds else None)
        self._layouts = self.simulation.layouts
        return replace(made, wood=None) if self._layouts else made

    def _follow(self) -> None:
        """Describe the scene again after parts have joined, or were removed by a reset."""
        count, before = len(self.simulation.state.parts), self._content
        if count < len(before) or self.simulation.layouts != self._layouts:
            self._scene += 1
        if count != len(before) or self._scene != before.scene:
            self._content = self._describe(before if self._scene == before.scene else None)

    def _take_frame(self) -> Frame:
        simulation = self.simulation
        self._follow()
        return Frame(self._content, simulation.state.shown_poses().copy(), simulation.leaf_poses(),
                     simulation.dust, self._broken_bonds())

    def _broken_bonds(self) -> np.ndarray:
        log = self.simulation.log
        if log.total < self._known_breaks:  # time has jumped back
            self._known_breaks, self._broken = 0, _NONE_BROKEN
        new = min(log.total - self._known_breaks, len(log.rows))
        self._known_breaks = log.total
        if new:
            rows = log.rows[-new:]
            pairs = np.stack([rows['part_a'], rows['part_b']], axis=-1)
            self._broken = np.concatenate([self._broken, pairs])
        return self._broken
