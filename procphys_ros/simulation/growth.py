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
Growth: plants that grow on while the simulation runs.

A year is one derivation step of a grammar. At its beginning the next string is derived, and the
plant is laid out as it will be at the end of the year: with segments that are new, all but nothing
at first, and with those that the grammar sheds, which wither until they are nothing. Within the
year nothing but constants change, in every step.
"""

import logging

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError, nearest_names, ProcPhysError
from procphys_ros.lsystem import Growth
from procphys_ros.physics.air import FOLIAGE_DRAG
from procphys_ros.physics.masonry import BondGraph, StressSolver
from procphys_ros.physics.trees import Forest, growing
from procphys_ros.scene import SceneObject
from procphys_ros.scene.capacity import available_memory, check_addition
from procphys_ros.scene.plants import advance, Grow, Stand
from procphys_ros.simulation import additions, breaking
from procphys_ros.simulation.layout_of_year import lay_out, living, match, subset, Year
from procphys_ros.simulation.model import compile_model, Model
from procphys_ros.simulation.parts import columns_of
from procphys_ros.simulation.plants import COLUMNS, PART, PlantState
from procphys_ros.simulation.state import State

STAGE = 'growth'  # its name
_ROUNDING = 1e-9  # of shares of years, which are sums of steps
_LOG = logging.getLogger(__name__)


def command(model: Model, state: State, wish: Grow) -> int:
    """
    Let plants grow on, or stop them; the next years are derived in the steps to come.

    :returns: number of the plants.
    :raises CommandError: if there is no such plant, or it is one that cannot grow.
    """
    names = _named(model, state, wish.target)
    for name in names:
        own = state.growing.plants.get(name)
        if own is None:
            own = state.growing.plants[name] = _started(model, state, name)
        own.rate, own.until = wish.rate, own.string.steps + wish.years
    return len(names)


def _named(model: Model, state: State, target: str) -> list[str]:
    """Find the plants that a command names."""
    left = [name for name in model.plants if name not in state.removed]
    if target in left:
        found = [target]
    else:
        stem = f'{target}_' if target else ''
        found = [name for name in left if not target or (
            name.startswith(stem) and name[len(stem):].isdigit())]
    if not found:
        known = any(own.name == target for own in state.objects)
        raise CommandError(
            f'"{target}" is no plant that an L-system of the scene has grown, and cannot grow on'
            if known else f'there is no plant "{target}"{nearest_names(target, left)}'
            if left else 'the scene has no plant that an L-system has grown')
    climbers = model.trees.climbers.anchors
    held = np.concatenate([climbers.part, climbers.host])
    for own in state.objects:
        if own.name in found and ((held >= own.first) & (held < own.first + own.count)).any():
            raise CommandError(f'"{own.name}" climbs or is climbed on; such plants cannot grow on')
    return found


def _started(model: Model, state: State, name: str) -> PlantState:
    """Begin to keep the string of a plant, as it stands in the scene."""
    growth = model.plants[name].grown()
    drawn = growth.drawn()
    placed = next(own for own in state.objects if own.name == name)
    assert drawn is not None and len(drawn.segments) == placed.count
    leaves = model.blueprint.leaves.part
    return PlantState(
        growth.string(), placed.first + np.arange(placed.count), drawn.segments,
        np.flatnonzero((leaves >= placed.first) & (leaves < placed.first + placed.count)),
        drawn.leaves)


def step(model: Model, state: State, dt: float) -> None:
    """
    Grow plants through a part of their year.

    Writes constants of the forest, its poses, sizes and masses of parts, and `state.growing`.
    """
    own = state.growing
    moving, done = [], []
    for number, plant in enumerate(own.plants.values()):
        if plant.rate > 0.0 and plant.share < 1.0:
            plant.share += plant.rate * dt
            if plant.share > 1.0 - _ROUNDING:
                plant.share = max(plant.share, 1.0)
            moving.append(number)
            if plant.share >= 1.0 and plant.string.steps >= plant.until:
                done.append(number)
    if not moving:
        return
    change(model, state, np.isin(own.plant, moving))
    if done:
        for number in done:
            _end_year(state, list(own.plants.values())[number])
        own.forget(done)


def change(model: Model, state: State, chosen: np.ndarray) -> None:
    """
    Set what grows to its present share of the year; what has broken off stays as it is.

    :param chosen: rows of `state.growing`, (K,) bool; changed.
    """
    own, parts, forest = state.growing, state.parts, state.forest
    chosen &= living(state, own.part)
    if not chosen.any():
        return
    place: slice | np.ndarray = slice(None) if chosen.all() else np.flatnonzero(chosen)
    if own.slope is None:
        own.slope = growing.slope_of(own.start, own.end)
    part, share = own.part[place], own.shares()[own.plant[place]]
    now = growing.between(own.start[place], own.end[place], own.slope[place], share)
    growing.balance(now, own.bulge[place], share)
    rows, area = parts.row[part], model.blueprint.leaf_area[part]
    leaves = np.where(area > 0.0, state.leaves.left[part] / np.where(area > 0.0, area, 1.0), 1.0)
    forest.change(rows, now, np.clip(leaves, 0.0, 1.0))
    at = PART
    for name, width in COLUMNS.items():
        block = now[:, at:at + width]
        getattr(parts, name)[part] = block if width > 1 else block[:, 0]
        at += width
    parts.drag_area[part] -= FOLIAGE_DRAG * share * (1.0 - leaves) * area
    state.trees.sizes[rows] = parts.solid_size[part]
    lod = state.trees.lod
    if lod is not None:
        lod.update_trees(forest)
        lod.wake(lod.of_rows(forest, rows))


def enlarge(model: Model, state: State) -> Model:
    """
    Begin the next year of all plants that have come to the end of one.

    :returns: the model with the segments that are new, to which the state is extended.
    """
    own = state.growing
    due = [name for name, plant in own.plants.items() if plant.is_due]
    if not due:
        return model
    for name in due:
        _end_year(state, own.plants[name])
    own.forget([number for number, name in enumerate(own.plants) if name in due])
    years = _matched(model, state, _derived(model, state, due))
    if not years:
        return model
    whole, bonds = lay_out(state, years)
    made = [SceneObject(_free(state, f'{year.name}_year_{year.growth.steps}'),
                        int(year.parts[year.born[0]]), len(year.born))
            for year in years if len(year.born)]
    enlarged = compile_model(
        model.settings, model.shard, whole, [*state.objects, *made], model.time_step, model.seed,
        model.wind, model.loaded, plants=model.plants)
    nothing = StressSolver(BondGraph(Blueprint()), (0.0, 0.0, -model.gravity))
    additions.extend(model, enlarged, state, nothing)
    for placed, year in zip(made, (year for year in years if len(year.born))):
        state.objects.append(placed)
        state.names.extend([placed], year.fresh())
    _begin(enlarged, state, years, bonds)
    own.layouts += 1
    return enlarged


def _free(state: State, name: str) -> str:
    taken = {known.name for known in state.objects}
    while name in taken:
        name += '_'
    return name


def _matched(model: Model, state: State, growths: dict[str, Growth]) -> list[Year]:
    """Find what becomes of plants; one that cannot be drawn or placed stops, with a warning."""
    years, count = [], len(state.parts)
    for name, growth in growths.items():
        try:
            year = match(model, state, name, growth, count)
            check_addition(name, len(year.born), available_memory())
        except ProcPhysError as error:
            _stop(state, [name], error)
        else:
            years.append(year)
            count += len(year.born)
    return years


def _stop(state: State, names: list[str], error: ProcPhysError) -> None:
    _LOG.warning(f'{", ".join(names)}: no further growth: {error}')
    for name in names:
        state.growing.plants[name].rate = 0.0


def _derived(model: Model, state: State, due: list[str]) -> dict[str, Growth]:
    """Derive the next strings; a plant whose string cannot be derived stops, with a warning."""
    plants, own = model.plants, state.growing
    stands = {id(plants[name].stand): plants[name].stand for name in due}
    out: dict[str, Growth] = {}
    for stand in stands.values():
        left = Stand(tuple(name for name in stand.names if name not in state.removed),
                     stand.habitat)
        mine = [name for name in due if plants[name].stand is stand]
        try:
            out |= advance(plants, left, {name: plant.string
                                          for name, plant in own.plants.items()}, set(mine))
        except ProcPhysError as error:
            _stop(state, mine, error)
    return {name: out[name] for name in due if name in out}


def _end_year(state: State, plant: PlantState) -> None:
    """Remove what has withered."""
    if len(plant.withering):
        breaking.wither(state, plant.withering[living(state, plant.withering)])
    plant.withering = plant.withering[:0]


def _begin(model: Model, state: State, years: list[Year], bonds: np.ndarray) -> None:
    """
    Write what changes in the years that begin, and set it to their beginnings.

    :param bonds: of each part in the blueprint, -1 = none, (N,).
    """
    own, numbers = state.growing, {name: n for n, name in enumerate(state.growing.plants)}
    part = np.concatenate([year.all_parts() for year in years])
    plant = np.concatenate([np.full(len(year.all_parts()), numbers[year.name])
                            for year in years])
    born = np.isin(part, np.concatenate([year.parts[year.born] for year in years]))
    dying = np.isin(part, np.concatenate([year.withering for year in years]))
    start, end, bulge = _constants(model, state, part, bonds[part], born, dying)
    before, after = _columns(model, state, part, born)
    own.part, own.plant = np.append(own.part, part), np.append(own.plant, plant)
    own.start = np.concatenate([own.start, np.hstack([start, before])])
    own.end = np.concatenate([own.end, np.hstack([end, after])])
    own.bulge, own.slope = np.concatenate([own.bulge, bulge]), None
    for year in years:
        year.keep(own, numbers[year.name])
    state.leaves.left[part] = model.blueprint.leaf_area[part]
    rows = state.parts.row[part]
    state.leaves.next[rows] = model.leaves.first[rows]
    state.leaves.weakest = model.leaves.queue_speed[state.leaves.next]
    change(model, state, np.isin(own.plant, [numbers[year.name] for year in years]))
    fresh = np.sort(state.parts.row[part[born]])
    state.forest.follow(fresh)
    state.parts.poses[state.forest.parts[fresh]] = state.forest.poses[fresh]
    state.parts.velocities[state.forest.parts[fresh]] = state.forest.velocities[fresh]
    state.trees.start_poses[fresh] = state.forest.poses[fresh]


def _columns(model: Model, state: State, part: np.ndarray,
             born: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns of parts that change, at the beginning and the end, (K, 14) each."""
    made = columns_of(model.blueprint)
    after = np.column_stack([made[name][part] for name in COLUMNS])
    before = np.column_stack([getattr(state.parts, name)[part] for name in COLUMNS])
    lengths = sum(list(COLUMNS.values())[:3])
    before[born, :lengths] = growing.THIN * after[born, :lengths]
    before[born, lengths:] = growing.LIGHT * after[born, lengths:]
    return before, after


