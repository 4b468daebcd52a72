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


"""Cache files: written atomically; damaged ones count as missing."""

import hashlib
from pathlib import Path

from procphys_ros.files.whole_files import write_whole

_CHECKSUM = 32  # [B] of SHA-256, at the head of each file


def read(path: Path) -> bytes | None:
    """Read the payload of a file by `write`; None when it is missing or damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    payload = content[_CHECKSUM:]
    return payload if hashlib.sha256(payload).digest() == content[:_CHECKSUM] else None


def write(path: Path, payload: bytes) -> None:
    """
    Write a file atomically, with a checksum.

    :raises OSError: when that is not possible.
    """
    write_whole(path, hashlib.sha256(payload).digest() + payload)
