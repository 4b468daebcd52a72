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

from procphys_ros.simulation.commands import SetWind
from procphys_ros.view.clicks import Strength
from procphys_ros.view.commands import LoadScene, Reset, SetPause, SetSpeed, StartGust, Step
from procphys_ros.view.source import Status

_STRONGEST_WIND = 40.0  # [m/s] of the slider, a hurricane
_FASTEST = 4.0  # real-time factor of the slider
_HELP = 'Click a branch to pull it, a wall to throw a ball at it, the ground to set off a charge.'


class Controls:
    """
    Builds the panel, turns what is done there into commands, and shows how the source is.

    :param gui: `ViserServer.gui`.
    :param say: takes commands.
    :param scenes: files that may be loaded, by name; none = no choice of scenes.
    """

    def __init__(self, gui: Any, say: Callable[[Any], None], scenes: Mapping[str, Path]):
        self._say = say
        self._shown: Status | None = None
        self._state = gui.add_markdown('')
        self._add_time(gui)
        self._add_wind(gui)
        self._add_clicks(gui)
        if scenes:
            self._add_scenes(gui, scenes)

    @property
    def strength(self) -> Strength | None:
        """Say how strong clicks are; None = they only show what was clicked."""
        if not self.acts.value:
            return None
        return Strength(self.pull.value, self.ball_mass.value, self.ball_size.value,
                        self.ball_speed.value, self.charge.value)

    def show(self, status: Status, answer: str) -> None:
        """Show how the source is; what others have changed moves the sliders."""
        text = status.text if status.alive else f'**{status.text or "no answer"}**'
        text += f'  \n{answer}' if answer else ''
        if self._state.content != text:
            self._state.content = text
        old, self._shown = self._shown, status
        if not status.alive:
            return
        if old is None or old.paused != status.paused:
            self.pause.value = status.paused
        if old is None or old.factor != status.factor:
            self.factor.value = min(status.factor, _FASTEST)
        if old is None or old.wind != status.wind:
            x, y, _ = status.wind
            speed = math.hypot(x, y)
            self.wind.value = min(round(speed, 1), _STRONGEST_WIND)
            if speed:
                self.direction.value = round(math.degrees(math.atan2(y, x))) % 360

    def show_selected(self, text: str) -> None:
        """Show what was clicked."""
        self.selected.content = text

    def _add_time(self, gui: Any) -> None:
        with gui.add_folder('Time'):
            self.pause = gui.add_checkbox('pause', False)
            self.factor = gui.add_slider('speed', 0.0, _FASTEST, 0.05, 1.0,
                                         hint='simulated over real time; 0 = as fast as it goes')
            self.step = gui.add_button('step')
            self.reset = gui.add_button('reset')
        _on_user(self.pause.on_update, lambda: self._say(SetPause(self.pause.value)))
        _on_user(self.factor.on_update, lambda: self._say(SetSpeed(self.factor.value)))
        _on_user(self.step.on_click, lambda: self._say(Step()))
        _on_user(self.reset.on_click, lambda: self._say(Reset()))

    def _add_wind(self, gui: Any) -> None:
        with gui.add_folder('Wind'):
            self.wind = gui.add_slider('speed [m/s]', 0.0, _STRONGEST_WIND, 0.1, 0.0)
            self.direction = gui.add_slider('to [°]', 0, 359, 1, 0,
                                            hint='the way it blows to; 0 = x, 90 = y')
            self.gust_speed = gui.add_slider('gust [m/s]', 1.0, _STRONGEST_WIND, 1.0, 15.0)
            self.gust = gui.add_button('gust')
        _on_user(self.wind.on_update, self._blow)
        _on_user(self.direction.on_update, self._blow)
        _on_user(self.gust.on_click, lambda: self._say(StartGust(self.gust_speed.value)))

    def _blow(self) -> None:
        angle = math.radians(self.direction.value)
        self._say(SetWind((self.wind.value * math.cos(angle), self.wind.value * math.sin(angle),
                           0.0)))

    def _add_clicks(self, gui: Any) -> None:
        usual = Strength()
        with gui.add_folder('Click'):
            self.acts = gui.add_checkbox('clicks act', True, hint=_HELP)
            self.pull = gui.add_slider('pull [m/s]', 0.5, 50.0, 0.5, usual.pull)
            self.ball_mass = gui.add_slider('ball [kg]', 0.5, 500.0, 0.5, usual.ball_mass)
            self.ball_size = gui.add_slider('ball [m]', 0.05, 1.5, 0.05, usual.ball_size)
            self.ball_speed = gui.add_slider('ball [m/s]', 1.0, 100.0, 1.0, usual.ball_speed)
            self.charge = gui.add_slider('charge [kg]', 0.1, 100.0, 0.1, usual.charge)
            self.selected = gui.add_markdown(_HELP)

    def _add_scenes(self, gui: Any, scenes: Mapping[str, Path]) -> None:
        with gui.add_folder('Scene'):
            self.scene = gui.add_dropdown('scene', list(scenes))
            self.load = gui.add_button('load')
        _on_user(self.load.on_click, lambda: self._say(LoadScene(scenes[self.scene.value])))


def _on_user(register: Callable, act: Callable[[], None]) -> None:
    """Act when somebody at a page has done something, not when the value was set from here."""
    def react(event: Any) -> None:
        if event.client is not None:
            act()
    register(react)
