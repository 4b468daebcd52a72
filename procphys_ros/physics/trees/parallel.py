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

"""Parallel: steps of trees on several threads, by ranges of trees with a workspace each."""

import numpy as np

from procphys_ros.compilation import threads as pool
from procphys_ros.physics.trees import equilibrium, integrator, state


def step(plan: state.TraversalPlan, trees: np.ndarray, spans: np.ndarray,
         model: state.ForestModel, columns: state.ForestState, workspaces: list[state.Scratch],
         wind: np.ndarray, gravity: np.ndarray, threads: int) -> None:
    """
    Advance some trees, with the result of `integrator.step`, to the last bit.

    :param workspaces: at least one; more are added for further threads.
    :param threads: largest number of threads.
    """
    def advance(place: int, first: int, last: int) -> None:
        integrator.step(plan, trees[first:last], spans[first:last], model, columns,
                        workspaces[place], wind, gravity)
    starts = np.append(0, np.cumsum(np.diff(plan.start)[trees]))
    run(advance, pool.group_ranges(starts, threads), plan, workspaces)


def lean(plan: state.TraversalPlan, trees: np.ndarray, model: state.ForestModel,
         columns: state.ForestState, workspaces: list[state.Scratch], wind: np.ndarray,
         gravity: np.ndarray, goal: float, threads: int) -> None:
    """Set some trees to their static equilibrium, see `equilibrium.lean` and `step`."""
    def advance(place: int, first: int, last: int) -> None:
        equilibrium.lean(plan, trees[first:last], model, columns, workspaces[place], wind,
                         gravity, goal)
    starts = np.append(0, np.cumsum(np.diff(plan.start)[trees]))
    run(advance, pool.group_ranges(starts, threads), plan, workspaces)


def run(work: pool.Work, ranges: np.ndarray, plan: state.TraversalPlan,
        workspaces: list[state.Scratch]) -> None:
    """
    Run work on ranges of trees, each with its own workspace.

    :param ranges: first tree of each range, and one past the last.
    :param workspaces: see `step`.
    """
    while len(workspaces) < len(ranges) - 1:
        workspaces.append(state.make_scratch(plan))
    pool.run(work, ranges)
