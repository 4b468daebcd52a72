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

"""Wood as a brittle patch: hinges of detached branches as mortar bonds."""

from dataclasses import fields, replace

import numpy as np

from procphys_ros.blueprint import Blueprint, Hinges, Law, Mortar

_STIFFNESS = 1e12  # [Pa/m] of a rigid joint; the load in chains of branches does not depend on it
_SQUARE = 0.75     # side of the rectangle over the diameter of the circle of the same strength:
#                    A·e/6 = π·d³/32


def as_mortar(blueprint: Blueprint) -> Blueprint:
    """
    Return the blueprint with mortar for every hinge; capacities of wood are kept elsewhere.

    :param blueprint: hinges and mortar.
    :returns: a blueprint of mortar alone, rows as before.
    """
    hinge = blueprint.bond_law == Law.HINGE
    if not hinge.any():
        return blueprint
    columns = {}
    count = int(hinge.sum())
    values = {'normal_stiffness': np.full(count, _STIFFNESS),
              'shear_stiffness': np.full(count, _STIFFNESS),
              'friction': np.zeros(count), 'reinforcement': np.zeros(count)}
    for f in fields(Mortar):
        columns[f.name] = np.zeros(len(hinge))
        columns[f.name][~hinge] = getattr(blueprint.mortar, f.name)
        columns[f.name][hinge] = values.get(f.name, blueprint.hinges.strength)
    extent = np.where(hinge[:, None], _SQUARE, 1.0) * blueprint.bond_extent
    return replace(blueprint, bond_law=np.full(len(hinge), Law.MORTAR, np.uint8),
                   bond_extent=extent, hinges=Hinges(), mortar=Mortar(**columns))
