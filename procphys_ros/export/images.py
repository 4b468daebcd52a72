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

"""Images: the textures of a scene as PNG files with their colours in them."""

import struct
import zlib

import numpy as np

from procphys_ros.appearance import texture
from procphys_ros.appearance.palette import look

_OPAQUE = 255
_CUT = 128  # alpha below it counts as a hole in a leaf


def pixels(name: str) -> np.ndarray:
    """
    Colour the image of a texture, (P, P, 4) uint8; the first row is the upper edge.

    :param name: texture name in the grammar; a plain one gets a single pixel.
    """
    appearance = look(name)
    pattern = texture.image(appearance.pattern)
    if pattern is None:
        pattern = np.full((1, 1, 4), _OPAQUE, np.uint8)
    colour = np.array(appearance.rgba)
    colour[:3] /= texture.mean_light(appearance.pattern)
    return np.clip(np.round(pattern * colour), 0, _OPAQUE).astype(np.uint8)


def has_holes(name: str) -> bool:
    """Return whether a texture is cut out, like those of leaves."""
    pattern = texture.image(look(name).pattern)
    return pattern is not None and bool((pattern[..., 3] < _CUT).any())


def png(image: np.ndarray) -> bytes:
    """
    Write an image as PNG (W3C PNG 1.2: eight bits, RGBA, no filters).

    :param image: (H, W, 4) uint8.
    """
    height, width = image.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1)
    return b'\x89PNG\r\n\x1a\n' + b''.join((
        _chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 6, 0, 0, 0)),
        _chunk(b'IDAT', zlib.compress(rows.tobytes(), 9)), _chunk(b'IEND', b'')))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
