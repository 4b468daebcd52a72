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

"""What stands without mortar stands with any; large walls are solved by subdomains."""

from masonry_walls import bonded, braced
import numpy as np
import pytest
from test_dry_sizes import BRICK, Drawn, stands

from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver, subdomains

G = 9.81  # [m/s²]
# Tension and cohesion [Pa]: next to nothing, one of both alone, old lime, and more.
MORTARS = [(1.0, 0.0), (0.0, 1.0), (1e3, 1e3), (1e5, 1e5), (0.0, 1e5)]


def laid(plan, mortar):
    """Lay a plan in a mortar."""
    plan.mortar.tension[:], plan.mortar.cohesion[:] = mortar
    return plan


@pytest.mark.parametrize(('kind', 'seed'), [
    ('round', 0), ('round', 5), ('segmental', 2), ('pointed', 5)])
def test_no_mortar_makes_an_arch_weaker(kind, seed):
    """Stand 4 % above the least thickness of dry limit analysis, whatever the mortar."""
    arch = Drawn(kind, seed, BRICK)
    least = arch.least()
    for mortar in MORTARS:
        assert stands(laid(arch.build(1.04 * least), mortar))


class FlatArch(Drawn):
    """
    A flat arch of nine stones, whose joints meet in a point below.

    :param depth: of that point below the soffit, over half the span of 1.5 m.
    """

    def __init__(self, depth):
        self.radius, self.friction, self.density, self.modulus, self.breadth = (
            1.0, 0.7, 2000.0, BRICK, 0.3)
        low = np.column_stack([np.linspace(-0.75, 0.75, 10), np.zeros(10)])
        below = np.array([0.0, -0.75 * depth])
        high = below + (low - below) * (1.0 + 0.3 / (0.75 * depth))
        self.ends = np.stack([low, high], axis=1)

    def lines(self, ratio):
        """Return the ends of the joints."""
        return self.ends


@pytest.mark.parametrize('depth', [1.0, 1.7, 2.8])
def test_no_mortar_makes_a_flat_arch_fall(depth):
    """Let flat arches stand that stand dry."""
    for mortar in [(0.0, 0.0), *MORTARS]:
        assert stands(laid(FlatArch(depth).build(1.0), mortar))


def leaf(draw):
    """Lay a wall of two to six stones in running bond, one stone thick."""
    count, courses = int(draw.integers(2, 7)), int(draw.integers(4, 12))
    x, width, z = [], [], []
    for course in range(courses):
        edges = np.arange(count + 1.0) if course % 2 else np.concatenate(
            [[0.0], np.arange(count) + 0.5, [count]])
        x.append(0.2 * (edges[1:] + edges[:-1]))
        width.append(0.4 * np.diff(edges))
        z.append(np.full(len(edges) - 1, 0.2 * course + 0.1))
    x, width, z = (np.concatenate(part) for part in (x, width, z))
    return (np.column_stack([x, np.zeros(len(x)), z]),
            np.column_stack([width, np.full((len(x), 2), 0.2)]))


def portal(draw):
    """Lay two piers of two to seven stones, a lintel, and up to three stones on its middle."""
    height, width = int(draw.integers(2, 8)), draw.uniform(0.8, 2.0)
    piers = [(x, 0.0, 0.2 * k + 0.1) for x in (0.0, width) for k in range(height)]
    above = [(0.5 * width, 0.0, 0.2 * (height + k) + 0.3) for k in range(int(draw.integers(4)))]
    centres = np.array([*piers, (0.5 * width, 0.0, 0.2 * height + 0.1), *above])
    sizes = np.tile([0.4, 0.3, 0.2], (len(centres), 1))
    sizes[len(piers), 0] += width
    return centres, sizes


def corbel(draw):
    """Lay three to six stones, each as far out as those above allow, less 5 %."""
    count = int(draw.integers(3, 7))
    out = np.cumsum([0.0, *(0.95 * 0.2 / np.arange(count, 0, -1))])
    centres = np.column_stack([out, np.zeros(count + 1), 0.1 * np.arange(count + 1) + 0.05])
    return centres, np.tile([0.4, 0.2, 0.1], (count + 1, 1))


