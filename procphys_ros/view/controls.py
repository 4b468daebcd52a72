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


"""Controls: sliders and buttons beside the scene, and their commands."""

from collections.abc import Callable, Mapping
import math
from pathlib import Path
from typing import Any

from procphys_ros.physics.wind import FASTEST
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.simulation.commands import SetWind
from procphys_ros.view.clicks import effect, Strength, Tool
from procphys_ros.view.commands import (
    LoadScene,
    Reset,
    SetPause,
    SetSpeed,
    StartEarthquake,
    StartGust,
    Step,
    Undo,
)
from procphys_ros.view.source import Status

_USUAL_FACTOR = 4.0  # largest real-time factor of the slider, unless the source has a larger one
_FASTEST = (1.0 - 1e-12) * FASTEST  # [m/s] below the limit in spite of rounding
_STEP, _RESET, _UNDO, _GUST = 'step', 'reset', 'undo', 'gust'
_SHAKE = 'earthquake'
_DEEP, _THICK = 300.0, 50.0  # [kg/m²] snow on Alpine villages, [mm] ice in the worst storms


class Controls:
    """
    Build the panel, convert its events to commands, and show the status of the source.

    :param gui: `ViserServer.gui`.
    :param say: called with commands.
    :param scenes: files that may be loaded, by name; none = no choice of scenes.
    :param can_undo: whether there is an undo button.
    """

    def __init__(self, gui: Any, say: Callable[[Any], None], scenes: Mapping[str, Path],
                 can_undo: bool):
        self._say = say
        self._shown: Status | None = None
        self._scenes = scenes
        self._state = gui.add_markdown('')
        self._add_tools(gui)
        self._add_time(gui, [_STEP, _RESET, *[_UNDO] * can_undo])
        self._add_wind(gui)
        self._add_snow(gui)
        self._add_ground(gui)
        if scenes:
            self._add_scenes(gui)

    @property
    def strength(self) -> Strength:
        """Return the strengths of the tools."""
        return Strength(self.push.value, self.ball_mass.value, self.ball_size.value,
                        self.ball_speed.value, self.charge.value)

    def show(self, status: Status, answer: str) -> None:
        """Show the status of the source; changes by others move the sliders."""
        text = status.text if status.alive else f'**{status.text or "no answer"}**'
        text = f'**{status.scene}**  \n{text}' if status.scene else text
        text += f'  \n{answer}' if answer else ''
        if self._state.content != text:
            self._state.content = text
        old, self._shown = self._shown, status
        if not status.alive:
            return
        if old is None or old.paused != status.paused:
            self.pause.value = status.paused
        if old is None or old.factor != status.factor:
            self.factor.max = max(_USUAL_FACTOR, status.factor)
            self.factor.value = status.factor
        if old is None or old.wind != status.wind:
            x, y, _ = status.wind
            speed = math.hypot(x, y)
            self.wind.value = round(speed, 1)
            if speed:
                self.direction.value = round(math.degrees(math.atan2(y, x))) % 360
        if self._scenes and (old is None or old.scene != status.scene):
            other = [status.scene] * (status.scene not in self._scenes)
            self.scene.options = (*other, *self._scenes)
            self.scene.value = status.scene

    def show_selected(self, text: str) -> None:
        """Show the description of the clicked part."""
        self.selected.content = text

    def _add_tools(self, gui: Any) -> None:
        usual = Strength()
        self.tool = gui.add_dropdown('tool', [str(tool) for tool in Tool],
                                     hint='what a click into the scene does')
        self.push = gui.add_slider('push [m/s]', 0.5, 50.0, 0.5, usual.push)
        self.ball_mass = gui.add_slider('ball [kg]', 0.5, 500.0, 0.5, usual.ball_mass)
        self.ball_size = gui.add_slider('ball [m]', 0.05, 1.5, 0.05, usual.ball_size)
        self.ball_speed = gui.add_slider('ball [m/s]', 1.0, 100.0, 1.0, usual.ball_speed)
        self.charge = gui.add_slider('charge [kg]', 0.1, 100.0, 0.1, usual.charge)
        self.effect = gui.add_markdown('')
        self.selected = gui.add_markdown('')
        balls = self.ball_mass, self.ball_size, self.ball_speed
        self._users = [(self.push, (Tool.PUSH, Tool.PULL)), (self.charge, (Tool.CHARGE,)),
                       *((handle, (Tool.BALL,)) for handle in balls)]
        for handle in (self.tool, self.push, *balls, self.charge):
            handle.on_update(lambda _: self._show_tool())
        self._show_tool()

    def _show_tool(self) -> None:
        """Show the sliders of the selected tool, and the effect of a click."""
        tool = Tool(self.tool.value)
        for slider, tools in self._users:
            slider.visible = tool in tools
        self.effect.content = effect(tool, self.strength)

    def _add_time(self, gui: Any, buttons: list[str]) -> None:
        with gui.add_folder('Time'):
            self.pause = gui.add_checkbox('pause', False)
            self.factor = gui.add_slider('speed', 0.0, _USUAL_FACTOR, 0.05, 1.0,
                                         hint='simulated over real time; 0 = as fast as it goes')
            self.time = gui.add_button_group('', buttons)
        commands = {_STEP: Step(), _RESET: Reset(), _UNDO: Undo()}
        _on_user(self.pause.on_update, lambda: self._say(SetPause(self.pause.value)))
        _on_user(self.factor.on_update, lambda: self._say(SetSpeed(self.factor.value)))
        _on_user(self.time.on_click, lambda: self._say(commands[self.time.value]))

    def _add_wind(self, gui: Any) -> None:
        with gui.add_folder('Wind'):
            self.wind = gui.add_slider('speed [m/s]', 0.0, FASTEST, 0.1, 0.0)
            self.direction = gui.add_slider('to [°]', 0, 359, 1, 0,
                                            hint='the way it blows to; 0 = x, 90 = y')
            self.gust_speed = gui.add_slider('gust [m/s]', 1.0, FASTEST, 1.0, 15.0)
            self.gust = gui.add_button_group('', [_GUST])
        _on_user(self.wind.on_update, self._blow)
        _on_user(self.direction.on_update, self._blow)
        _on_user(self.gust.on_click, lambda: self._say(StartGust(self.gust_speed.value)))

    def _add_snow(self, gui: Any) -> None:
        with gui.add_folder('Snow', expand_by_default=False):
            self.snow = gui.add_slider('snow [kg/m²]', 0.0, _DEEP, 5.0, 0.0,
                                       hint='on open ground; trees and roofs catch their share')
            self.ice = gui.add_slider('ice [mm]', 0.0, _THICK, 1.0, 0.0,
                                      hint='thickness of a coat around all twigs')
        for slider in (self.snow, self.ice):
            _on_user(slider.on_update, lambda: self._say(
                SnowLoad(self.snow.value, 1e-3 * self.ice.value)))

    def _add_ground(self, gui: Any) -> None:
        with gui.add_folder('Ground', expand_by_default=False):
            self.peak = gui.add_slider('up to [m/s²]', 0.5, 15.0, 0.5, 3.0,
                                       hint='greatest acceleration of a synthetic earthquake')
            self.shake = gui.add_button_group('', [_SHAKE])
        _on_user(self.shake.on_click, lambda: self._say(StartEarthquake(self.peak.value)))

    def _blow(self) -> None:
        angle = math.radians(self.direction.value)
        rising = self._shown.wind[2] if self._shown is not None else 0.0
        speed = min(self.wind.value, math.sqrt(max(_FASTEST ** 2 - rising ** 2, 0.0)))
        self._say(SetWind((speed * math.cos(angle), speed * math.sin(angle), rising)))

    def _add_scenes(self, gui: Any) -> None:
        with gui.add_folder('Scene', expand_by_default=False):
            self.scene = gui.add_dropdown('scene', list(self._scenes))
            self.load = gui.add_button('load')
        _on_user(self.load.on_click, self._load)

    def _load(self) -> None:
        if self.scene.value in self._scenes:  # the running scene may not be in the list
            self._say(LoadScene(self._scenes[self.scene.value]))


def _on_user(register: Callable, act: Callable[[], None]) -> None:
    """Call a function after input at a page, but not after changes from the program."""
    def react(event: Any) -> None:
        if event.client is not None:
            act()
    register(react)
