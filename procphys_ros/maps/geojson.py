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

"""GeoJSON (RFC 7946): polygons, lines and points with their properties."""

from collections.abc import Iterator, Mapping
import json
from pathlib import Path
import re
from typing import Any

import numpy as np

from procphys_ros.errors import SceneError
from procphys_ros.maps.features import kind_of, Map

_GEOGRAPHIC = re.compile(r'.*(CRS84|EPSG:+4326)\Z')
_DEPTH = {'Point': 0, 'MultiPoint': 1, 'LineString': 1, 'MultiLineString': 2, 'Polygon': 2,
          'MultiPolygon': 3}
_KINDS = {'Polygon': 'building', 'LineString': 'road', 'Point': 'tree'}
# Keys of OpenStreetMap by which an area without `building` is something else.
_OTHER_AREAS = {'highway', 'landuse', 'natural', 'leisure', 'waterway', 'water', 'boundary',
                'place', 'railway', 'amenity', 'barrier', 'man_made', 'power', 'aeroway'}


def parse_json(raw: bytes, path: Path) -> dict[str, Any]:
    """
    Read a JSON object.

    :raises SceneError: naming the line where it is not JSON.
    """
    try:
        found = json.loads(raw)
    except json.JSONDecodeError as problem:
        raise SceneError(f'{path}:{problem.lineno}: this is no JSON: {problem.msg}') from None
    except (UnicodeDecodeError, RecursionError, ValueError):
        raise SceneError(f'{path}: this is no JSON, or it is nested too deep') from None
    if not isinstance(found, dict):
        raise SceneError(f'{path}: a JSON object is expected')
    return found


def read(raw: bytes, path: Path) -> Map:
    """
    Read a FeatureCollection, or a single Feature.

    Polygons without tags of anything else are buildings, as in files of footprints alone.

    :raises SceneError: naming the feature that cannot be read.
    """
    root = parse_json(raw, path)
    found = Map(geographic=_is_geographic(root))
    if root.get('type') not in ('FeatureCollection', 'Feature'):
        raise SceneError(f'{path}: "type" is {root.get("type")!r}, it must be FeatureCollection '
                         'or Feature')
    features = root.get('features', []) if root['type'] == 'FeatureCollection' else [root]
    if not isinstance(features, list):
        raise SceneError(f'{path}: "features" must be a list')
    for number, feature in enumerate(features):
        where = f'{path}: feature {number}'
        if not isinstance(feature, dict):
            raise SceneError(f'{where} is no object')
        tags = texts(feature.get('properties'))
        for shape, rings in _shapes(feature.get('geometry'), where):
            plain = shape == 'Polygon' and 'building' not in tags and tags.keys().isdisjoint(
                _OTHER_AREAS)
            kind = 'building' if plain else kind_of(tags)
            if kind is not None and _KINDS[shape] == kind:
                found.add(kind, rings, tags, where)
            else:
                found.leave_out(shape)
    return found


def texts(properties: Any) -> dict[str, str]:
    """Return properties as texts by key, without empty ones."""
    if not isinstance(properties, Mapping):
        return {}
    return {str(key): str(value) for key, value in properties.items()
            if isinstance(value, str | int | float) and not isinstance(value, bool)}


def _is_geographic(root: Mapping[str, Any]) -> bool:
    """Return whether coordinates are degrees; older files may name another system."""
    named = root.get('crs')
    name = named.get('properties', {}) if isinstance(named, dict) else {}
    name = name.get('name') if isinstance(name, dict) else None
    return not isinstance(name, str) or bool(_GEOGRAPHIC.match(name))


def _shapes(geometry: Any, where: str) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Yield the parts of a geometry: name of the shape, and its rings."""
    if geometry is None:
        return
    shape = geometry.get('type') if isinstance(geometry, dict) else None
    if shape == 'GeometryCollection':
        members = geometry.get('geometries')
        for member in members if isinstance(members, list) else []:
            if isinstance(member, dict) and member.get('type') != shape:  # not nested further
                yield from _shapes(member, where)
        return
    if not isinstance(shape, str) or shape not in _DEPTH:
        raise SceneError(f'{where}: the type of its geometry is {shape!r}, it must be one of '
                         f'{", ".join(_DEPTH)}')
    parts = geometry.get('coordinates')
    parts = parts if shape.startswith('Multi') else [parts]
    single = shape.removeprefix('Multi')
    for part in parts if isinstance(parts, list) else [None]:
        lines = {0: lambda p: [[p]], 1: lambda p: [p], 2: lambda p: p}[_DEPTH[single]](part)
        yield single, [_points(line, where) for line in (
            lines if isinstance(lines, list) and lines else [None])]


def _points(values: Any, where: str) -> np.ndarray:
    """Read a list of positions; heights are dropped, (n, 2)."""
    if not isinstance(values, list) or not all(
            isinstance(point, list) and len(point) >= 2 and all(
                isinstance(v, int | float) and abs(v) < 1e300 for v in point[:2])
            for point in values):
        raise SceneError(f'{where}: its coordinates are no lists of positions [x, y]')
    return np.array([point[:2] for point in values], float).reshape(-1, 2)