class Pushed:
    """A drawn structure of loose stones that is pushed sideways, by shares of its weight."""

    def __init__(self, form, side, seed, **strengths):
        draw = np.random.default_rng(seed)
        self.centres, self.sizes = form(draw)
        self.strengths = {'friction': draw.uniform(0.4, 0.8), 'compression': 1e12, **strengths}
        self.side, self.growing = side, draw.integers(2)

    def holds(self, share, mortar=(0.0, 0.0), **stronger):
        plan = bonded(self.centres, self.sizes, 2000.0, 1e-3, **(self.strengths | stronger))
        force = np.zeros((len(plan), 3))
        force[:, self.side] = share * G * plan.mass * (plan.poses[:, 2] if self.growing else 1.0)
        return stands(laid(plan, mortar), force)

    def most(self, mortar=(0.0, 0.0)):
        """Find the share of its weight that it holds, to 1 %."""
        low, high = 0.0, 3.0
        for _ in range(8):
            low, high = (0.5 * (low + high), high) if self.holds(0.5 * (low + high), mortar) else (
                low, 0.5 * (low + high))
        assert low > 0.0
        return low


_FORMS = pytest.mark.parametrize(('form', 'side'), [(leaf, 1), (portal, 0), (portal, 1),
                                                    (corbel, 0), (corbel, 1)])


@_FORMS
def test_no_mortar_makes_a_loaded_structure_weaker(form, side, seed=0):
    """Push drawn structures sideways by 95 % of what they hold dry: all hold in every mortar."""
    loose = Pushed(form, side, seed)
    most = 0.95 * loose.most()
    assert all(loose.holds(most, mortar) for mortar in MORTARS)


@pytest.mark.parametrize(('mortar', 'seed'), [((0.0, 0.0), 0), ((1e5, 1e5), 1)])
@_FORMS
def test_no_friction_makes_a_loaded_structure_weaker(form, side, mortar, seed):
    """Push them by 95 % of what they hold: they do with a fifth more friction, and with more."""
    loose = Pushed(form, side, seed)
    most = 0.95 * loose.most(mortar)
    assert all(loose.holds(most, mortar, friction=share * loose.strengths['friction'])
               for share in (1.2, 2.0, 8.0))


@_FORMS
def test_no_crushing_strength_makes_a_loaded_structure_weaker(form, side, seed=1):
    """Push stones that are crushed at 0.3 MPa by 95 % of what they hold: harder ones do, too."""
    loose = Pushed(form, side, seed, compression=0.3e6)
    most = 0.95 * loose.most()
    assert all(loose.holds(most, compression=strength) for strength in (0.6e6, 3e6, 1e12))


_PUSHED = np.arange(150, 156)  # neighbours, some way up


@pytest.fixture
def chosen(monkeypatch):
    """Allow steps on a part in small walls, too; list the numbers of parts they are on."""
    choose, sizes = subdomains.furthest_off, []

    def listed(*given):
        found = choose(*given)
        if found is not None:
            sizes.append(len(found.parts))
        return found
    monkeypatch.setattr(subdomains, '_LARGE', 0)
    monkeypatch.setattr(subdomains, 'furthest_off', listed)
    return sizes


def struck(built):
    """Make a standing wall under a blow that acts from now on."""
    fracture = Fracture(StressSolver(BondGraph(built)), 2.0)
    fracture.advance(20_000)
    push = np.zeros((len(built), 3))
    push[_PUSHED, 1] = 1000.0
    fracture.solver.set_loads(push)
    return fracture


def rounds_of(fracture, count, iterations=100):
    """Work on a blow until `count` rounds have failed something; return the failures of each."""
    failed = []
    for _ in range(4000 // iterations):
        found, over = fracture.withstand(iterations, 1000.0, np.concatenate)
        failed += [set(failures.bond.tolist()) for failures in found]
        if over or len(failed) == count:
            break
    return failed


def unbalanced(solver):
    """Add loads and true forces up from scratch, (N, 6)."""
    equilibrium = solver.equilibrium
    left = equilibrium.weight + equilibrium._given + equilibrium._sudden
    equilibrium.joints.add_pulls(np.flatnonzero(solver.graph.alive), solver.displacement, left,
                                 1.0)
    left[:-1][~solver.supported] = 0.0
    return left[:-1]


def test_the_residual_stays_exact_while_steps_are_on_a_part(chosen):
    """Compare the residual of every part with its forces, after every few iterations."""
    fracture = struck(braced(16, 30, 0.4e6))
    solver = fracture.solver
    for _ in range(60):
        fracture.withstand(7, 1000.0, np.concatenate)
        solver._halt()
        assert np.abs(solver.equilibrium.residual[:-1] - unbalanced(solver)).max() < 1e-6
    assert len(chosen) > 10 and max(chosen) < 0.34 * solver.graph.count


def test_steps_on_a_part_fail_the_same_bonds(chosen):
    """Crack a wall under a blow in four rounds, with such steps and without."""
    built = braced(16, 30, 0.4e6)
    confined = rounds_of(struck(built), 4)
    assert chosen
    subdomains._LARGE = 10_000
    assert confined == rounds_of(struck(built), 4) and len(confined) == 4
