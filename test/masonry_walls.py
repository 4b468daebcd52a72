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

"""Boxes laid and bonded by plain geometry, as blueprints for the stress solver's tests."""

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import lil_matrix
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from procphys_ros.blueprint import Blueprint, box_inertia, GROUND, Law, Mortar, Shape
from procphys_ros.physics.masonry import Resistance, StressSolver
from procphys_ros.physics.masonry.capacity import at_failure

BRICK = (0.215, 0.1025, 0.065)  # [m], UK work size
JOINT = 0.01                    # [m]
DENSITY = 1900.0                # [kg/m³]
_FRAMES = np.array([[0.0, 0.5 ** 0.5, 0.0, 0.5 ** 0.5],    # z of the frame along world x
                    [-0.5 ** 0.5, 0.0, 0.0, 0.5 ** 0.5],   # along y
                    [0.0, 0.0, 0.0, 1.0]])                 # along z
_EXTENT = ((2, 1), (0, 2), (0, 1))  # world axes along the frame's x and y


def mortar(count, tension=0.2e6, cohesion=0.3e6, friction=0.7, compression=1e7, normal=1e11,
           shear=0.4e11):
    """Make the mortar of bonds with the same strengths."""
    return Mortar(*(np.full(count, float(v)) for v in (
        tension, cohesion, friction, compression, normal, shear)))


def bonded(centres, sizes, density=DENSITY, gap=0.012, ground=True, **strengths):
    """
    Bond axis-parallel boxes wherever faces look at each other over at most `gap`.

    :param centres: (N, 3).
    :param sizes: full extents along world x, y, z, (N, 3).
    :param ground: bond boxes whose underside lies within gap above z = 0 to the ground.
    """
    centres = np.asarray(centres, float)
    sizes = np.broadcast_to(np.asarray(sizes, float), centres.shape)
    i, j = _candidates(centres, sizes, gap)
    low = np.maximum(centres[i] - sizes[i] / 2, centres[j] - sizes[j] / 2)
    high = np.minimum(centres[i] + sizes[i] / 2, centres[j] + sizes[j] / 2)
    overlap = high - low
    axis = np.argmin(overlap, axis=1)
    rows = np.arange(len(i))
    others = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    faces = overlap[rows[:, None], others]
    keep = (faces.min(axis=1) > 1e-3) & (overlap[rows, axis] > -gap)
    i, j, axis, overlap, middle = (a[keep] for a in (i, j, axis, overlap, (low + high) / 2))
    turned = centres[j, axis] < centres[i, axis]
    i, j = np.where(turned, j, i), np.where(turned, i, j)
    if ground:
        base = np.flatnonzero(centres[:, 2] - sizes[:, 2] / 2 < gap)
        i = np.append(i, np.full(len(base), GROUND))
        j = np.append(j, base)
        axis = np.append(axis, np.full(len(base), 2))
        overlap = np.vstack([overlap, sizes[base]])
        middle = np.vstack([middle, centres[base] * [1, 1, 0]])
    extent = np.take_along_axis(overlap, np.array(_EXTENT)[axis], axis=1)
    return blueprint(centres, sizes, np.column_stack([i, j]),
                     np.hstack([middle, _FRAMES[axis]]), extent, density, **strengths)


def _candidates(centres, sizes, gap):
    """List pairs of boxes that may touch, each once, big boxes against all others."""
    big = sizes.max(axis=1) > 1.0
    small = np.flatnonzero(~big)
    reach = np.linalg.norm(sizes[small], axis=1).max(initial=0.0) + gap
    pairs = small[cKDTree(centres[small]).query_pairs(reach, output_type='ndarray')]
    for b in np.flatnonzero(big):
        near = np.all(np.abs(centres - centres[b]) < (sizes + sizes[b]) / 2 + gap, axis=1)
        near[b] = False
        near &= ~big | (np.arange(len(big)) > b)
        other = np.flatnonzero(near)
        pairs = np.vstack([pairs, np.column_stack([np.full(len(other), b), other])])
    return pairs[:, 0], pairs[:, 1]


