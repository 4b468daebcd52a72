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


"""Connected components of the bond graph against scipy, and who keeps the ground."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from procphys_ros.physics.masonry import components


def pairs_of(*pairs):
    """Return first and second of bonds, ground written as 'g' in a graph of ten parts."""
    array = np.array([[10 if p == 'g' else p for p in pair] for pair in pairs], np.int32)
    return array[:, 0].copy(), array[:, 1].copy()


def test_ground_supports_but_does_not_join():
    """Keep two islands apart that both stand on the ground."""
    first, second = pairs_of(('g', 0), (0, 1), ('g', 5), (5, 4))
    labels, supported = components.label(10, first, second, np.ones(4, bool))
    assert labels[0] == labels[1] == 0
    assert labels[4] == labels[5] == 4
    assert np.flatnonzero(supported).tolist() == [0, 1, 4, 5]


def test_cut_takes_the_ground_from_what_hangs_on_it():
    """Cut the bond that carries an arm: the arm falls, the rest stands."""
    first, second = pairs_of(('g', 0), (0, 1), (1, 2), (2, 3), (3, 4))
    alive = np.array([True, True, False, True, True])
    labels, supported = components.label(10, first, second, alive)
    assert supported[[0, 1]].all() and not supported[2:5].any()
    falling = np.zeros(10, bool)
    falling[:5] = ~supported[:5]
    assert [g.tolist() for g in components.groups(labels, falling)] == [[2, 3, 4]]


def test_groups_list_each_component_once_in_order():
    """Split several falling pieces into ascending part lists."""
    first, second = pairs_of((7, 2), (5, 9), (9, 8))
    labels, supported = components.label(10, first, second, np.ones(3, bool))
    pieces = components.groups(labels, ~supported)
    assert [p.tolist() for p in pieces] == [[0], [1], [2, 7], [3], [4], [5, 8, 9], [6]]
    assert components.groups(labels, np.zeros(10, bool)) == []


def test_labels_agree_with_scipy_on_random_graphs():
    """Find the same partition as scipy for graphs from dust to one lump."""
    rng = np.random.default_rng(11)
    count = 2000
    for bonds in (200, 1000, 1500, 5000):
        first, second = rng.integers(0, count + 1, (2, bonds)).astype(np.int32)
        keep = first != second
        first, second = first[keep], second[keep]
        alive = rng.random(len(first)) < 0.8
        labels, supported = components.label(count, first, second, alive)
        inner = alive & (first < count) & (second < count)
        matrix = coo_matrix((np.ones(inner.sum()), (first[inner], second[inner])), (count, count))
        number, expected = connected_components(matrix, directed=False)
        assert len(np.unique(labels)) == number
        assert len(np.unique(labels.astype(np.int64) * count + expected)) == number
        feet = np.minimum(first, second)[alive & ((first == count) | (second == count))]
        np.testing.assert_array_equal(supported, np.isin(expected, expected[feet]))
        assert np.all(labels[labels] == labels) and np.all(labels <= np.arange(count))
