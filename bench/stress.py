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


"""
Time the stress solver on a building of 16,000 bricks against its two natural rivals, in one run.

The rivals are the same conjugate gradients with the block-Jacobi preconditioner alone, and scipy's
sparse LU. All are asked for the same accuracy: the largest nodal residual below a tenth of a
brick's weight. Usage: python bench/stress.py [bricks per side]
"""

from pathlib import Path
import sys
import time

import numpy as np
from scipy.sparse import bsr_matrix
from scipy.sparse.linalg import splu

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / 'test')]

from masonry_walls import building  # noqa: E402, I100

from procphys_ros.physics.masonry import (  # noqa: E402
    BondGraph,
    factor,
    Fracture,
    pcg,
    StressSolver,
)
from procphys_ros.physics.masonry.coarse import CoarseSpace  # noqa: E402
from procphys_ros.physics.masonry.coarse_matrix import CoarseMatrix  # noqa: E402

_REPEATS = 3
_ROUNDS = 10  # of the comparison of factors
_AGGREGATE = 8  # parts per aggregate, as the solver has them
_SYMMETRIC = {'permc_spec': 'MMD_AT_PLUS_A', 'diag_pivot_thresh': 0.0,
              'options': {'SymmetricMode': True}}


def timed(work):
    """Measure the duration of a call [s]; return it and its result."""
    begin = time.perf_counter()
    result = work()
    return time.perf_counter() - begin, result


