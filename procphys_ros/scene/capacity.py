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

"""Capacity: how many parts fit into the memory of this machine."""

from pathlib import Path

from procphys_ros.errors import SceneError

# [bytes] of memory at its peak, from `bench/scale.py`: 18 kB per brick, 9 to 13 kB per segment.
_PER_PART = 20_000
_MEMORY = Path('/proc/meminfo')


def available_memory() -> int | None:
    """Read the memory available to new processes [bytes]; None where that is unknown."""
    try:
        lines = _MEMORY.read_text('ascii').splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith('MemAvailable:')]
    return 1024 * int(found[0]) if found else None


def check_capacity(parts: int, memory: int | None) -> None:
    """
    Check that memory can hold a scene, before it is allocated.

    :param parts: of the scene.
    :param memory: available [bytes]; None = unknown.
    :raises SceneError: naming both numbers.
    """
    _check('the scene', f'{parts:,} parts or more', '; take fewer objects, or share them among '
           'several machines with shard.count', parts, memory)


def check_addition(name: str, parts: int, memory: int | None) -> None:
    """
    Check that memory can hold an addition to a running scene, before it is allocated.

    :param name: of the addition.
    :param parts: number of its parts.
    :param memory: free beside the running scene [bytes]; None = unknown.
    :raises SceneError: naming both numbers.
    """
    _check(name, f'{parts:,} parts', ' more', parts, memory)


def _check(what: str, size: str, end: str, parts: int, memory: int | None) -> None:
    if memory is not None and parts * _PER_PART > memory:
        raise SceneError(f'{what} has {size}, but the {memory / 2 ** 30:.1f} GiB of memory that '
                         f'are free hold {memory // _PER_PART:,}{end}')