def _constants(model: Model, state: State, part: np.ndarray, bond: np.ndarray, born: np.ndarray,
               dying: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Compute the constants of segments at the beginning and the end, and the bulge of preloads.

    :param part, bond: of each, (K,).
    :param born, dying: (K,) bool.
    """
    source = model.blueprint
    alone = subset(source, part, bond)
    forest = Forest(alone, (0.0, 0.0, -model.gravity))
    order = np.argsort(forest.parts, kind='stable')  # row of each part
    parent = np.where(alone.bonds[:, 0] < 0, -1, alone.bonds[:, 0])
    end, start = forest.constants[order], state.forest.constants[state.parts.row[part]]
    share = alone.hinges.preload[:, None]
    start[born], end[dying] = growing.slight(end[born]), growing.slight(start[dying])
    end[dying, :3] *= growing.ratios(end, start, parent[dying])
    start[born, :3] *= growing.ratios(start, end, parent[born])
    _remount(parent, born, start)
    start = growing.aligned(start, end)
    first, middle, last = (share * forest.balanced(table[forest.parts])[order]
                           for table in (start, 0.5 * (start + end), end))
    end[:, growing.PRELOADS] = last
    start[np.flatnonzero(born)[:, None], growing.PRELOADS] = first[born]
    return start, end, growing.bulge(first, middle, last)


def _remount(parent: np.ndarray, born: np.ndarray, start: np.ndarray) -> None:
    """Mount segments where they are on the new ones that have come between them and their old."""
    kept = np.flatnonzero(~born & (parent >= 0))
    for k in kept[born[parent[kept]]].tolist():
        mounts: list[np.ndarray] = []
        up = int(parent[k])
        while up >= 0 and born[up]:
            mounts.insert(0, start[up, :growing.BODY])
            up = int(parent[up])
        start[k, :growing.BODY] = growing.remounted(start[k, :growing.BODY], mounts)
