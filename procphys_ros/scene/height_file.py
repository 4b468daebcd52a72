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


"""Files of heights: PNG pictures, NPZ archives and ESRI ASCII grids."""

from pathlib import Path
import zipfile

import numpy as np

from procphys_ros.errors import SceneError
from procphys_ros.language import shorten
from procphys_ros.scene.data_file import find_data_file

MOST_CORNERS = 1_050_625  # 1025 x 1025, well below what PyBullet takes
_LARGEST = 8 * MOST_CORNERS + 1024  # [bytes] of an array of them with its header
_TALLEST = 9300.0  # [m] from the shore of the Dead Sea to the summit of Mount Everest
_KEY = 'terrain.file'
_HEADER = ('ncols', 'nrows', 'xllcorner', 'yllcorner', 'xllcenter', 'yllcenter', 'cellsize',
           'nodata_value')


class _FormatError(ValueError):
    """Fault of a file, in words that reveal nothing of its content."""


def read_heights(name: str, beside: Path | None,
                 white: float) -> tuple[np.ndarray, float]:
    """
    Read heights over a grid.

    :param name: file beside the scene file, a path, or package://procphys_ros/….
    :param beside: folder of the scene file, searched first; None = there is none.
    :param white: height of white in a PNG [m].
    :returns: [m], (X, Y), x to the right and y up as pictures and maps show them, and the edge of
        a cell [m], 0 = the file does not say.
    :raises SceneError: naming the file, the fault and what is allowed.
    """
    path = find_data_file(_KEY, name, beside)
    reader = {'.png': _png, '.npz': _npz, '.asc': _ascii}.get(path.suffix.lower())
    if reader is None:
        raise SceneError(f'{_KEY}: "{shorten(name)}" ends in "{path.suffix}"; files of heights '
                         'end in .png, .npz or .asc (ESRI ASCII grid)')
    try:
        heights, cell = reader(path)
    except (OSError, EOFError, ValueError, TypeError, KeyError, SyntaxError,
            zipfile.BadZipFile) as problem:  # numpy and Pillow raise all of them on broken files
        own = isinstance(problem, _FormatError)
        reason = (str(problem) if own else getattr(problem, 'strerror', None)
                  or f'it is no {path.suffix} file, or is damaged')
        raise SceneError(f'{_KEY}: {path} cannot be read: {reason}') from None
    if heights.ndim != 2 or min(heights.shape) < 2 or heights.size > MOST_CORNERS:
        raise SceneError(f'{_KEY}: {path} has a grid of {heights.shape}, it must have two '
                         f'dimensions, at least 2 x 2 and at most {MOST_CORNERS} heights')
    gaps = np.argwhere(~np.isfinite(heights))
    if len(gaps):
        raise SceneError(f'{_KEY}: {path} has {len(gaps)} cells without a height, the first in '
                         f'row {gaps[0][0] + 1}, column {gaps[0][1] + 1}; every cell needs one')
    low, high = float(heights.min()), float(heights.max())
    if not high - low <= _TALLEST:  # no-data values of maps are often numbers
        raise SceneError(f'{_KEY}: {path} has heights from {low:g} to {high:g} m, at most '
                         f'{_TALLEST:g} m may lie between the lowest and the highest; is one of '
                         'them no height, but stands for a gap?')
    if cell is not None and not 0.0 < cell < np.inf:
        raise SceneError(f'{_KEY}: {path} has cells of {cell} m, they must be larger than 0')
    if reader is _png:
        heights = heights * white
    return np.ascontiguousarray(heights[::-1].T, float), cell or 0.0


def _png(path: Path) -> tuple[np.ndarray, None]:
    """Read a grey picture, 0 = black to 1 = white."""
    try:
        from PIL import Image
    except ImportError:
        raise SceneError(f'{_KEY}: {path} is a PNG, which needs Pillow: '
                         'pip install pillow') from None
    try:
        opened = Image.open(path)
    except Image.DecompressionBombError as problem:
        raise _FormatError(str(problem)) from None
    with opened as picture:
        if picture.width * picture.height > MOST_CORNERS:  # before it is unpacked
            raise _FormatError(f'it has {picture.width} x {picture.height} pixels, at most '
                               f'{MOST_CORNERS} are allowed')
        if picture.mode not in ('1', 'L', 'I', 'I;16', 'I;16B'):
            raise _FormatError(f'it is a picture of mode {picture.mode}; heights are grey, with '
                               '8 or 16 bits')
        deep = picture.mode.startswith('I')
        grey = np.asarray(picture, float)
    return grey / (1.0 if picture.mode == '1' else 65535.0 if deep else 255.0), None


def _npz(path: Path) -> tuple[np.ndarray, float | None]:
    """Read the array `heights`, rows from north to south, and `cell` if present."""
    with zipfile.ZipFile(path) as members:
        if any(member.file_size > _LARGEST for member in members.infolist()):
            raise _FormatError(f'it unpacks to more than {_LARGEST} bytes, at most {MOST_CORNERS} '
                               'heights are allowed')
    with np.load(path, allow_pickle=False) as archive:
        if 'heights' not in archive:
            raise _FormatError('it has no array "heights"; "cell" may stand beside it')
        return (np.asarray(archive['heights'], float),
                float(archive['cell']) if 'cell' in archive else None)


def _ascii(path: Path) -> tuple[np.ndarray, float]:
    """Read a header of names and numbers, then rows of heights from north to south."""
    lines = path.read_text(encoding='utf-8-sig').splitlines()
    header: dict[str, float] = {}
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or not words[0][0].isalpha() or words[0].lower() == 'nan':
            break
        if words[0].lower() not in _HEADER or len(words) != 2:
            raise _FormatError(f'line {number} is not one of a header; it has '
                               f'{", ".join(_HEADER)}, each with a number')
        header[words[0].lower()] = _number(words[1], number)
    for key in ('ncols', 'nrows', 'cellsize'):
        if not 0.0 < header.get(key, 0.0) < np.inf:
            raise _FormatError(f'its header has no {key} above 0')
    values = np.array([_number(word, number) for number, line in enumerate(lines, 1)
                       if number > len(header) for word in line.split()])
    columns, rows = int(header['ncols']), int(header['nrows'])
    if len(values) != columns * rows:
        raise _FormatError(f'it has {len(values)} heights, {columns} columns and {rows} rows need '
                           f'{columns * rows}')
    values[values == header.get('nodata_value', -9999.0)] = np.nan
    return values.reshape(rows, columns), header['cellsize']


def _number(word: str, line: int) -> float:
    try:
        return float(word)
    except ValueError:
        raise _FormatError(f'line {line} has a word that is no number') from None
