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

"""
Time the world of loose bodies, with each engine, side by side with a joint per mortar bond.

The baseline is the way of Baxter et al. (2010) in PyBullet: one fixed constraint per bond.
Run with `python bench/world.py`.
"""

import time

import numpy as np
import pybullet
from scipy.spatial import cKDTree

from procphys_ros import rotation
from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.physics.world import installed_engines, rigid_sum, World

DT = 1.0 / 60.0
BRICK = np.array([0.215, 0.1025, 0.065])
PITCH = np.array([0.225, 0.1125, 0.075])
MASS = 2.7


def wall(columns, rows, walls=1):
    """Give the poses of half-brick walls in running bond, 2 m apart, (K, 7)."""
    row, column, index = np.meshgrid(range(rows), range(columns), range(walls), indexing='ij')
    x = (column + 0.5 * (row % 2)) * PITCH[0]
    z = 0.5 * BRICK[2] + row * PITCH[2]
    zero = np.zeros(x.size)
    return np.column_stack([x.ravel(), 2.0 * index.ravel(), z.ravel(), zero, zero, zero, zero + 1])


def neighbours(columns, rows):
    """Give the bonds of one such wall: along the courses, and with both bricks below."""
    bonds = []
    for row in range(rows):
        for column in range(columns):
            me = row * columns + column
            if column + 1 < columns:
                bonds.append((me, me + 1))
            for below in (column - 1 + row % 2, column + row % 2):
                if row and 0 <= below < columns:
                    bonds.append((below + (row - 1) * columns, me))
    return bonds


def standing(columns, rows, walls, engine, steps=120):
    """Time a step of bricks that stand [ms]; give it with the time to make one brick [µs]."""
    poses = wall(columns, rows, walls)
    start = time.perf_counter()
    with World(engine=engine) as world:
        world.add_bricks(poses, np.tile(BRICK, (len(poses), 1)), np.full(len(poses), MASS))
        made = (time.perf_counter() - start) / len(poses) * 1e6
        times = [timed(world.step, DT) for _ in range(steps)]
    return float(np.median(times)), made


def timed(call, *arguments):
    """Time a call [ms]."""
    start = time.perf_counter()
    call(*arguments)
    return (time.perf_counter() - start) * 1e3


def jointed(columns, rows, iterations, seconds=2.0):
    """Time a step of the same wall with a fixed joint per bond [ms]; give it with the sag [m]."""
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, 0, -9.81, physicsClientId=client)
    pybullet.setPhysicsEngineParameter(fixedTimeStep=DT, numSolverIterations=iterations,
                                       physicsClientId=client)
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    pybullet.createMultiBody(0, plane, useMaximalCoordinates=1, physicsClientId=client)
    box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=(0.5 * BRICK).tolist(),
                                        physicsClientId=client)
    poses = wall(columns, rows)
    ids = pybullet.createMultiBody(MASS, box, batchPositions=poses[:, :3].tolist(),
                                   useMaximalCoordinates=1, physicsClientId=client)
    for a, b in neighbours(columns, rows):
        arm = (0.5 * (poses[b, :3] - poses[a, :3])).tolist()
        pybullet.createConstraint(
            ids[a], -1, ids[b], -1, pybullet.JOINT_FIXED, [0, 0, 0], arm,
            [-value for value in arm], physicsClientId=client)
    times = [timed(lambda: pybullet.stepSimulation(physicsClientId=client))
             for _ in range(round(seconds / DT))]
    heights = [pybullet.getBasePositionAndOrientation(body, client)[0][2] for body in ids]
    pybullet.disconnect(client)
    return float(np.median(times)), float((poses[:, 2] - heights).max())


def settle(world, seconds):
    """Step; give real-time factors overall and in the worst second, and how many still move."""
    times = np.array([timed(world.step, DT) for _ in range(round(seconds / DT))]) * 1e-3
    worst = max(times[i:i + 60].sum() for i in range(0, len(times) - 59, 10))
    return seconds / times.sum(), 1.0 / worst, len(world.awake)