def blueprint(centres, sizes, pairs, frames, extent, density=DENSITY, **strengths):
    """Wrap boxes and bonds into a blueprint."""
    count, links = len(centres), len(pairs)
    sizes = np.array(sizes, float)
    density = np.broadcast_to(np.asarray(density, float), (count,)).copy()
    mass = density * sizes.prod(axis=1)
    return Blueprint(
        shape=np.full(count, Shape.BOX, np.uint8), size=sizes, visual_size=sizes, density=density,
        mass=mass, inertia=box_inertia(mass, sizes),
        poses=np.hstack([centres, np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))]),
        kind=np.zeros(count, np.int16), material=np.zeros(count, np.int16),
        texture=np.zeros(count, np.int16), leaf_area=np.zeros(count),
        bonds=np.asarray(pairs, np.int32), bond_law=np.full(links, Law.MORTAR, np.uint8),
        bond_frame=np.asarray(frames, float), bond_extent=np.asarray(extent, float),
        bond_area=np.prod(extent, axis=1), mortar=mortar(links, **strengths), kinds=('brick',),
        materials=('brick',), textures=('brick',))


def wall_boxes(length, courses, holes=(), shift=(0.0, 0.0, 0.0), along=0, offset=0):
    """
    Lay a half-brick wall in running bond: centres and sizes of its bricks.

    :param length: in bricks; every second course starts and ends with a half brick.
    :param holes: (x0, z0, x1, z1) along the wall [m]; bricks inside are left out.
    :param along: 0 for a wall along x, 1 along y.
    :param offset: 0 or 1, which courses start with the half brick.
    """
    pitch, lift = BRICK[0] + JOINT, BRICK[2] + JOINT
    edges = []
    for course in range(courses):
        cuts = np.arange(length + 1) * pitch
        if (course + offset) % 2:
            cuts = np.concatenate([[0.0], cuts[:-1] + pitch / 2, cuts[-1:]])
        edges += [(a, b, course) for a, b in zip(cuts[:-1], cuts[1:])]
    low, high, course = np.array(edges).T
    x, z = (low + high) / 2, (course + 0.5) * lift - JOINT / 2
    keep = np.ones(len(x), bool)
    for x0, z0, x1, z1 in holes:
        keep &= ~((x > x0) & (x < x1) & (z > z0) & (z < z1))
    x, z, span = x[keep], z[keep], (high - low)[keep] - JOINT
    centres = np.column_stack([x, np.zeros_like(x), z])
    sizes = np.column_stack([span, np.full_like(x, BRICK[1]), np.full_like(x, BRICK[2])])
    if along:
        centres, sizes = centres[:, [1, 0, 2]], sizes[:, [1, 0, 2]]
    return centres + np.asarray(shift), sizes


def braced(length, courses, strength):
    """
    Lay a wall along x, so many bricks long, with a return of six bricks behind each of its ends.

    :param strength: of the mortar in tension and in shear [Pa].
    """
    inset, far = BRICK[1] / 2, length * (BRICK[0] + JOINT) - JOINT - BRICK[1]
    boxes = [wall_boxes(length, courses, shift=(0.0, inset, 0.0))]
    boxes += [wall_boxes(6, courses, shift=(x + inset, BRICK[1] + JOINT, 0.0), along=1, offset=1)
              for x in (0.0, far)]
    return bonded(*(np.vstack(column) for column in zip(*boxes)), tension=strength,
                  cohesion=strength)


def wall(length, courses, holes=(), **strengths):
    """Build a free-standing half-brick wall in running bond."""
    return bonded(*wall_boxes(length, courses, holes), **strengths)


