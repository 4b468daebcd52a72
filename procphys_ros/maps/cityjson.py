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

"""CityJSON 1.0 to 2.0: footprints of buildings, from their ground surfaces."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from procphys_ros.errors import SceneError
from procphys_ros.maps.features import Map
from procphys_ros.maps.geojson import parse_json, texts
from procphys_ros.maps.outlines import joined

# Codes of roofs of CityGML (SIG3D, 2010), as words of OpenStreetMap.
_ROOFS = {'1000': 'flat', '1010': 'skillion', '1020': 'skillion', '1030': 'gabled',
          '1040': 'hipped', '1050': 'half-hipped', '1060': 'mansard', '1070': 'pyramidal',
          '3100': 'gabled', '3200': 'hipped', '3300': 'half-hipped', '3400': 'mansard',
          '3500': 'pyramidal'}
_LEVEL = 0.5  # [m] above the lowest point: surfaces up to there are the ground's
_DEPTH = {'MultiSurface': 1, 'CompositeSurface': 1, 'Solid': 2, 'MultiSolid': 3,
          'CompositeSolid': 3}  # of lists around a surface


def read(raw: bytes, path: Path) -> Map:
    """
    Read the buildings and their parts.

    :raises SceneError: naming the object that cannot be read.
    """
    root = parse_json(raw, path)
    objects, points = root.get('CityObjects'), _vertices(root, path)
    if root.get('type') != 'CityJSON' or not isinstance(objects, dict):
        raise SceneError(f'{path}: this is no CityJSON: "type" and "CityObjects" are expected')
    found = Map(geographic=False)
    for name, own in objects.items():
        if not isinstance(own, dict) or own.get('type') not in ('Building', 'BuildingPart'):
            found.leave_out(str(own.get('type')) if isinstance(own, dict) else 'object')
            continue
        parents = own.get('parents')
        whole = objects.get(str(parents[0])) if isinstance(parents, list) and parents else None
        tags = {**texts(whole.get('attributes') if isinstance(whole, dict) else None),
                **texts(own.get('attributes'))}
        where = f'{path}: object {name}'
        grounds, height = _ground(own.get('geometry'), points, where)
        if height:
            tags.setdefault('height', f'{height:.2f}')
        for rings in joined(grounds):
            found.add('building', rings, _as_osm(tags), where)
    return found


def _vertices(root: Mapping[str, Any], path: Path) -> np.ndarray:
    """Return the vertices of all objects [m], (n, 3)."""
    change = root.get('transform') or {}
    try:
        points = np.array(root.get('vertices') or np.zeros((0, 3)), float)
        scale, move = (np.array(change.get(key, value), float) for key, value in (
            ('scale', [1.0] * 3), ('translate', [0.0] * 3)))
        if points.shape[1:] != (3,) or scale.shape != (3,) or move.shape != (3,):
            raise ValueError
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise SceneError(f'{path}: "vertices" and "transform" must hold points [x, y, z]'
                         ) from None
    return points * scale + move


def _as_osm(tags: Mapping[str, str]) -> dict[str, str]:
    """Return attributes with the keys of OpenStreetMap beside those of CityJSON."""
    found = {'building': 'yes', **tags}
    for key, other in (('measuredHeight', 'height'), ('storeysAboveGround', 'building:levels')):
        if key in tags:
            found[other] = tags[key]
    if 'roofType' in tags:
        found['roof:shape'] = _ROOFS.get(tags['roofType'], tags['roofType'].lower())
    return found


def _ground(geometries: Any, points: np.ndarray, where: str
            ) -> tuple[list[list[np.ndarray]], float]:
    """
    Return the ground surfaces of an object, rings in plan, and its height [m].

    These are its surfaces with that name, else those at its lowest level.
    """
    surfaces = [surface for geometry in (geometries if isinstance(geometries, list) else [])
                for surface in _surfaces(geometry, len(points), where)]
    if not surfaces:
        return [], 0.0
    every = points[np.concatenate([ring for rings, _ in surfaces for ring in rings])]
    low, high = every[:, 2].min(), every[:, 2].max()
    named = [rings for rings, name in surfaces if name == 'GroundSurface']
    level = [rings for rings, _ in surfaces
             if points[rings[0], 2].max() < low + _LEVEL]
    return [[points[ring, :2] for ring in rings] for rings in named or level], high - low


def _surfaces(geometry: Any, count: int, where: str) -> Iterator[tuple[list[np.ndarray], str]]:
    """Yield the surfaces of a geometry: rows of vertices by ring, and their kind."""
    depth = _DEPTH.get(str(geometry.get('type'))) if isinstance(geometry, dict) else None
    if depth is None:
        return
    given = geometry.get('semantics') or {}
    try:
        kinds = [kind.get('type') for kind in given.get('surfaces', [])]
        for rings, kind in _paired(geometry['boundaries'], given.get('values'), depth):
            rows = [np.array(ring, np.intp) for ring in rings]
            if rows and all(row.ndim == 1 and len(row) > 2 and row.min() >= 0
                            and row.max() < count for row in rows):
                yield rows, str(kinds[kind]) if isinstance(kind, int) else ''
    except (AttributeError, KeyError, IndexError, TypeError, ValueError, OverflowError):
        raise SceneError(f'{where}: its geometry is no lists of vertices as CityJSON has them'
                         ) from None


def _paired(boundaries: Sequence[Any], values: Any, depth: int) -> Iterator[tuple[Any, Any]]:
    """Yield the surfaces in nested lists with their values, which have one list less."""
    for k, boundary in enumerate(boundaries):
        value = values[k] if isinstance(values, list) else None
        if depth == 1:
            yield boundary, value
        else:
            yield from _paired(boundary, value, depth - 1)
