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
Charges in walls: they break the masonry around them and throw it, alone or in turn.

A drilled charge is as heavy as the masonry needs that it is to break, so a kilogramme of masonry
gets the same from all of them: at most v = √(2·_SHARE·_ENERGY·_SPECIFIC/ρ), 8.1 m/s for brick,
and half of that at the rim. The gas opens a wall towards its free faces, and what it breaks flies
that way, to both sides. All of this is an estimate, see decision 32.
"""

import numpy as np

from procphys_ros.blueprint import Blueprint, chain, Shape
from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import eigen, norm, product
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.loads import exposed_faces
from procphys_ros.physics.masonry import cells
from procphys_ros.scene.placement import FOOTING
from procphys_ros.scene.strikes import Demolition
from procphys_ros.simulation import breaking, glass, masonry, spawned_parts
from procphys_ros.simulation.breaking import Shards
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

HEAVY = 200.0       # [kg] heavier parts, such as slabs, are cut loose, but not thrown
_SPECIFIC = 0.5     # [kg/m³] of explosive per volume of masonry to be demolished (estimate)
_ENERGY = 4.2e6     # [J/kg] of TNT
_SHARE = 0.03       # converted into kinetic energy: 3 to 21 % in rock (Sanchidrián, Segarra
#                     and López 2007, Int. J. Rock Mech. Min. Sci. 44, 130), least in thin walls
_RIM = 0.5          # of the speed at the charge, at the farthest broken parts
_ASIDE = 0.35       # radial speed away from the charge over that out of the wall
_FREE = 0.25        # [m] before a face that is open to the gas
_NEAR = 0.5         # [m] around the broken parts, in which other parts may cover their faces
_MIDDLE = 0.03      # [m] from the charge along the way out, up to which both directions are equal
_FEWEST = 3         # pieces of a charge beyond that budget
_SOON = 1.0         # [s] within which other charges share the budget
_QUARTERS = 4       # pieces of a broken brick
_LONGEST = 0.5      # [m] longer parts do not break into quarters
_LOAD = 1.0         # over strength, of the bonds that charges break
_BAND = (0.3, 2.0)  # [m] above the foot of a building, where charges are drilled
_SPACING = 1.1     # [m] between charges of the default plan, at least
_MARGIN = 1.1      # reach of a charge over the distance to its last brick, ...
_BEYOND = 0.02     # [m] ... and more
_SPREAD = 1.2      # [s] from the first charge, in the middle, to the last, at the corners


def fire(model: Model, state: State, place: np.ndarray, radius: float) -> None:
    """
    Break and throw the masonry within reach of a charge; all parts are kept.

    Writes bonds, parts and bodies, loads of the surrounding masonry, and the ledger.

    :param place: of the charge, world [m], (3,).
    :param radius: of broken masonry [m].
    """
    source, standing = model.blueprint, state.standing[:len(model.blueprint)]
    away = source.poses[:, :3] - place
    distance = norm(away, axis=1)
    hit = np.flatnonzero(standing & (distance < radius) & (source.shape == Shape.BOX))
    pane = model.glass.is_pane[hit]
    light = hit[~pane & (source.mass[hit] < HEAVY)]
    light = light[np.argsort(distance[light], kind='stable')]  # the nearest first
    speed = speed_of(source, light)
    _burst_panes(model, state, hit[pane], away, speed)
    hit = hit[~pane]
    if len(hit):
        around = state.solver.graph.boundary(hit)
        thrown = _throw(model, state, light, hit[source.mass[hit] >= HEAVY], place, radius)
        masonry.apply_impulse_around(state, around, hit, -thrown, speed)


def speed_of(source: Blueprint, parts: np.ndarray) -> float:
    """Return the largest speed at which a charge throws parts, (K,) [m/s]; 0 for none."""
    mass = float(source.mass[parts].sum())
    volume = float((source.mass[parts] / source.density[parts]).sum())
    return float(np.sqrt(2.0 * _SHARE * _ENERGY * _SPECIFIC * volume / mass)) if mass else 0.0


def _throw(model: Model, state: State, light: np.ndarray, heavy: np.ndarray, place: np.ndarray,
           radius: float) -> np.ndarray:
    """
    Break parts out of standing masonry, and throw them.

    :param light: parts to throw, the nearest first, (L,); heavy: parts to cut loose, (H,).
    :returns: the momentum of the thrown parts [N·s], (3,).
    """
    source, free, room = model.blueprint, _free_faces(model, state, light), _room(model, state)
    broken = np.zeros(len(light), bool)
    small = np.flatnonzero(_breakable(source, light))
    broken[small[:max(room - len(light), 0) // (_QUARTERS - 1)]] = True
    made = [_quarter(model, part) for part in light[broken].tolist()]
    whole = np.flatnonzero(~broken)
    lump, count = _lumps(state, light[whole], room)
    mass = np.bincount(lump, source.mass[light[whole]], count)
    middle = np.column_stack([np.bincount(lump, source.mass[light[whole]] * x, count) / mass
                              for x in source.poses[light[whole], :3].T])
    faces = np.zeros((count, 3, 3))
    np.add.at(faces, lump, free[whole])
    away = np.concatenate([middle, *(pieces.poses[:, :3] for pieces in made)]) - place
    fall = (1.0 - _RIM) * np.minimum(norm(away, axis=1) / radius, 1.0)
    speed = speed_of(source, light) * (1.0 - fall)
    weight = speed * np.concatenate([mass, *(pieces.mass for pieces in made)])
    ways = _ways(away, np.concatenate([faces, np.repeat(free[broken], _QUARTERS, axis=0)]),
                 weight)
    velocities = speed[:, None] * ways
    _release_lumps(model, state, light[whole], lump, velocities[:count], heavy)
    if made:
        torn, moving = light[broken], np.zeros((_QUARTERS * len(made), 6))
        moving[:, :3] = velocities[count:]
        breaking.shatter(model, state, [Shards(
            torn, np.full(len(torn), _LOAD), [(f'fragments_{torn[0]}', chain(made))], moving)],
            Cause.DEMOLITION)
    state.ledger.throw(product(weight, ways), 0.5 * float(product(weight, speed)))
    return product(weight, ways)


def _release_lumps(model: Model, state: State, parts: np.ndarray, lump: np.ndarray,
                   velocities: np.ndarray, heavy: np.ndarray) -> None:
    """Throw lumps with velocities (C, 3), and drop the heavy parts."""
    count = len(velocities)
    parts = np.concatenate([parts, heavy])
    lump = np.concatenate([lump, count + np.arange(len(heavy))])
    breaking.cut_out(model, state, parts, Cause.DEMOLITION, _LOAD, lump)
    order = np.argsort(lump, kind='stable')
    pieces = np.split(parts[order], np.cumsum(np.bincount(lump))[:-1]) if len(parts) else []
    moving = np.zeros((len(parts), 6))
    moving[:, :3] = np.concatenate([velocities, np.zeros((len(heavy), 3))])[lump[order]]
    breaking.release(model, state, pieces, moving)


def _burst_panes(model: Model, state: State, panes: np.ndarray, away: np.ndarray,
                 speed: float) -> None:
    """Throw the shards of panes within reach away from the charge."""
    way = away[panes] / np.maximum(norm(away[panes], axis=1, keepdims=True), 1e-9)
    glass.shatter_standing(model, state, [
        (glass.crack(model, pane, count=len(panes)), speed * out, _LOAD)
        for pane, out in zip(panes.tolist(), way)], Cause.DEMOLITION)


def _room(model: Model, state: State) -> int:
    """Estimate the number of pieces into which a charge may break the masonry in its reach."""
    soon = sum(moment < state.time + _SOON for moment, _, _ in state.charges)
    room = model.settings.debris_bodies - len(state.world.awake)
    return max(room // (soon + 1), _FEWEST)


def _breakable(source: Blueprint, parts: np.ndarray) -> np.ndarray:
    """Mark the parts that break into quarters, (K,) bool."""
    return (source.size[parts].max(axis=1, initial=0.0) < _LONGEST) & ~np.isin(
        parts, source.hexahedra.part)


def _quarter(model: Model, part: int) -> Blueprint:
    source = model.blueprint
    return spawned_parts.shards(
        source.size[part], float(source.density[part]), source.poses[part],
        source.textures[source.texture[part]], source.materials[source.material[part]], 0,
        np.random.default_rng([model.seed, part]), kind='fragment')


def _lumps(state: State, parts: np.ndarray, wanted: int) -> tuple[np.ndarray, int]:
    """Divide parts into about `wanted` connected lumps: the lump of each, and their number."""
    if wanted >= len(parts):
        return np.arange(len(parts)), len(parts)
    graph = state.solver.graph
    _, a, b = cells.inside(parts, graph.start, graph.incident, graph.alive, graph.first,
                           graph.second, np.full(graph.count + 1, -1, np.int32))
    rank = np.random.default_rng(len(parts)).permutation(len(parts))
    return cells.grow(len(parts), a, b, rank, wanted)


def _free_faces(model: Model, state: State, parts: np.ndarray) -> np.ndarray:
    """Sum up area times n·nᵀ of the unobstructed faces of parts, (K, 3, 3) [m²]."""
    shell, source = model.masonry, model.blueprint
    middle = source.poses[parts, :3]
    low, high = middle.min(axis=0, initial=np.inf), middle.max(axis=0, initial=-np.inf)
    reach = 0.5 * norm(source.size, axis=1, keepdims=True) + _NEAR
    near = (source.poses[:, :3] > low - reach) & (source.poses[:, :3] < high + reach)
    near = np.flatnonzero(near.all(axis=1) & state.standing[:len(source)]
                          & (source.shape == Shape.BOX))
    poses, sizes = shell.face_poses[near], shell.face_sizes[near]
    row = np.searchsorted(near, parts)
    open_to = exposed_faces(poses, sizes, reach=_FREE, terrain=model.terrain)[row]
    extent = sizes[row]
    area = extent.prod(axis=1, keepdims=True) / extent * open_to.reshape(-1, 3, 2).sum(axis=2)
    axes = rotation.to_matrix(poses[row, 3:])
    return np.einsum('kia,ka,kja->kij', axes, area, axes)


def _ways(away: np.ndarray, faces: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """
    Choose the directions of flight: out of the wall, and a little away from the charge.

    Parts in the middle of a wall go to the side with less momentum so far.

    :param away: from the charge to each [m], (P, 3).
    :param faces: see `_free_faces`, (P, 3, 3).
    :param weight: momentum of each [N·s], (P,).
    :returns: unit vectors, (P, 3).
    """
    area, normal = eigen(faces)
    normal = normal[:, :, 2] * (area[:, 2] > 1e-9)[:, None]
    out = np.einsum('pi,pi->p', away, normal)
    radial = away / np.maximum(norm(away, axis=1, keepdims=True), 1e-9)
    radial[~radial.any(axis=1)] = [0.0, 0.0, 1.0]
    both = np.stack([side * normal + _ASIDE * radial for side in (1.0, -1.0)])
    both /= np.maximum(norm(both, axis=2, keepdims=True), 1e-9)
    ways = np.where((out >= 0.0)[:, None], both[0], both[1])
    either = np.abs(out) < _MIDDLE
    total = product(weight[~either], ways[~either])
    for row in np.flatnonzero(either).tolist():
        sums = total + weight[row] * both[:, row]
        side = int(np.argmin(norm(sums, axis=1)))
        ways[row], total = both[side, row], sums[side]
    return ways


def arm(model: Model, state: State, plan: Demolition) -> int:
    """
    Schedule the charges of a plan.

    :param plan: if it is empty, charges are laid along the ground-floor walls.
    :returns: number of charges.
    :raises CommandError: if no building stands.
    """
    if not state.standing.any():
        raise CommandError('there is no building left to demolish')
    plan = plan if len(plan) else implosion(model, state)
    for delay, place, radius in zip(plan.delays, plan.places, plan.radii):
        state.charges.append((state.time + float(delay), place, float(radius)))
    state.charges.sort(key=lambda charge: charge[0])
    return len(plan)


def step(model: Model, state: State, dt: float) -> None:
    """Fire the charges due within the step; breaks and releases, see `charges`."""
    while state.charges and state.charges[0][0] < state.time + dt:
        _, place, radius = state.charges.pop(0)
        fire(model, state, place, radius)


def implosion(model: Model, state: State) -> Demolition:
    """
    Lay charges along the walls of all ground floors, to be fired from the middle out.

    :raises CommandError: if no wall stands at the height of the charges.
    """
    source, standing = model.blueprint, state.standing[:len(model.blueprint)]
    low = source.poses[:, 2] - 0.5 * source.size[:, 2]
    graph = state.solver.graph
    on_ground = np.zeros(len(source) + 1, bool)
    for ends in (graph.first, graph.second):
        on_ground[ends[graph.grounded()]] = True
    foot = float(np.min(low[on_ground[:-1] & standing], initial=0.0))
    height = source.poses[:, 2] - foot
    if not model.terrain.is_flat:
        height = source.poses[:, 2] - _feet(model, low)
    chosen = np.flatnonzero(standing & (source.shape == Shape.BOX) & (height > _BAND[0])
                            & (height < _BAND[1]) & (source.mass < HEAVY))
    if not len(chosen):
        raise CommandError('no wall stands between 0.3 and 2 m above the ground; give '
                           'demolition.positions')
    points = source.poses[chosen, :3]
    place = cells.nearest(points, points[cells.spread(points, _SPACING)])
    count = np.bincount(place)
    middles = np.column_stack([np.bincount(place, column) / count for column in points.T])
    away = norm(middles[:, :2] - middles[:, :2].mean(axis=0), axis=1)
    delays = _SPREAD * away / max(float(np.max(away)), 1e-9)
    reach = np.zeros(len(middles))  # such that no pier is left between two charges
    np.maximum.at(reach, place,
                  norm(points - middles[place], axis=1))
    return Demolition(delays.tolist(), middles.ravel().tolist(),
                      (_MARGIN * reach + _BEYOND).tolist())


def _feet(model: Model, low: np.ndarray) -> np.ndarray:
    """Return the foot of the building that each part belongs to, above its footings [m], (N,)."""
    source = model.blueprint
    footing = np.array([kind == FOOTING for kind in source.kinds])[source.kind]
    height = np.where(footing, np.inf, low)
    feet = [height[thing.first:][:thing.count].min(initial=np.inf) for thing in model.objects]
    return np.repeat(feet, [thing.count for thing in model.objects])
