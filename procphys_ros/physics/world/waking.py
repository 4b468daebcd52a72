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

"""Waking: wake resting bodies before they are hit, and sweep bodies that may tunnel."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.linear import norm
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.engine import Engine
from procphys_ros.physics.world.extents import are_near, bounds
from procphys_ros.physics.world.settling import TREMBLE_TIME

WAKE_SPEED = 0.6  # [m/s], speed change by a hit that thaws a resting body: a fall of 2 cm
_NEAR = 0.02  # [m] gap at which engines make contacts, beyond the motion of one step
_FAST = 0.5  # motion in one step, as a share of a body's least extent, above which it is swept
_SWEEP = 0.45  # radius of the swept sphere as a share of the least extent


def about_to_be_hit(bodies: BodyTable, time_step: float) -> np.ndarray:
    """
    Choose the resting bodies that moving ones will hit in this step, hard enough to move them.

    Thawing them *before* the step lets the contact solver share the momentum exactly; against an
    immovable body it would be lost.

    :param time_step: [s].
    :returns: ids, ascending, (K,).
    """
    resting = np.flatnonzero(bodies.state == BodyState.RESTING)
    moving = np.flatnonzero(bodies.state >= BodyState.AWAKE)
    if len(resting):
        moving = moving[(bodies.stay[moving] < TREMBLE_TIME)
                        & (rim_speed(bodies, moving) > WAKE_SPEED)]
    if not len(resting) or not len(moving):
        return np.zeros(0, np.intp)
    pairs = reached_pairs(bodies, resting, moving, bounds(bodies, moving), time_step)
    pairs = pairs[_local_speed(bodies, pairs) > _least_hit(bodies, pairs)]
    reach = rim_speed(bodies, pairs[:, 1]) * time_step + _NEAR
    return np.unique(pairs[are_near(bodies, pairs, reach), 0])


def sweep_fast(engine: Engine, bodies: BodyTable, awake: np.ndarray, time_step: float) -> None:
    """
    Sweep plain bodies that move so far in a step that they could pass through a thin one.

    Slower ones are not swept: Bullet ends a swept move where the other body *was*, so that a body
    behind a moving one cannot catch up with it.

    :param awake: ids, (K,).
    :param time_step: [s].
    """
    way = np.sqrt(np.square(bodies.velocities[awake, :3]).sum(axis=1)) * time_step
    least = bodies.least[awake]
    fast = (least > 0.0) & (way > _FAST * least)
    changed = awake[fast != (bodies.swept_radius[awake] > 0.0)]
    if len(changed):
        radii = np.where(bodies.swept_radius[changed] > 0.0, 0.0, _SWEEP * bodies.least[changed])
        bodies.swept_radius[changed] = radii
        engine.set_swept(changed, radii)


def reached_pairs(bodies: BodyTable, resting: np.ndarray, moving: np.ndarray,
                  moving_bounds: np.ndarray, time_step: float) -> np.ndarray:
    """
    List the resting bodies that a moving one may reach in this step and hit hard enough.

    Bounds of branches are mostly air: look closer at each pair.

    :param moving: ids, (K,).
    :param moving_bounds: their axis-aligned bounds now [m], (K, 6).
    :param time_step: [s].
    :returns: ids of a resting and of a moving body each, ascending, (P, 2).
    """
    velocity = bodies.velocities[moving]
    shift = velocity[:, :3] * time_step
    low = moving_bounds[:, :3] + np.minimum(shift, 0.0)
    high = moving_bounds[:, 3:] + np.maximum(shift, 0.0)
    mass = np.where(bodies.state[moving] == BodyState.KINEMATIC, np.inf, bodies.mass[moving])
    order = np.argsort(low[:, 0], kind='stable')
    pairs = _reached(low[order], high[order], rim_speed(bodies, moving)[order], mass[order],
                     bodies.bounds[resting], bodies.mass[resting])
    return np.column_stack([resting[pairs[:, 0]], moving[order][pairs[:, 1]]])


def rim_speed(bodies: BodyTable, ids: np.ndarray) -> np.ndarray:
    """Give the speed that no point of a body exceeds [m/s], (K,)."""
    return _rim_speed(ids, bodies.velocities, bodies.radius)


@kernel
def _rim_speed(ids, velocities, radius):
    out = np.empty(len(ids))
    for k in range(len(ids)):
        v = velocities[ids[k]]
        out[k] = (np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
                  + np.sqrt(v[3] ** 2 + v[4] ** 2 + v[5] ** 2) * radius[ids[k]])
    return out


def _local_speed(bodies: BodyTable, pairs: np.ndarray) -> np.ndarray:
    """Give the speed that no point of a moving body exceeds next to a resting one [m/s], (P,)."""
    resting, moving = pairs.T
    velocity = bodies.velocities[moving]
    arm = bodies.poses[resting, :3] - bodies.poses[moving, :3]
    there = velocity[:, :3] + np.cross(velocity[:, 3:], arm)
    near = (norm(there, axis=1)
            + norm(velocity[:, 3:], axis=1) * (bodies.radius[resting] + _NEAR))
    return np.minimum(near, rim_speed(bodies, moving))


def _least_hit(bodies: BodyTable, pairs: np.ndarray) -> np.ndarray:
    """Give the speed of the moving body at which a hit changes the other's by `WAKE_SPEED`."""
    resting, moving = pairs.T
    mass = np.where(bodies.state[moving] == BodyState.KINEMATIC, np.inf, bodies.mass[moving])
    return WAKE_SPEED * (1.0 + bodies.mass[resting] / mass)


@kernel
def _reached(low, high, speed, mass, bounds, resting_mass):
    """Pair resting boxes with the moving ones, sorted by their least x, that reach them."""
    pairs = np.empty((64, 2), np.int64)
    found = 0
    width = 0.0
    for m in range(len(low)):
        width = max(width, high[m, 0] - low[m, 0])
    for r in range(len(bounds)):
        first = np.searchsorted(low[:, 0], bounds[r, 0] - width)
        for m in range(first, len(low)):
            if low[m, 0] > bounds[r, 3]:
                break
            if (high[m, 0] >= bounds[r, 0]
                    and low[m, 1] <= bounds[r, 4] and high[m, 1] >= bounds[r, 1]
                    and low[m, 2] <= bounds[r, 5] and high[m, 2] >= bounds[r, 2]
                    and speed[m] > WAKE_SPEED * (1.0 + resting_mass[r] / mass[m])):
                if found == len(pairs):
                    more = np.empty((2 * found, 2), np.int64)
                    more[:found] = pairs
                    pairs = more
                pairs[found, 0], pairs[found, 1] = r, m
                found += 1
    return pairs[:found]