def building(side=27, storeys=4, courses=38, windows=4, **strengths):
    """Build a square half-brick building with windows and rigid slabs on every storey."""
    # Façades along y start half a brick in, in alternate courses, so that the corners interlock.
    pitch, lift = BRICK[0] + JOINT, BRICK[2] + JOINT
    width = side * pitch
    step = width / windows
    holes = [(step * (w + 0.28), 0.9, step * (w + 0.72), 2.2) for w in range(windows)]
    inset, slab = BRICK[1] / 2, 0.16
    storey = courses * lift + slab + JOINT
    boxes = []
    for level in range(storeys):
        base = level * storey
        far = width - JOINT - BRICK[1]
        for y in (0.0, far):
            boxes.append(wall_boxes(side, courses, holes, (0.0, y + inset, base)))
        for x in (0.0, far):
            boxes.append(wall_boxes(side - 1, courses, holes,
                                    (x + inset, BRICK[1] + JOINT, base), along=1, offset=1))
        top = base + courses * lift
        boxes.append((np.array([[width / 2, width / 2, top + slab / 2]]),
                      np.array([[width, width, slab]])))
    return bonded(np.vstack([b[0] for b in boxes]), np.vstack([b[1] for b in boxes]), **strengths)


def admissible(plan, friction, standing=None):
    """
    Return whether dry joints can carry parts in the plane of x and z, by limit analysis (LP).

    Each joint presses at the two edges of its patch, and rubs; the lower bound theorem.

    :param standing: parts to look at, (N,) bool; None = all.
    """
    standing = np.ones(len(plan), bool) if standing is None else standing
    pairs, axes = plan.bonds, Rotation.from_quat(plan.bond_frame[:, 3:]).as_matrix()
    rows = np.flatnonzero(np.all((pairs == GROUND) | standing[pairs], axis=1))
    half = 0.5 * plan.bond_extent[:, 0]
    balance = lil_matrix((3 * len(plan), 3 * len(rows)))
    limit = lil_matrix((2 * len(rows), 3 * len(rows)))
    for n, k in enumerate(rows):
        edge, normal = axes[k][:, 0], axes[k][:, 2]
        for body, sign in zip(pairs[k], (-1.0, 1.0)):
            for column, (force, shift) in enumerate(((normal, -1.0), (normal, 1.0), (edge, 0.0))):
                if body == GROUND:
                    continue
                arm = plan.bond_frame[k, :3] + shift * half[k] * edge - plan.poses[body, :3]
                balance[3 * body:3 * body + 3, 3 * n + column] = sign * np.array(
                    [[force[0]], [force[2]], [arm[2] * force[0] - arm[0] * force[2]]])
        limit[2 * n:2 * n + 2, 3 * n:3 * n + 3] = [[-friction, -friction, 1.0],
                                                   [-friction, -friction, -1.0]]
    load = np.zeros(3 * len(plan))
    load[1::3] = np.where(standing, plan.mass * 9.81, 0.0)
    found = linprog(np.zeros(3 * len(rows)), A_ub=limit.tocsr(), b_ub=np.zeros(2 * len(rows)),
                    A_eq=balance.tocsr(), b_eq=load,
                    bounds=[(0, None), (0, None), (None, None)] * len(rows), method='highs')
    return found.status == 0


def resistance_of(solver: StressSolver, parts: np.ndarray, direction: np.ndarray) -> Resistance:
    """
    Compute the resistance of a set of parts that is driven out as one, without other parts.

    :param parts: (K,) indices.
    :param direction: unit vector, world, (3,).
    """
    graph = solver.graph
    bonds = graph.boundary(parts)
    driven = np.zeros(graph.count + 1, bool)
    driven[parts] = True
    force, work, rubbing = at_failure(graph, bonds, driven[graph.first[bonds]], direction,
                                      solver.wrenches(bonds))
    return Resistance(bonds, force.sum(), work.sum() + rubbing.sum(), rubbing.sum())
