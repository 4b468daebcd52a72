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


"""Additions: objects that join or leave a scene while it runs, without touching the rest."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from itertools import count

import numpy as np

from procphys_ros.blueprint import Blueprint, chain
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.physics.masonry.brittle import as_mortar
from procphys_ros.physics.wind.shelter import Shelter
from procphys_ros.scene import SceneObject
from procphys_ros.scene.capacity import available_memory, check_addition
from procphys_ros.scene.placement import stand_on, unbonded
from procphys_ros.scene.scene import check_place
from procphys_ros.simulation import (
    at_rest,
    breaking,
    fragments,
    load_checks,
    mechanisms,
    snow,
)
from procphys_ros.simulation.contact_pairs import TreeBounds
from procphys_ros.simulation.model import compile_model, Model, SETTLING
from procphys_ros.simulation.obstacles import find_shelter
from procphys_ros.simulation.parts import columns_of, Owner, owners
from procphys_ros.simulation.state import ClimberState, State


def add(model: Model, state: State, blueprint: Blueprint, position: Sequence[float], yaw: float,
        name: str) -> tuple[Model, list[str]]:
    """
    Place an object into a running scene, at rest and with its static stresses solved.

    :param blueprint: of the object; it is not changed.
    :param position: of its origin [m], (3,), world; z counts from the ground.
    :param yaw: turn about the vertical [rad].
    :param name: must be new, among the objects there are and were.
    :returns: the model of the enlarged scene, to which the state has grown, and warnings for the
        user about an object that cracks or collapses under its own weight.
    :raises CommandError: if the name is taken, the position is not finite, or free memory cannot
        hold the object.
    """
    if any(known.name == name for known in state.objects):
        raise CommandError(f'there is, or was, an object called "{name}"; choose another name')
    try:
        check_place(name, blueprint, position, yaw)
        check_addition(name, len(blueprint), available_memory())
        placed = stand_on(model.terrain, unbonded(blueprint.placed(position, yaw), position[2]),
                          name)
        mechanisms.check_engine(name, placed, state.world)
    except SceneError as error:
        raise CommandError(str(error)) from None
    added = SceneObject(name, len(state.parts), len(placed))
    whole, graph = chain([state.blueprint, placed]), BondGraph(placed)
    enlarged = compile_model(
        model.settings, model.shard, whole, [*state.objects, added], model.time_step, model.seed,
        model.wind, model.loaded, _chained(model, whole, placed, graph, added.first),
        model.plants)
    settled, lines = _settled(placed, graph, model.gravity, name)
    rows = len(state.forest)
    extend(model, enlarged, state, settled)
    snow.join(enlarged, state, rows, added.first)
    at_rest.lean(enlarged, state, rows)
    state.objects.append(added)
    state.names.extend([added], placed)
    state.added[name] = placed
    return enlarged, lines


def remove(model: Model, state: State, name: str) -> None:
    """
    Remove an object from the scene, wherever its parts are by now.

    :raises CommandError: if there is no such object, it has been removed already, or is what
        another one has grown in a year.
    """
    found = next((known for known in state.objects if known.name == name), None)
    parts = np.arange(found.first, found.first + found.count) if found else np.zeros(0, np.intp)
    grown = state.growing.owner_of(parts)
    if grown not in ('', name):
        raise CommandError(f'"{name}" has grown on "{grown}"; remove that')
    if grown:
        parts = np.union1d(parts, state.growing.finish(grown))
    owner = state.parts.owner[parts]
    if (owner == Owner.GONE).all():
        raise CommandError(f'there is no object "{name}"{state.names.nearest(name)}')
    breaking.fell(state, parts[owner == Owner.TREE])
    breaking.destroy(model, state, parts[owner != Owner.TREE], None, 0.0)
    state.added.pop(name, None)
    state.removed.append(name)
    state.wind.shelter = _shelter(model, state)


def with_added(scene: Model, added: Mapping[str, Blueprint]) -> Model:
    """
    Compile a scene together with the objects that users added.

    :param scene: model of the scene as loaded.
    :param added: placed blueprints by name.
    """
    if not added:
        return scene
    objects = list(scene.objects)
    for name, placed in added.items():
        first = objects[-1].first + objects[-1].count if objects else 0
        objects.append(SceneObject(name, first, len(placed)))
    return compile_model(scene.settings, scene.shard, chain([scene.blueprint, *added.values()]),
                         objects, scene.time_step, scene.seed, scene.wind, scene.loaded,
                         plants=scene.plants)


def free_name(state: State, stem: str) -> str:
    """Return the first unused object name among `<stem>_0`, `<stem>_1`, …."""
    taken = {known.name for known in state.objects}
    return next(name for name in (f'{stem}_{i}' for i in count()) if name not in taken)


def extend(before: Model, model: Model, state: State, settled: StressSolver) -> None:
    """
    Extend a state by the last parts of an enlarged model.

    :param before: the model so far.
    :param model: the enlarged one; the state has its first parts so far.
    :param settled: static stresses of the new parts alone, broken where their weight breaks them.
    """
    first, bonds = len(state.parts), len(state.blueprint.bonds)
    rows = model.trees.row[state.forest.parts]
    source = model.blueprint
    fresh = np.arange(first, len(source))
    columns = columns_of(source)
    if len(fresh):
        state.parts.append(**{name: column[fresh] for name, column in columns.items()},
                           owner=owners(model)[fresh], row=-1)
    state.parts.row[:] = model.trees.row
    state.blueprints[:] = [source]
    state.wind.shelter = _shelter(model, state)
    _extend_masonry(model, state, settled, first, bonds)
    forest = deepcopy(model.trees.forest)
    forest.adopt(state.forest, rows)
    state.forest = forest
    fallen = state.leaves.next - before.leaves.first
    _extend_columns(model, state)
    _extend_trees(model, state, rows)
    _extend_leaves(model, state, rows, fallen)
    stands = fresh[state.parts.owner[fresh] == Owner.STANDING]
    if len(stands):
        state.parts.body[stands] = state.world.add_bricks(
            source.poses[stands], source.size[stands], source.mass[stands],
            hexahedra=source.hexahedra.among(stands), inertia=source.inertia[stands])
    for parts in mechanisms.rigid_groups(model, fresh[state.parts.owner[fresh] == Owner.BODY]):
        fragments.make_body(model, state, parts, source.poses[parts], np.zeros((len(parts), 6)))
    mechanisms.connect(model, state, len(state.mechanisms.joint))


def _shelter(model: Model, state: State) -> Shelter:
    """Find the wind shelter by all objects that were not removed."""
    left = [own for own in model.objects if own.name not in state.removed]
    return find_shelter(model.blueprint, left, model.masonry.members, model.settings.terrain)


def _chained(model: Model, whole: Blueprint, placed: Blueprint, graph: BondGraph,
             first: int) -> tuple[BondGraph, BondGraph]:
    """
    Return the bond graphs of the enlarged scene: masonry bonds, and all bonds as mortar.

    :param graph: masonry bonds of the added object, its parts from `first` on.
    """
    every = BondGraph(as_mortar(placed)) if len(placed.hinges) else graph
    return (BondGraph.chained(whole, [(model.masonry.graph, 0), (graph, first)]),
            BondGraph.chained(as_mortar(whole), [(model.loose_bonds.graph, 0), (every, first)]))


def _settled(blueprint: Blueprint, graph: BondGraph, gravity: float,
             name: str) -> tuple[StressSolver, list[str]]:
    """Solve the static stresses of an object by itself, with its mortar set."""
    solver = StressSolver(graph, (0.0, 0.0, -gravity))
    if not len(solver.graph):
        return solver, []
    rounds = Fracture(solver).advance(SETTLING)
    loose = np.flatnonzero(~solver.supported)
    return solver, load_checks.describe_failures(
        blueprint, [SceneObject(name, 0, len(blueprint))], rounds, solver.graph.rows, loose)


def _extend_masonry(model: Model, state: State, settled: StressSolver, first: int,
                    bonds: int) -> None:
    """Join the stress solver of a new object, parts from `first` and bonds from `bonds` on."""
    graph = deepcopy(model.masonry.graph)
    known = len(state.solver.graph)
    solver = StressSolver.joined(graph, (0.0, 0.0, -model.gravity), [
        (state.solver, 0, np.arange(known)), (settled, first, np.arange(known, len(graph)))])
    fracture = Fracture(solver)
    fracture.adopt(state.fracture)
    state.solver, state.fracture = solver, fracture
    loose = deepcopy(model.loose_bonds)
    loose.graph.adopt(state.loose_bonds.graph, np.arange(bonds), np.arange(bonds))
    state.loose_bonds = loose
    state.loads.resize(graph.count)


def _extend_columns(model: Model, state: State) -> None:
    """Extend all arrays with a row per part or pane."""
    parts = len(model.blueprint)
    blasts, rubble = state.blasts, state.rubble
    blasts.momentum, blasts.pulse = _padded(blasts.momentum, parts), _padded(
        blasts.pulse, parts, np.inf)
    rubble.given = _padded(rubble.given, parts)
    rubble.rocked = _padded(rubble.rocked, parts)
    load = np.zeros(len(model.glass.parts))
    load[:len(state.glass.load)] = state.glass.load
    state.glass.load = load
    holds = state.climbers.holds
    more = np.ones(len(model.trees.climbers.row) - len(holds), bool)
    state.climbers = ClimberState(np.concatenate([holds, more]))
    state.wall_wind.parts = state.wall_wind.parts[:0]  # find the exposed parts again
    state.skyline.drawn = None


def _extend_trees(model: Model, state: State, rows: np.ndarray) -> None:
    """Move what is known of segments to their new rows, and add that of new ones."""
    trees, forest, contacts = state.trees, state.forest, state.contacts
    air, faded, poses, sizes = (np.zeros((len(forest), 3)), np.zeros((len(forest), 3)),
                                forest.poses.copy(), model.trees.sizes.copy())
    air[rows], faded[rows] = trees.air, trees.faded_air
    poses[rows], sizes[rows] = trees.start_poses, trees.sizes
    trees.air, trees.faded_air, trees.start_poses, trees.sizes = air, faded, poses, sizes
    for name in ('age', 'quiet', 'down'):
        setattr(trees, name, {int(rows[row]): time for row, time in getattr(trees, name).items()})
    crowns = np.zeros((2, len(forest)))
    crowns[:, rows[:state.snow.on_crowns.shape[1]]] = state.snow.on_crowns
    state.snow.on_crowns = crowns
    if trees.lod is not None:
        trees.lod.renumber(rows)
    contacts.row = rows[contacts.row]
    contacts.other = np.where(contacts.other >= 0, rows[contacts.other], -1)
    state.tree_bounds = TreeBounds()


def _extend_leaves(model: Model, state: State, rows: np.ndarray, fallen: np.ndarray) -> None:
    """Add leaves; `fallen` is the number of those that each former segment has lost, (S',)."""
    leaves, queue = state.leaves, model.leaves
    leaves.attached = np.concatenate([
        leaves.attached, np.ones(len(model.blueprint.leaves) - len(leaves.attached), bool)])
    leaves.left = np.concatenate([leaves.left, model.blueprint.leaf_area[len(leaves.left):]])
    leaves.next = queue.first.copy()
    leaves.next[rows] += fallen
    leaves.weakest = queue.queue_speed[leaves.next]
    leaves.speed = np.zeros(len(state.forest))


def _padded(column: np.ndarray, rows: int, value: float = 0.0) -> np.ndarray:
    """Return a column padded with rows at its end, (count, ...)."""
    more = np.full((rows - len(column), *column.shape[1:]), value, column.dtype)
    return np.concatenate([column, more])
