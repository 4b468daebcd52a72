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

"""Cells of pieces that a blow strikes, against a dense solution with all bonds one by one."""

from masonry_walls import bonded, BRICK, JOINT
import numpy as np
import pytest

from procphys_ros.physics.masonry import blow_kernels, cells, FreeBodies, links


def wall(along, courses):
    """Bond bricks in the air, half a brick shifted in every other course."""
    length, tall = BRICK[0] + JOINT, BRICK[2] + JOINT
    return bonded([[length * (i + 0.5 * (k % 2)), 0.0, tall * k + 1.0]
                   for k in range(courses) for i in range(along)], BRICK, ground=False)


def loads_of_bonds(piece, wrenches, wanted):
    """
    Solve rigid cells and all bonds between them densely, in the accelerating frame of the piece.

    :returns: rows of the bonds between cells, and load over strength of each.
    """
    free, parts = FreeBodies(piece), np.arange(len(piece))
    graph, count = free.graph, len(piece)
    rows, a, b = cells.inside(parts, graph.start, graph.incident, graph.alive, graph.first,
                              graph.second, free._place)
    node, made = cells.grow(count, a, b, free._rank[parts], wanted)
    a, b = node[a], node[b]
    rows, a, b = rows[a != b], a[a != b], b[a != b]
    rigid = [_motions(graph.centre - graph.centre[node == cell].mean(axis=0), node == cell)
             for cell in range(made)]  # bricks weigh the same
    back = np.concatenate(rigid, axis=1)  # motion of parts by that of cells
    centre = np.array([graph.centre[node == cell].mean(axis=0) for cell in range(made)])
    packed = links.build(a, b, graph.centroid[rows], centre, graph.axes[rows], graph.spring[rows])
    whole = _motions(graph.centre - graph.centre.mean(axis=0), np.ones(count, bool))
    inertia = np.zeros((6 * count, 6 * count))
    for k in range(count):
        inertia[6 * k:6 * k + 3, 6 * k:6 * k + 3] = np.eye(3) * graph.mass[k]
        inertia[6 * k + 3:6 * k + 6, 6 * k + 3:6 * k + 6] = free._inertia[k]
    push = np.linalg.solve(whole.T @ inertia @ whole, whole.T @ wrenches.ravel())
    load = back.T @ (wrenches.ravel() - inertia @ whole @ push)
    stiffness = np.zeros((6 * made, 6 * made))
    for column in range(6 * made):
        q, out = np.zeros((2, made, 6))
        q.flat[column] = 1.0
        links.add_pulls(np.arange(len(rows)), packed, a, b, q, out, -1.0)
        stiffness[:, column] = out.ravel()
    moved = np.linalg.lstsq(stiffness, load, rcond=1e-10)[0].reshape(made, 6)
    wrench = np.zeros((len(rows), 6))
    links.pulls(np.arange(len(rows)), packed, graph.axes[rows], a, b, moved, wrench)
    over = np.zeros(len(rows))
    blow_kernels._overloads(
        wrench, rows, np.ones(len(rows), bool), (
            graph.centroid, graph.axes, graph.spring, graph.area, graph.extent,
            graph.whole_extent, graph.held), free._strength, free._wood, 1.0, over)
    return rows, over


def _motions(arms, moving):
    """Return the motions of parts with a body that they are rigid parts of, (6N, 6)."""
    out = np.zeros((len(arms), 6, 6))
    out[moving] = np.eye(6)
    x, y, z = arms[moving].T
    for (row, column), value in {(0, 4): z, (0, 5): -y, (1, 3): -z, (1, 5): x, (2, 3): y,
                                 (2, 4): -x}.items():
        out[moving, row, column] = value
    return out.reshape(-1, 6)


@pytest.mark.parametrize('wanted', [6, 20, 96])
def test_what_a_blow_breaks_first_is_what_a_dense_solution_tells(wanted):
    """Strike a wall of 96 bricks in one corner and turn another: few cells, many, and bricks."""
    piece = wall(8, 12)
    wrenches = np.zeros((len(piece), 6))
    wrenches[3] = 3e3, -8e3, 2e4, 40.0, 900.0, -300.0
    wrenches[90] = -5e3, 2e3, 0.0, 0.0, -700.0, 100.0
    rows, over = loads_of_bonds(piece, wrenches, wanted)
    clear = rows[over > 0.42 * over.max()]  # 0.4 of the worst and more break at once
    broken = FreeBodies(piece).strike(np.arange(len(piece)), wrenches, wanted)
    assert broken.share == pytest.approx(1.0 / over.max(), rel=0.02)
    loads = dict(zip(broken.bonds.tolist(), broken.load.tolist()))
    expected = dict(zip(rows.tolist(), over.tolist()))
    for row in clear.tolist():
        assert loads[row] == pytest.approx(expected[row], rel=0.02, abs=0.01 * over.max())
    first = broken.bonds[:len(clear)].tolist()
    assert min(expected[row] for row in first) > 0.38 * over.max()
