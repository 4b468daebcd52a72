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


"""File access: which files parameters may name that come over ROS."""

from collections.abc import Mapping, Sequence
import os
from pathlib import Path
from typing import Any

from procphys_ros.errors import CommandError
from procphys_ros.files.file_bounds import FileBounds, named_by, outside, within
from procphys_ros.files.resources import shared_folder

_TEMPORARY = 'launch_params_'  # prefix of files into which `launch` writes values


def bounds_at_start(roots: Sequence[str], given: Mapping[str, Any],
                    arguments: Sequence[str]) -> FileBounds:
    """
    Determine the files that may be named after the start.

    :param roots: value of `files.root`; () = the folders of scene files, and that of states.
    :param given: parameters given at start, by full name.
    :param arguments: command line of the process.
    """
    folders = [Path(os.path.expanduser(root)) for root in roots]
    if not folders:
        folders = [_state_folder(given), *_scene_folders(arguments)]
    # States go to the first folder, so the package is the last.
    return FileBounds(tuple(dict.fromkeys(
        folder.resolve() for folder in (*folders, shared_folder()))), given)


def state_path(name: str, bounds: FileBounds) -> Path:
    """
    Return the path of a state file.

    :param name: value of `state.file`; a relative path set after the start is a file in the first
        folder of the bounds.
    :raises CommandError: if it is not allowed, or its folder cannot be made.
    """
    if not name:
        raise CommandError('state.file is empty, it must name a file')
    path = Path(os.path.expanduser(name))
    if bounds.given.get('state.file') != name:
        path = bounds.folders[0] / path
    with within(bounds), named_by('state.file', name):
        if reason := outside(path):
            raise CommandError(f'state.file: {path}: {reason}')
    if path.parent == _own_folder():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CommandError(f'state.file: {path.parent} cannot be made: '
                               f'{error.strerror}') from None
    return path


def _state_folder(given: Mapping[str, Any]) -> Path:
    name = given.get('state.file')
    if isinstance(name, str) and name:
        return Path(os.path.expanduser(name)).absolute().parent
    return _own_folder()


def _own_folder() -> Path:
    """Return the default folder of states."""
    return Path(os.path.expanduser(os.environ.get('ROS_HOME') or '~/.ros')) / 'procphys_ros'


def _scene_folders(arguments: Sequence[str]) -> list[Path]:
    named = [Path(after) for word, after in zip(arguments, arguments[1:])
             if word == '--params-file']
    return [path.absolute().parent for path in named if not path.name.startswith(_TEMPORARY)]
