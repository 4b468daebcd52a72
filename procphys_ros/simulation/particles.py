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
Particles: leaves and dust in the air, and the outline of what stands, on which they come down.

The mass of a leaf that falls stays with its branch: leaves are about 3 % of the mass of a tree
and 7 % of that of the segments which carry them, while their share of the drag is most of it.
"""

from itertools import islice

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics import fracture_energy
from procphys_ros.physics.air import FOLIAGE_DRAG
from procphys_ros.physics.dust import DustCloud, lost_energy
from procphys_ros.physics.foliage import air_speeds, carried, Flutter
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.skyline import Skyline
from procphys_ros.physics.touch import piece_bounds
from procphys_ros.physics.world import BodyState
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_PATIENCE = 0.25  # [s] that an outline stays in use while a building collapses
_TURNS = 4  # steps between samples of the air for each flying leaf; it moves a metre meanwhile,
#             far less than the size of the eddies that carry it
_FLUTTER_SEED = 101  # separates random streams that share the scene's seed
_HARD = 1.0  # [m/s] slower contacts make no dust; resting bodies emit none
_FREE_LOSS = 0.02  # of its energy that a body may lose in a step without an impact
_LARGE = 0.5  # [m] radius of bodies whose contact points are looked up, which is expensive
_SPREAD = 0.3  # of a body's radius, around the point of impact
_JUMP = 0.5  # [m] displacement in a step, beyond twice its path, up to which a body is the same
_NOWHERE = np.zeros((0, 3)), np.zeros(0), np.zeros(0)


def current_skyline(model: Model, state: State) -> Skyline:
    """Return the present skyline; it is the same object while nothing has changed."""
    own = state.skyline
    if own.drawn is None or state.time > own.looked + _PATIENCE - 1e-9:
        own.looked = state.time
        standing = state.standing[:len(model.blueprint)]
        if own.drawn is None or not np.array_equal(standing, own.standing):
            own.standing, own.drawn = standing, _draw_skyline(model, np.flatnonzero(standing))
    return own.drawn


def _draw_skyline(model: Model, parts: np.ndarray) -> Skyline:
    source = model.blueprint
    return Skyline.over(piece_bounds(
        source.shape[parts].astype(np.uint8), source.poses[parts], source.solid_size(parts),
        np.zeros((len(parts), 6)), 0.0, 0.0), model.terrain)


def step_leaves(model: Model, state: State, dt: float) -> None:
    """
    Tear off leaves in strong wind, and move those in flight.

    Trees and flexible branches lose leaves; those of a rigid branch fall with it. Writes
    `state.leaves`, the leaf area of the forest and the drag areas of parts.
    """
    if model.settings.leaves.shedding and state.wind.moves and len(model.leaves.queue):
        _tear_off(model, state)
    if len(state.leaves.fallen):
        _fly(model, state, dt)


def make_flutter(model: Model) -> Flutter:
    """Draw the random flutter of each leaf about its petiole."""
    return Flutter(model.blueprint.leaves, (_FLUTTER_SEED << 64) + model.seed)


def leaf_poses(model: Model, state: State, flutter: Flutter | None) -> np.ndarray:
    """
    Compute the pose of every leaf: on its branch and fluttering, in the air or on the ground.

    :param flutter: from `make_flutter`; None = leaves do not flutter.
    :returns: petiole poses, z along the leaf, world, (L, 7); NaN on parts that are gone.
    """
    leaves = model.leaves
    frames = state.shown_poses()[leaves.carriers]
    local, moved = model.blueprint.leaves.pose, _petioles(model, state)
    if flutter is not None and len(local):
        exists = np.isfinite(frames).all(axis=1)
        air = np.zeros((len(frames), 3))
        air[exists] = state.wind.velocity(frames[exists, :3], state.time,
                                          threads=model.threads)
        air -= state.parts.velocities[leaves.carriers, :3]
        local = flutter.poses(leaves.carrier, frames, air, state.time, model.threads)
    if moved is not None:
        local = local.copy()
        local[:, :3] += moved
    out = carried(leaves.carrier, frames, local, model.threads)
    out[state.leaves.fallen.leaf] = state.leaves.fallen.poses
    return out


def _petioles(model: Model, state: State) -> np.ndarray | None:
    """Return how far leaves sit from where they will on grown segments [m], (L, 3); None = not."""
    if not len(state.growing.part):
        return None
    leaves, length = model.blueprint.leaves, state.parts.visual_size[:, 2]
    share = length[leaves.part] / model.blueprint.visual_size[leaves.part, 2]
    return (share - 1.0)[:, None] * leaves.pose[:, :3]


def _fly(model: Model, state: State, dt: float) -> None:
    own, below = state.leaves, current_skyline(model, state)
    if own.skyline is not below:
        own.skyline = below
        own.fallen.lift(below)
    flying = np.flatnonzero(own.fallen.flying)
    if len(flying):
        _sample_air(model, state, flying)
        own.fallen.step(flying, own.felt[flying], dt, below, model.threads)


def _sample_air(model: Model, state: State, flying: np.ndarray) -> None:
    """Sample the air at a share of the leaves, in turn, and at those just torn off."""
    own = state.leaves
    fresh = len(own.fallen) - len(own.felt)
    if fresh:
        own.felt = np.concatenate([own.felt, np.full((fresh, 3), np.nan)])
    own.turn = (own.turn + 1) % _TURNS
    due = flying[(flying % _TURNS == own.turn) | np.isnan(own.felt[flying, 0])]
    own.felt[due] = state.wind.velocity(own.fallen.poses[due, :3], state.time,
                                        threads=model.threads)


def _tear_off(model: Model, state: State) -> None:
    own, leaves, forest = state.leaves, model.leaves, state.forest
    air_speeds(state.trees.air, forest.velocities, forest.active, own.speed)
    torn = []
    rows = np.flatnonzero(own.speed > own.weakest)
    while len(rows):  # the weakest leaf of every row that loses any, then the next weakest
        torn.append(leaves.queue[own.next[rows]])
        own.next[rows] += 1
        own.weakest[rows] = leaves.queue_speed[own.next[rows]]
        rows = rows[own.speed[rows] > own.weakest[rows]]
    leaf = np.concatenate([np.zeros(0, np.intp), *torn])
    leaf = leaf[own.attached[leaf]]  # growth may have put a leaf in the place of a fallen one
    if len(leaf):
        _let_go(model, state, leaf)


def _let_go(model: Model, state: State, leaf: np.ndarray) -> None:
    own, leaves = state.leaves, model.blueprint.leaves
    part = leaves.part[leaf]
    own.attached[leaf] = False
    petiole, moved = leaves.pose[leaf], _petioles(model, state)
    if moved is not None:
        petiole[:, :3] += moved[leaf]
    own.fallen.let_go(leaf, rotation.compose(state.parts.poses[part], petiole),
                      state.parts.velocities[part, :3], leaves.size[leaf])
    np.subtract.at(own.left, part, model.leaves.area[leaf])
    np.subtract.at(state.parts.drag_area, part, FOLIAGE_DRAG * model.leaves.area[leaf])
    part = np.unique(part)
    share = np.clip(own.left[part] / model.blueprint.leaf_area[part], 0.0, 1.0)
    state.forest.keep_leaves(state.parts.row[part], share)


def watch_dust(model: Model, state: State, dt: float) -> None:
    """
    Emit dust where projectiles struck masonry, and record the free motion of bodies.

    Runs just before the engine's step; writes `state.dust`.
    """
    own = state.dust
    if own.cloud is None:
        return
    _from_projectiles(model, state, own.cloud)
    bodies, ids = state.world.bodies, state.world.awake
    free = bodies.velocities[ids]  # a copy
    free[:, :3] += state.world.gravity * dt
    fast = (free[:, :3] * free[:, :3]).sum(axis=1) > _HARD * _HARD
    own.watch = None
    if fast.any():
        poses, mass = bodies.poses[ids], bodies.mass[ids]
        energy = motion_energy(mass, bodies.inertia[ids], poses[:, 3:], free)
        spared = np.zeros(len(bodies.state) + 1, bool)
        spared[state.carrier[model.wooden]] = True  # the last row is for parts without a body
        own.watch = {'ids': ids, 'poses': poses, 'free': free, 'fast': fast, 'mass': mass,
                     'radius': bodies.radius[ids], 'energy': energy, 'spared': spared[ids]}


def drift_dust(model: Model, state: State, dt: float) -> None:
    """Move all dust; runs beside the engine's step, and writes `state.dust`."""
    own = state.dust
    if own.cloud is None:
        return
    if own.cloud.dusty:
        below = current_skyline(model, state)
        if own.skyline is not below:
            own.skyline = below
            own.cloud.lift(below)
    own.cloud.step(dt, lambda points: state.wind.velocity(points, state.time), own.skyline)


