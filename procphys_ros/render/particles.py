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

"""Particles: puffs of dust as soft translucent discs that face the camera."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.palette import rgba
from procphys_ros.render import light
from procphys_ros.render.mesh import Mesh

_CORNERS = 10  # of the disc of a puff
# The disc reaches two deviations from the middle; the profile of a Gaussian puff runs out there.
_RINGS = np.array([0.5, 1.0])  # radii over that of the disc
_FADE = np.array([0.61, 0.0])  # share of the optical depth in the middle that is left there
_FAINTEST = 2e-3  # opacity that cannot be seen in eight bits


def dust(positions: np.ndarray, sizes: np.ndarray, opacity: np.ndarray,
         eye: Sequence[float]) -> tuple[Mesh, np.ndarray]:
    """
    Build the discs, the furthest first, so that they may be blended in this order.

    :param positions: middles of the puffs [m], world, (K, 3).
    :param sizes: diameters of the discs [m], (K,).
    :param opacity: in the middle, 0 to 1, (K,).
    :param eye: where the camera stands [m], (3,).
    :returns: the mesh, and colour and opacity per vertex, 0 to 1, (V, 4).
    """
    seen = np.flatnonzero(opacity > _FAINTEST)
    towards = np.asarray(eye, float) - positions[seen]
    distance = np.linalg.norm(towards, axis=1)
    order = np.argsort(-distance, kind='stable')
    seen, towards = seen[order], (towards / np.maximum(distance, 1e-9)[:, None])[order]
    side, up = _facing(towards)
    turn = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    rings = (_RINGS[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], -1)).reshape(-1, 2)
    disc = np.concatenate([np.zeros((1, 2)), rings])
    reach = 0.5 * sizes[seen, None, None]
    points = positions[seen, None] + reach * (disc[:, :1] * side[:, None]
                                              + disc[:, 1:] * up[:, None])
    depth = -np.log1p(-np.minimum(opacity[seen], 1.0 - 1e-9))
    share = np.concatenate([[1.0], np.repeat(_FADE, _CORNERS)])
    count = len(disc)
    colours = np.empty((len(seen), count, 4))
    colours[..., :3] = _colour()
    colours[..., 3] = -np.expm1(-depth[:, None] * share)
    faces = (count * np.arange(len(seen))[:, None, None] + _faces()).reshape(-1, 3)
    mesh = Mesh(points.reshape(-1, 3), faces, np.repeat(towards, count, axis=0),
                np.zeros((len(seen) * count, 2)), np.repeat(seen, count))
    return mesh, colours.reshape(-1, 4)


def _colour() -> np.ndarray:
    """Give the colour of dust that sun and sky shine on from all sides, (3,)."""
    up = np.array([[0.0, 0.0, 1.0]])
    lit = light.on_surfaces(up, np.ones(1), np.ones(1))[0]
    return np.clip(np.asarray(rgba('mortar')[:3]) * lit, 0.0, 1.0)


def _facing(towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give two unit vectors across each direction (K, 3)."""
    aside = np.where(np.abs(towards[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    side = np.cross(aside, towards)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return side, np.cross(towards, side)


def _faces() -> np.ndarray:
    """Give the triangles of one disc: a fan, and a ring around it, (F, 3)."""
    inner = 1 + np.arange(_CORNERS)
    following = 1 + (np.arange(_CORNERS) + 1) % _CORNERS
    outer, beyond = inner + _CORNERS, following + _CORNERS
    return np.concatenate([
        np.column_stack([np.zeros_like(inner), inner, following]),
        np.column_stack([inner, outer, beyond]), np.column_stack([inner, beyond, following])])
