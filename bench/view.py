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


"""What the page costs: share of a core at 20 Hz, and bytes per second, of scenes in motion."""

from multiprocessing import get_context
from socket import socket
import sys
from time import perf_counter, process_time, sleep

import numpy as np

from procphys_ros.blueprint import Leaves, Shape
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation
from procphys_ros.view.page import Page, RATE
from procphys_ros.view.source import Frame, PageContent, Status

SECONDS = 4.0  # of each scene, played forth and back
LARGEST = {'bricks': 15_196, 'branches': 12_000, 'leaves': 50_000}
SCENES = {  # name: wind [m/s], when to begin [s]
    'demo': (12.0, 1.0), 'village_street': (20.0, 1.0), 'implosion': (0.0, 4.0),
    'figure_8': (15.0, 1.0)}


class Replay:
    """A source that shows frames that were taken before, so that only the page is measured."""

    can_undo = False

    def __init__(self, frames: list[Frame]):
        self.watched, self.frames, self.turn = True, frames, 0

    def frame(self) -> Frame:
        """Return the next frame."""
        self.turn += 1
        place = self.turn % (2 * len(self.frames) - 2)
        return self.frames[min(place, 2 * len(self.frames) - 2 - place)]

    def status(self) -> Status:
        """Return a status without faults."""
        return Status(True, 'replay')

    def say(self, command: object) -> None:
        """Ignore commands."""

    def answer(self) -> str:
        """Return no answer."""
        return ''

    def close(self) -> None:
        """End nothing."""


def look(address: str, received) -> None:
    """Be a browser that takes everything as it comes."""
    import viser
    from websockets.sync.client import connect
    with connect(address.replace('http:', 'ws:'), max_size=None,
                 subprotocols=[f'viser-v{viser.__version__}']) as client:
        client.send(camera())
        for data in client:
            received.value += len(data)


def camera() -> bytes:
    """Write the message with which a browser says that it is there."""
    import msgspec
    return msgspec.msgpack.encode({
        'type': 'ViewerCameraMessage', 'wxyz': (1, 0, 0, 0), 'position': (0, 0, 0), 'fov': 1.0,
        'near': 0.1, 'far': 100.0, 'image_height': 10, 'image_width': 10, 'look_at': (0, 0, 1),
        'up_direction': (0, 0, 1)})


def take_frames(name: str, wind: float, start: float) -> list[Frame]:
    """Simulate a scene and keep what the page would show."""
    simulation = Simulation(Scene.from_yaml(shared_folder() / 'config' / f'{name}.yaml'))
    if wind:
        simulation.set_wind((wind, 0.0, 0.0))
    simulation.step(round(start / simulation.time_step))
    frames = []
    for _ in range(round(SECONDS * RATE)):
        simulation.step(round(1.0 / RATE / simulation.time_step))
        content = PageContent.of(simulation.blueprint, simulation.names.name, 0)
        frames.append(Frame(content, simulation.poses.copy(), simulation.leaf_poses().copy(),
                            simulation.dust))
    # Played back and forth, all frames show the same parts.
    last = frames[-1].content
    return [frame for frame in frames if len(frame.content) == len(last)]


def largest() -> list[Frame]:
    """Make frames of a scene of the largest size, in which every branch and leaf moves."""
    bricks, branches, leaves = LARGEST.values()
    count, rng = bricks + branches, np.random.default_rng(0)
    shape = np.repeat([Shape.BOX, Shape.CAPSULE], [bricks, branches])
    size = np.where(shape[:, None] == Shape.BOX, (0.24, 0.115, 0.07), (0.06, 0.05, 0.6))
    rest = np.tile([0.0, 0.0, 0.0, *rotation.IDENTITY], (count + leaves, 1))
    rest[:, :3] = rng.uniform((-40.0, -40.0, 0.0), (40.0, 40.0, 12.0), (count + leaves, 3))
    carried = Leaves(rng.integers(bricks, count, leaves), rest[count:], np.full(leaves, 0.3),
                     np.full(leaves, 2))
    content = PageContent(0, str, shape, size, np.ones(count), np.zeros(count, bool),
                          (shape == Shape.CAPSULE).astype(int), str,
                          ('brick', 'bark_oak', 'leaf_oak'), carried)
    frames = []
    for angle in np.linspace(0.0, np.pi, round(SECONDS * RATE)):
        poses = rest.copy()
        poses[bricks:, 0] += 0.3 * np.sin(angle + poses[bricks:, 1])
        poses[bricks:, 3:] = rotation.from_axis_angle(
            np.array([0.0, 1.0, 0.0]), 0.1 * np.sin(angle + poses[bricks:, 1]))
        frames.append(Frame(content, poses[:count], poses[count:]))
    return frames


def measure(name: str) -> None:
    """Print what one scene costs."""
    frames = take_frames(name, *SCENES[name]) if name in SCENES else largest()
    with socket() as probe:
        probe.bind(('localhost', 0))
        port = probe.getsockname()[1]
    page = Page(Replay(frames), port=port)
    context = get_context('spawn')
    received = context.Value('q', 0)
    browser = context.Process(target=look, args=(page.address, received), daemon=True)
    browser.start()
    while not page.server.get_clients():
        sleep(0.1)
    page.update(perf_counter())
    sleep(2.0)
    page.start()
    before, work, wall = received.value, process_time(), perf_counter()
    sleep(2 * SECONDS)
    share = (process_time() - work) / (perf_counter() - wall)
    rate = (received.value - before) / (perf_counter() - wall)
    shown = frames[-1].content
    print(f'{name:16} {len(shown):6} parts {len(shown.leaves):6} leaves: '
          f'{100 * share:5.1f} % of a core at {RATE:g} Hz, {rate / 1e6:6.2f} MB/s')
    browser.kill()
    page.close()


if __name__ == '__main__':
    for chosen in sys.argv[1:] or [*SCENES, 'largest']:
        measure(chosen)