def loose_bricks(count, engine, seconds=8.0):
    """Drop single bricks on a heap."""
    rng = np.random.default_rng(0)
    side = int(np.sqrt(count / 10)) + 1
    with World(engine=engine) as world:
        for i in range(count):
            spot = [i % side * 0.25 + rng.uniform(0, 0.02), i // side % side * 0.15,
                    0.2 + i // side ** 2 * 0.12]
            world.add_body(Shape.BOX, BRICK, MASS, np.array([*spot, 0, 0, 0, 1.0]))
        return settle(world, seconds)


def building(columns, rows):
    """Give the poses of four walls round a square, (K, 7)."""
    side = wall(columns, rows)
    side[:, :2] += [0.05 - 0.5 * columns * PITCH[0], -0.5 * columns * PITCH[0]]
    corners = [np.array([0, 0, 0, *rotation.from_yaw(0.5 * np.pi * i)]) for i in range(4)]
    return np.concatenate([rotation.compose(corner, side) for corner in corners])


def demolition(columns, rows, count, engine, seconds=8.0):
    """
    Let a building fall as cells round random points, all but its eight lowest courses.

    :returns: bricks, real-time factors overall and in the worst second, bodies that still move,
        ms to make one fragment.
    """
    rng = np.random.default_rng(3)
    poses = building(columns, rows)
    size, mass = np.tile(BRICK, (len(poses), 1)), np.full(len(poses), MASS)
    inertia = box_inertia(mass, size)
    loose = np.flatnonzero(poses[:, 2] > 8 * PITCH[2])
    foot = np.flatnonzero(poses[:, 2] <= 8 * PITCH[2])
    cell = cKDTree(poses[rng.choice(loose, count, replace=False), :3]).query(poses[loose, :3])[1]
    with World(engine=engine) as world:
        world.add_bricks(poses[foot], size[foot], mass[foot])
        start = time.perf_counter()
        for i in range(count):
            rows = loose[cell == i]
            total = rigid_sum(mass[rows], inertia[rows], poses[rows])
            world.add_fragment(np.full(len(rows), Shape.BOX), size[rows], total.local_poses,
                               total.mass, total.inertia, total.pose,
                               np.concatenate([rng.normal(0.0, 0.3, 3), np.zeros(3)]))
        made = (time.perf_counter() - start) / count * 1e3
        return (len(poses), *settle(world, seconds), made)


def report(engine):
    """Print the figures of one engine."""
    standing(10, 10, 1, engine)
    loose_bricks(20, engine, 1.0)
    step, made = standing(131, 29, 4, engine)
    print(f'{engine}: 15,196 bricks standing: {step:.2f} ms/step, made in {made:.0f} µs each')
    for count in (500, 1000, 2000):
        overall, worst, awake = loose_bricks(count, engine)
        print(f'{engine}: {count} loose bricks fall and settle: real-time factor {overall:.1f} '
              f'over 8 s, {worst:.2f} in the worst second, {awake} still move', flush=True)
    for columns, rows, count in ((14, 36, 100), (22, 57, 200), (38, 100, 300)):
        bricks, overall, worst, awake, made = demolition(columns, rows, count, engine)
        print(f'{engine}: {bricks} bricks fall as {count} fragments: real-time factor '
              f'{overall:.1f} over 8 s, {worst:.2f} in the worst second, {awake} still move, '
              f'made in {made:.2f} ms each', flush=True)


def main():
    """Print all figures."""
    for columns, rows, iterations in ((20, 25, 10), (20, 25, 50), (20, 50, 50)):
        ours, _ = standing(columns, rows, 1, 'bullet')
        theirs, sag = jointed(columns, rows, iterations)
        print(f'{columns * rows} bricks standing: {ours:.3f} ms/step; with a joint per bond '
              f'({iterations} iterations) {theirs:.1f} ms/step, sagging {sag * 1e3:.0f} mm: '
              f'{theirs / ours:.0f} times faster, and exactly still')
    for engine in installed_engines():
        report(engine)


if __name__ == '__main__':
    main()