def step_dust(model: Model, state: State, dt: float) -> None:
    """Emit dust from the fractures and impacts of this step; writes `state.dust`."""
    own = state.dust
    if own.cloud is None:
        return
    _from_fractures(model, state, own.cloud)
    if own.watch is not None:
        own.cloud.raise_dust(*_spent(model, state, own.watch, dt))


def _from_projectiles(model: Model, state: State, cloud: DustCloud) -> None:
    """Emit dust where projectiles struck standing masonry."""
    own, ledger, bodies = state.dust, state.ledger, state.world.bodies
    fresh, own.struck = ledger.count - own.struck, ledger.count
    if not fresh:
        return
    velocity: dict[int, np.ndarray] = {}
    stony = np.ones(len(state.parts), bool)
    stony[model.wooden] = False
    # From the remaining speed back to that before the first blow.
    for blow in islice(reversed(ledger.recent), fresh):
        body = state.parts.body[blow.projectile]
        mass = bodies.mass[body]
        after = velocity.get(blow.projectile, bodies.velocities[body, :3])
        before = velocity[blow.projectile] = after + blow.lost / mass
        if stony[blow.parts].all():
            moved = state.parts.mass[blow.parts].sum()
            carried = product(blow.carried, blow.carried) / (2.0 * moved)
            lost = 0.5 * mass * (product(before, before) - product(after, after))
            energy = lost - carried - blow.work
            cloud.raise_dust(blow.point[None], np.zeros(1), np.array([max(energy, 0.0)]))


