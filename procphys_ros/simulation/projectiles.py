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


"""Projectiles: sweep fast bodies against standing parts before each step."""

import math

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, norm, product
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import ALIKE, contact_time
from procphys_ros.physics.loads import (
    Hits,
    sweep_box_boxes,
    sweep_box_capsules,
    sweep_boxes,
    sweep_capsules,
)
from procphys_ros.physics.world import BodyState
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import fragments, glass, masonry, spawned_parts
from procphys_ros.simulation.ledger import Impact
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import Missile, State

RESTITUTION = 0.25   # of hard bodies on masonry and wood that hold
_FRICTION = 0.6      # stone on brick, EN 1996-1-1 3.6.2 gives 0.4 for design, means lie higher
_ROLLING = 2.0 / 7.0  # share of its tangential momentum that a ball loses until it rolls
_SLOW = 0.3          # [m/s] closing speed below which the world's contacts handle the touch
_DENT = 0.015        # [m] parts touched within this depth are struck together
_FLAT = 0.9998       # cosine of 1°: least one between normals of faces that meet flat
_FLUSH = 1e-5        # [m] depth within which touches determine the normal of the wall
_MOST_HITS = 150     # in one step
_SHARES = (0.7,) * 7 + (0.0,)  # shares of a blow kept, in turn, while it would create energy
_MOST_FLYING = 200   # projectiles since the last reset
_BALL_DRAG = 0.47 * 0.25 * np.pi  # Cd·A over diameter squared of a sphere (Hoerner 1965, 3-8)


def launch(model: Model, state: State, projectile: Projectile) -> int:
    """
    Launch a projectile.

    :returns: its part.
    :raises CommandError: if there are too many, or it would start inside an obstacle.
    """
    number = len(state.missiles)
    if number >= _MOST_FLYING:
        raise CommandError(f'{_MOST_FLYING} projectiles have been launched, no more are '
                           'allowed until the simulation is reset')
    made = spawned_parts.projectile_part(projectile)
    ball, size = projectile.shape == 'sphere', projectile.edges
    ground = float(model.terrain.height(made.poses)[0])
    if made.poses[0, 2] < ground + 0.5 * size[2]:
        raise CommandError(f'projectile.position is {list(projectile.position)}: it reaches '
                           f'{ground + 0.5 * size[2] - made.poses[0, 2]:.3g} m into the ground, '
                           f'which is {ground:.2f} m high there')
    probe = Missile(-1, -1, ball, size, 0.0)
    wall, tree = _ahead(model, state, probe, made.poses[0], np.zeros(3))
    inside = (int(wall.index[0]) if len(wall)
              else int(state.forest.parts[tree.index[0]]) if len(tree) else -1)
    if inside >= 0:
        raise CommandError(f'projectile.position is {list(projectile.position)}: it touches '
                           f'{state.names.name(inside)} from the start')
    part = state.append(model, [(made, f'projectile_{number}')])[0]
    velocity = np.concatenate([np.asarray(projectile.velocity, float), np.zeros(3)])
    body = state.world.add_projectile(int(made.shape[0]), size, float(projectile.mass),
                                      made.poses[0], velocity, restitution=RESTITUTION)
    fragments.adopt(state, np.array([part]), np.array([body]))
    state.parts.velocities[part] = velocity
    if ball:
        state.bodies.drag_area[body] = _BALL_DRAG * np.square(float(size[0]))
    state.missiles.append(Missile(part, body, ball, size, float(projectile.mass)))
    return part


def step(model: Model, state: State, dt: float) -> None:
    """
    Find and apply the hits of projectiles on standing parts within the next step.

    Blows act at the point of contact without turning the projectile: its spin changes only by
    the world's contacts. Writes bodies of projectiles, trees that are hit, loads and the ledger;
    releases.
    """
    bodies = state.world.bodies
    for missile in state.missiles:
        if state.parts.owner[missile.part] != Owner.BODY:
            continue
        speed = norm(bodies.velocities[missile.body, :3])
        if bodies.state[missile.body] == BodyState.AWAKE and speed > _SLOW:
            _fly(model, state, missile, dt)


