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

"""Convex hexahedra: volume, centre, inertia and faces of solids with eight corners."""

from typing import NamedTuple

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import determinant, eigen, norm

# Corners of the faces, counter-clockwise from outside: -x +x -y +y -z +z (see `Hexahedra`).
FACES = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1],
                  [4, 5, 7, 6]])
_TRIANGLES = np.concatenate([FACES[:, [0, 1, 2]], FACES[:, [0, 2, 3]]])
_ADJACENT = np.array([np.flatnonzero(np.isin(FACES, corner).any(axis=1)) for corner in range(8)])
_PARALLEL = 1e-9  # products of inertia over the largest moment that count as zero
_FLAT = 1e-12  # eigenvalue of products of unit normals below which they lie in a plane


def box_corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """
    Return the corners of rectangular boxes, (N, 8, 3).

    :param low, high: opposite corners, (N, 3).
    """
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.where(bits, np.asarray(high)[:, None], np.asarray(low)[:, None])


def prisms(outlines: np.ndarray, low: np.ndarray | float, high: np.ndarray | float) -> np.ndarray:
    """
    Return the corners of upright prisms, (N, 8, 3).

    :param outlines: -x -y, +x -y, -x +y, +x +y, (N, 4, 2).
    :param low, high: levels, (N, 1) or numbers.
    """
    corners = np.empty((len(outlines), 8, 3))
    corners[:, :4, :2] = corners[:, 4:, :2] = outlines
    corners[:, :4, 2], corners[:, 4:, 2] = low, high
    return corners


def faces(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Compute the faces of hexahedra.

    :param corners: (N, 8, 3).
    :returns: their corners, counter-clockwise from outside, (N, 6, 4, 3), unit normals outwards,
        (N, 6, 3), zero for faces without area, and middles of the corners, (N, 6, 3).
    """
    points = corners[:, FACES]
    across = np.cross(points[:, :, 2] - points[:, :, 0], points[:, :, 3] - points[:, :, 1])
    length = norm(across, axis=2, keepdims=True)
    size = np.ptp(corners, axis=1).max(axis=1)[:, None, None]
    real = length > 1e-9 * (size * size)
    return points, np.where(real, across / np.where(real, length, 1.0), 0.0), points.mean(axis=2)


def volumes(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Compute volumes [m³], (N,), and centroids [m], (N, 3), of solids with flat faces.

    :param corners: [m], (N, 8, 3).
    """
    volume, middle, edges = _tetrahedra(corners)
    total = volume.sum(axis=1)
    arm = (volume[..., None] * edges.sum(axis=2)).sum(axis=1) / 4.0
    return total, middle + arm / np.where(total > 0.0, total, 1.0)[:, None]


def _tetrahedra(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut solids into tetrahedra about the middles of their corners: volumes, middles, edges."""
    middle = corners.mean(axis=1)
    edges = corners[:, _TRIANGLES] - middle[:, None, None]
    return determinant(edges) / 6.0, middle, edges


def inertia_tensors(corners: np.ndarray) -> np.ndarray:
    """
    Compute inertia tensors about the centroids for a density of 1 [m⁵], (N, 3, 3).

    Exact: a tetrahedron's second moments about its apex are V/20 (Σ e·eᵀ + s·sᵀ), with e its
    edges from there and s their sum (Tonon 2004, J. Math. Stat. 1(1)).

    :param corners: [m], (N, 8, 3).
    """
    volume, middle, edges = _tetrahedra(corners)
    total, centre = volumes(corners)
    whole = edges.sum(axis=2)
    second = (np.einsum('nt,ntei,ntej->nij', volume, edges, edges)
              + np.einsum('nt,nti,ntj->nij', volume, whole, whole)) / 20.0
    arm = centre - middle
    second -= total[:, None, None] * arm[:, :, None] * arm[:, None, :]
    trace = np.trace(second, axis1=1, axis2=2)
    return trace[:, None, None] * np.eye(3) - second


def principal_axes(tensors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Diagonalise inertia tensors, with axes as near to the given ones as possible.

    :param tensors: (N, 3, 3).
    :returns: moments, (N, 3), and axes as columns, right-handed, (N, 3, 3).
    """
    moments, axes = eigen(tensors)
    for row, own in enumerate(axes):
        order = _nearest_order(np.abs(own))
        turned = own[:, order]
        turned = turned * np.where(np.diag(turned) < 0.0, -1.0, 1.0)
        if determinant(turned) < 0.0:
            turned[:, np.argmin(np.abs(np.diag(turned)))] *= -1.0
        axes[row], moments[row] = turned, moments[row][order]
    diagonal = np.diagonal(tensors, axis1=1, axis2=2)
    rest = np.abs(tensors - diagonal[:, :, None] * np.eye(3)).max(axis=(1, 2))
    straight = rest < _PARALLEL * diagonal.max(axis=1)
    axes[straight], moments[straight] = np.eye(3), diagonal[straight]
    return moments, axes


def _nearest_order(size: np.ndarray) -> list[int]:
    """Choose for each axis the column most nearly along it."""
    orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]]
    return max(orders, key=lambda order: sum(size[i, c] for i, c in enumerate(order)))


