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

from collections.abc import Sequence

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics import fracture_energy
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import ALIKE
from procphys_ros.physics.loads import (
    air_blast,
    blast_boxes,
    blast_capsules,
    faces,
    find_room,
    gas_impulse,
    heading,
    Impulses,
    peak_pressure,
    Sight,
)
from procphys_ros.physics.masonry import cells
from procphys_ros.physics.masonry.capacity import fails, joints_of
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.scene.strikes import Explosion
from procphys_ros.simulation import breaking, glass, masonry
from procphys_ros.simulation.masonry import WALL_RATE
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State, Wave

_DEEPEST_COLUMN = 4    # leaves of a wall that move as one
_STOREY = 2.7        # [m] height of the wall whose rate is `masonry.WALL_RATE`, ...
_LEAF = 0.1025       # [m] ... and its thickness
_BRICK = 0.225       # [m] smallest piece of wall that comes out as one
_BENDING = 5.0       # bending strength over shear strength, times span over thickness
_LEAST = 1e-3        # [m/s] speed of a body below which a wave is neglected
_AFTERMATH = 0.3     # [s] after which the fall of parts out of a wall is not due to the blast
_PATCHES = (3.0, 2.4, 1.9, 1.5, 1.2, 0.9, 0.6, 0.3)  # [m] radii of pieces of wall, tried in turn
_MOST_PATCHES = 60   # in one step, ...
_MOST_FAILED = 150   # ... and positions where none comes out, ...
_APART = 0.6         # [m] ... that are tried at this distance
_DEEPEST = 0.35      # [m] before and behind its middle that a piece reaches
_SURPLUS = 4.0       # kinetic energy over the work of its bonds from which on a brick flies singly
_CLUMP = 12          # parts per piece of debris that does not fly singly, more where there would
#                      be more than half of the bodies aimed at
_MOST_WAVES = 50     # explosions with waves under way


def spread(state: State, impulses: np.ndarray, peaks: np.ndarray) -> np.ndarray:
    """
    Distribute impulses on standing parts over the thickness of their walls.

    A stress wave crosses a wall in a tenth of a millisecond, so that the parts behind another in
    the direction of its impulse move off with it, at one velocity.

    :param impulses: on all parts of buildings [N·s], world, (N, 3).
    :param peaks: largest force on each [N], (N,).
    :returns: impulses and peaks of jointly moving parts, (N, 4).
    """
    graph, count = state.solver.graph, len(impulses)
    given = np.column_stack([impulses, peaks])
    bonds = np.flatnonzero(graph.alive & (graph.first < count) & (graph.second < count))
    front = np.concatenate([graph.first[bonds], graph.second[bonds]])
    back = np.concatenate([graph.second[bonds], graph.first[bonds]])
    normal = np.tile(graph.axes[bonds, :, 2], (2, 1))
    normal[len(bonds):] *= -1.0
    area = np.tile(graph.area[bonds], 2)
    pressed = _pressed(front, back, normal, area, impulses)
    if not len(pressed):
        return given
    front, back, area = front[pressed], back[pressed], area[pressed]
    held = np.bincount(back, area, count)
    share = area / held[back]
    mass = state.parts.mass[:count]
    column = mass
    for _ in range(_DEEPEST_COLUMN):
        column = mass + np.bincount(front, share * column[back], count)
    share = share * column[back] / column[front]
    total, passed = given, given
    for _ in range(_DEEPEST_COLUMN):
        onward = np.zeros_like(given)
        np.add.at(onward, back, share[:, None] * passed[front])
        passed = onward
        total = total + passed
    return (mass / column)[:, None] * total


def _pressed(front: np.ndarray, back: np.ndarray, normal: np.ndarray, area: np.ndarray,
             impulses: np.ndarray) -> np.ndarray:
    """Select the joints that transmit an impulse, given the parts in front of and behind them."""
    size = norm(impulses, axis=1, keepdims=True)
    way = impulses / np.where(size > 0.0, size, 1.0)
    chosen = np.zeros(len(front), bool)
    for _ in range(_DEEPEST_COLUMN):
        known = np.abs(way).sum(axis=1) > 0.0
        chosen = (way[front] * normal).sum(axis=1) > ALIKE
        fresh = np.flatnonzero(chosen & ~known[back])
        if not len(fresh):
            break
        total = np.zeros_like(way)
        np.add.at(total, back[fresh], area[fresh, None] * way[front[fresh]])
        size = norm(total, axis=1, keepdims=True)
        way += total / np.where(size > 0.0, size, 1.0)
    return np.flatnonzero(chosen & ((way[front] * way[back]).sum(axis=1) > ALIKE))


