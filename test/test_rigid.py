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


"""The contact solver of our own: manifolds against brute force, and bodies against statics."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from procphys_ros.blueprint import Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.rigid.contacts import find, join_key, no_contacts, split_key
from procphys_ros.physics.rigid.pieces import BOX, HEXAHEDRON, no_pieces, place, ROUND
from procphys_ros.physics.rigid.reduction import spanning
from procphys_ros.physics.terrain import FLAT
from procphys_ros.physics.touch import overlaps
from procphys_ros.physics.world import World
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.loose_bodies import plain
from procphys_ros.physics.world.native import NativeEngine
from procphys_ros.physics.world.pairs import meeting, PairList
from procphys_ros.physics.world.pieces import single

G = np.array([0.0, 0.0, -9.81])
BRICK = np.array([0.215, 0.1025, 0.065])
DT = 1.0 / 60.0


def bodies(places, sizes, masses, friction=0.6, fixed=(), gravity=G):
    """Put boxes into an engine; some stand still."""
    table = BodyTable()
    table.add_ground(friction)
    poses = np.column_stack([places, np.tile([0.0, 0.0, 0.0, 1.0], (len(places), 1))])
    ids = table.add_bodies(BodyState.AWAKE, [
        plain(Shape.BOX, np.broadcast_to(sizes, (len(places), 3))[n], masses[n], poses[n],
              friction=friction) for n in range(len(places))])
    table.set_state(ids[list(fixed)], BodyState.FIXED)
    engine = NativeEngine(gravity)
    engine.add(table, np.concatenate([[0], ids]))
    return table, ids, engine


def run(engine, seconds, time_step=DT):
    """Step for some time."""
    for _ in range(round(seconds / time_step)):
        engine.step(time_step)


def two_pieces(kinds, sizes, poses):
    """Place two pieces; hexahedra have the corners of boxes."""
    pieces = no_pieces(2)
    pieces.body[:], pieces.kind[:] = [1, 2], kinds
    pieces.size[:], pieces.local[:, 6] = sizes, 1.0
    signs = np.array([[1 if c & b else -1 for b in (1, 2, 4)] for c in range(8)])
    pieces.cut[:] = (0.5 * signs * np.asarray(sizes)[:, None]).reshape(2, 24)
    table = np.concatenate([[[0.0, 0.0, -9.0, 0.0, 0.0, 0.0, 1.0]], poses])
    place(np.arange(2), pieces, table, np.zeros((3, 6)), 0.0)
    return pieces, table


def touching(pieces, table, before=None):
    """Find the contacts of two pieces, those of the step before given."""
    no_points = np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64)
    both = join_key(np.array([0]), np.array([1]))
    rows, count = find(np.array([0]), np.ones(1, bool), both, pieces, table,
                       np.zeros((3, 6)), no_points, FLAT, 0.0,
                       no_contacts(0) if before is None else before)
    return rows.head(count)


def draw_poses(rng, apart):
    """Draw two poses near each other, high above the ground."""
    turns = rng.normal(size=(2, 4))
    turns /= np.linalg.norm(turns, axis=1)[:, None]
    way = rng.normal(size=3)
    return np.column_stack([[[0.0, 0.0, 5.0], [0.0, 0.0, 5.0] + apart * way], turns])


@cache
def everywhere():
    """Draw directions, (40000, 3)."""
    ways = np.random.default_rng(4).normal(size=(40_000, 3))
    return ways / np.linalg.norm(ways, axis=1)[:, None]


def nearest(one, two, rng):
    """Compute the gap of two convex sets of corners along the best of many directions."""
    ways = everywhere()
    gaps = (ways @ one.T).min(axis=1) - (ways @ two.T).max(axis=1)
    best = ways[np.argmax(gaps)]
    for size in (0.02, 0.004, 0.0008):
        more = best + size * rng.normal(size=(4000, 3))
        more /= np.linalg.norm(more, axis=1)[:, None]
        gaps = (more @ one.T).min(axis=1) - (more @ two.T).max(axis=1)
        best = more[np.argmax(gaps)]
    return gaps.max()


@pytest.mark.parametrize('kinds', [(BOX, BOX), (HEXAHEDRON, BOX), (HEXAHEDRON, HEXAHEDRON)])
def test_gaps_are_those_of_the_best_of_many_directions(kinds):
    """Place boxes at random, as boxes and as hexahedra: no direction separates them more."""
    rng, seen = np.random.default_rng(3), 0
    for _ in range(40):
        sizes = rng.uniform(0.05, 0.4, (2, 3))
        pieces, table = two_pieces(kinds, sizes, draw_poses(rng, 0.12))
        rows = touching(pieces, table)
        wanted = nearest(*pieces.corners, rng)
        if not len(rows.gap):
            assert wanted > 0.004
            continue
        assert rows.gap.min() == pytest.approx(wanted, abs=2e-3)
        np.testing.assert_allclose(np.linalg.norm(rows.normal, axis=1), 1.0, atol=1e-9)
        assert len(rows.gap) <= 4
        seen += 1
    assert seen > 15


@pytest.mark.parametrize('ridge', [1.0, 0.6, 0.0])
def test_hexahedra_touch_on_the_surface_of_both(ridge):
    """Lay boxes, voussoirs and prisms against each other: they touch where they are."""
    rng, crossed = np.random.default_rng(6), 0
    for _ in range(200):
        sizes, poses = rng.uniform(0.05, 0.4, (2, 3)), draw_poses(rng, 0.12)
        for _ in range(4):  # the second comes out of the first until they hardly touch
            pieces, table = two_pieces((HEXAHEDRON, HEXAHEDRON), sizes, poses)
            pieces.cut[:, [12, 15, 18, 21]] *= ridge  # both ends of their upper sides
            place(np.arange(2), pieces, table, np.zeros((3, 6)), 0.0)
            rows = touching(pieces, table)
            if not len(rows.gap):
                break
            normal = rows.normal[0]
            low, high = (pieces.corners[0] @ normal).min(), (pieces.corners[1] @ normal).max()
            poses[1, :3] += (low - high) * normal
        if not len(rows.gap):
            continue
        for point in rows.point:
            assert abs(point @ normal - 0.5 * (low + high)) < 5e-3
            for faces, corners in zip(pieces.normals, pieces.corners):
                assert ((faces @ point) - (corners @ faces.T).max(axis=0)).max() < 5e-3
        crossed += bool((np.abs(np.concatenate(pieces.normals) @ normal) < 0.99).all())
    assert crossed > 5


def test_round_pieces_keep_the_distance_of_their_axes():
    """Place capsules and balls near boxes: the gap is that of points along the axis."""
    rng, seen = np.random.default_rng(5), 0
    for n in range(80):
        length = 0.1 if n % 2 else rng.uniform(0.1, 0.6)
        sizes = np.array([[0.1, 0.1, length], rng.uniform(0.1, 0.4, 3)])
        pieces, table = two_pieces((ROUND, BOX), sizes, draw_poses(rng, 0.15))
        a, b = pieces.corners[0, :2]
        along = a + np.linspace(0.0, 1.0, 2001)[:, None] * (b - a)
        inside = (along - pieces.centre[1]) @ pieces.axes[1].T
        beyond = np.maximum(np.abs(inside) - 0.5 * sizes[1], 0.0)
        far = np.linalg.norm(beyond, axis=1).min()
        rows = touching(pieces, table)
        if far > 1e-6 and far - 0.05 < 0.004:
            assert rows.gap.min() == pytest.approx(far - 0.05, abs=1e-3)
            seen += 1
        elif far - 0.05 > 0.006:
            assert not len(rows.gap)
    assert seen > 15


@pytest.mark.parametrize(('share', 'stands'), [(0.95, True), (1.03, False)])
def test_corbels_stand_up_to_their_limit(share, stands, count=6):
    """Lay each brick over the one below by L / 2n, times a share."""
    reach = [0.0]
    for n in range(1, count + 1):
        reach.append(reach[-1] - BRICK[0] / (2 * n) * share)
    places = [(reach[n], 0.0, BRICK[2] * (count - n + 0.5)) for n in range(count + 1)]
    table, ids, engine = bodies(places, BRICK, np.full(count + 1, 2.6), 0.7, [count])
    run(engine, 3.0)
    assert (np.abs(table.poses[ids, :3] - places).max() < 1e-3) == stands


def test_slabs_lie_on_loose_posts():
    """Lay a slab on 25 posts of loose bricks, 15,000 times as heavy as one: it stays."""
    mass, height = 40e3, 4
    places = [(0.5 * i, 0.5 * j, BRICK[2] * (k + 0.5))
              for i in range(5) for j in range(5) for k in range(height)]
    sizes = [BRICK] * len(places) + [[4.0, 4.0, 0.2]]
    places.append((1.0, 1.0, BRICK[2] * height + 0.1))
    table, ids, engine = bodies(places, sizes, [2.6] * (len(places) - 1) + [mass])
    run(engine, 1.0)
    assert np.abs(table.poses[ids, :3] - places).max() < 5e-4  # 0.04 mm


@pytest.mark.parametrize(('mass', 'courses', 'time_step'), [
    (2e3, 3, DT), (20e3, 1, 1 / 240), (20e3, 3, 1 / 30)])
def test_what_lands_on_light_bricks_does_not_drive_them_into_the_ground(mass, courses, time_step):
    """Drop a slab on loose bricks: none sinks in, and the ground gets all momentum."""
    places = [(0.5 * i, 0.5 * j, BRICK[2] * (k + 0.5))
              for i in range(5) for j in range(5) for k in range(courses)]
    places.append((1.0, 1.0, BRICK[2] * courses + 0.13))
    table, ids, engine = bodies(places, [BRICK] * (len(places) - 1) + [[3.0, 3.0, 0.2]],
                                [2.6] * (len(places) - 1) + [mass])
    table.velocities[ids[-1], 2] = -5.0
    given, lowest = 0.0, 1.0
    for _ in range(round(0.5 / time_step)):
        engine.step(time_step)
        told = engine.contacts()
        given += told[told[:, 1] == 0, 11].sum() * time_step
        lowest = min(lowest, table.poses[ids[:-1], 2].min())
    assert lowest > 0.5 * BRICK[2] - 5e-3
    assert given == pytest.approx(5.0 * mass + 0.5 * 9.81 * table.mass[ids].sum(), rel=0.02)
    assert np.abs(table.velocities[ids]).max() < 0.05


def test_a_brick_is_as_light_to_the_side_whatever_lies_on_it():
    """Throw the lowest of a column to the side: friction alone brakes it."""
    count, speed, grip = 12, 4.0, 0.3
    places = [(0.0, 0.0, BRICK[2] * (k + 0.5)) for k in range(count)]
    table, ids, engine = bodies(places, BRICK, np.full(count, 2.6), grip)
    table.velocities[ids[0], 0] = speed
    run(engine, 1 / 240, 1 / 240)
    brake = grip * 9.81 * (2 * count - 1)  # by what lies on it, and the ground by all
    assert table.velocities[ids[0], 0] == pytest.approx(speed - brake / 240, rel=0.01)


@pytest.mark.parametrize('time_step', [1 / 30, 1 / 60, 1 / 240])
def test_a_block_rocks_as_housner_has_it(time_step):
    """Let a tilted block go: the share of its amplitude after the first impact (Housner 1963)."""
    half, tilt = np.array([0.1, 0.5]), 0.1
    radius, edge = np.hypot(*half), np.arctan2(*half)
    middle = [half[0] - radius * np.sin(edge - tilt), 0.0, radius * np.cos(edge - tilt)]
    table, ids, engine = bodies([middle], [[0.2, 0.4, 1.0]], [50.0], 0.9)
    table.poses[ids[0], 3:] = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), tilt)
    least = 0.0
    for _ in range(round(1.2 / time_step)):
        engine.step(time_step)
        least = min(least, 2.0 * np.arctan2(*table.poses[ids[0], [4, 6]]))
    kept = 1.0 - 1.5 * np.sin(edge) ** 2
    wanted = edge * (1.0 - np.sqrt(1.0 - kept ** 2 * (1.0 - (1.0 - tilt / edge) ** 2)))
    assert -least == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize('time_step', [1 / 60, 1 / 240])
def test_dominoes_fall_one_by_one(time_step):
    """Push the first of 20: all fall, at a speed that hardly depends on the step."""
    count, height, pitch = 20, 0.24, 0.13
    table, ids, engine = bodies([(pitch * n, 0.0, 0.5 * height) for n in range(count)],
                                [0.05, 0.12, height], np.full(count, 2.6))
    table.velocities[ids[0]] = [0.4, 0.0, 0.0, 0.0, 4.0, 0.0]
    fell = np.full(count, np.nan)
    for step in range(round(5.0 / time_step)):
        engine.step(time_step)
        upright = 1.0 - 2.0 * (np.square(table.poses[ids, 3:5]).sum(axis=1))
        fell[np.isnan(fell) & (upright < 0.95)] = step * time_step
        if np.isfinite(fell).all():
            break
    assert np.isfinite(fell).all()
    speed = 9 * pitch / (fell[17] - fell[8])
    assert speed == pytest.approx(0.825 * np.sqrt(9.81 * height), rel=0.05)


@pytest.mark.parametrize('order', [(0, 1, 2), (2, 0, 1)])
@pytest.mark.parametrize('moments', [(1.0, 1.0, 1e-3), (1e-3, 1e-3, 1.0), (1.0, 1.0, 1.0),
                                     (1e-3, 0.9, 1.0)])
def test_free_bodies_turn_as_their_moments_have_it(moments, order):
    """Tumble bodies two of whose moments are equal, in any order: energy and momentum stay."""
    table, ids, engine = bodies([(0.0, 0.0, 5.0)], [[0.3, 0.2, 0.1]], [2.6], gravity=np.zeros(3))
    inertia = table.inertia[ids[0]] = np.array(moments)[list(order)]
    spin = table.velocities[ids[0], 3:] = [1.0, 2.0, 0.5]
    energy, momentum = inertia @ np.square(spin), np.linalg.norm(inertia * spin)
    for _ in range(60):
        engine.step(DT)
        spin = rotation.rotate(rotation.conjugate(table.poses[ids[0], 3:]),
                               table.velocities[ids[0], 3:])
        assert inertia @ spin ** 2 == pytest.approx(energy, rel=5e-3)
        assert np.linalg.norm(inertia * spin) == pytest.approx(momentum, rel=1e-9)


def test_a_heap_falls_lands_and_keeps_its_books():
    """Drop 100 bricks: energy never rises, contacts carry the weight, little overlaps."""
    rng, count = np.random.default_rng(0), 100
    places = np.array([(0.28 * (n % 3), 0.28 * (n // 3 % 3), 0.3 + 0.22 * (n // 9))
                       for n in range(count)]) + rng.uniform(-0.02, 0.02, (count, 3))
    table, ids, engine = bodies(places, BRICK, np.full(count, 2.6))
    turns = rng.normal(size=(count, 4))
    table.poses[ids, 3:] = turns / np.linalg.norm(turns, axis=1)[:, None]
    energies, carried = [], []
    for _ in range(240):
        engine.step(DT)
        attitude = table.poses[ids, 3:]
        spin = rotation.rotate(rotation.conjugate(attitude), table.velocities[ids, 3:])
        energies.append(2.6 * (0.5 * np.square(table.velocities[ids, :3]).sum()
                               + 9.81 * table.poses[ids, 2].sum())
                        + 0.5 * (table.inertia[ids] * spin ** 2).sum())
        told = engine.contacts()
        carried.append(told[told[:, 1] == 0, 11].sum())
    assert np.diff(energies).max() < 1e-3 * energies[0]
    assert np.mean(carried[-60:]) == pytest.approx(count * 2.6 * 9.81, rel=0.02)
    assert engine.contacts()[:, 8].min() > -3e-3
    assert np.sqrt(np.square(table.velocities[ids, :3]).sum(axis=1).mean()) < 0.02


def test_threads_change_no_bit(monkeypatch):
    """Let heaps beside each other fall, in islands of all sizes, with one thread and with five."""
    monkeypatch.setattr('procphys_ros.physics.world.native._WORTH', 100.0)
    monkeypatch.setattr('procphys_ros.compilation.threads._WORTH', 10)

    def fall(threads):
        rng = np.random.default_rng(8)
        size = np.repeat([1, 2, 5, 12, 30], [9, 6, 4, 2, 1])
        heap = np.repeat(np.arange(len(size)), size)
        places = rng.uniform(-0.2, 0.2, (len(heap), 3)) + np.column_stack(
            [2.0 * (heap % 5), 2.0 * (heap // 5), np.full(len(heap), 0.5)])
        places[:, 2] += 0.1 * (np.arange(len(heap)) % 12)
        table, ids, engine = bodies(places, BRICK, np.full(len(heap), 2.6))
        engine.threads = threads
        for _ in range(40):
            engine.step(DT)
        return table.poses[ids], engine.contacts()
    for one, other in zip(fall(1), fall(5)):
        np.testing.assert_array_equal(one, other)


def test_only_the_outermost_points_of_a_plane_count():
    """Touch at random points of a plane: few are left, and these span nearly all of it."""
    rng = np.random.default_rng(21)
    for _ in range(20):
        count = int(rng.integers(5, 120))
        rows = no_contacts(count)
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        across = np.linalg.svd(normal[None])[2][1:]
        flat = rng.uniform(-1.0, 1.0, (count, 2)) * rng.uniform(0.01, 3.0, 2)
        rows.point[:], rows.normal[:] = flat @ across, normal
        rows.gap[:], rows.force[:] = 1e-3 + flat @ rng.uniform(-1e-3, 1e-3, 2), 0.0
        same = np.zeros(count, np.int64)
        kept = spanning(same, same + 1, rows)
        assert len(kept) <= 8
        outline = ConvexHull(flat).volume
        assert ConvexHull(flat[kept]).volume > 0.6 * outline
        assert rows.gap[kept].min() == rows.gap.min()
        near = int(rng.integers(count))
        rows.gap[near] -= 2e-3  # a tooth presses before all others
        assert near in spanning(same, same + 1, rows)
        rows.gap[near] += 2e-3
        rows.force[near] = 1.0  # where the solver starts from
        assert near in spanning(same, same + 1, rows)
        np.testing.assert_array_equal(  # pairs of four points each, of which nothing is left out
            spanning(np.arange(count) // 4, same + 1000, rows), np.arange(count))


def test_what_was_removed_leaves_no_rows_and_others_go_on():
    """Remove and add bodies beside a column for a while: it stands to the bit, rows stay few."""
    def column(busy):
        places = [(0.0, 0.0, BRICK[2] * (n + 0.5)) for n in range(6)]
        table, ids, engine = bodies(places, BRICK, np.full(6, 2.6))
        most = 0
        for step in range(120):
            engine.step(DT)
            if busy:
                pose = np.array([5.0 + step, 0.0, 0.5 * BRICK[2], 0.0, 0.0, 0.0, 1.0])
                more = table.add_bodies(BodyState.AWAKE, [
                    plain(Shape.BOX, BRICK, 2.6, pose + n * np.eye(7)[1]) for n in range(4)])
                engine.add(table, more)
                engine.remove(more[:3] if step % 40 else more)
                table.remove(more[:3] if step % 40 else more)
            most = max(most, len(engine._pieces.body))
        return table.poses[ids], most, len(table.ids)
    alone, _, _ = column(False)
    beside, rows, count = column(True)
    np.testing.assert_array_equal(beside, alone)
    assert rows < 3 * count


def test_pairs_meet_once_whatever_moves():
    """Let many small boxes and a large one overlap: each pair once, as laws of motion have it."""
    rng, count = np.random.default_rng(11), 300
    low = rng.uniform(0.0, 2.0, (count, 3))
    bounds = np.column_stack([low, low + rng.uniform(0.0, 0.4, (count, 3))])
    bounds[7] = [0.0, 0.0, 0.0, 2.0, 2.0, 2.0]  # meets more than are sorted one by one
    body, moves = rng.integers(1, 150, count), rng.integers(0, 3, 150)
    excluded = np.array([[x, y] for x in range(150) for y in range(x, 150) if (x + y) % 9 == 0])
    rows = np.flatnonzero(moves[body] > 0)
    one, other = overlaps(bounds[rows], bounds)
    found = meeting(one, other, rows, moves[body] > 0, body, moves, join_key(*excluded.T))
    wanted = []
    for p in rows:
        for q in range(count):
            a, b = body[p], body[q]
            near = ((bounds[p, :3] <= bounds[q, 3:]) & (bounds[q, :3] <= bounds[p, 3:])).all()
            once = moves[b] == 0 or p < q
            if near and once and a != b and 2 in (moves[a], moves[b]) and (a + b) % 9:
                wanted.append((min(p, q), max(p, q)))
    np.testing.assert_array_equal(np.array(split_key(np.sort(found))).T, sorted(wanted))


def test_pairs_that_are_kept_are_those_that_would_be_found():
    """Let pieces move, jump, start and stop: pairs depend on where all are now alone."""
    rng, count, pairs = np.random.default_rng(12), 120, PairList()
    pieces, moves = no_pieces(count), rng.integers(0, 3, 60)
    pieces.body[:] = np.arange(count) // 2
    low, size = rng.uniform(0.0, 2.0, (count, 3)), rng.uniform(0.02, 0.5, (count, 3))
    excluded, seen = join_key(np.arange(0, 40, 2), np.arange(1, 41, 2)), 0
    for turn in range(60):
        rows = np.flatnonzero(moves[pieces.body] > 0)
        pace = rng.choice([0.0, 0.003, 0.2], (len(rows), 1))
        low[rows] += pace * rng.normal(size=(len(rows), 3))
        if turn % 7 == 3:
            moves = rng.permutation(moves)
        if turn % 11 == 5:
            low[::5] = rng.uniform(0.0, 2.0, (len(low[::5]), 3))
            pairs.forget()
        pieces.bounds[:] = np.hstack([low, low + size])
        rows = np.flatnonzero(moves[pieces.body] > 0)
        way = rng.uniform(0.0, 0.05, len(rows))
        found = pairs.near(rows, way, pieces, moves, excluded)
        one, other = overlaps(pieces.bounds[rows], pieces.bounds)
        np.testing.assert_array_equal(found, np.sort(meeting(
            one, other, rows, moves[pieces.body] > 0, pieces.body, moves, excluded)))
        seen += len(found)
    assert seen > 1000


@pytest.mark.parametrize('beside', [False, True])
def test_a_thin_rod_keeps_its_energy_however_it_spins(beside):
    """Spin rods 400 times as long as thick, about all axes; some as they sweep past a brick."""
    rng, table, pairs = np.random.default_rng(5), BodyTable(), []
    table.add_ground(0.6)
    for n in range(10):
        spin = rng.uniform(-1.0, 1.0, 3) * (300.0 if beside else 5.0)
        spin[2] += rng.uniform(100.0, 800.0)
        pairs.append(table.add_bodies(BodyState.AWAKE, [
            plain(Shape.BOX, [0.005, 0.006, 2.0], 0.05,
                  np.array([0.0, 9.0 * n, 5.0, 0.0, 0.0, 0.0, 1.0]),
                  np.concatenate([np.zeros(3), spin])),
            plain(Shape.BOX, BRICK, 2.6, np.array([0.13, 9.0 * n, 5.0 if beside else 8.0,
                                                   0.0, 0.0, 0.0, 1.0]))]))
    ids, energy = np.concatenate(pairs), []
    engine = NativeEngine(np.zeros(3))
    engine.add(table, np.array([0, *ids]))
    for _ in range(61):
        energy.append(motion_energy(table.mass[ids], table.inertia[ids], table.poses[ids, 3:],
                                    table.velocities[ids]).reshape(10, 2).sum(axis=1))
        engine.step(1.0 / 60.0)
    assert (np.diff(energy, axis=0) < 1e-6 * energy[0]).all()
    assert beside or energy[-1] == pytest.approx(energy[0], rel=1e-6)


def test_what_is_driven_fast_pushes_all_along_a_step():
    """Drive a plate at 4 m/s against a brick that it reaches in the middle of a step."""
    size, speed = np.array([0.02, 0.4, 0.4]), 4.0
    with World((0.0, 0.0, 0.0), engine='native') as world:
        plate = world.add_driven(single(Shape.BOX, size), np.array([0, 0, 1, 0, 0, 0, 1.0]))
        brick = world.add_body(Shape.BOX, np.array([0.2, 0.1, 0.07]), 2.6,
                               np.array([0.15, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
        for step in range(1, 4):
            x = step * speed / 60.0
            world.drive(plate, np.array([x, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
            world.step(1.0 / 60.0)
            gap = world.poses(np.array([brick]))[0, 0] - 0.1 - (x + 0.01)
            assert gap > -1e-3
        assert world.velocities(np.array([brick]))[0, 0] == pytest.approx(speed, rel=0.01)


@pytest.mark.parametrize('kind', [BOX, HEXAHEDRON])
def test_points_are_kept_while_a_pair_stays(kind):
    """Shift and turn touching pairs a little: their old points tell the gap that new ones have."""
    rng, kept = np.random.default_rng(6), 0
    for _ in range(400):
        sizes, poses = rng.uniform(0.1, 0.4, (2, 3)), draw_poses(rng, 0.1)
        first = touching(*two_pieces([kind, kind], sizes, poses))
        if not len(first.gap):
            continue
        first.force[:, 0] = np.arange(1, len(first.gap) + 1)
        later, axis = poses.copy(), rng.normal(size=3)
        later[1, :3] += rng.uniform(-2e-4, 2e-4, 3)
        later[1, 3:] = rotation.multiply(
            rotation.from_axis_angle(axis / np.linalg.norm(axis), np.array(4e-4)), later[1, 3:])
        pair = two_pieces([kind, kind], sizes, later)
        old, new = touching(*pair, before=first), touching(*pair)
        np.testing.assert_array_equal(old.found, first.found)
        np.testing.assert_array_equal(old.force, first.force)
        if len(new.gap):  # shallow points may come and go
            assert old.gap.min() == pytest.approx(new.gap.min(), abs=2e-4)
        later[1, :3] += 0.004 * first.normal[0]  # deeper or apart: looked at anew
        anew = touching(*two_pieces([kind, kind], sizes, later), before=first)
        assert not np.isin(anew.found[:, 7], first.found[:, 7]).any()
        kept += 1
    assert kept > 100


def thrown(shape, size, middle, velocity, friction=0.6, restitution=0.0, mass=1.0):
    """Describe what is thrown, unturned."""
    return plain(shape, np.array(size), mass, np.array([*middle, 0.0, 0.0, 0.0, 1.0]),
                 np.array([*velocity, 0.0, 0.0, 0.0]), friction=friction, restitution=restitution)


def weightless(loose, friction=0.6):
    """Put bodies into an engine, over the ground and without gravity."""
    table = BodyTable()
    table.add_ground(friction)
    ids = table.add_bodies(BodyState.AWAKE, loose)
    engine = NativeEngine(np.zeros(3))
    engine.add(table, np.concatenate([[0], ids]))
    return table, ids, engine


@pytest.mark.parametrize('friction', [0.0, 0.6])
@pytest.mark.parametrize('size', [(0.2, 0.2, 0.2), (0.4, 0.1, 0.1), (0.4, 0.4, 0.02)])
def test_what_lands_flat_does_not_begin_to_spin_as_it_bounces(size, friction):
    """Throw boxes flat at the ground, which has a restitution of 1, and at each other."""
    box = thrown(Shape.BOX, size, (0.0, 0.0, 0.5 * size[2] + 0.02), (0.0, 0.0, -2.0), friction,
                 0.64)
    table, ids, engine = weightless([box], friction)
    run(engine, 0.1)
    np.testing.assert_allclose(table.velocities[ids[0]], [0.0, 0.0, 1.6, 0.0, 0.0, 0.0],
                               atol=5e-3)
    pair = [thrown(Shape.BOX, size, (0.0, 0.0, 5.0), (0.0, 0.0, 1.0), friction, 0.6),
            thrown(Shape.BOX, [0.1, 0.1, 0.1], (0.0, 0.0, 5.07 + 0.5 * size[2]),
                   (0.0, 0.0, -1.0), friction, 0.6)]
    table, ids, engine = weightless(pair)
    run(engine, 0.1)
    wanted = np.zeros((2, 6))
    wanted[:, 2] = [-0.6, 0.6]
    np.testing.assert_allclose(table.velocities[ids], wanted, atol=5e-3)


@pytest.mark.parametrize('friction', [0.05, 0.1, 0.2])
@pytest.mark.parametrize('restitution', [0.0, 0.64])
def test_friction_brakes_by_all_of_a_bounce(friction, restitution):
    """Throw a ball at an angle: it slides, and friction has both parts of the impulse."""
    speed, fall, root = 3.0, 2.0, restitution ** 0.5
    ball = thrown(Shape.CAPSULE, [0.2, 0.2, 0.2], (0.0, 0.0, 0.13), (speed, 0.0, -fall),
                  friction, restitution)
    table, ids, engine = weightless([ball], friction)
    run(engine, 0.1)
    np.testing.assert_allclose(table.velocities[ids[0], :3],
                               [speed - friction * (1.0 + root) * fall, 0.0, root * fall],
                               atol=5e-3)


@pytest.mark.parametrize('mass', [0.1, 1.0, 10.0])
def test_a_ball_bounces_from_what_lies_on_the_ground_as_from_the_ground(mass):
    """Drop a ball on a box that cannot give way, however light that is."""
    table, ids, engine = weightless([
        thrown(Shape.CAPSULE, [0.2, 0.2, 0.2], (0.0, 0.0, 0.33), (0.0, 0.0, -2.0), 0.6, 0.6),
        thrown(Shape.BOX, [0.4, 0.4, 0.2], (0.0, 0.0, 0.1), np.zeros(3), mass=mass)])
    table.restitution[ids[1]] = 0.6
    run(engine, 0.1)
    np.testing.assert_allclose(table.velocities[ids, 2], [1.2, 0.0], atol=0.03)


def off_surface(pieces, rows):
    """Return how far points of a round piece and another one are off the surfaces of both [m]."""
    worst = 0.0
    for point, gap, normal in zip(rows.point, rows.gap, rows.normal):
        for p, spot in enumerate((point + 0.5 * gap * normal, point - 0.5 * gap * normal)):
            if pieces.kind[p] == ROUND:
                a, b = pieces.corners[p, :2]
                share = np.clip((spot - a) @ (b - a) / max((b - a) @ (b - a), 1e-18), 0.0, 1.0)
                far = abs(np.linalg.norm(spot - a - share * (b - a)) - pieces.radius[p])
            else:
                faces = pieces.normals[p]
                far = max(((faces @ spot) - (pieces.corners[p] @ faces.T).max(axis=0)).max(), 0.0)
            worst = max(worst, far)
    return worst


@pytest.mark.parametrize(('ridge', 'length'), [(1.0, 0.3), (0.0, 6.0)])
def test_poles_inside_of_solids_leave_them_by_the_shortest_way(ridge, length):
    """Run poles through boxes, voussoirs and prisms: no direction lets them out sooner."""
    rng, inside = np.random.default_rng(9), 0
    for _ in range(60):
        sizes = np.array([[0.05, 0.05, length], rng.uniform(0.1, 0.4, 3)])
        poses = draw_poses(rng, 0.05)
        pieces, table = two_pieces((ROUND, HEXAHEDRON), sizes, poses)
        pieces.cut[1, [12, 15, 18, 21]] *= ridge
        place(np.arange(2), pieces, table, np.zeros((3, 6)), 0.0)
        ends, corners, faces = pieces.corners[0, :2], pieces.corners[1], pieces.normals[1]
        wanted = nearest(ends, corners, rng)
        if wanted > -2e-3:
            continue
        rows = touching(pieces, table)
        overlap = -rows.gap.min() - 0.025  # of the axis, which is out when it has gone that far
        axis = ends[0] + np.linspace(0.0, 1.0, 6001)[:, None] * (ends[1] - ends[0])
        beyond = (axis + overlap * rows.normal[0]) @ faces.T - (corners @ faces.T).max(axis=0)
        assert beyond.max(axis=1).min() == pytest.approx(0.0, abs=1e-3)
        assert overlap < 2e-3 - wanted
        assert off_surface(pieces, rows) < 0.02  # beside a face that is as near
        inside += 1
    assert inside > 10


@pytest.mark.parametrize(('length', 'width'), [(6.0, 0.1), (1.0, 0.02), (0.5, 0.1)])
def test_poles_that_cross_at_a_small_angle_touch_where_they_meet(length, width):
    """Lay poles side by side, turned by up to 1.7°: they touch on the surface of both."""
    rng, twice = np.random.default_rng(10), 0
    for _ in range(100):
        poses, turn = draw_poses(rng, 0.0), rng.uniform(0.0, 0.03)
        across = rotation.rotate(poses[0, 3:], np.array([1.0, 0.0, 0.0]))
        poses[1, 3:] = rotation.multiply(rotation.from_axis_angle(across, np.array(turn)),
                                         poses[0, 3:])
        gap = rng.uniform(-0.2 * width, 0.003)
        poses[1, :3] += (width + gap) * across
        pieces, table = two_pieces((ROUND, ROUND), np.full((2, 3), [width, width, length]), poses)
        rows = touching(pieces, table)
        np.testing.assert_allclose(rows.gap, gap, atol=1e-6)
        assert off_surface(pieces, rows) < 2e-3
        twice += len(rows.gap) == 2
    assert twice > 90


@pytest.mark.parametrize('turn', [0.0, 1.0, 0.5 * np.pi])
@pytest.mark.parametrize('lengths', [(1.0, 1.0), (0.1, 1.0)])
def test_poles_whose_axes_meet_part_across_both(lengths, turn):
    """Let poles cross in an upright plane, and a ball sit on an axis: the way out is a width."""
    poses = np.tile([0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
    poses[0, 3:] = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(turn))
    pieces, table = two_pieces((ROUND, ROUND), [[0.1, 0.1, size] for size in lengths], poses)
    rows = touching(pieces, table)
    np.testing.assert_allclose(rows.gap, -0.1, atol=1e-9)
    for axis in pieces.corners[:, 1] - pieces.corners[:, 0]:
        np.testing.assert_allclose(rows.normal @ axis, 0.0, atol=1e-9)
