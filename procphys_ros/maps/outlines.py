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

"""Outlines of buildings in plan, by the library shapely."""

from collections.abc import Sequence
from typing import Any, TYPE_CHECKING

import numpy as np

from procphys_ros.errors import SceneError

if TYPE_CHECKING:
    import shapely

_LEAST = 1.0  # [m²] of an outline


def polygon_of(rings: Sequence[np.ndarray]) -> 'shapely.Polygon':
    """Return the largest polygon of rings that may cross themselves; it may be empty."""
    return largest(library().make_valid(library().Polygon(rings[0], rings[1:])))


def largest(geometry: 'shapely.Geometry') -> 'shapely.Polygon':
    """Return the largest polygon of a geometry; it may be empty."""
    return max((part for part in library().get_parts(geometry) if part.geom_type == 'Polygon'),
               key=lambda part: part.area, default=library().Polygon())


def joined(surfaces: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
    """Join surfaces in a plane that touch each other; return the rings of each outline."""
    whole = library().union_all([polygon_of(rings) for rings in surfaces if len(rings[0]) > 2])
    return [[np.array(ring.coords)[:-1, :2] for ring in (part.exterior, *part.interiors)]
            for part in library().get_parts(whole)
            if part.geom_type == 'Polygon' and part.area > _LEAST]


def library() -> Any:
    """
    Return shapely.

    :raises SceneError: when it is not installed.
    """
    try:
        import shapely
    except ImportError:
        raise SceneError('maps need the package shapely: pip install "procphys_ros[maps]", or '
                         'apt install python3-shapely') from None
    return shapely
