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

"""Dry walls bonded into a buttress by through stones, against contacts of many points."""

from contact_points import ContactPoints
from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver

G = 9.81          # [m/s²]
MODULUS = 3e10    # [Pa] of the stones
FRICTION = 0.6
STRENGTH = 1e12   # [Pa] in compression: nothing crushes
LENGTH, THICKNESS, HEIGHT, DEPTH = 0.4, 0.2, 0.2, 0.4  # [m] of wall stones; the buttress behind


def buttressed(count, courses):
    """
    Lay a dry wall with a buttress behind its middle, stones of every other course through both.

    :param count: stones per course, even.
    """
    stones = []
    middle = 0.5 * count * LENGTH
    for course in range(courses):
        z = (course + 0.5) * HEIGHT
        ends = np.arange(count + 1) * LENGTH
        if course % 2:
            ends = np.concatenate([[0.0], ends[:-1] + 0.5 * LENGTH, ends[-1:]])
        for a, b in zip(ends[:-1], ends[1:]):
            through = course % 2 and abs(0.5 * (a + b) - middle) < 0.1 * LENGTH
            stones.append((a, b, 0.0, THICKNESS + DEPTH * bool(through), z))
        if not course % 2:
            stones.append((middle - 0.5 * LENGTH, middle + 0.5 * LENGTH, THICKNESS,
                           THICKNESS + DEPTH, z))
    left, right, front, back, z = np.array(stones).T
    plan = bonded(
        np.column_stack([0.5 * (left + right), 0.5 * (front + back), z]),
        np.column_stack([right - left, back - front, np.full(len(z), HEIGHT)]), density=2000.0,
        gap=1e-3, tension=0.0, cohesion=0.0, friction=FRICTION, compression=STRENGTH)
    stone = np.where(plan.bonds == GROUND, 0.0, np.abs(
        plan.poses[plan.bonds, :3] - plan.bond_frame[:, None, :3]).max(axis=2)).sum(axis=1)
    plan.mortar.normal_stiffness[:] = MODULUS / stone
    plan.mortar.shear_stiffness[:] = 0.4 * MODULUS / stone
    return plan


def stands(plan, force):
    """Let a wall settle, push it, and return whether all of it stands."""
    solver = StressSolver(BondGraph(plan))
    fracture = Fracture(solver)
    fracture.advance(6000)
    solver.set_loads(force)
    fracture.advance(20_000)
    assert fracture.stable
    return bool(solver.supported.all())


@pytest.mark.report('laws')
@pytest.mark.parametrize(('courses', 'push', 'most'), [(3, -1.0, 0.436), (4, 1.0, 0.461)])
def test_walls_lean_as_far_as_contacts_of_many_points_let_them(courses, push, most, measured):
    """
    Push walls away from their buttress and onto it: 5 % below and above what they stand.

    Limit analysis, whose friction widens the joints that slide, lets them stand 0.562 and 0.556
    of their weight (decision 49).
    """
    plan = buttressed(4, courses)
    force = np.zeros((len(plan), 3))
    force[:, 1] = push * plan.mass * G
    for share, holds in ((0.95, True), (1.05, False)):
        assert ContactPoints(plan, FRICTION).carry(share * most * force) == holds
        measured('dry walls bonded into a buttress stand, pushed to '
                 f'{share:g} of what contacts of many points carry',
                 stands(plan, share * most * force), holds)
