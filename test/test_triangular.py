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

"""The supernodal factor: it solves what scipy solves, also for one island alone."""

import numpy as np
import pytest
from scipy.sparse import block_diag, csc_matrix
from scipy.sparse import random as random_sparse
from scipy.sparse.linalg import spsolve

from procphys_ros.physics.masonry.triangular import clear, Factor, solve


def matrix(count, density, seed):
    """Make a symmetric positive definite matrix of 6 x 6 blocks."""
    pattern = random_sparse(count, count, density, rng=np.random.default_rng(seed)).toarray() > 0
    full = np.kron(pattern, np.ones((6, 6))) * np.random.default_rng(seed).normal(
        size=(6 * count, 6 * count))
    return csc_matrix(full @ full.T * (np.kron(pattern @ pattern.T, np.ones((6, 6))) > 0)
                      + np.diag(np.full(6 * count, 10.0)))


@pytest.mark.parametrize('count, density', [(1, 1.0), (5, 0.3), (40, 0.05), (60, 0.5)])
def test_it_solves_as_scipy_does(count, density):
    """Agree to rounding, for matrices from diagonal to full."""
    system = matrix(count, density, count)
    factor = Factor.of(system)
    wanted = np.random.default_rng(1).normal(size=6 * count)
    found = system @ wanted
    solve(factor.panels, factor.supernodes(np.arange(6 * count)), found, np.empty(6 * count))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found, spsolve(system, system @ wanted), rtol=1e-9, atol=1e-9)


def test_an_island_is_solved_by_itself():
    """Touch the unknowns of one island, and nothing of the other."""
    island, other = matrix(12, 0.3, 2), matrix(20, 0.2, 3)
    factor = Factor.of(block_diag([island, other], format='csc'))
    chosen = factor.supernodes(np.array([5]))
    load = np.arange(1.0, 1.0 + 6 * 32)
    found = load.copy()
    solve(factor.panels, chosen, found, np.empty(len(load)))
    reached = factor.component_of == factor.component_of[5]
    np.testing.assert_array_equal(found[~reached], load[~reached])
    np.testing.assert_allclose(found[reached], spsolve(
        block_diag([island, other], format='csc'), np.where(reached, load, 0.0))[reached])
    clear(factor.panels, chosen, found)
    assert not found[reached].any() and found[~reached].all()


def test_an_indefinite_matrix_is_refused():
    """Say so instead of giving a wrong answer."""
    with pytest.raises((FloatingPointError, RuntimeError)):
        Factor.of(csc_matrix(np.array([[0.0, 1.0], [1.0, 0.0]])))