class Solids(NamedTuple):
    """
    Hexahedra as parts of a blueprint.

    :ivar poses: centres and principal axes, world, (N, 7).
    :ivar corners: in these frames [m], (N, 24).
    :ivar size: full extents of the boxes about the frames that contain them [m], (N, 3).
    :ivar volume: [m³], (N,).
    :ivar inertia: principal moments over the density [m⁵], (N, 3).
    """

    poses: np.ndarray
    corners: np.ndarray
    size: np.ndarray
    volume: np.ndarray
    inertia: np.ndarray


def solids(corners: np.ndarray) -> Solids:
    """
    Find centres and principal axes of hexahedra.

    :param corners: world [m], (N, 8, 3).
    """
    volume, centre = volumes(corners)
    inertia, axes = principal_axes(inertia_tensors(corners))
    local = np.einsum('nck,nkj->ncj', corners - centre[:, None], axes)
    poses = np.column_stack([centre, rotation.from_matrix(axes)])
    return Solids(poses, local.reshape(-1, 24), 2.0 * np.abs(local).max(axis=1), volume, inertia)


def inset(corners: np.ndarray, distance: float) -> np.ndarray:
    """
    Move all faces of hexahedra inwards, (N, 8, 3).

    :param corners: (N, 8, 3).
    :param distance: by which each face moves.
    """
    normal = faces(corners)[1]
    normal = normal[:, _ADJACENT]
    real = (norm(normal, axis=3) > 0.5).astype(float)
    # Least shift with that component along each of the normals, two of which may be the same.
    values, vectors = eigen(np.einsum('ncik,ncjk->ncij', normal, normal))
    inverses = np.where(values > _FLAT, 1.0 / np.maximum(values, _FLAT), 0.0)
    weights = np.einsum('ncij,ncj,nckj,nck->nci', vectors, inverses, vectors, real)
    return corners - distance * np.einsum('nci,ncik->nck', weights, normal)


def write_hulls(corners: np.ndarray) -> str:
    """
    Format hexahedra as Wavefront OBJ, one object each: Bullet makes a convex hull of every object.

    :param corners: [m], (H, 8, 3).
    """
    quads = [' '.join(str(corner - 8) for corner in face) for face in FACES.tolist()]
    faces = ''.join(f'f {quad}\n' for quad in quads)  # counted back from the last corner
    return ''.join(f'o {number}\n' + ''.join(f'v {x:.9g} {y:.9g} {z:.9g}\n'
                                             for x, y, z in solid) + faces
                   for number, solid in enumerate(corners.tolist()))
