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

"""Scenes at rest: the state a simulation starts from, with trees bent by mean wind and snow."""

import numpy as np

from procphys_ros.physics.trees import anchors, Forest
from procphys_ros.physics.wind import WindSettings
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.simulation import contact, fragments, masonry, mechanisms, snow
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State
from procphys_ros.simulation.trees import end_climbers_lean, lean_climbers, load_climbed_walls

_ROUNDS = 3  # iterations: the wind changes with the height of bent trees, a twentieth per round
_SHARES = 0.5, 0.25, 0.0  # of the wind, for trees that the full wind would bend into a wall
_INSIDE = 0.005  # [m] smallest overlap with a wall or body that counts


def lean(model: Model, state: State, first: int = 0) -> None:
    """
    Bend trees at rest into equilibrium with snow and mean wind, without gusts and eddies.

    Overloaded joints break in the first step. Trees that would bend into walls or bodies get half
    of the wind, a quarter of it, or none: the largest share that keeps them clear.
    Writes the forest, its anchors, and the poses and the air of these trees.

    :param first: first row of the forest that is at rest.
    """
    forest, wind = state.forest, state.wind
    roots = forest.plan.row[forest.plan.start[:-1]]
    chosen = np.flatnonzero(roots >= first)
    blows = wind.enabled and any(wind.mean_velocity(state.time))
    if not len(chosen) or not (blows or forest.snow[first:].any()):
        return
    on_trees = not first and bool((model.trees.climbers.host_row >= 0).any())  # not later ones
    _lean(model, state, chosen, 1.0, on_trees)
    for share in _SHARES:
        inside = np.intersect1d(chosen, _trees_of(
            forest, contact.find_inside(model, state, _INSIDE)))
        if not len(inside):
            break
        _lean(model, state, inside, share, on_trees)
    rows = forest.rows_of(chosen)
    state.trees.start_poses[rows] = forest.poses[rows]
    state.parts.poses[forest.parts[rows]] = forest.poses[rows]
    if state.trees.lod is not None and first == 0:
        state.trees.lod.enclose(forest)


def _lean(model: Model, state: State, trees: np.ndarray, share: float, on_trees: bool) -> None:
    """Solve the equilibrium of some trees, and of their climbers, in a share of the wind."""
    forest, air = state.forest, state.trees.air
    clings = np.isin(trees, _trees_of(forest, np.flatnonzero(
        forest.active & (forest.anchors[:, anchors.STIFFNESS] > 0.0))))
    for _ in range(_ROUNDS):
        for group in (trees[~clings], trees[clings]):
            if not len(group):
                continue
            rows = forest.rows_of(group)
            air[rows] = share * state.wind.steady_velocity(forest.poses[rows, :3], state.time,
                                                           model.threads)
            forest.lean(group, air, model.threads)
            if on_trees:
                lean_climbers(model, state)
    if on_trees:
        end_climbers_lean(model, state)


def _trees_of(forest: Forest, rows: np.ndarray) -> np.ndarray:
    """Return the trees of the plan that rows belong to, (K,)."""
    plan = forest.plan
    return np.unique(np.searchsorted(plan.row[plan.start[:-1]], forest.roots(rows)))


def at_rest(model: Model, wind: WindSettings | None = None,
            load: SnowLoad | None = None) -> tuple[State, list[str]]:
    """
    Put a scene at rest, with its trees in the initial wind, under the initial snow.

    :param wind: replaces the scene's wind settings.
    :param load: replaces its snow and ice.
    :returns: the state, after the collapse of parts that cannot carry their weight, and warnings
        about it.
    """
    state = State.initial(model)
    if wind is not None and wind != state.wind.settings:
        state.wind.change(wind)
        state.wind.reset()
    bricks = np.flatnonzero(state.standing)
    if len(bricks):
        source = model.blueprint
        state.parts.body[bricks] = state.world.add_bricks(
            source.poses[bricks], source.size[bricks], source.mass[bricks],
            hexahedra=source.hexahedra.among(bricks), inertia=source.inertia[bricks])
    for parts in mechanisms.rigid_groups(model, np.flatnonzero(state.parts.owner == Owner.BODY)):
        fragments.make_body(model, state, parts, state.parts.poses[parts],
                            np.zeros((len(parts), 6)))
    mechanisms.connect(model, state)
    snow.lay(model, state, model.settings.load if load is None else load)
    lean(model, state)
    load_climbed_walls(model, state)
    state.loads.apply(state.solver, 0.0)
    lines = masonry.settle(model, state)
    state.dust.seen = state.log.total
    return state, lines