def on_everything(model: Model, state: State, point: Sequence[float], charge: float,
                  ground: float) -> list[tuple[np.ndarray, Impulses]]:
    """
    Compute the loads of an explosion on parts.

    :param point: of the charge, (3,) [m], world.
    :param charge: mass of TNT [kg].
    :param ground: height of the ground below it [m].
    :returns: parts, (K,), and their impulses; each part is in one of the rows.
    """
    parts = state.parts
    there = parts.owner != Owner.GONE
    boxes = np.flatnonzero(there & (parts.shape == Shape.BOX))
    rods = np.flatnonzero(there & (parts.shape == Shape.CAPSULE))
    found, sight = [], None
    if len(boxes):
        sight = Sight(parts.poses[boxes], parts.size[boxes])
        found = [(boxes, _on_boxes(model, state, point, charge, ground, boxes, sight))]
    if len(rods):
        found.append((rods, blast_capsules(point, charge, parts.poses[rods], parts.size[rods],
                                           sight=sight, ground=ground)))
    return found


def _on_boxes(model: Model, state: State, point: Sequence[float], charge: float, ground: float,
              boxes: np.ndarray, sight: Sight) -> Impulses:
    poses, sizes = _faces(model, state, boxes)
    fronts = _fronts(state, boxes, poses, sizes)
    centres = state.parts.poses[boxes, :3]
    pane, skin = np.zeros(len(boxes), bool), np.zeros((len(boxes), 6), bool)
    standing = np.flatnonzero(state.parts.owner[boxes] == Owner.STANDING)
    skin[standing] = model.masonry.skin[boxes[standing]]
    shock = blast_boxes(point, charge, poses, sizes, sight=sight, ground=ground, fronts=fronts,
                        centres=centres, skin=skin)
    pane[standing] = model.glass.is_pane[boxes[standing]]
    shock = _add(shock, _gas(state, point, charge, ground, boxes, poses, sizes, centres, ~pane,
                             sight))
    wall = standing[~pane[standing]]
    return _through_walls(state, boxes[wall], wall, shock)


