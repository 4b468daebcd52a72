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

"""Numbers in tags."""

from collections.abc import Mapping
import re

_NUMBER = re.compile(r'\s*(\d+(?:\.\d+)?)\s*(m|metres?|ft|feet|\')?\s*(?:(\d+)")?\s*\Z')
_FOOT = 0.3048  # [m]
_MOST = 1e4


def metres(tags: Mapping[str, str], *keys: str) -> float | None:
    """
    Read the first of some tags that holds a number, in metres unless it says feet.

    :returns: None where none of them does; numbers beyond 10,000 are no numbers of a map.
    """
    for key in keys:
        match = _NUMBER.match(tags.get(key, ''))
        if match is None:
            continue
        value = float(match[1])
        if match[2] in ('ft', 'feet', "'"):
            value = _FOOT * (value + float(match[3] or 0.0) / 12.0)
        if value <= _MOST:
            return value
    return None
