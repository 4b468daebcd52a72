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


"""What keeps a file from being written, told before anything is computed for it."""

import os
from pathlib import Path


def obstacle(path: Path) -> str:
    """Say why a file cannot be written; '' = nothing is in the way yet."""
    try:
        if not path.parent.is_dir():
            return f'there is no folder "{path.parent}"'
        if path.is_dir():
            return 'it is a folder'
        if path.exists() and not path.is_file():
            return 'it is not a regular file'
        if not os.access(path if path.exists() else path.parent, os.W_OK):
            return 'permission denied'
    except (OSError, ValueError) as error:  # ValueError: a null character
        return getattr(error, 'strerror', None) or str(error)
    return ''
