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


"""Explosions: what their waves do to all that stands and lies about, as they come to it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.physics.loads import air_blast, blast_boxes, blast_capsules, Impulses, Sight
from procphys_ros.physics.masonry.capacity import FRACTURE_ENERGY_SHEAR
from procphys_ros.physics.world import World
from procphys_ros.scene.strikes import Explosion
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.standing.blows import Blows, WALL_RATE
from procphys_ros.simulation.strikes.panes import Panes
from procphys_ros.simulation.trees.grove import Grove

_LEAST = 1e-3        # [m/s] a wave that gives a body less than this has passed it by
_STOREY = 2.7        # [m] height of the wall whose rate is `blows.WALL_RATE`
_BRICK = 0.225       # [m] smallest piece of wall that comes out as one
_GLASS_RATE = 125.0  # [1/s] angular frequency of a window pane, 2π over 50 ms
_AFTERMATH = 0.3     # [s] after which what falls out of a wall owes nothing to the blast
_PATCHES = (3.0, 2.4, 1.9, 1.5, 1.2, 0.9, 0.6, 0.3)  # [m] radii of pieces of wall, tried in turn
_MOST_PATCHES = 60   # in one step
_SURPLUS = 4.0       # energy over the work of its bonds that makes a brick fly on its own
_MOST_SINGLE = 250   # such bricks per explosion, the fastest; more could not be simulated in time
_CLUMP = 12          # parts to a piece of what comes out but does not fly singly


@dataclass
class _Wave:
    """A wave on its way: what it gives to which parts, sorted by arrival."""

    parts: np.ndarray
    linear: np.ndarray
    angular: np.ndarray
    arrival: np.ndarray
    pulse: np.ndarray
    done: int = 0


class Blasts:
    """
    Carries out explosions.

    :param blueprint: all parts and bonds of the scene.
    :param grove: trees that stand.
    :param blows: on masonry.
    :param panes: of glass.

    :ivar momentum: that waves gave to standing parts lately [N·s], world, (N, 3).
    """

    def __init__(self, blueprint: Blueprint, grove: Grove, blows: Blows, panes: Panes):
        self._blueprint = blueprint
        self._grove = grove
        self._blows = blows
        self._panes = panes

    def begin(self, world: World, debris: Debris) -> None:
        """Start anew in a world that has just been built."""
        self._world = world
        self._debris = debris
        self._waves: list[_Wave] = []
        self._passed = -np.inf
        self._single_left = 0
        self.momentum = np.zeros((len(self._blueprint), 3))
        self._pulse = np.full(len(self._blueprint), np.inf)

    @property
    def under_way(self) -> int:
        """Count the waves that have not reached everything."""
        return len(self._waves)

    def explode(self, explosion: Explosion, blueprint: Blueprint, poses: np.ndarray,
                time: float) -> None:
        """
        Set a charge off; its wave arrives in this and the next steps.

        :param explosion: where and how much.
        :param blueprint: all parts there are by now.
        :param poses: of them, (N, 7), world; parts that are not finite do not exist.
        :param time: [s].
        """
        there = np.isfinite(poses[:, 0])
        boxes = np.flatnonzero(there & (blueprint.shape == Shape.BOX))
        rods = np.flatnonzero(there & (blueprint.shape == Shape.CAPSULE))
        point, charge = explosion.position, explosion.charge
        self._single_left = _MOST_SINGLE
        sight = Sight(poses[boxes], blueprint.size[boxes]) if len(boxes) else None
        found: list[tuple[np.ndarray, Impulses]] = []
        if sight is not None:
            found.append((boxes, blast_boxes(point, charge, poses[boxes], blueprint.size[boxes],
                                             sight=sight)))
        if len(rods):
            found.append((rods, blast_capsules(point, charge, poses[rods], blueprint.size[rods],
                                               sight=sight)))
        if not found:
            return
        parts, linear, angular, arrival = (np.concatenate(column) for column in zip(*(
            (rows, gift.linear, gift.angular, gift.arrival) for rows, gift in found)))
        speed = np.linalg.norm(linear, axis=1) / blueprint.mass[parts]
        felt = np.flatnonzero(speed > _LEAST)
        felt = felt[np.argsort(arrival[felt], kind='stable')]
        scale = air_blast.effective_charge(charge, float(point[2])) ** (1.0 / 3.0)
        away = np.linalg.norm(poses[parts[felt], :3] - np.asarray(point, float), axis=1)
        self._waves.append(_Wave(parts[felt], linear[felt], angular[felt], arrival[felt] + time,
                                 scale * air_blast.duration(away / scale)))

    def advance(self, poses: np.ndarray, time: float, time_step: float) -> None:
        """
        Deliver what arrives within the next step.

        :param poses: of all parts, (N, 7), world.
        :param time: [s].
        :param time_step: [s].
        """
        if self._passed < time - _AFTERMATH:
            self.momentum[:] = 0.0
            self._passed = np.inf
        for wave in self._waves:
            end = int(np.searchsorted(wave.arrival, time + time_step))
            if end > wave.done:
                rows = np.arange(wave.done, end)
                wave.done = end
                self._deliver(wave, rows, poses, time)
                self._passed = time
        self._waves = [w for w in self._waves if w.done < len(w.parts)]

    def kick(self, pieces: list[np.ndarray], velocities: np.ndarray) -> None:
        """
        Give what has just lost the ground the velocity that a wave gave it.

        :param pieces: parts of each.
        :param velocities: of all parts, (N, 6), written in place.
        """
        for parts in pieces:
            own = self.momentum[parts]
            if own.any():
                velocities[parts, :3] += own / self._blueprint.mass[parts][:, None]
                self.momentum[parts] = 0.0

    def _deliver(self, wave: _Wave, rows: np.ndarray, poses: np.ndarray,
                 time: float) -> None:
        parts = wave.parts[rows]
        known = parts < len(self._blueprint)
        stands = np.zeros(len(parts), bool)
        stands[known] = self._blows.buildings.standing[parts[known]]
        for row in rows[~stands].tolist():
            part = int(wave.parts[row])
            if self._grove.holds(part):
                self._grove.forest.apply_impulse(int(self._grove.row_of_part[part]), None,
                                                 wave.linear[row], wave.angular[row])
        self._push_loose(wave, rows[~stands], poses)
        if stands.any():
            self._shake(wave, rows[stands], time)

    def _push_loose(self, wave: _Wave, rows: np.ndarray, poses: np.ndarray) -> None:
        """Add up what parts of the same body get, about its centre of mass."""
        carrier = self._debris.carrier[wave.parts[rows]]
        rows, carrier = rows[carrier >= 0], carrier[carrier >= 0]
        bodies, place = np.unique(carrier, return_inverse=True)
        total = np.zeros((len(bodies), 6))
        arm = poses[wave.parts[rows], :3] - self._world.bodies.poses[carrier, :3]
        np.add.at(total[:, :3], place, wave.linear[rows])
        np.add.at(total[:, 3:], place, wave.angular[rows] + np.cross(arm, wave.linear[rows]))
        for body, impulse in zip(bodies.tolist(), total):
            self._world.apply_impulse(body, impulse[:3], angular=impulse[3:])

    def _shake(self, wave: _Wave, rows: np.ndarray, time: float) -> None:
        """Let standing parts feel a wave: panes burst, pieces come loose, the rest bends."""
        parts = wave.parts[rows]
        self.momentum[parts] += wave.linear[rows]
        self._pulse[parts] = wave.pulse[rows]
        self._burst(parts[self._panes.are(parts)], time)
        standing = self._blows.buildings.standing
        shaken = self._loosest(np.flatnonzero(standing & self.momentum.any(axis=1)))
        loose = self._tear_patches(shaken, time)
        holds = np.setdiff1d(parts[standing[parts]], loose)
        rate = np.minimum(2.0 / self._pulse[holds], WALL_RATE)[:, None]
        if len(holds):
            self._blows.press(holds, self.momentum[holds] * rate / WALL_RATE)

    def _burst(self, panes: np.ndarray, time: float) -> None:
        """Break the panes that the wave overloads."""
        if not len(panes):
            return
        size = np.sort(self._blueprint.size[panes], axis=1)
        rate = np.minimum(2.0 / self._pulse[panes], _GLASS_RATE)
        pressure = np.linalg.norm(self.momentum[panes], axis=1) * rate / size[:, 1:].prod(axis=1)
        load = pressure / self._panes.pressure(panes)
        breaks = np.flatnonzero(load > 1.0)
        for i in breaks:
            part = int(panes[i])
            pane = self._panes.crack(part, count=len(breaks))
            self._panes.shatter(pane, self.momentum[part] / self._blueprint.mass[part],
                                float(load[i]), time, Cause.BLAST)

    def _own_work(self) -> np.ndarray:
        """Give the work of fracture of each part's share of its living bonds [J], (N,)."""
        graph = self._blows.buildings.graph
        work = 0.5 * FRACTURE_ENERGY_SHEAR * graph.area * graph.alive
        return (np.bincount(graph.first, work, graph.count + 1)
                + np.bincount(graph.second, work, graph.count + 1))[:-1]

    def _energy(self, parts: np.ndarray) -> np.ndarray:
        """Give what parts would move with if nothing held them [J], (K,)."""
        return 0.5 * (self.momentum[parts] ** 2).sum(axis=1) / self._blueprint.mass[parts]

    def _loosest(self, parts: np.ndarray) -> np.ndarray:
        """Choose parts that got the energy to break away from their neighbours."""
        return parts[self._energy(parts) > self._own_work()[parts]]

    def _tear_patches(self, shaken: np.ndarray, time: float) -> np.ndarray:
        """
        Tear round patches out of walls, each as large as the wave can.

        :param shaken: parts with the energy to break away, (K,).
        :param time: [s].
        :returns: parts that came loose.
        """
        loose: list[np.ndarray] = [np.zeros(0, np.intp)]
        if not len(shaken):
            return loose[0]
        places = self._blueprint.poses[shaken, :3]
        tree, left = cKDTree(places), np.ones(len(shaken), bool)
        energy = self._energy(shaken)
        for _ in range(_MOST_PATCHES):
            if not left.any():
                break
            seed = int(np.argmax(np.where(left, energy, -1.0)))
            for radius in _PATCHES:
                near = np.array(tree.query_ball_point(places[seed], radius))
                patch = np.sort(near[left[near]])
                if self._comes_out(shaken[patch]):
                    self._loosen(shaken[patch], time)
                    loose.append(shaken[patch])
                    break
            left[patch] = False
        return np.concatenate(loose)

    def _comes_out(self, parts: np.ndarray) -> bool:
        """
        Say whether a piece of wall is torn from what surrounds it.

        The steady force of the same effect as a short pulse is the impulse times the angular
        frequency of what it hits, at most twice the mean force of the pulse (Biggs 1964,
        Introduction to Structural Dynamics, 2.5); that of a plate goes with its span squared.
        """
        momentum = self.momentum[parts].sum(axis=0)
        size = float(np.linalg.norm(momentum))
        if size == 0.0:
            return False
        resistance = self._blows.resistance(parts, momentum / size)
        extent = np.sort(np.ptp(self._blueprint.poses[parts, :3], axis=0))
        rate = WALL_RATE * (_STOREY / max(float(extent[1]), _BRICK)) ** 2
        rate = min(rate, 2.0 / float(np.median(self._pulse[parts])))
        energy = float(self._energy(parts).sum())
        return size * rate > resistance.force and energy > resistance.energy

    def _loosen(self, parts: np.ndarray, time: float) -> None:
        """Cut a piece of wall out, and into what flies singly and clumps."""
        graph, solver = self._blows.buildings.graph, self._blows.buildings.solver
        surplus = self._energy(parts) / np.maximum(self._own_work()[parts], 1e-9)
        cell = np.full(graph.count + 1, -1)
        single = np.argsort(-surplus, kind='stable')[:min(self._single_left, _MOST_SINGLE // 4)]
        single = single[surplus[single] > _SURPLUS]
        self._single_left -= len(single)
        clumped = np.delete(np.arange(len(parts)), single)
        if len(clumped):
            rng = np.random.default_rng([len(parts), int(parts[0])])
            seeds = rng.choice(clumped, -(-len(clumped) // _CLUMP), replace=False)
            places = self._blueprint.poses[parts, :3]
            cell[parts[clumped]] = cKDTree(places[seeds]).query(places[clumped])[1]
        cell[parts[single]] = len(parts) + np.arange(len(single))
        touching = graph.neighbours(parts)
        touching = touching[graph.alive[touching]]
        cut = touching[cell[graph.first[touching]] != cell[graph.second[touching]]]
        kept = np.maximum(1.0 - 1.0 / np.maximum(surplus, 1.0), 0.0)
        self.momentum[parts] *= np.sqrt(kept)[:, None]
        solver.cut(cut)
        rows = graph.rows[cut]
        self._blows.log.record(time, self._blueprint.bond_frame[rows, :3], rows,
                               self._blueprint.bonds[rows], Cause.BLAST,
                               np.full(len(rows), float(np.median(surplus))))
