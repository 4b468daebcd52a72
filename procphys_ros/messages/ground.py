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


"""The ground in messages: heights of the terrain and pavings as JSON, and as markers."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.appearance.paving import Paving
from procphys_ros.messages.cdr import Stamp
from procphys_ros.messages.marker_rows import Action, command, ListMarker, marker_array, MarkerType
from procphys_ros.physics.terrain import FLAT, Terrain

MOST_HEIGHTS = 30_000  # in a message: 0.2 MB of JSON, 4.3 MB of triangles
_DIGITS = 3  # millimetres
_TERRAIN, _PAVING = 'terrain', 'paving'  # namespaces of markers


def thinned(terrain: Terrain, most: int = MOST_HEIGHTS) -> Terrain:
    """
    Keep every k-th height in both directions, with the smallest k that leaves at most `most`.

    Beyond the last height the ground continues level, so the last cells may reach farther.
    """
    step = 1
    while np.prod([-(-(count - 1) // step) + 1 for count in terrain.heights.shape]) > most:
        step += 1
    if step == 1:
        return terrain
    rows, columns = (np.minimum(step * np.arange(-(-(count - 1) // step) + 1), count - 1)
                     for count in terrain.heights.shape)
    return Terrain(terrain.heights[np.ix_(rows, columns)], terrain.low, step * terrain.edge)


def _on(shown: Terrain, terrain: Terrain, points: np.ndarray) -> np.ndarray:
    """Move points over a terrain to the same height over the terrain shown instead of it."""
    if shown is terrain:
        return points
    lift = points[:, 2] - terrain.height(points)
    return np.column_stack([points[:, :2], shown.height(points) + lift])


def describe_ground(terrain: Terrain, paving: Sequence[Paving]) -> dict[str, Any]:
    """
    Describe the ground for JSON.

    :returns: `terrain`: `low`, `edge` [m], `shape`, `heights` [m], row by row along x, and
        `simulated_edge` [m]; none of flat ground. `paving`: `texture`, `points` [m], `faces`.
    """
    described: dict[str, Any] = {}
    shown = thinned(terrain)
    if not terrain.is_flat:
        described['terrain'] = {
            'low': shown.low.tolist(), 'edge': shown.edge, 'simulated_edge': terrain.edge,
            'shape': list(shown.heights.shape),
            'heights': shown.heights.ravel().round(_DIGITS).tolist()}
    if paving:
        described['paving'] = [{'texture': one.texture, 'faces': one.faces.tolist(),
                                'points': _on(shown, terrain, one.points).round(
                                    _DIGITS).tolist()} for one in paving]
    return described


def ground_of(described: Mapping[str, Any]) -> tuple[Terrain, list[Paving]]:
    """Read the ground from a scene description."""
    paving = [Paving(one['texture'], np.array(one['points'], float).reshape(-1, 3),
                     np.array(one['faces'], int).reshape(-1, 3))
              for one in described.get('paving', ())]
    if not (hills := described.get('terrain')):
        return FLAT, paving
    heights = np.array(hills['heights'], float).reshape(hills['shape'])
    return Terrain(heights, np.array(hills['low'], float), float(hills['edge'])), paving


def ground_markers(terrain: Terrain, paving: Sequence[Paving], at: Stamp,
                   frame_id: str) -> bytes:
    """
    Write a visualization_msgs/MarkerArray of the ground, which clears earlier markers.

    :param terrain: its surface; flat ground has no marker.
    :param paving: of the ground.
    :param at: stamp of the markers.
    :param frame_id: frame of the markers.
    """
    chunks = [command(Action.DELETEALL, '', 0, frame_id)]
    shown = thinned(terrain)
    if not terrain.is_flat:
        points, faces = shown.mesh()
        chunks.append(ListMarker(MarkerType.TRIANGLE_LIST, _TERRAIN, 0, frame_id, rgba('ground'))
                      .write(points[faces.ravel()], at))
    for number, one in enumerate(paving):
        chunks.append(ListMarker(MarkerType.TRIANGLE_LIST, _PAVING, number, frame_id,
                                 rgba(one.texture))
                      .write(_on(shown, terrain, one.points)[one.faces.ravel()], at))
    return marker_array(chunks, len(chunks))
