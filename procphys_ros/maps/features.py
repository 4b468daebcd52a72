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

"""Features of a map with their tags, whatever the format of its file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import cos, sin
from procphys_ros.errors import SceneError
from procphys_ros.language import read_regular

MAPS = ('.geojson', '.osm', '.osm.pbf', '.city.json')
_READERS = {'.geojson': 'geojson', '.osm': 'openstreetmap', '.osm.pbf': 'openstreetmap',
            '.city.json': 'cityjson'}
_LARGEST_FILE = 50_000_000  # [bytes] a town of some 20,000 buildings
_MOST = 20_000       # features
_MOST_POINTS = 5000  # of one feature
_WIDEST = 20_000.0   # [m] here a plane through the middle lies 8 m above the ground at the edge
_EQUATOR = 6378137.0           # [m] radius, WGS 84 (NIMA TR8350.2, table 3.1) ...
_FLATTENING = 1.0 / 298.257223563  # ... and flattening


class Feature(NamedTuple):
    """
    Building, road or tree.

    :ivar kind: 'building', 'road' or 'tree'.
    :ivar rings: of a building its outline, then its courtyards, the first corner not repeated; of
        a road its line; of a tree its place, each (n, 2), in the coordinates of the file.
    :ivar tags: texts by key, as in OpenStreetMap.
    :ivar where: file and number, for messages.
    """

    kind: str
    rings: tuple[np.ndarray, ...]
    tags: Mapping[str, str]
    where: str


@dataclass
class Map:
    """
    Content of a map file.

    :ivar features: in the order of the file.
    :ivar geographic: whether coordinates are longitude and latitude [degrees], else metres.
    :ivar left_out: how many there are of what no scene has, by their kinds.
    """

    features: list[Feature] = field(default_factory=list)
    geographic: bool = True
    left_out: dict[str, int] = field(default_factory=dict)

    def add(self, kind: str, rings: Sequence[np.ndarray], tags: Mapping[str, str],
            where: str) -> None:
        """
        Add a feature.

        :raises SceneError: when it has impossible coordinates, or there are too many.
        """
        if len(self.features) >= _MOST:
            raise SceneError(f'{where}: the map has more than {_MOST} buildings, roads and trees; '
                             'cut a part out of it')
        opened = [ring[:-1] if kind == 'building' and len(ring) > 1
                  and np.array_equal(ring[0], ring[-1]) else ring for ring in rings]
        least = {'building': 3, 'road': 2, 'tree': 1}[kind]
        opened[1:] = [ring for ring in opened[1:] if len(ring) >= least]
        if len(opened[0]) < least:
            self.leave_out(f'{kind} of less than {least} points')
            return
        every = np.concatenate(opened)
        if len(every) > _MOST_POINTS:
            raise SceneError(f'{where}: it has {len(every)} points, {_MOST_POINTS} are allowed')
        most = np.array([180.0, 90.0]) if self.geographic else np.array([1e8, 1e8])
        if not (np.abs(every) <= most).all():
            raise SceneError(
                f'{where}: coordinates must be ' + (
                    'longitudes from -180 to 180 and latitudes from -90 to 90 degrees'
                    if self.geographic else 'metres, up to 1e8'))
        self.features.append(Feature(kind, tuple(opened), tags, where))

    def leave_out(self, kind: str) -> None:
        """Count something that no scene has."""
        self.left_out[kind] = self.left_out.get(kind, 0) + 1

    def in_metres(self) -> list[Feature]:
        """
        Return the features in a plane, x to the east and y to the north [m].

        The origin is the middle of the map. Geographic coordinates are projected along the
        vertical there (east, north and up in the tangent plane of the ellipsoid).

        :raises SceneError: when the map is too wide for a plane.
        """
        if not self.features:
            return []
        every = np.concatenate([ring for feature in self.features for ring in feature.rings])
        middle = 0.5 * (every.min(axis=0) + every.max(axis=0))
        flat = [feature._replace(rings=tuple(
            (_tangent(ring, middle) if self.geographic else ring - middle).round(3)
            for ring in feature.rings)) for feature in self.features]
        width = np.ptp(np.concatenate([ring for one in flat for ring in one.rings]), axis=0).max()
        if width > _WIDEST:
            raise SceneError(f'{flat[0].where.split(":")[0]}: the map is {width / 1e3:.0f} km '
                             f'wide, at most {_WIDEST / 1e3:.0f} km are allowed')
        return flat


def read_map(path: Path) -> Map:
    """
    Read the buildings, roads and trees of a map; its ending tells the format.

    :raises SceneError: naming file and place, when it cannot be read.
    """
    try:
        raw = read_regular(path, _LARGEST_FILE + 1)
    except (OSError, ValueError) as problem:
        raise SceneError(f'{path}: it cannot be read: '
                         f'{getattr(problem, "strerror", None) or problem}') from None
    if len(raw) > _LARGEST_FILE:
        raise SceneError(f'{path}: it has more than {_LARGEST_FILE / 1e6:.0f} MB; cut a part out '
                         'of it')
    ending = next(end for end in sorted(MAPS, key=len, reverse=True) if path.name.endswith(end))
    reader = import_module(f'procphys_ros.maps.{_READERS[ending]}')
    return reader.read(raw, path)


def kind_of(tags: Mapping[str, str]) -> str | None:
    """Tell a feature by its tags, as OpenStreetMap has them; None = nothing that scenes have."""
    if tags.get('building', 'no') != 'no' and tags.get('location') != 'underground':
        return 'building'
    if 'highway' in tags and tags.get('area') != 'yes':
        return 'road'
    return 'tree' if tags.get('natural') == 'tree' else None


def _tangent(degrees: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Project longitudes and latitudes onto the tangent plane at a place [m], (n, 2)."""
    squared = _FLATTENING * (2.0 - _FLATTENING)  # of the eccentricity

    def earth(places: np.ndarray) -> np.ndarray:
        """Return points of the ellipsoid, turned so that the middle has longitude 0 [m]."""
        longitude = np.radians(places[:, 0] - middle[0])
        latitude = np.radians(places[:, 1])
        across = _EQUATOR / np.sqrt(1.0 - squared * np.square(sin(latitude)))
        return np.column_stack([across * cos(latitude) * cos(longitude),
                                across * cos(latitude) * sin(longitude),
                                across * (1.0 - squared) * sin(latitude)])

    away = earth(degrees) - earth(middle[None])
    up = float(np.radians(middle[1]))
    return np.column_stack([away[:, 1], cos(up) * away[:, 2] - sin(up) * away[:, 0]])
