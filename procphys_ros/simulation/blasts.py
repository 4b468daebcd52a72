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


"""Blasts: what explosions do to all that stands and lies about, as their waves come to it."""

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.errors import CommandError
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics import fracture_energy
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.loads import air_blast
from procphys_ros.physics.masonry import cells
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.scene.strikes import Explosion
from procphys_ros.simulation import blast_loads, breaking, glass, masonry
from procphys_ros.simulation.blast_patches import BlastPatches
from procphys_ros.simulation.masonry import WALL_RATE
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State, Wave

_LEAST = 1e-3        # [m/s] speed of a body below which a wave is neglected
_AFTERMATH = 0.3     # [s] after which the fall of parts out of a wall is not due to the blast
_PATCHES = (3.0, 2.4, 1.9, 1.5, 1.2, 0.9, 0.6, 0.3)  # [m] radii of pieces of wall, tried in turn
_MOST_PATCHES = 60   # in one step, ...
_MOST_FAILED = 150   # ... and positions where none comes out, ...
_APART = 0.6         # [m] ... that are tried at this distance
_ALIKE = 0.7         # cosine between impulses on the parts of one piece
_DEEPEST = 0.35      # [m] before and behind its middle that a piece reaches
_SURPLUS = 4.0       # kinetic energy over the work of its bonds from which on a brick flies singly
_MOST_SINGLE = 250   # such bricks per explosion, the fastest; more could not be simulated in time
_CLUMP = 12          # parts per piece of debris that does not fly singly, ...
_MOST_CLUMPS = 120   # ... more where there would be more pieces: each takes milliseconds to make
_MOST_WAVES = 50     # explosions with waves under way


def explode(model: Model, state: State, explosion: Explosion) -> None:
    """
    Detonate a charge; its wave arrives in this and the next steps. Writes `state.blasts`.

    :param explosion: position and charge.
    :raises CommandError: if too many waves are under way.
    """
    if len(state.blasts.waves) >= _MOST_WAVES:
        raise CommandError(f'the waves of {_MOST_WAVES} explosions are under way; wait '
                           'for them to pass')
    parts = state.parts
    point, charge = explosion.position, explosion.charge
    ground = float(model.terrain.height(np.array([point]))[0])
    if point[2] < ground:
        raise CommandError(f'explosion.position is {list(point)}: that is under the ground, which '
                           f'is {ground:.2f} m high there')
    state.blasts.single_left = _MOST_SINGLE
    found = blast_loads.on_everything(model, state, point, charge, ground)
    if not found:
        return
    hit, linear, angular, arrival, pulse = (np.concatenate(column) for column in zip(*(
        (rows, gift.linear, gift.angular, gift.arrival, gift.duration) for rows, gift in found)))
    speed = norm(linear, axis=1) / parts.mass[hit]
    felt = np.flatnonzero(speed > _LEAST)
    felt = felt[np.argsort(arrival[felt], kind='stable')]
    state.blasts.waves.append(Wave(hit[felt], linear[felt], angular[felt],
                                   arrival[felt] + state.time, pulse[felt]))


def step(model: Model, state: State, dt: float) -> None:
    """
    Apply the waves that arrive within the step.

    Writes `state.blasts`, momentum of trees and bodies, bonds and loads of walls; releases.
    """
    own = state.blasts
    if own.passed < state.time - _AFTERMATH:
        own.momentum[:] = 0.0
        own.passed = np.inf
    for wave in own.waves:
        end = int(np.searchsorted(wave.arrival, state.time + dt))
        if end > wave.done:
            rows = np.arange(wave.done, end)
            wave.done = end
            _deliver(model, state, wave, rows)
            own.passed = state.time
    own.waves = [w for w in own.waves if w.done < len(w.parts)]


def _deliver(model: Model, state: State, wave: Wave, rows: np.ndarray) -> None:
    owner = state.parts.owner[wave.parts[rows]]
    for row in rows[owner == Owner.TREE].tolist():
        part = int(wave.parts[row])
        state.forest.apply_impulse(int(state.parts.row[part]), None, wave.linear[row],
                                   wave.angular[row])
    _push_bodies(model, state, wave, rows[owner == Owner.BODY])
    if (owner == Owner.STANDING).any():
        _shake(model, state, wave, rows[owner == Owner.STANDING])