def _fly(model: Model, state: State, missile: Missile, dt: float) -> None:
    body = np.array([missile.body])
    pose = state.world.bodies.poses[missile.body].copy()
    velocity = state.world.bodies.velocities[missile.body].copy()
    left, thrown_back, has_struck = dt, dt, False  # time left, then and when it last bounced
    passed: set[int] = set()
    for _ in range(_MOST_HITS):
        way = velocity[:3] * left
        found = _next_hit(model, state, missile, pose, way, velocity[:3], passed)
        if found is None:
            break
        hits, is_tree = found
        _move(pose, velocity, hits.fraction[0] * left, state.world.gravity)
        left *= 1.0 - hits.fraction[0]
        before = velocity[:3].copy()
        if is_tree:
            passed.add(int(hits.index[0]))
            _hit_tree(state, missile, hits, velocity, dt)
            goes_on = product(before, velocity[:3]) > 0.0
        else:
            goes_on = _hit_wall(model, state, missile, hits, way, pose, velocity)
        thrown_back = thrown_back if goes_on else left
        has_struck = True
    if has_struck:
        # The engine makes a whole step: move the start back along the path, as far as it is free.
        _move(pose, velocity, left - thrown_back, state.world.gravity)
        missile.ahead = dt - thrown_back
        state.world.set_poses(body, pose[None])
        state.world.set_velocities(body, velocity[None])


def take_back(model: Model, state: State, dt: float) -> None:
    """Move bounced projectiles back to their place at the end of the step, unless they touch."""
    bodies = state.world.bodies
    bounced = [m for m in state.missiles if m.ahead and state.parts.owner[m.part] == Owner.BODY]
    if not bounced:
        return
    contacts = state.world.contacts()
    touches = np.concatenate([contacts.body_a, contacts.body_b])
    for missile in bounced:
        ahead, missile.ahead = missile.ahead, 0.0
        if missile.body in touches:
            continue
        pose, velocity = bodies.poses[missile.body].copy(), bodies.velocities[missile.body].copy()
        _move(pose, velocity, -ahead, state.world.gravity)
        state.world.set_poses(np.array([missile.body]), pose[None])
        state.world.set_velocities(np.array([missile.body]), velocity[None])


def _move(pose: np.ndarray, velocity: np.ndarray, duration: float, gravity: np.ndarray) -> None:
    """Move straight ahead, or back, with the energy of free flight under gravity, (3,)."""
    pose[:3] += duration * velocity[:3]
    for c in np.flatnonzero(gravity).tolist():
        square = velocity[c] * velocity[c] + 2.0 * gravity[c] * duration * velocity[c]
        velocity[c] = np.copysign(np.sqrt(max(square, 0.0)), velocity[c])


def _ahead(model: Model, state: State, missile: Missile, pose: np.ndarray,
           way: np.ndarray) -> tuple[Hits, Hits]:
    """Sweep over standing masonry, and over standing trees."""
    forest, end = state.forest, pose[:3] + way
    wall = (model.blueprint.poses, model.masonry.closed_sizes,
            state.standing[:len(model.blueprint)])
    trees = (forest.poses, state.trees.sizes, forest.active)
    if missile.ball:
        radius = 0.5 * float(missile.size[0])
        return (sweep_boxes(pose[:3], end, radius, *wall),
                sweep_capsules(pose[:3], end, radius, *trees))
    return (sweep_box_boxes(pose[:3], end, pose[3:], missile.size, *wall),
            sweep_box_capsules(pose[:3], end, pose[3:], missile.size, *trees))


def _next_hit(model: Model, state: State, missile: Missile, pose: np.ndarray, way: np.ndarray,
              velocity: np.ndarray, passed: set[int]) -> tuple[Hits, bool] | None:
    """Find the next blow on a path: its touches, and whether it is on a tree."""
    wall, tree = _ahead(model, state, missile, pose, way)
    wall = _take(wall, product(wall.normal, velocity) < -_SLOW)
    if len(tree):
        forest = state.forest
        moving = forest.velocities[tree.index]
        arm = tree.point - forest.poses[tree.index, :3]
        slip = velocity - moving[:, :3] - cross(moving[:, 3:], arm)
        closes = np.einsum('ki,ki->k', tree.normal, slip) < -_SLOW
        fresh = ~np.isin(tree.index, list(passed))
        tree = _take(tree, closes & fresh)
    if len(tree) and (not len(wall) or tree.fraction[0] <= wall.fraction[0]):
        return _take(tree, np.arange(1)), True
    if not len(wall):
        return None
    depth = _depth(wall, way)
    together = (depth < _DENT) & (product(wall.normal, wall.normal[0]) > ALIKE)
    panes = model.glass.is_pane[wall.index]
    return _take(wall, together & (panes == panes[0])), False


