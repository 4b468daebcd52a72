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


"""Mechanisms: the joints at which parts without equilibrium come off."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry.components import root_of
from procphys_ros.physics.masonry.graph import BondGraph

_GROUND, _LOOSE = 1, 2  # side of a component; 0 is undecided


@kernel
def separate(count, first, second, order, loose, cut):
    """
    Join parts bond by bond, but no loose part to the ground; mark the bonds between the sides.

    :param order: rows of the bonds that join, (K,) int64.
    :param loose: parts, (S,) int64.
    :param cut: (M,) bool, written for these bonds.
    """
    parent = np.arange(count + 1)
    side = np.zeros(count + 1, np.uint8)  # of each root
    side[count] = _GROUND
    side[loose] = _LOOSE
    for m in order:
        i, j = root_of(parent, first[m]), root_of(parent, second[m])
        if i != j and (side[i] == 0 or side[j] == 0):
            parent[max(i, j)] = min(i, j)
            side[min(i, j)] = max(side[i], side[j])
    for m in order:
        i, j = side[root_of(parent, first[m])], side[root_of(parent, second[m])]
        cut[m] = i != j


def loosening(graph: BondGraph, share: np.ndarray, parts: np.ndarray, labels: np.ndarray,
              drift: np.ndarray) -> np.ndarray:
    """
    Mark the overloaded bonds between drifting parts and the rest.

    As a load grows, bonds break in the order of their utilisation, until the part that has drifted
    furthest is loose. Only the bonds between it and the ground are chosen: breaking them relieves
    the others, so the largest possible lump comes off. This is the watershed of the utilisation
    with two sources (Cousty et al. 2009, IEEE Trans. Pattern Anal. Mach. Intell. 31(8)).

    :param share: utilisation, (M,).
    :param parts: drifting parts; the furthest of each island comes off with its lump, (K,).
    :param labels: island of each part, (N,).
    :param drift: displacement of the parts [m], (N,).
    :returns: mark of these bonds, (M,) bool. Bonds that are not overloaded may still hold.
    """
    drifts = np.zeros(graph.count + 1, bool)
    drifts[parts] = True
    around = (drifts[graph.first] | drifts[graph.second]) & (share > 1.0)
    weight = np.where(around, share, np.minimum(share, 1.0))
    return _watershed(graph, weight, parts, labels, drift) & around


def parting(graph: BondGraph, share: np.ndarray, parts: np.ndarray, labels: np.ndarray,
            drift: np.ndarray) -> np.ndarray:
    """
    List the bonds between overturned parts and the rest, at any utilisation.

    :param share: utilisation, (M,).
    :param parts, labels, drift: see `loosening`.
    :returns: rows of these bonds, (K,).
    """
    thrown = np.zeros(graph.count + 1, bool)
    thrown[parts] = True
    weight = np.where(thrown[graph.first] | thrown[graph.second], 1.0 + share,
                      np.minimum(share, 1.0))
    return np.flatnonzero(_watershed(graph, weight, parts, labels, drift))


def _watershed(graph: BondGraph, weight: np.ndarray, parts: np.ndarray, labels: np.ndarray,
               drift: np.ndarray) -> np.ndarray:
    """Mark the heaviest bonds that separate the furthest part of each island from the ground."""
    living = np.flatnonzero(graph.alive)
    parts = parts[np.argsort(-drift[parts], kind='stable')]
    furthest = parts[np.unique(labels[parts], return_index=True)[1]]
    cut = np.zeros(len(graph), bool)
    separate(graph.count, graph.first, graph.second,
             living[np.argsort(weight[living], kind='stable')], furthest, cut)
    return cut
