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


"""Page: serves a scene to browsers, sends what moves, and takes clicks."""

from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout
import io
import logging
from pathlib import Path
import socket
from threading import Event, Thread
from time import perf_counter
from typing import Any

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.view import surroundings
from procphys_ros.view.batches import Batches
from procphys_ros.view.clicks import command_of, describe, mark_of, title, Tool
from procphys_ros.view.commands import Inspect
from procphys_ros.view.controls import Controls
from procphys_ros.view.cracks import Cracks
from procphys_ros.view.dust import DustSpheres
from procphys_ros.view.guard import Guard
from procphys_ros.view.library import load_viser, ViewError
from procphys_ros.view.marks import Marks
from procphys_ros.view.mortar import MortarBoxes
from procphys_ros.view.outlook import Outlook
from procphys_ros.view.picking import GROUND, pick
from procphys_ros.view.source import Frame, Source
from procphys_ros.view.surroundings import Vicinity
from procphys_ros.view.torn_meshes import TornMeshes
from procphys_ros.view.wind_arrow import WindArrow

HOST, PORT = 'localhost', 8080
RATE = 20.0  # [Hz] highest rate of updates
_STATUS_PERIOD = 0.25  # [s] between updates of the status


class Page:
    """
    A page in the browser.

    :param source: the running scene to show.
    :param host: address that it is served on; the default is reachable from this machine only.
    :param port: TCP port.
    :param scenes: files that may be loaded, by name.
    :param names: other host names of the page, besides `host` and localhost.
    :ivar address: URL of the page; anyone who has it may send commands.
    :ivar controls: sliders and buttons.
    :ivar unit: length of the page per metre.
    :raises ViewError: if viser is missing, or the port is in use.
    """

    def __init__(self, source: Source, host: str = HOST, port: int = PORT,
                 scenes: Mapping[str, Path] | None = None, names: Iterable[str] = ()):
        self._source = source
        guard = Guard(host, names)
        self.server = _serve(host, port, guard)
        self.address = guard.address(self.server.get_port())
        self.server.gui.configure_theme(show_logo=False, show_share_button=False,
                                        control_width='small')
        surroundings.light_up(self.server)
        self.controls = Controls(self.server.gui, source.say, scenes or {}, source.can_undo)
        self.outlook = Outlook(self.server.gui, lambda: (self._frame, self.unit))
        self.server.scene.on_click()(self._clicked)
        self._marks = Marks(self.server.scene)
        self._frame: Frame | None = None
        self._vicinity: Vicinity | None = None
        self._arrow: WindArrow | None = None
        self._drawn: tuple[Batches, MortarBoxes, DustSpheres, Cracks, TornMeshes] | None = None
        self._eyes = np.zeros((0, 3))
        self.unit = 1.0
        self._status_due = 0.0
        self._ended = Event()
        self._thread = Thread(target=self.run, name='page', daemon=True)

    def start(self) -> None:
        """Start sending updates, in a thread."""
        self._thread.start()

    def run(self) -> None:
        """Send updates until the page is closed."""
        due = perf_counter()
        while not self._ended.wait(max(due - perf_counter(), 0.0)):
            due = max(due + 1.0 / RATE, perf_counter())
            self.update(perf_counter())

    def update(self, now: float) -> None:
        """
        Send all changes since the last call.

        :param now: any clock [s].
        """
        self._source.watched = bool(self.server.get_clients())
        if now >= self._status_due:
            self._status_due = now + _STATUS_PERIOD
            self._show_status()
        self._marks.update(now)
        frame = self._source.frame()
        eyes = self._seen_from()
        still = frame is self._frame and np.array_equal(eyes, self._eyes)
        if frame is None or still:
            return
        self._eyes = eyes
        with self.server.atomic():
            self.draw(frame)

    def draw(self, frame: Frame) -> None:
        """Draw a frame, independent of the source."""
        is_new = not self._continues(frame)
        if is_new:
            self._begin(frame)
        self.outlook.list_objects(frame.content, is_new)
        self._frame = frame
        assert self._drawn is not None
        batches, mortar, dust, cracks, torn = self._drawn
        batches.update(frame, self._eyes)
        for drawn in (mortar, dust, cracks, torn):
            drawn.update(frame)

    def close(self) -> None:
        """Stop the server."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        with redirect_stdout(io.StringIO()):  # viser prints that it has stopped
            self.server.stop()

    def click(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """
        Execute a click.

        :param origin: the eye, world [m], (3,).
        :param direction: of the ray, world, (3,).
        """
        frame, vicinity = self._frame, self._vicinity
        hit = pick(frame, origin, direction) if frame is not None else None
        if frame is None or vicinity is None or hit is None:
            return
        text, way, tool = title(hit, frame.content), None, Tool(self.controls.tool.value)
        sight = np.asarray(direction, float) / np.linalg.norm(direction)
        try:
            command = command_of(tool, hit, frame.content, sight, self.controls.strength, vicinity)
        except CommandError as error:
            text, command = str(error), None
        if command is not None:
            text, way = mark_of(command)
            self._source.say(command)
        self._marks.put(self.unit * hit.point, self.unit * hit.distance, text, way)
        self.controls.show_selected(describe(hit, frame.content))
        if hit.part != GROUND:
            self._source.say(Inspect(hit.part))

    def _repr_html_(self) -> str:
        """Show the page in a notebook."""
        return f'<iframe src="{self.address}" width="100%" height="600"></iframe>'

    def _clicked(self, event: Any) -> None:
        self.click(np.array(event.ray_origin) / self.unit, np.array(event.ray_direction))

    def _seen_from(self) -> np.ndarray:
        """Return the positions of all cameras, world [m], (K, 3)."""
        cameras = [client.camera for client in self.server.get_clients().values()]
        return np.array([camera.position / self.unit for camera in cameras
                         if camera.update_timestamp != 0.0]).reshape(-1, 3)

    def _show_status(self) -> None:
        status = self._source.status()
        self.controls.show(status, self._source.answer())
        if self._arrow is not None and status.alive:
            self._arrow.show(status.wind)

    def _continues(self, frame: Frame) -> bool:
        return self._frame is not None and frame.content.scene == self._frame.content.scene

    def _begin(self, frame: Frame) -> None:
        for drawn in (self._marks, self._arrow, *(self._drawn or ())):
            if drawn is not None:
                drawn.close()
        self.unit = surroundings.unit_of(frame)
        surroundings.arrange(self.server, frame, self.unit)
        scene = self.server.scene
        self._vicinity = Vicinity.of(frame)
        self._arrow = WindArrow(scene, self.unit, self._vicinity)
        self._drawn = (Batches(scene, self.unit), MortarBoxes(scene, self.unit),
                       DustSpheres(scene, self.unit), Cracks(scene, self.unit),
                       TornMeshes(scene, self.unit))


def _serve(host: str, port: int, guard: Guard) -> Any:
    """Start a server, quietly; viser itself would take another port if this is in use."""
    viser = load_viser()
    # It logs the stack for clients that connect without a request, as browsers do in advance.
    logging.getLogger('websockets.server').setLevel(logging.CRITICAL)
    try:
        family, *_, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except UnicodeError as error:
        raise ViewError(f'cannot serve the page on {host}: that is no name of a host') from error
    except OSError as error:
        raise ViewError(f'cannot serve the page on {host}:{port}: '
                        f'{error.strerror}; --port names another one') from error
    with redirect_stdout(io.StringIO()), guard.watching():
        server = viser.ViserServer(host=host, port=port, label='procphys_ros', verbose=False)
    if not guard.watches:
        server.stop()
        raise ViewError(f'viser {viser.__version__} cannot be kept from letting other sites in; '
                        'pip install viser==1.1.1')
    return server