def _hit_tree(state: State, missile: Missile, hits: Hits, velocity: np.ndarray,
              dt: float) -> None:
    """
    Reflect the projectile at the position of the branch at the end of the step.

    A joint that an impulse moves off its limit responds differently than before: where that would
    create energy (see `contact.too_much`), the blow is weaker.
    """
    forest, row = state.forest, hits.index[:1]
    point, normal = hits.point[0], hits.normal[0]
    air = None if state.trees.still else state.trees.air
    look = forest.predict_response(row, point[None], dt, air)
    closing = product(normal, look.before[0] - velocity[:3])
    then = product(normal, look.velocity[0] - velocity[:3])
    yielding = 1.0 / missile.mass + product(product(normal, look.response[0]), normal)
    impulse = -max(then + RESTITUTION * closing, 0.0) / yielding * normal  # on the tree
    for share in _SHARES:
        after = forest.predict_response(row, point[None], dt, air, impulse[None])
        mean = after.velocity[0] + after.old_share[0] * (after.before[0] - after.velocity[0])
        if product(impulse, mean - velocity[:3] + 0.5 * impulse / missile.mass) <= 0.0:
            break
        impulse *= share
    forest.apply_impulse(int(row[0]), point, impulse)
    velocity[:3] -= impulse / missile.mass
    _record(state, missile, point, forest.parts[row], False, impulse, impulse, 0.0)


def _hit_wall(model: Model, state: State, missile: Missile, hits: Hits, way: np.ndarray,
              pose: np.ndarray, velocity: np.ndarray) -> bool:
    """Strike standing parts together; return whether they come out."""
    parts, flush = hits.index, _depth(hits, way) < _FLUSH
    point, normal = hits.point[flush].mean(axis=0), hits.normal[flush].mean(axis=0)
    normal /= norm(normal)
    before, closing = velocity[:3].copy(), float(product(-normal, velocity[:3]))
    direction = _line(before, normal, closing)
    momentum = missile.mass * closing / float(product(-normal, direction))
    patch = _patch(model, missile, pose, normal, parts[flush])
    lasts = float(contact_time(missile.mass, patch, closing))
    blow = masonry.Strike(direction, (1.0 + RESTITUTION) * momentum / lasts, missile.mass,
                          momentum)
    pane = None
    if model.glass.is_pane[parts[0]]:
        parts = parts[:1]
        pane = glass.crack(model, int(parts[0]), point, float(missile.size.max()))
        out = masonry.comes_out([parts], pane.mass, pane.resistance, blow)
    else:
        out = masonry.drive_out(state, parts, blow)
    if out is None:
        _bounce(velocity, normal, closing)
        lost = missile.mass * (before - velocity[:3])
        pushes = _pushes(model, state, missile, pose, _take(hits, np.arange(len(parts))), lost)
        masonry.apply_impulses(state, parts, pushes, speed=float(norm(before)))
        _record(state, missile, point, parts, False, lost, np.zeros(3), 0.0)
        return False
    velocity[:3] -= (momentum / missile.mass - out.speed) * direction
    lost = missile.mass * (before - velocity[:3])
    if pane is not None:
        glass.shatter_standing(model, state, [(pane, out.speed * direction, out.load)],
                               Cause.IMPACT)
    else:
        masonry.apply_impulse_around(state, out.withstood.bonds, out.parts,
                                     out.passed_on * direction, float(norm(before)))
        masonry.release(model, state, out, blow)
    _record(state, missile, point, out.parts, True, lost, out.mass * out.speed * direction,
            out.withstood.energy)
    return True