def _from_fractures(model: Model, state: State, cloud: DustCloud) -> None:
    """Emit dust from the mortar that broke since the last call."""
    own, source = state.dust, model.blueprint
    new, own.seen = state.log.total - own.seen, state.log.total
    if new <= 0:
        return
    events = state.log.recent(new)
    events = events[events['bond'] >= 0]
    events = events[model.mortar[events['bond']]]
    bond = events['bond']
    energy = fracture_energy.BY_CAUSE[events['cause']] * source.bond_area[bond]
    spread = 0.3 * source.bond_extent[bond].max(axis=1, initial=0.0)
    cloud.raise_dust(events['position'], spread, energy)


def _spent(model: Model, state: State, watch: dict[str, np.ndarray],
           dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Find where bodies dissipated energy since `watch`.

    Energy transferred to other bodies, or to the pieces of a broken one, is not dissipated.

    :returns: positions [m] (K, 3), radii around them [m] (K,) and energies [J] (K,).
    """
    bodies, ids, free = state.world.bodies, watch['ids'], watch['free']
    now, after, same = _present(model, state, watch, dt)
    lost = watch['energy'] - now
    hit = watch['fast'] & (lost > _FREE_LOSS * watch['energy']) & ~watch['spared']
    if not hit.any():
        return _NOWHERE
    others = state.world.awake
    others = others[~np.isin(others, ids[same])]
    gained = float(np.sum(motion_energy(bodies.mass[others], bodies.inertia[others],
                                        bodies.poses[others, 3:], bodies.velocities[others])))
    energy = lost_energy(watch['energy'], now, gained)[hit]
    kick = (after - free)[hit, :3]  # away from the obstacle
    kick /= np.maximum(norm(kick, axis=1, keepdims=True), 1e-9)
    radius = watch['radius'][hit]
    place = watch['poses'][hit, :3] - radius[:, None] * kick
    place[:, 2] = np.maximum(place[:, 2], model.terrain.height(place))
    return _at_contacts(state, ids[hit], place, radius, energy)


def _present(model: Model, state: State, watch: dict[str, np.ndarray],
             dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return present energies (W,) and velocities (W, 6), and which bodies are still the same, (W,).

    Energies and velocities of bodies that no longer exist are zero.
    """
    bodies, ids, mass, free = state.world.bodies, watch['ids'], watch['mass'], watch['free']
    poses, after = bodies.poses[ids], bodies.velocities[ids]
    way = norm(free[:, :3], axis=1) * dt
    shift = norm(poses[:, :3] - watch['poses'][:, :3], axis=1)
    doing = bodies.state[ids]
    same = (((doing == BodyState.AWAKE) | (doing == BodyState.RESTING))
            & (bodies.mass[ids] == mass) & (shift < 2.0 * way + _JUMP))
    lift = poses[:, :3] - watch['poses'][:, :3] - free[:, :3] * dt
    energy = (motion_energy(mass, bodies.inertia[ids], poses[:, 3:], after)
              - mass * product(lift, state.world.gravity))
    return np.where(same, energy, 0.0), np.where(same[:, None], after, 0.0), same


def _at_contacts(state: State, ids: np.ndarray, place: np.ndarray, radius: np.ndarray,
                 energy: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distribute the energy of large bodies over their contact points."""
    spread = _SPREAD * radius
    if radius.max() <= _LARGE:
        return place, spread, energy
    contacts = state.world.contacts()
    row = np.full(len(state.world.bodies.state) + 1, -1)
    row[ids[radius > _LARGE]] = np.flatnonzero(radius > _LARGE)
    side = row[np.concatenate([contacts.body_a, contacts.body_b])]
    push = np.tile(norm(contacts.impulse, axis=1), 2)
    point = np.flatnonzero((side >= 0) & (push > 0.0))
    side, push = side[point], push[point]
    total = np.bincount(side, push, minlength=len(ids))
    left = total == 0.0
    return (np.concatenate([place[left], np.tile(contacts.point, (2, 1))[point]]),
            np.concatenate([spread[left], np.full(len(point), _SPREAD * _LARGE)]),
            np.concatenate([energy[left], energy[side] * push / total[side]]))
