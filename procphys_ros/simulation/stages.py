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
    charges,
    commands,
    contact,
    earthquake,
    fragments,
    growth,
    impacts,
    intruder,
    masonry,
    mechanisms,
    particles,
    projectiles,
    sawing,
    snow,
    ties,
    trees,
    wall_loads,
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
    particles.step_leaves(model, state, dt)
    particles.drift_dust(model, state, dt)


def step_rigid_bodies(model: Model, state: State, dt: float) -> None:
    """
    Move and collide rigid bodies; solve stresses, and move leaves and dust, in parallel.

    Writes `state.world`, `state.rubble`, stresses, leaves and dust, and see `impacts.judge`.
    """
    bodies, rubble = state.world.bodies, state.rubble
    with ExitStack() as meanwhile:  # waits for both, even on errors
        others = [beside(name, partial(work, model, state, dt), model.threads) for name, work
                  in (('air', move_in_air), ('stresses', masonry.solve_stresses))]
        for ended in others:
            meanwhile.callback(ended)
        rubble.velocities = bodies.copied('velocities', rubble.velocities)
        rubble.poses = bodies.copied('poses', rubble.poses)
        state.world.step(dt, model.threads, partial(impacts.judge, model, state, others))


STAGES = (
    Stage('cues', commands.run_cues),
    Stage('commands', commands.apply_wrenches),
    Stage('earthquake', earthquake.shake),
    Stage(growth.STAGE, growth.step),
    Stage('snow', snow.step),
    Stage('intruder', intruder.advance),
    Stage('saws', sawing.step),
    Stage('charges', charges.step),
    Stage('blasts', blasts.step),
    Stage('projectiles', projectiles.step),
    Stage('wall wind', wall_loads.press_wind),
    Stage('tree wind', trees.sample_wind),
    Stage('contact', contact.step),
    Stage('waking', trees.wake_touched),
    Stage('trees', trees.step),
    Stage('climbers', trees.step_climbers),
    Stage('branches', trees.step_joints),
    Stage('loads', apply_loads),
    Stage('tree poses', trees.write_poses),
    Stage('rubble wind', fragments.wake_in_wind),
    Stage('drag', fragments.apply_drag),
    Stage('plate wind', mechanisms.press_plates),
    Stage('motors', mechanisms.drive_motors),
    Stage('dust sources', particles.watch_dust),
    Stage('engine', step_rigid_bodies),
    Stage('bounces', projectiles.take_back),
    Stage('ties', ties.end_step),
    Stage('joint breaks', mechanisms.break_overloaded),
    Stage('hinges', mechanisms.press_hosts),
    Stage('intruder wrench', intruder.sum_wrench),
    Stage('body poses', fragments.write_poses),
    Stage('debris', wall_loads.press_debris),
    Stage('impacts', impacts.step),
    Stage('stress', masonry.judge_stresses),
    Stage('dust', particles.step_dust),
)
