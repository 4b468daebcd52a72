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


"""Writers: pictures on their way into a file or a series of files, whole or not at all."""

from contextlib import suppress
from fractions import Fraction
import os
from pathlib import Path
import re
from typing import Any

import numpy as np

from procphys_ros.errors import SceneError
from procphys_ros.files.output_files import obstacle, part_of, write_beside
from procphys_ros.render.backend import RenderUnavailableError

PICTURES = ('.png', '.jpg', '.jpeg')
FILMS = ('.mp4', '.gif')
_NO_ENCODER = 'films (.mp4) need PyAV with x264: pip install av'
_GIF_COLOURS = 128
_GIF_RATE = 50.0  # [1/s] above which viewers slow a gif down
_QUALITY = {'crf': '20', 'preset': 'veryfast'}  # of x264; 18 to 23 look as good as the original
_JPEG_QUALITY = 85
_NUMBERED = re.compile(r'(?:[^%]|%%)*%0?[1-9]?d(?:[^%]|%%)*\Z')  # a longer number fills memory


class PictureWriter:
    """
    Receives pictures one after the other.

    :ivar count: number of pictures added.
    """

    count = 0

    def add(self, pixels: np.ndarray) -> None:
        """Add a picture, (H, W, 3) uint8."""
        raise NotImplementedError

    def finish(self) -> None:
        """Complete the file and move it to its path."""

    def discard(self) -> None:
        """Remove incomplete files."""


def is_series(path: Path) -> bool:
    """Return whether a path is a pattern for many files, such as frames/%04d.png."""
    return '%' in path.name


def check_output(path: Path) -> None:
    """
    Validate the output path, before minutes of simulation.

    :raises SceneError: with the option and the allowed values.
    :raises RenderUnavailableError: if the encoder of the format is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in (*PICTURES, *FILMS):
        raise SceneError(f'--out: "{path}" must end in {", ".join((*PICTURES, *FILMS))}')
    if is_series(path):
        if suffix not in PICTURES:
            raise SceneError(f'--out: "{path}": only pictures ({", ".join(PICTURES)}) come in '
                             'series')
        _numbered(path, 0)
        path.parent.mkdir(parents=True, exist_ok=True)
    if reason := obstacle(path):
        raise SceneError(f'--out: "{path}" cannot be written: {reason}')
    if suffix == '.mp4':
        _load_encoder()


def open_writer(path: Path, size: tuple[int, int], rate: float) -> PictureWriter:
    """
    Select the writer for a path.

    :param path: its suffix selects the format.
    :param size: width and height [px].
    :param rate: pictures per second.
    :raises SceneError: if the format does not support this size or rate.
    """
    suffix = path.suffix.lower()
    if suffix == '.mp4':
        return _Mp4(path, size, rate)
    if suffix == '.gif':
        return _Gif(path, rate)
    return _Pictures(path)


class _Pictures(PictureWriter):
    """One file for each picture."""

    def __init__(self, path: Path):
        self._path = path

    def add(self, pixels: np.ndarray) -> None:
        path = _numbered(self._path, self.count) if is_series(self._path) else self._path
        self.count += 1
        write_beside(path, lambda part: _image(pixels).save(part, quality=_JPEG_QUALITY,
                                                            optimize=True))


class _Gif(PictureWriter):
    """A loop with the colours of its middle picture."""

    def __init__(self, path: Path, rate: float):
        if rate > _GIF_RATE:
            raise SceneError(f'--fps: a gif shows at most {_GIF_RATE:g} pictures per second')
        self._path, self._duration = path, 10 * round(100.0 / rate)
        self._frames: list[np.ndarray] = []

    def add(self, pixels: np.ndarray) -> None:
        self._frames.append(pixels.copy())
        self.count += 1

    def finish(self) -> None:
        from PIL.Image import Dither

        palette = _image(self._frames[len(self._frames) // 2]).quantize(_GIF_COLOURS)
        first, *others = [_image(pixels).quantize(palette=palette, dither=Dither.NONE)
                          for pixels in self._frames]
        write_beside(self._path, lambda part: first.save(
            part, save_all=True, append_images=others, loop=0, optimize=True,
            duration=self._duration))


class _Mp4(PictureWriter):
    """A film in H.264, which browsers and players support."""

    def __init__(self, path: Path, size: tuple[int, int], rate: float):
        if size[0] % 2 or size[1] % 2:
            raise SceneError(f'--size: a film needs an even width and height, not {size[0]}x'
                             f'{size[1]}')
        av = _load_encoder()
        self._path, self._part, self._frame = path, part_of(path), av.VideoFrame.from_ndarray
        self._container: Any = av.open(str(self._part), 'w', format='mp4')
        self._stream: Any = self._container.add_stream(
            'libx264', rate=Fraction(rate).limit_denominator(1001), options=_QUALITY)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = 'yuv420p'

    def add(self, pixels: np.ndarray) -> None:
        frame = self._frame(np.ascontiguousarray(pixels), format='rgb24')
        self._container.mux(self._stream.encode(frame))
        self.count += 1

    def finish(self) -> None:
        try:
            self._container.mux(self._stream.encode())
            self._container.close()
            os.replace(self._part, self._path)
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        with suppress(Exception):  # it is discarded
            self._container.close()
        self._part.unlink(missing_ok=True)


def _load_encoder() -> Any:
    try:
        import av
    except ImportError as error:
        raise RenderUnavailableError(f'{_NO_ENCODER} ({error})') from error
    if 'libx264' not in av.codecs_available:
        raise RenderUnavailableError(_NO_ENCODER)
    return av


def _image(pixels: np.ndarray) -> Any:
    from PIL import Image
    return Image.fromarray(pixels)


def _numbered(path: Path, number: int) -> Path:
    if not _NUMBERED.match(path.name):
        raise SceneError(f'--out: "{path}" must hold one number, as frames/%04d.png')
    return path.with_name(path.name % number)