def _push_bodies(model: Model, state: State, wave: Wave, rows: np.ndarray) -> None:
    """Apply impulses to bodies, summed about their centres of mass; crack panes among them."""
    panes = rows[np.isin(wave.parts[rows], model.glass.parts)]
    np.maximum.at(state.glass.load, np.searchsorted(model.glass.parts, wave.parts[panes]),
                  _pane_loads(model, wave.parts[panes], wave.linear[panes], wave.pulse[panes]))
    carrier = state.parts.body[wave.parts[rows]]
    bodies, place = np.unique(carrier, return_inverse=True)
    total = np.zeros((len(bodies), 6))
    arm = state.parts.poses[wave.parts[rows], :3] - state.world.bodies.poses[carrier, :3]
    np.add.at(total[:, :3], place, wave.linear[rows])
    np.add.at(total[:, 3:], place, wave.angular[rows] + np.cross(arm, wave.linear[rows]))
    for body, impulse in zip(bodies.tolist(), total):
        state.world.apply_impulse(body, impulse[:3], angular=impulse[3:])


def _shake(model: Model, state: State, wave: Wave, rows: np.ndarray) -> None:
    """Apply a wave to standing parts: break panes, tear out pieces, load the rest."""
    own, parts = state.blasts, wave.parts[rows]
    own.momentum[parts] += wave.linear[rows]
    own.pulse[parts] = wave.pulse[rows]
    pane = model.glass.is_pane[parts]
    state.ledger.waves = state.ledger.waves + wave.linear[rows[~pane]].sum(axis=0)
    _burst_panes(model, state, parts[pane])
    standing = state.standing[:len(model.blueprint)]
    shaken = np.flatnonzero(standing & own.momentum.any(axis=1))
    graph = state.solver.graph
    work = _bond_work(graph, np.flatnonzero(graph.alive))
    shaken = shaken[_energy(state, shaken) > work[shaken]]
    loose = _tear_patches(model, state, shaken)
    holds = np.setdiff1d(parts[state.standing[parts]], loose)
    if len(holds):
        rate = np.minimum(2.0 / own.pulse[holds], WALL_RATE)[:, None]
        masonry.apply_impulses(state, holds, own.momentum[holds], rate, carried=False)


def _burst_panes(model: Model, state: State, panes: np.ndarray) -> None:
    """Break the panes that a wave overloads."""
    if not len(panes):
        return
    own = state.blasts
    load = _pane_loads(model, panes, own.momentum[panes], own.pulse[panes])
    _shatter(model, state, panes[load > 1.0], load[load > 1.0])


def _shatter(model: Model, state: State, panes: np.ndarray, load: np.ndarray) -> None:
    glass.shatter_standing(model, state, [
        (glass.crack(model, pane, count=len(panes)),
         state.blasts.momentum[pane] / state.parts.mass[pane], over)
        for pane, over in zip(panes.tolist(), load.tolist())], Cause.BLAST)


def _pane_loads(model: Model, panes: np.ndarray, impulses: np.ndarray,
                pulse: np.ndarray) -> np.ndarray:
    """Return the loads of panes under triangular pulses over their capacity, (K,)."""
    area = np.sort(model.blueprint.size[panes], axis=1)[:, 1:].prod(axis=1)
    pressure = 2.0 * norm(impulses, axis=1) / (pulse * area)
    return pressure / glass.pressure(model, panes) * air_blast.dynamic_load_factor(
        glass.frequency(model, panes) * pulse)


def _bond_work(graph: BondGraph, bonds: np.ndarray) -> np.ndarray:
    """Return the work of fracture of each part's share of some of its bonds [J], (N,)."""
    whole = (graph.mortar.cohesion[bonds] > 0.0) & ~graph.cracked[bonds]
    work = np.where(whole, 0.5 * fracture_energy.SHEARING * graph.area[bonds], 0.0)
    return (np.bincount(graph.first[bonds], work, graph.count + 1)
            + np.bincount(graph.second[bonds], work, graph.count + 1))[:-1]


def _energy(state: State, parts: np.ndarray) -> np.ndarray:
    """Return the kinetic energy that parts would have without bonds [J], (K,)."""
    return 0.5 * np.square(state.blasts.momentum[parts]).sum(axis=1) / state.parts.mass[parts]


