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


"""Cut bricks: the parts that are pieces of one brick, so that they are drawn alike."""

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.blueprint import Blueprint, Law
from procphys_ros.geometry import rotation

# [Pa] tension and cohesion inside a brick or stone: a tenth of the compressive strength of bricks
# of 20 MPa, as good as sandstone of low strength.
TENSION, COHESION = 2e6, 3e6
_TOUCHING = 1e-4  # [m] between faces without a joint; joints of masonry are thicker


def first_pieces(blueprint: Blueprint) -> np.ndarray:
    """
    Find the first piece of the brick that each part was cut from, (N,) int.

    Bricks that are not cut are their own first pieces. Pieces of one brick touch each other and
    are bonded as strongly as stone, unlike neighbours with a joint between them.

    :param blueprint: at rest.
    """
    first = np.arange(len(blueprint))
    pair = _touching(blueprint) if len(blueprint.hexahedra) else ()
    if len(pair):
        graph = scipy.sparse.coo_array((np.ones(len(pair)), np.transpose(pair)),
                                       (len(first), len(first)))
        _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
        first = np.unique(label, return_index=True)[1][label]
    return first


def _touching(blueprint: Blueprint) -> np.ndarray:
    """List the pairs of pieces of one brick that share a face, (K, 2)."""
    solids = blueprint.hexahedra
    row = np.full(len(blueprint) + 1, -1)  # the last one is for the ground
    row[solids.part] = np.arange(len(solids))
    bonds = np.flatnonzero(blueprint.bond_law == Law.MORTAR)
    held = (blueprint.mortar.tension >= TENSION) & (row[blueprint.bonds[bonds]] >= 0).all(axis=1)
    bonds = bonds[held]
    pair = blueprint.bonds[bonds]
    frame = blueprint.bond_frame[bonds, None]
    points = solids.points(blueprint.poses)[row[pair]]
    normal = rotation.rotate(frame[..., 3:], np.array([0.0, 0.0, 1.0]))
    height = ((points - frame[:, None, :, :3]) * normal[:, None]).sum(axis=3)
    gap = height[:, 1].min(axis=1) - height[:, 0].max(axis=1)
    return pair[np.abs(gap) < _TOUCHING]
