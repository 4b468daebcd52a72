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

"""Files of triangles."""

from io import BytesIO
import os
from pathlib import Path
from typing import Any

import numpy as np

from procphys_ros.errors import SceneError
from procphys_ros.files.file_bounds import outside
from procphys_ros.files.resources import shipped_file
from procphys_ros.language.syntax import read_regular, shorten

_LARGEST = 50_000_000  # [bytes] of a file; half a million triangles


def read_mesh(name: str, key: str) -> np.ndarray:
    """
    Read a mesh file: STL, OBJ, PLY, OFF or GLB.

    :param name: path, or package://procphys_ros/….
    :param key: parameter that named the file, for error messages.
    :returns: corners of its triangles [m], (T, 3, 3).
    :raises SceneError: when it cannot be read, or the library that reads it is missing.
    """
    try:
        import trimesh
    except ImportError as error:
        raise SceneError(f'{key}: meshes need the package trimesh: pip install trimesh') from error
    path = shipped_file(name) or Path(os.path.expanduser(name))
    if reason := outside(path):
        raise SceneError(f'{key}: "{shorten(name)}" cannot be read: {reason}')
    try:
        content = read_regular(path, _LARGEST + 1)
        if len(content) > _LARGEST:
            raise ValueError(f'it has more than {_LARGEST} bytes')
        mesh: Any = trimesh.load(BytesIO(content), path.suffix[1:].lower(), force='mesh',
                                 process=False)
        triangles = np.asarray(mesh.triangles, float)
    except Exception as error:  # readers of formats raise anything on broken files
        raise SceneError(f'{key}: "{shorten(name)}" cannot be read as a mesh: '
                         f'{str(error) or type(error).__name__}') from error
    if not len(triangles) or not np.isfinite(triangles).all():
        raise SceneError(f'{key}: "{shorten(name)}" holds no triangles')
    return triangles