def _tear_patches(model: Model, state: State, shaken: np.ndarray) -> np.ndarray:
    """
    Tear round patches out of walls, each as large as the wave allows.

    :param shaken: parts with the energy to break away, (K,).
    :returns: the detached parts.
    """
    loose: list[np.ndarray] = [np.zeros(0, np.intp)]
    cut, loads = [np.zeros(0, np.intp)], [np.zeros(0)]
    if not len(shaken):
        return loose[0]
    places = model.blueprint.poses[shaken, :3]
    tree, left = scipy.spatial.cKDTree(places), np.ones(len(shaken), bool)
    momentum = state.blasts.momentum[shaken]
    size = norm(momentum, axis=1)
    speed, way = size / state.parts.mass[shaken], momentum / size[:, None]
    judge = BlastPatches(model, state, shaken)
    torn = failed = 0
    while torn < _MOST_PATCHES and failed < _MOST_FAILED and (speed > 0.0).any():
        seed = int(np.argmax(speed))
        near = np.array(tree.query_ball_point(places[seed], _PATCHES[0]))
        away = places[near] - places[seed]
        distance = norm(away, axis=1)
        speed[near[distance < _APART]] = 0.0  # they may fly along with others
        alike = left[near] & (product(way[near], way[seed]) > _ALIKE)
        alike &= np.abs(product(away, way[seed])) < _DEEPEST
        failed += 1
        tried = 0
        for radius in _PATCHES:
            patch = np.sort(near[alike & (distance < radius)])
            if len(patch) == tried:
                continue  # the same as within the radius before
            tried = len(patch)
            if judge.comes_out(patch):
                bonds, load = _loosen(model, state, shaken[patch], judge.alive)
                cut.append(bonds)
                loads.append(np.full(len(bonds), load))
                loose.append(shaken[patch])
                left[patch], speed[patch] = False, 0.0
                torn, failed = torn + 1, failed - 1
                break
    graph, bonds = state.solver.graph, np.concatenate(cut)
    breaking.break_bonds(model, state, graph.rows[bonds], Cause.BLAST, np.concatenate(loads),
                         told=~graph.has_cracked(bonds), dynamic_factor=1.0)
    bent = glass.in_bent_frames(model, graph.rows[bonds])
    bent = bent[state.standing[bent]]
    _shatter(model, state, bent, np.ones(len(bent)))
    return np.concatenate(loose)


def _loosen(model: Model, state: State, parts: np.ndarray,
            alive: np.ndarray) -> tuple[np.ndarray, float]:
    """
    Cut out a piece of wall, and divide it into single parts and clumps.

    :param alive: bonds not cut yet, (M,) bool; updated.
    :returns: bonds to cut, and the ratio of energy to work of fracture.
    """
    own, graph = state.blasts, state.solver.graph
    touching = graph.neighbours(parts)
    touching = touching[alive[touching]]
    surplus = _energy(state, parts) / np.maximum(_bond_work(graph, touching)[parts], 1e-9)
    cell = np.full(graph.count + 1, -1)
    single = np.argsort(-surplus, kind='stable')[:min(own.single_left, _MOST_SINGLE // 4)]
    single = single[surplus[single] > _SURPLUS]
    own.single_left -= len(single)
    clumped = np.delete(np.arange(len(parts)), single)
    if len(clumped):
        rng = np.random.default_rng([len(parts), int(parts[0])])
        size = max(_CLUMP, -(-len(clumped) // _MOST_CLUMPS))
        seeds = rng.choice(clumped, -(-len(clumped) // size), replace=False)
        places = model.blueprint.poses[parts, :3]
        cell[parts[clumped]] = cells.nearest(places[clumped], places[seeds])
    cell[parts[single]] = len(parts) + np.arange(len(single))
    cut = touching[cell[graph.first[touching]] != cell[graph.second[touching]]]
    kept = np.sqrt(np.maximum(1.0 - 1.0 / np.maximum(surplus, 1.0), 0.0))
    _pass_on(state, parts, (1.0 - kept)[:, None] * own.momentum[parts], touching)
    alive[cut] = False
    return cut, float(np.median(surplus))


def _pass_on(state: State, parts: np.ndarray, impulses: np.ndarray, bonds: np.ndarray) -> None:
    """
    Transfer the impulse lost in tearing a piece of wall loose to its surroundings.

    By action and reaction the bonds around the piece pull its neighbours along: each gets its
    share by area, and the ground that of its bonds. A piece without bonds keeps all.

    :param impulses: taken from each part [N·s], world, (K, 3).
    :param bonds: of the parts, not cut yet, (B,).
    """
    own, graph = state.blasts, state.solver.graph
    inside = np.zeros(graph.count + 1, bool)
    inside[parts] = True
    around = bonds[inside[graph.first[bonds]] != inside[graph.second[bonds]]]
    if not len(around):
        return
    own.momentum[parts] -= impulses
    share = graph.area[around, None] * impulses.sum(axis=0) / graph.area[around].sum()
    outer = np.where(inside[graph.first[around]], graph.second[around], graph.first[around])
    built = outer < graph.count
    np.add.at(own.momentum, outer[built], share[built])