def _faces(model: Model, state: State, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses and extents of boxes; standing ones share the mortar joints of their wall."""
    poses, sizes = state.parts.poses[boxes].copy(), state.parts.size[boxes].copy()
    stands = state.parts.owner[boxes] == Owner.STANDING
    poses[stands] = model.masonry.face_poses[boxes[stands]]
    sizes[stands] = model.masonry.face_sizes[boxes[stands]]
    return poses, sizes


def _fronts(state: State, boxes: np.ndarray, poses: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """
    Measure the surface that the faces of each box belong to, across each of its axes.

    Connected parts are measured along their largest box. Pressure clears from a wall on the ground
    upwards and to both sides, from a ceiling to all sides.

    :returns: height or half the width, the smaller first [m], (N, 3, 2).
    """
    labels, carrier = state.solver.labels, state.parts.body[boxes]
    stands = state.parts.owner[boxes] == Owner.STANDING
    whole = np.where(stands, 0, carrier + int(labels.max(initial=0)) + 1)
    whole[stands] = labels[boxes[stands]]
    _, whole = np.unique(whole, return_inverse=True)
    count = int(whole.max()) + 1
    along = np.zeros(count, np.intp)
    order = np.argsort(sizes.prod(axis=1), kind='stable')
    along[whole[order]] = order
    turn = heading(poses[along, 3:])[whole]
    back = rotation.conjugate(turn)
    axes = rotation.rotate(back[:, None], np.swapaxes(rotation.to_matrix(poses[:, 3:]), 1, 2))
    middle = rotation.rotate(back, poses[:, :3])
    reach = 0.5 * np.einsum('nai,na->ni', np.abs(axes), sizes)
    low, high = np.full((2, count, 3), np.inf)
    high *= -1.0
    np.minimum.at(low, whole, middle - reach)
    np.maximum.at(high, whole, middle + reach)
    length, width, height = (high - low)[whole].T[..., None]
    sideways = np.abs(axes[:, :, 0]) * width + np.abs(axes[:, :, 1]) * length
    flat = np.abs(axes[:, :, 2]) > ALIKE
    both = np.stack([np.where(flat, 0.5 * length, height),
                     0.5 * np.where(flat, width, sideways)], axis=2)
    return np.sort(both, axis=2)


def _gas(state: State, point: Sequence[float], charge: float, ground: float, boxes: np.ndarray,
         poses: np.ndarray, sizes: np.ndarray, centres: np.ndarray, closed: np.ndarray,
         sight: Sight) -> Impulses | None:
    """Compute the loads of confined gas on the room around the charge; None in the open."""
    place = np.asarray(point, float)
    room = find_room(place, poses[closed], sizes[closed], sight, ground)
    if room is None or not room.is_confined():
        return None
    moved = closed & room.encloses(centres)
    peak = peak_pressure(charge, room.volume)
    impulse, _ = gas_impulse(peak, room.volume, room.vents, room.walls,
                             float(state.parts.mass[boxes[moved]].sum()))
    near = np.zeros((len(boxes), 6), bool)
    near[closed] = True
    patches = faces.cut(poses, sizes, near)
    patches = patches.take(room.faces(patches.centre, patches.normal))
    push = -patches.area[:, None] * patches.normal
    linear, angular = faces.gather(patches, impulse * push, centres)
    return Impulses(linear, angular, np.zeros(len(boxes)),
                    peak / impulse * norm(linear, axis=1))


def _through_walls(state: State, parts: np.ndarray, rows: np.ndarray,
                   shock: Impulses) -> Impulses:
    """
    Distribute impulses so that the leaves of a wall move together.

    :param parts: standing parts, (S,), and their rows in the shock, (S,).
    """
    if not len(parts):
        return shock
    count = state.solver.graph.count
    linear, peak = np.zeros((count, 3)), np.zeros(count)
    linear[parts], peak[parts] = shock.linear[rows], shock.peak[rows]
    both = spread(state, linear, peak)[parts]
    result = Impulses(shock.linear.copy(), shock.angular, shock.arrival, shock.peak.copy())
    result.linear[rows], result.peak[rows] = both[:, :3], both[:, 3]
    return result


def _add(shock: Impulses, gas: Impulses | None) -> Impulses:
    """Add the loads of the gas, from the arrival of the shock on."""
    if gas is None:
        return shock
    return Impulses(shock.linear + gas.linear, shock.angular + gas.angular, shock.arrival,
                    shock.peak + gas.peak)


class BlastPatches:
    """
    Select the pieces of wall that a wave tears out, from the bond forces at its arrival.

    :param model, state: the stresses must not change meanwhile.
    :param shaken: parts that pieces consist of, (S,).
    :ivar alive: bonds not cut yet, (M,) bool; to be updated as pieces come out.
    """

    def __init__(self, model: Model, state: State, shaken: np.ndarray):
        self._state = state
        self.alive = state.solver.graph.alive.copy()
        graph, own = state.solver.graph, state.blasts
        poses, size = model.blueprint.poses[shaken], model.blueprint.size[shaken]
        momentum, mass = own.momentum[shaken], state.parts.mass[shaken]
        self._shaken = np.asarray(shaken, np.int64)
        self._bodies = (np.ascontiguousarray(poses[:, :3]),
                        rotation.to_matrix(poses[:, 3:]) * size[:, None, :], momentum,
                        0.5 * (momentum * momentum).sum(axis=1) / mass, own.pulse[shaken])
        self._topology = (graph.start, graph.incident, graph.first, graph.second, self.alive)
        self._inside = np.zeros(graph.count + 1, bool)
        self._wrench = state.solver.wrenches()

    def comes_out(self, rows: np.ndarray) -> bool:
        """
        Return whether a piece of wall is torn from its surroundings.

        The static force equivalent to a short pulse is the impulse times the angular frequency of
        the loaded member, at most twice the mean force of the pulse (Biggs 1964, Introduction to
        Structural Dynamics, 2.5); the frequency of a plate goes with its thickness over its span
        squared.

        A piece that is short for its thickness is sheared off all around; a plate of span a and
        thickness t bends, and arches between its surroundings. A square one carries 8·f·t² by
        yield lines and 0.72·f_c·t² by arching (EN 1996-1-1, 6.3.2; f_c is about 17 times f), over
        4·a·t·f in shear.

        Friction work is not counted: joints in a wall that is shaken as a whole are not compressed
        as before. With this the damage to houses is as published (decision 33).

        :param rows: of its parts among the shaken ones, (K,).
        """
        joints, strength = joints_of(self._state.solver.graph)
        return bool(_comes_out(rows, self._shaken, self._inside, self._bodies, self._topology,
                               self._wrench, joints, strength))


@kernel
def _comes_out(rows, shaken, inside, bodies, topology, wrench, joints, strength):
    places, edges, momentum, energy, pulse = bodies
    total = np.zeros(3)
    moved = 0.0
    for row in rows:
        moved += energy[row]
        for c in range(3):
            total[c] += momentum[row, c]
    size = np.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
    if size == 0.0:
        return False
    way = total / size
    force, work = _withstood(shaken[rows], inside, way, topology, wrench, joints, strength)
    if not moved > work:
        return False
    span = max(_middle_extent(places, edges, rows), _BRICK)
    thickness = _thickness(places, edges, rows, way)
    rate = WALL_RATE * thickness / _LEAF * (_STOREY / span) ** 2
    rate = min(rate, 2.0 / _quantile(np.sort(pulse[rows]), 0.5))
    return size * rate > min(_BENDING * thickness / span, 1.0) * force


@subroutine
def _withstood(parts, inside, way, topology, wrench, joints, strength):
    """Return force and work of fracture at which all bonds around some parts fail."""
    start, incident, first, second, alive = topology
    for part in parts:
        inside[part] = True
    force = work = 0.0
    for part in parts:
        for k in range(start[part], start[part + 1]):
            m = np.int64(incident[k])
            is_first = first[m] == part
            if not alive[m] or inside[second[m] if is_first else first[m]]:
                continue
            one = fails(m, 1.0 if is_first else -1.0, way, wrench[m], joints, strength)
            force += one[0]
            work += one[1]
    for part in parts:
        inside[part] = False
    return force, work


@subroutine
def _middle_extent(places, edges, rows):
    """Return the median of the three extents of some positions along the first's edges [m]."""
    extent, edge = np.empty(3), edges[rows[0]]
    for c in range(3):
        length = np.sqrt(edge[0, c] ** 2 + edge[1, c] ** 2 + edge[2, c] ** 2)
        low, high = np.inf, -np.inf
        for row in rows:
            place = (places[row, 0] * edge[0, c] + places[row, 1] * edge[1, c]
                     + places[row, 2] * edge[2, c]) / length
            low, high = min(low, place), max(high, place)
        extent[c] = high - low
    return extent.sum() - extent.min() - extent.max()


@subroutine
def _thickness(places, edges, rows, way):
    """Return the prevailing thickness of a piece of wall along a direction [m]."""
    depth, reach = np.empty(len(rows)), np.zeros(len(rows))
    for k in range(len(rows)):
        row = rows[k]
        depth[k] = (places[row, 0] * way[0] + places[row, 1] * way[1] + places[row, 2] * way[2])
        for c in range(3):
            reach[k] += abs(edges[row, 0, c] * way[0] + edges[row, 1, c] * way[1]
                            + edges[row, 2, c] * way[2])
    depth, reach = np.sort(depth), np.sort(reach)
    return _quantile(depth, 0.9) - _quantile(depth, 0.1) + _quantile(reach, 0.5)


@subroutine
def _quantile(ascending, share):
    """Return a quantile of sorted numbers, interpolated linearly."""
    place = share * (len(ascending) - 1)
    below = int(place)
    above = min(below + 1, len(ascending) - 1)
    return ascending[below] + (place - below) * (ascending[above] - ascending[below])


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
    state.blasts.single_left = model.settings.debris_bodies  # the fastest ones
    found = on_everything(model, state, point, charge, ground)
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
        alike = left[near] & (product(way[near], way[seed]) > ALIKE)
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
    own, graph, aim = state.blasts, state.solver.graph, model.settings.debris_bodies
    touching = graph.neighbours(parts)
    touching = touching[alive[touching]]
    surplus = _energy(state, parts) / np.maximum(_bond_work(graph, touching)[parts], 1e-9)
    cell = np.full(graph.count + 1, -1)
    single = np.argsort(-surplus, kind='stable')[:min(own.single_left, aim // 4)]
    single = single[surplus[single] > _SURPLUS]
    own.single_left -= len(single)
    clumped = np.delete(np.arange(len(parts)), single)
    if len(clumped):
        rng = np.random.default_rng([len(parts), int(parts[0])])
        size = max(_CLUMP, -(-2 * len(clumped) // aim))
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
