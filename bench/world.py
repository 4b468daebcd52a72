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
Time bricks that stand, with each engine, side by side with a joint per mortar bond.

The baseline is the way of Baxter et al. (2010) in PyBullet: one fixed constraint per bond.
Run with `python bench/world.py`.
"""

import time

import numpy as np
import pybullet

from procphys_ros.physics.world import installed_engines, World

DT = 1.0 / 60.0
BRICK = np.array([0.215, 0.1025, 0.065])
PITCH = np.array([0.225, 0.1125, 0.075])
MASS = 2.7


def wall(columns, rows, walls=1):
    """Compute the poses of half-brick walls in running bond, 2 m apart, (K, 7)."""
    row, column, index = np.meshgrid(range(rows), range(columns), range(walls), indexing='ij')
    x = (column + 0.5 * (row % 2)) * PITCH[0]
    z = 0.5 * BRICK[2] + row * PITCH[2]
    zero = np.zeros(x.size)
    return np.column_stack([x.ravel(), 2.0 * index.ravel(), z.ravel(), zero, zero, zero, zero + 1])


def neighbours(columns, rows):
    """List the bonds of one such wall: along the courses, and with both bricks below."""
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
    """Time a step of bricks that stand [ms]; return it with the time to make one brick [µs]."""
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
    """Time a step of the same wall with a fixed joint per bond [ms]; return it and the sag [m]."""
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


def report(engine):
    """Print the figures of one engine."""
    standing(10, 10, 1, engine)
    step, made = standing(131, 29, 4, engine)
    print(f'{engine}: 15,196 bricks standing: {step:.2f} ms/step, made in {made:.0f} µs each')


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
