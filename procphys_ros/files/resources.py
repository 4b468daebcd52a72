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


"""Find the files shipped with the package beside its code: grammars and scenes."""

from functools import cache
import os
from pathlib import Path
import sys

PACKAGE = 'procphys_ros'
_PREFIX = f'package://{PACKAGE}/'


@cache
def shared_folder() -> Path:
    """
    Find the folder that holds `grammars/`, `config/` and `package.xml`.

    Code that runs from a source tree uses that tree; otherwise the ament index is searched (a ROS
    workspace), then the share folder of the Python prefix (a pip install, where
    AMENT_PREFIX_PATH is not set).

    :raises FileNotFoundError: when none of them has the files: the install is broken.
    """
    source = Path(__file__).resolve().parents[2]
    prefixes = [Path(p) for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    folders = [source, *(p / 'share' / PACKAGE for p in [*prefixes, Path(sys.prefix)])]
    for folder in folders:
        if (folder / 'package.xml').is_file() and (folder / 'grammars').is_dir():
            return folder
    tried = ', '.join(str(folder) for folder in folders)
    raise FileNotFoundError(f'the grammars of {PACKAGE} are not installed; looked in {tried}')


def shipped_file(name: str) -> Path | None:
    """Return the shipped file that package://procphys_ros/… names; None = it is another name."""
    return shared_folder() / name.removeprefix(_PREFIX) if name.startswith(_PREFIX) else None


def cache_home() -> Path:
    """Return the folder of this user's caches, by XDG_CACHE_HOME."""
    home = os.environ.get('XDG_CACHE_HOME', '')
    if not os.path.isabs(home):  # the specification: a relative one counts as unset
        home = os.path.expanduser('~/.cache')
    return Path(home, PACKAGE)
