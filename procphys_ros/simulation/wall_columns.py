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


"""Columns: parts behind the struck face of a wall that are pushed along."""

import numpy as np

from procphys_ros.geometry.linear import norm
from procphys_ros.simulation.state import State

_PRESSED = 0.7  # cosine between an impulse and a joint's normal, least for its transmission
_DEEPEST = 4    # leaves of a wall that move as one


def spread(state: State, impulses: np.ndarray, peaks: np.ndarray) -> np.ndarray:
    """
    Distribute impulses on standing parts over the thickness of their walls.

    A stress wave crosses a wall in a tenth of a millisecond, so that the parts behind another in
    the direction of its impulse move off with it, at one velocity.

    :param impulses: on all parts of buildings [N·s], world, (N, 3).
    :param peaks: largest force on each [N], (N,).
    :returns: impulses and peaks of jointly moving parts, (N, 4).
    """
    graph, count = state.solver.graph, len(impulses)
    given = np.column_stack([impulses, peaks])
    bonds = np.flatnonzero(graph.alive & (graph.first < count) & (graph.second < count))
    front = np.concatenate([graph.first[bonds], graph.second[bonds]])
    back = np.concatenate([graph.second[bonds], graph.first[bonds]])
    normal = np.tile(graph.axes[bonds, :, 2], (2, 1))
    normal[len(bonds):] *= -1.0
    area = np.tile(graph.area[bonds], 2)
    pressed = _pressed(front, back, normal, area, impulses)
    if not len(pressed):
        return given
    front, back, area = front[pressed], back[pressed], area[pressed]
    held = np.bincount(back, area, count)
    share = area / held[back]
    mass = state.parts.mass[:count]
    column = mass
    for _ in range(_DEEPEST):
        column = mass + np.bincount(front, share * column[back], count)
    share = share * column[back] / column[front]
    total, passed = given, given
    for _ in range(_DEEPEST):
        onward = np.zeros_like(given)
        np.add.at(onward, back, share[:, None] * passed[front])
        passed = onward
        total = total + passed
    return (mass / column)[:, None] * total


def _pressed(front: np.ndarray, back: np.ndarray, normal: np.ndarray, area: np.ndarray,
             impulses: np.ndarray) -> np.ndarray:
    """Select the joints that transmit an impulse, given the parts in front of and behind them."""
    size = norm(impulses, axis=1, keepdims=True)
    way = impulses / np.where(size > 0.0, size, 1.0)
    chosen = np.zeros(len(front), bool)
    for _ in range(_DEEPEST):
        known = np.abs(way).sum(axis=1) > 0.0
        chosen = (way[front] * normal).sum(axis=1) > _PRESSED
        fresh = np.flatnonzero(chosen & ~known[back])
        if not len(fresh):
            break
        total = np.zeros_like(way)
        np.add.at(total, back[fresh], area[fresh, None] * way[front[fresh]])
        size = norm(total, axis=1, keepdims=True)
        way += total / np.where(size > 0.0, size, 1.0)
    return np.flatnonzero(chosen & ((way[front] * way[back]).sum(axis=1) > _PRESSED))
