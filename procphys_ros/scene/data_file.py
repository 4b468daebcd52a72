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

"""Data files of scenes, and the folders searched for them."""

import os
from pathlib import Path

from procphys_ros.errors import SceneError
from procphys_ros.files.file_bounds import named_by, outside
from procphys_ros.files.resources import shared_folder
from procphys_ros.language import shorten

_PACKAGE = 'package://procphys_ros/'


def find_data_file(key: str, name: str, beside: Path | None) -> Path:
    """
    Find a data file of a scene.

    :param key: of the scene file, for messages.
    :param name: file beside the scene file, a path, or package://procphys_ros/….
    :param beside: folder of the scene file, searched first; None = there is none.
    :raises SceneError: naming the places searched.
    """
    candidates = [Path(os.path.expanduser(name))]
    if name.startswith(_PACKAGE):
        candidates = [shared_folder() / name[len(_PACKAGE):]]
    elif beside is not None:
        candidates.insert(0, beside / name)
    for path in candidates:
        with named_by(key, name):
            reason = outside(path)
        if reason:
            raise SceneError(f'{key}: "{shorten(name)}" cannot be read: {reason}')
        if _is_file(path):
            return path
    where = ' and '.join(dict.fromkeys(shorten(str(path)) for path in candidates))
    raise SceneError(f'{key}: there is no file "{shorten(name)}" (looked for {where})')


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long, say
        return False
