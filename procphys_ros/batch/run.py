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


"""Run: one simulation of a batch, and the results that are kept of it."""

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from procphys_ros.scene import Scene
from procphys_ros.simulation import Cause, Simulation
from procphys_ros.simulation.parts import Owner, owners
from procphys_ros.simulation.readings import record_series, Series

_TAKEN_EVERY = 60  # steps between reads of the log of breaks, long before it is full
MEASURES = ('parts', 'mass_kg', 'bonds', 'bonds_broken',
            *(f'broken_by_{cause.name.lower()}' for cause in Cause), 'parts_fallen',
            'mass_fallen_kg', 'first_break_s', 'last_break_s', 'wall_time_s')
"""Columns of a table behind those that say what was varied."""


@dataclass(frozen=True)
class Run:
    """
    One simulation of a batch.

    :ivar number: of the run.
    :ivar parameters: of the scene, nested, including varied ones.
    :ivar folder: of the scene file, searched first for grammars.
    :ivar duration: simulated time [s].
    :ivar series: recorded parts, as in `Simulation.series`; () = none.
    :ivar every: time steps per row of the series.
    """

    number: int
    parameters: Mapping[str, Any]
    folder: Path
    duration: float
    series: tuple[str, ...] = ()
    every: int = 1


def run(what: Run) -> dict[str, float]:
    """
    Simulate, and summarise the breakage; see `record`.

    :returns: values of `MEASURES`; NaN for times of breaks if no bond broke.
    :raises ProcPhysError: if the scene cannot be built.
    """
    return record(what)[0]


def record(what: Run) -> tuple[dict[str, float], Series | None]:
    """
    Simulate, summarise the breakage, and record parts.

    Bonds that break under their own weight during the setup of the scene count too. A part has
    fallen if it was part of a building or a tree and is loose, on a detached branch, or gone.

    :returns: values of `MEASURES`, NaN for times of breaks if no bond broke; and the series of
        the recorded parts.
    :raises ProcPhysError: if the scene cannot be built, or there is no such part.
    """
    start = perf_counter()
    simulation = Simulation(Scene.from_parameters(what.parameters, what.folder))
    built = owners(simulation.model) != Owner.BODY
    events = [simulation.log.take()]
    steps = int(round(what.duration / simulation.time_step))

    def step(count: int) -> None:
        for first in range(0, count, _TAKEN_EVERY):
            simulation.step(min(_TAKEN_EVERY, count - first))
            events.append(simulation.log.take())
    series = None
    with closing(simulation):
        if what.series:
            series = record_series(simulation, step, steps, what.series, what.every)
        else:
            step(steps)
        result = _sum_up(simulation, built, np.concatenate(events))
    return result | {'wall_time_s': round(perf_counter() - start, 3)}, series


def _sum_up(simulation: Simulation, built: np.ndarray, breaks: np.ndarray) -> dict[str, float]:
    """Return the values of `MEASURES`, except the wall time."""
    fallen = built & _loose(simulation)[:len(built)]
    mass = simulation.model.blueprint.mass
    return {
        'parts': len(built), 'mass_kg': float(mass.sum()),
        'bonds': len(simulation.model.blueprint.bonds), 'bonds_broken': len(breaks),
        **{f'broken_by_{cause.name.lower()}': int(np.count_nonzero(breaks['cause'] == cause))
           for cause in Cause},
        'parts_fallen': int(np.count_nonzero(fallen)),
        'mass_fallen_kg': float(mass[fallen].sum()),
        'first_break_s': float(breaks['time'].min()) if len(breaks) else np.nan,
        'last_break_s': float(breaks['time'].max()) if len(breaks) else np.nan}


def _loose(simulation: Simulation) -> np.ndarray:
    """Mark the parts that neither stand nor are attached to a standing part, (N,) bool."""
    parts, forest = simulation.state.parts, simulation.state.forest
    loose = (parts.owner == Owner.BODY) | (parts.owner == Owner.GONE)
    grown = np.flatnonzero(parts.owner == Owner.TREE)
    if len(grown):
        roots = parts.row[grown]
        while (forest.parents[roots] >= 0).any():
            roots = np.where(forest.parents[roots] >= 0, forest.parents[roots], roots)
        loose[grown] = forest.is_free(roots)
    return loose
