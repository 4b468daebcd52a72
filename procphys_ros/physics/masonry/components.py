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


"""Connected components of the bond graph and their support by the ground."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine


@subroutine
def root_of(parent, i):
    """Return the root of the component of part i, and shorten the path there."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]  # path halving (Tarjan & van Leeuwen 1984)
        i = parent[i]
    return i


@kernel
def label_living(count, first, second, alive):
    parent = np.arange(count)
    held = np.zeros(count, np.bool_)
    for m in range(len(first)):
        if not alive[m]:
            continue
        i, j = first[m], second[m]
        if i == count or j == count:
            held[root_of(parent, min(i, j))] = True
            continue
        i, j = root_of(parent, i), root_of(parent, j)
        if i != j:
            low, high = min(i, j), max(i, j)
            parent[high] = low  # the lowest part is the root of its component
            held[low] = held[low] or held[high]
    labels = np.empty(count, np.int32)
    supported = np.empty(count, np.bool_)
    for i in range(count):
        root = root_of(parent, i)
        labels[i] = root
        supported[i] = held[root]
    return labels, supported


def label(count: int, first: np.ndarray, second: np.ndarray,
          alive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Find the components of parts connected by living bonds; the ground supports, but joins none.

    Union-find over all bonds: linear, about a millisecond for 15,000 parts and 45,000 bonds.

    :param count: number of parts N.
    :param first, second: parts per bond, N for the ground, (M,).
    :param alive: bonds that hold, (M,) bool.
    :returns: label of each part, the lowest part of its component, (N,) int32, and whether its
        component is supported by the ground, (N,) bool.
    """
    if not len(first):
        return np.arange(count, dtype=np.int32), np.zeros(count, bool)
    return label_living(count, first, second, alive)


@kernel
def bonds_of_standing(first, second, alive, supported):
    """List the living bonds of supported parts, ascending."""
    found = np.zeros(len(first), np.bool_)
    for m in range(len(first)):
        found[m] = alive[m] and supported[min(first[m], second[m])]
    return np.flatnonzero(found)


@kernel
def joints_of_fallen(first, second, cracked, supported):
    """List the cracked joints of unsupported parts."""
    count = len(supported)
    found = np.zeros(len(first), np.bool_)
    for m in range(len(first)):
        if cracked[m]:
            i, j = first[m], second[m]
            found[m] = i < count and not supported[i] or j < count and not supported[j]
    return np.flatnonzero(found)


@kernel
def forget_fallen(supported, displacement, residual, sudden):
    """
    Clear displacements and loads of unsupported parts, rows of (N + 1, 6) each.

    :returns: whether any sudden load on supported parts is left.
    """
    left = False
    for i in range(len(sudden)):
        if i == len(supported) or supported[i]:
            for c in range(6):
                left |= sudden[i, c] != 0.0
        else:
            displacement[i], residual[i], sudden[i] = 0.0, 0.0, 0.0
    return left


def groups(labels: np.ndarray, chosen: np.ndarray) -> list[np.ndarray]:
    """
    List the components among the chosen parts, each as ascending part indices.

    :param labels: from `label`, (N,).
    :param chosen: parts of interest, (N,) mask, such as `~supported`.
    """
    parts = np.flatnonzero(chosen)
    order = np.argsort(labels[parts], kind='stable')
    parts = parts[order]
    return np.split(parts, np.flatnonzero(np.diff(labels[parts])) + 1) if len(parts) else []