def processor(work):
    """Measure the processor time of a call [s]."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def jacobi(solver, displacement, load, limit=20000):
    """Solve with blocks alone, from a displacement and its residual; return the iterations."""
    graph = solver.graph
    parts = np.flatnonzero(solver.supported)
    bonds = np.flatnonzero(graph.alive)
    state = (displacement, load, *np.zeros((3, graph.count + 1, 6)))
    ends, none = np.array([0, 1]), np.zeros(0, np.int64)
    whole = (parts, bonds, none, np.zeros(1, np.int64), ends * len(parts), ends * len(bonds),
             0 * ends, ends)
    rigid = (np.zeros(1, np.int64), np.zeros(2, np.int64), none, np.zeros(0, np.float32),
             np.zeros((1, 6, 6)))  # one aggregate, which does not move
    alone = (solver._gradients.blocks, np.zeros(graph.count + 1, np.int32),
             np.zeros((graph.count, 3)), rigid, *np.zeros((2, 1, 6)))
    return pcg.iterate(whole, (graph.links, graph.coupling, graph.first, graph.second), alone,
                       state, graph.reach, np.zeros(1), solver.tolerance, limit)[0][0]


def assembled(graph, owner, middle):
    """Assemble K itself, each part its own aggregate."""
    matrix = CoarseMatrix(graph, np.flatnonzero(graph.alive), owner, middle)
    return bsr_matrix((matrix.blocks, matrix.column, matrix.start)).tocsc()


def direct(solver):
    """Assemble and factor the whole K with scipy, solve once; return seconds of each."""
    parts = np.flatnonzero(solver.supported)
    owner = np.full(solver.graph.count + 1, -1)
    owner[parts] = np.arange(len(parts))
    assembly, matrix = timed(lambda: assembled(solver.graph, owner, solver.graph.centre[parts]))
    factoring, lu = timed(lambda: splu(matrix, **_SYMMETRIC))
    solving, _ = timed(lambda: lu.solve(solver.equilibrium.weight[parts].ravel()))
    return assembly, factoring, solving


def coarse_factors(solver):
    """Factor and solve the coarse matrix with our blocks and with scipy; print one line each."""
    graph, parts = solver.graph, np.flatnonzero(solver.supported)
    living = np.flatnonzero(graph.alive)
    space = CoarseSpace(graph, parts, living, _AGGREGATE)
    matrix = CoarseMatrix(graph, living, space.owner, space.middle)
    sparse = bsr_matrix((matrix.blocks, matrix.column, matrix.start)).tocsc()
    load = np.random.default_rng(0).normal(size=(space.count, 6))
    work = np.empty_like(load)
    whole = factor.Factor(matrix.start, matrix.column, matrix.blocks)
    every = np.arange(space.count)
    factor.solve(whole.panels, every, load.copy(), work)  # compiled
    lu = splu(sparse, **_SYMMETRIC)
    makers = {'ours': lambda: factor.Factor(matrix.start, matrix.column, matrix.blocks),
              'splu': lambda: splu(sparse, **_SYMMETRIC)}
    solvers = {'ours': lambda: factor.solve(whole.panels, every, load.copy(), work),
               'splu': lambda: lu.solve(load.ravel())}
    sizes = {'ours': sum(panel.nbytes for panel in whole.panels),
             'splu': 12 * (lu.L.nnz + lu.U.nnz)}
    times = {name: [[], []] for name in makers}
    for _ in range(_ROUNDS):  # side by side: the machine may be busy
        for name in makers:
            for kept, act in zip(times[name], (makers[name], solvers[name])):
                kept.append(processor(act))
    for name, (made, solved) in times.items():
        print(f'coarse matrix of {space.count} aggregates, {name}: factor '
              f'{1e3 * min(made):.1f} ms, solve {1e3 * min(solved):.2f} ms, '
              f'{1e-6 * sizes[name]:.1f} MB')


def change(name, solver, act):
    """Solve after a change with both preconditioners from the same state; print one line."""
    act()
    start = solver.displacement.copy(), solver.equilibrium.residual.copy()
    before = solver.spent
    ours, _ = timed(lambda: solver.iterate(20000))
    its = solver.spent - before
    theirs, count = timed(lambda: jacobi(solver, *start))
    print(f'{name:34s} {1e3 * ours:8.0f} ms {its:5d} its {1e3 * theirs:8.0f} ms {count:5d} its '
          f'  x{theirs / ours:5.1f}')


def main(side: int) -> None:
    """Print set-up, cold and warm solutions, and the cost of one iteration."""
    plan = building(side=side)
    warm = StressSolver(BondGraph(plan))
    warm.iterate(3)
    warm.utilisation()  # compiled
    jacobi(warm, warm.displacement, warm.equilibrium.residual, 1)
    graph_time, graph = timed(lambda: BondGraph(plan))
    setup, solver = timed(lambda: StressSolver(graph))
    print(f'{len(plan):,} parts, {len(graph):,} bonds; bond graph {graph_time:.2f} s, '
          f'solver {setup:.2f} s')
    print(f'{"":34s} {"two-level":>21s} {"block-Jacobi":>21s}')
    for _ in range(_REPEATS):
        change('cold', solver, solver.reset)
    judged, _ = timed(solver.utilisation)
    rng = np.random.default_rng(0)
    for count in (1, 20):
        change(f'{count} bonds cut', solver, lambda n=count: solver.cut(
            rng.choice(np.flatnonzero(graph.alive), n, replace=False)))
    centre = graph.centre
    wall = np.flatnonzero((centre[:, 1] < 0.11) & (centre[:, 2] < 2.7) & (graph.mass < 10.0))
    change(f'{len(wall)} bricks of one wall removed', solver,
           lambda: solver.cut(graph.neighbours(wall), 2.0))
    push = np.zeros((graph.count, 3))
    push[graph.count // 2] = 0, 1e4, 0
    change('10 kN on one brick', solver, lambda: solver.set_loads(push))

    solver.reset()
    solver.iterate(20)
    step = np.median([timed(lambda: solver.iterate(2))[0] / 2 for _ in range(10)])
    solver.iterate(20000)
    idle = np.median([timed(lambda: solver.iterate(6))[0] for _ in range(100)])
    print(f'one iteration {1e3 * step:.2f} ms; idle call {1e6 * idle:.1f} us; '
          f'all utilisations {1e3 * judged:.1f} ms')
    fracture = Fracture(solver)
    spent = solver.spent
    breaking, rounds = timed(lambda: fracture.advance(100000))
    print(f'cracks under own weight: {len(rounds)} rounds, {solver.spent - spent} its, '
          f'{breaking:.2f} s, {int((~solver.supported).sum())} parts fall')
    solver.reset()
    coarse_factors(solver)
    assembly, factoring, solving = direct(solver)
    print(f'scipy splu: assemble {assembly:.2f} s, factor {factoring:.2f} s, solve '
          f'{1e3 * solving:.0f} ms; factor/iteration = {factoring / step:.0f}')


if __name__ == '__main__':
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 32)
