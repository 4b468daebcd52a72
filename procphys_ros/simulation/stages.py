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


"""Stages: one step of a simulation, in order; each reads and writes the state only."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import NamedTuple

from procphys_ros.compilation.threads import beside
from procphys_ros.simulation import (
    blasts,
    climbers,
    commands,
    contact,
    cues,
    debris_loads,
    demolition,
    detached_branches,
    dust,
    foliage,
    fragments,
    impacts,
    intruder,
    masonry,
    projectiles,
    rubble_wind,
    trees,
    wall_wind,
    yielding,
)
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State


class Stage(NamedTuple):
    """
    One part of a step.

    :ivar name: shown in timings and diagnostics.
    :ivar step: `step(model, state, dt)`; its docstring lists the state it writes.
    """

    name: str
    step: Callable[[Model, State, float], None]


def apply_loads(model: Model, state: State, dt: float) -> None:
    """Set the changed loads of the stress solver; writes stresses."""
    state.loads.apply(state.solver, state.time)


def move_in_air(model: Model, state: State, dt: float) -> None:
    """Move leaves and dust, which both sample the wind and the skyline; writes both."""
    foliage.step(model, state, dt)
    dust.drift(model, state, dt)


def step_rigid_bodies(model: Model, state: State, dt: float) -> None:
    """
    Move and collide rigid bodies; solve stresses, and move leaves and dust, in parallel.

    Writes `state.world`, `state.rubble`, stresses, leaves and dust, and the output of `yielding`.
    """
    bodies, rubble = state.world.bodies, state.rubble
    with ExitStack() as meanwhile:  # waits for both, even on errors
        others = [beside(name, partial(work, model, state, dt), model.threads) for name, work
                  in (('air', move_in_air), ('stresses', masonry.solve_stresses))]
        for ended in others:
            meanwhile.callback(ended)
        rubble.velocities = bodies.copied('velocities', rubble.velocities)
        rubble.poses = bodies.copied('poses', rubble.poses)
        looked = partial(yielding.judge, model, state, others) if state.standing.any() else None
        state.world.step(dt, model.threads, looked)


STAGES = (
    Stage('cues', cues.step),
    Stage('commands', commands.apply_wrenches),
    Stage('intruder', intruder.advance),
    Stage('charges', demolition.step),
    Stage('blasts', blasts.step),
    Stage('projectiles', projectiles.step),
    Stage('wall wind', wall_wind.step),
    Stage('tree wind', trees.sample_wind),
    Stage('contact', contact.step),
    Stage('waking', trees.wake_touched),
    Stage('trees', trees.step),
    Stage('climbers', climbers.step),
    Stage('branches', detached_branches.step),
    Stage('loads', apply_loads),
    Stage('tree poses', trees.write_poses),
    Stage('rubble wind', rubble_wind.step),
    Stage('drag', fragments.apply_drag),
    Stage('dust sources', dust.watch),
    Stage('engine', step_rigid_bodies),
    Stage('bounces', projectiles.take_back),
    Stage('intruder wrench', intruder.sum_wrench),
    Stage('body poses', fragments.write_poses),
    Stage('debris', debris_loads.update),
    Stage('impacts', impacts.step),
    Stage('stress', masonry.judge_stresses),
    Stage('dust', dust.step),
)