def _patch(model: Model, missile: Missile, pose: np.ndarray, normal: np.ndarray,
           parts: np.ndarray) -> float:
    """Return the radius of the circle with the contact area of a flat face [m]; 0 for a point."""
    if missile.ball:
        return 0.0
    along = np.abs(rotation.rotate(rotation.conjugate(pose[3:]), normal))
    if along.max() < _FLAT:
        return 0.0
    size = missile.size
    own = float(size.prod() / size[np.argmax(along)])
    solid = model.blueprint.size[parts]
    across = np.abs(rotation.rotate(rotation.conjugate(model.blueprint.poses[parts, 3:]), normal))
    met = solid.prod(axis=1) / (solid * across).sum(axis=1)
    return math.sqrt(min(own, float(met.sum())) / math.pi)


def _pushes(model: Model, state: State, missile: Missile, pose: np.ndarray, hits: Hits,
            lost: np.ndarray) -> np.ndarray:
    """Share a momentum out to what was touched: impulses and their moments, (K, 6)."""
    places, share = hits.point, np.ones(len(hits))
    if _patch(model, missile, pose, hits.normal[0], hits.index) > 0.0:
        places, share = _covered(model, missile, pose, hits)
    return masonry.about_centres(state, hits.index, places,
                                 (share / share.sum())[:, None] * lost)


def _covered(model: Model, missile: Missile, pose: np.ndarray,
             hits: Hits) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the areas of parts that a flat face covers: middles, world [m], (K, 3), and sizes [m²].

    The face presses on them evenly. The points of a sweep are those nearest to its middle, at the
    rims of most parts.
    """
    parts = hits.index
    solid, half = model.blueprint.poses[parts], 0.5 * model.blueprint.size[parts]
    back = rotation.conjugate(solid[:, 3:])
    edges = rotation.rotate(pose[3:], np.diag(0.5 * missile.size))
    reach = np.abs(rotation.rotate(back[:, None], edges)).sum(axis=1)
    middle = rotation.rotate(back, pose[:3] - solid[:, :3])
    low, high = np.maximum(-half, middle - reach), np.minimum(half, middle + reach)
    covered, wide = 0.5 * (low + high), np.maximum(high - low, _FLUSH)
    touch = rotation.rotate(back, hits.point - solid[:, :3])
    out = np.abs(rotation.rotate(back, hits.normal)).argmax(axis=1)
    each = np.arange(len(parts))
    covered[each, out], wide[each, out] = touch[each, out], 1.0
    return solid[:, :3] + rotation.rotate(solid[:, 3:], covered), wide.prod(axis=1)


def _bounce(velocity: np.ndarray, normal: np.ndarray, closing: float) -> None:
    """Reflect a body from a wall that holds; friction slows it along the wall."""
    along = velocity[:3] + closing * normal
    speed = float(norm(along))
    grip = min(_FRICTION * (1.0 + RESTITUTION) * closing, _ROLLING * speed)
    velocity[:3] = RESTITUTION * closing * normal
    if speed > 0.0:
        velocity[:3] += (1.0 - grip / speed) * along


def _record(state: State, missile: Missile, point: np.ndarray, parts: np.ndarray, torn: bool,
            lost: np.ndarray, carried: np.ndarray, work: float) -> None:
    state.ledger.record(Impact(state.time, missile.part, point, parts, torn, lost, carried,
                               lost - carried, work))


def _line(velocity: np.ndarray, normal: np.ndarray, closing: float) -> np.ndarray:
    """Return the direction of a blow: that of the motion, within the cone of friction."""
    along = velocity + closing * normal
    slide = float(norm(along))
    if slide > _FRICTION * closing:
        along *= _FRICTION * closing / slide
    direction = along - closing * normal
    return direction / norm(direction)


def _depth(hits: Hits, way: np.ndarray) -> np.ndarray:
    """Return the depth of touches behind the first one [m], (K,)."""
    return (hits.fraction - hits.fraction[0]) * norm(way)


def _take(hits: Hits, rows: np.ndarray) -> Hits:
    return Hits(hits.index[rows], hits.fraction[rows], hits.point[rows], hits.normal[rows])
