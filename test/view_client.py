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

"""A client of the page that is no browser: it speaks viser's protocol over a WebSocket."""

from collections.abc import Callable
import struct
from time import monotonic
from typing import Any

import msgspec
import viser
from websockets.sync.client import connect
import zstandard

PATIENCE = 120.0  # [s] far more than is ever needed
_TURN = 0.05  # [s]
_PLACE = (0, 0, 1000)  # of the eye, in the page's lengths: where no leaf is near


class ViewClient:
    """
    Connects to a page and keeps what it is told.

    :param address: of the page.
    :ivar messages: all that came, oldest first.
    """

    def __init__(self, address: str):
        self.messages: list[dict[str, Any]] = []
        self._socket = connect(address.replace('http:', 'ws:'), max_size=None,
                               subprotocols=[f'viser-v{viser.__version__}'])
        self.send('ViewerCameraMessage', wxyz=(1, 0, 0, 0), position=_PLACE, fov=1.0, near=0.1,
                  far=1e4, image_height=10, image_width=10, look_at=(0, 0, 1),
                  up_direction=(0, 0, 1))

    def close(self) -> None:
        """Leave."""
        self._socket.close()

    def send(self, kind: str, **fields: Any) -> None:
        """Send a message as the browser does."""
        self._socket.send(msgspec.msgpack.encode({'type': kind, **fields}))

    def click(self, origin: Any, direction: Any) -> None:
        """Click into the scene, in the page's own lengths."""
        self.send('ScenePointerMessage', event_type='click', modifier=None,
                  ray_origin=tuple(map(float, origin)), screen_pos=((0.5, 0.5),),
                  ray_direction=tuple(map(float, direction)))

    def change(self, label: str, value: Any) -> None:
        """Move the slider, tick the box or press the button of a label."""
        uuid = self.wait_for(lambda m: m.get('props', {}).get('label') == label)['uuid']
        self.send('GuiUpdateMessage', uuid=uuid, updates={'value': value})

    def wait_for(self, fits: Callable[[dict], Any]) -> dict[str, Any]:
        """Return the first message that fits, of those received or to come."""
        end, seen = monotonic() + PATIENCE, 0
        while True:
            for message in self.messages[seen:]:
                if fits(message):
                    return message
            seen = len(self.messages)
            assert monotonic() < end, 'waited in vain for a message'
            self.read()

    def wait_until(self, done: Callable[[], Any]) -> None:
        """Read until a condition holds."""
        end = monotonic() + PATIENCE
        while not done():
            assert monotonic() < end, 'waited in vain'
            self.read()

    def read(self) -> None:
        """Take what comes within a moment."""
        try:
            data = self._socket.recv(timeout=_TURN)
        except TimeoutError:
            return
        _, packed = struct.unpack('<QQ', data[:16])
        inner = zstandard.ZstdDecompressor().decompress(data[16:16 + packed])
        self.messages += msgspec.msgpack.decode(inner)['messages']

    def updates(self, prop: str) -> list[str]:
        """List the scene nodes of which a property was sent again, in order."""
        return [m['name'] for m in self.messages
                if m['type'] == 'SceneNodeUpdateMessage' and prop in m['updates']]
