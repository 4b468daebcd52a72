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


"""The factor of the coarse matrix: it solves what scipy solves."""

from masonry_walls import wall
import numpy as np
import pytest
from scipy.sparse import block_diag, bsr_matrix
from scipy.sparse.linalg import spsolve

from procphys_ros.physics.masonry import BondGraph
from procphys_ros.physics.masonry.coarse_matrix import CoarseMatrix
from procphys_ros.physics.masonry.factor import clear, Factor, solve
from procphys_ros.physics.masonry.links import add_pulls


def matrix(count, density, seed):
    """Make a symmetric positive definite matrix of 6 x 6 blocks, the diagonal ones included."""
    rng = np.random.default_rng(seed)
    pattern = rng.random((count, count)) < density
    full = np.kron(pattern, np.ones((6, 6))) * rng.normal(size=(6 * count, 6 * count))
    made = bsr_matrix(full @ full.T + np.diag(np.full(6 * count, 10.0)), blocksize=(6, 6))
    made.sort_indices()
    return made


def factored(system):
    """Factor a matrix of blocks."""
    return Factor(system.indptr, system.indices, system.data.copy())


def reached(factor, unknowns):
    """List the columns that have to do with some unknowns."""
    columns, start = factor.reached(np.asarray(unknowns), np.array([0, len(unknowns)]))
    assert start.tolist() == [0, len(columns)]
    return columns


def solved(factor, load, columns=None):
    """Solve for all unknowns, or those of some columns."""
    found = load.copy()
    columns = np.arange(len(load)) if columns is None else columns
    solve(factor.panels, columns, found, np.empty_like(found))
    return found


@pytest.mark.parametrize('count, density', [(1, 1.0), (5, 0.3), (40, 0.05), (60, 0.5)])
def test_it_solves_as_scipy_does(count, density):
    """Agree to single precision, for matrices from diagonal to full."""
    system = matrix(count, density, count)
    load = np.random.default_rng(1).normal(size=(count, 6))
    found = solved(factored(system), load)
    wanted = spsolve(system.tocsc(), load.ravel()).reshape(-1, 6)
    np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


def test_the_solution_is_symmetric_in_double_precision():
    """Keep a·S·b = b·S·a, which conjugate gradients rest on."""
    factor = factored(matrix(40, 0.05, 2))
    a, b = np.random.default_rng(3).normal(size=(2, 40, 6))
    left = (a * solved(factor, b)).sum()
    assert left == pytest.approx((b * solved(factor, a)).sum(), rel=1e-11)


def test_an_island_is_solved_by_itself():
    """Touch the unknowns of one island, and nothing of the other."""
    both = bsr_matrix(block_diag([matrix(12, 0.3, 2), matrix(20, 0.2, 3)]), blocksize=(6, 6))
    both.sort_indices()
    factor = factored(both)
    load = np.arange(1.0, 1.0 + 6 * 32).reshape(-1, 6)
    found = solved(factor, load, reached(factor, np.arange(12)))
    changed = np.flatnonzero(np.any(found != load, axis=1))
    assert changed.tolist() == list(range(12))
    np.testing.assert_allclose(found[changed], solved(factor, load)[changed])
    clear(factor.panels, reached(factor, np.arange(12)), found)
    assert not found[changed].any() and found[12:].all()


def test_few_columns_have_to_do_with_few_unknowns():
    """Solve for some unknowns of a chain as with all columns, where nothing else is loaded."""
    chain = np.diag(np.full(60, 4.0)) - np.eye(60, k=1) - np.eye(60, k=-1)
    factor = factored(bsr_matrix(np.kron(chain, np.eye(6)), blocksize=(6, 6)))
    columns, start = factor.reached(np.array([30, 31, 7]), np.array([0, 2, 3]))
    for begin, end, unknowns in zip(start, start[1:], ([30, 31], [7])):
        load = np.zeros((60, 6))
        load[unknowns] = 1.0
        own = columns[begin:end]
        assert len(own) < 40 and np.all(np.diff(own) > 0)
        np.testing.assert_allclose(solved(factor, load, own)[unknowns],
                                   solved(factor, load)[unknowns], rtol=1e-12)


def test_what_nothing_holds_is_left_out():
    """Expect a finite solution where a piece has come loose, and the right one elsewhere."""
    spring = np.eye(6) * 1e9
    free = np.block([[spring, -spring], [-spring, spring]])
    system = bsr_matrix(block_diag([free, 2.0 * np.eye(6)]), blocksize=(6, 6))
    found = solved(factored(system), np.ones((3, 6)))
    assert np.all(np.isfinite(found)) and np.abs(found[:2]).max() < 1e-8
    np.testing.assert_allclose(found[2], 0.5)


def test_the_coarse_matrix_does_the_work_of_the_bonds():
    """Let PᵀKP of rigid motions be what the bonds between the aggregates resist."""
    graph = BondGraph(wall(15, 20))
    owner = np.append(np.arange(graph.count) // 12, -1)
    middle = np.add.reduceat(graph.centre, np.arange(0, graph.count, 12)) / 12.0
    matrix = CoarseMatrix(graph, np.flatnonzero(graph.alive), owner, middle)
    motion = np.random.default_rng(5).normal(size=(len(middle), 6))
    parts = np.zeros((graph.count + 1, 6))
    parts[:-1] = motion[owner[:-1]]
    parts[:-1, :3] += np.cross(parts[:-1, 3:], graph.centre - middle[owner[:-1]])
    force = np.zeros_like(parts)
    add_pulls(np.arange(len(graph)), graph.links, graph.first, graph.second, parts, force, -1.0)
    dense = bsr_matrix((matrix.blocks, matrix.column, matrix.start)).toarray()
    work = motion.ravel() @ dense @ motion.ravel()
    assert work == pytest.approx((force[:-1] * parts[:-1]).sum(), rel=1e-9)
