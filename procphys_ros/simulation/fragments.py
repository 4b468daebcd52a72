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

"""Fragments: rigid bodies made of parts, and the wind on them."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import GROUND, Shape
from procphys_ros.elementary import expm1
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.world import (
    BodyState,
    expand,
    fragment,
    FRICTION,
    JointKind,
    JointOptions,
    LooseBody,
    plain,
    rigid_sum,
)
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import box_drag, Owner
from procphys_ros.simulation.state import State

WOOD_FRICTION = 0.6  # green wood and bark on soil or wood
NEGLIGIBLE = 0.05  # [m/s²] by the air, which changes no motion and wakes nothing, 0.5 % of gravity
_IDENTITY = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])  # the part's frame is the body's
_WIND_INTERVAL = 0.1  # [s] between checks
_FASTEST = 120.0  # [m/s] above any wind


def make_body(model: Model, state: State, parts: np.ndarray, poses: np.ndarray,
              velocities: np.ndarray) -> int:
    """Make one rigid body, see `make_bodies`, and return its id."""
    return make_bodies(model, state, [(parts, poses, velocities)])[0]


def make_bodies(model: Model, state: State, pieces: Sequence[tuple[
        np.ndarray, np.ndarray, np.ndarray]]) -> list[int]:
    """
    Make rigid bodies of parts in one call; momentum and angular momentum are kept.

    :param pieces: the indices of the parts of each, (P,), their poses, (P, 7), and velocities,
        world axes, (P, 6).
    :returns: ids of the bodies.
    """
    if not pieces:
        return []
    made = [_joined(model, state, *piece) for piece in pieces]
    bodies = state.world.add_loose([body for body, _, _ in made]).tolist()
    for body, (_, parts, local) in zip(bodies, made):
        _enter(state, body, parts, local)
    return bodies


def _joined(model: Model, state: State, parts: np.ndarray, poses: np.ndarray,
            velocities: np.ndarray) -> tuple[LooseBody, np.ndarray, np.ndarray]:
    """Describe a rigid body made of parts; return it, the sorted parts, and their local poses."""
    # Rows of a tree follow its branches, not the part indices.
    order = np.argsort(parts, kind='stable')
    parts, poses, velocities = np.asarray(parts)[order], poses[order], velocities[order]
    columns = state.parts
    friction = FRICTION if columns.shape[parts[0]] == Shape.BOX else WOOD_FRICTION
    sizes, hexahedra = columns.solid_size[parts], model.blueprint.hexahedra.among(parts)
    if len(parts) == 1:
        part = int(parts[0])
        return plain(columns.shape[part], sizes[0], float(columns.mass[part]), poses[0],
                     velocities[0], columns.inertia[part], friction,
                     hexahedra=hexahedra), parts, _IDENTITY
    total = rigid_sum(columns.mass[parts], columns.inertia[parts], poses, velocities)
    return fragment(columns.shape[parts], sizes, total.local_poses, total.mass, total.inertia,
                    total.pose, total.velocity, friction,
                    hexahedra=hexahedra), parts, total.local_poses


def adopt(state: State, parts: np.ndarray, bodies: np.ndarray) -> None:
    """
    Record existing bodies as carriers of single parts, one each.

    :param parts: (P,) indices.
    :param bodies: ids in the world, (P,).
    """
    for part, body in zip(parts, bodies):
        _enter(state, int(body), np.array([part]), _IDENTITY)


def hang(model: Model, state: State, bonds: np.ndarray) -> None:
    """
    Suspend separated pieces by the rebars of their bonds, if the engine has joints.

    The steel of both layers is in the middle of the section, and the faces press on each other, so
    it carries up to twice its force without a moment. The joint is removed with either piece.

    :param bonds: broken bonds, rows of the blueprint, (K,).
    """
    graph, source = state.loose_bonds.graph, model.blueprint
    bonds = bonds[graph.mortar.reinforcement[bonds] > 0.0]
    bonds = bonds[(source.bonds[bonds] != GROUND).all(axis=1)]
    pairs = source.bonds[bonds]
    bodies = state.parts.body[pairs]
    loose = (state.parts.owner[pairs] == Owner.BODY).all(axis=1) & (bodies[:, 0] != bodies[:, 1])
    if not loose.any() or not state.world.has_joints:
        return
    bonds, pairs, bodies = bonds[loose], pairs[loose], bodies[loose]
    frames = []
    for part, body in zip(pairs.T, bodies.T):
        local = rotation.relative(source.poses[part], source.bond_frame[bonds])
        now = rotation.compose(state.world.poses(body), state.parts.local[part])
        frames.append(rotation.compose(now, local))
    steel = graph.mortar.reinforcement[bonds] * graph.area[bonds]
    state.world.join(JointKind.BALL, bodies[:, 0], bodies[:, 1], frames[0],
                     JointOptions(force=2.0 * steel, collides=True), frames[1])


def part_states(state: State, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (P, 7) and velocities (P, 6) of parts from those of their bodies."""
    bodies, columns = state.world.bodies, state.parts
    poses, velocities = np.empty((len(parts), 7)), np.empty((len(parts), 6))
    expand(bodies.poses, bodies.velocities, columns.body[parts], columns.local[parts],
           np.arange(len(parts)), poses, velocities)
    return poses, velocities


def apply_drag(model: Model, state: State, dt: float) -> None:
    """
    Apply the drag of the air to loose bodies; writes their velocities.

    Quadratic drag with the speed of the last step, integrated exactly over the step, so that no
    light body overshoots the speed of the air.
    """
    awake = state.world.awake
    if not len(awake):
        return
    air = state.wind.velocity(state.world.poses(awake)[:, :3], state.time)
    area = np.zeros(max(awake[-1] + 1, len(state.bodies.drag_area)))
    area[:len(state.bodies.drag_area)] = state.bodies.drag_area
    velocities = state.world.velocities(awake).copy()
    slip = air - velocities[:, :3]
    rate = (0.5 * AIR_DENSITY * area[awake] * norm(slip, axis=1)
            / state.world.bodies.mass[awake])
    share = -expm1(-rate * dt)[:, None]
    velocities[:, :3] += share * slip
    velocities[:, 3:] *= 1.0 - share
    felt = rate * norm(slip, axis=1) > NEGLIGIBLE
    state.world.set_velocities(awake[felt], velocities[felt])


def write_poses(model: Model, state: State, dt: float) -> None:
    """Update the poses and velocities of parts whose bodies moved in this step."""
    if not state.bodies.members:
        return
    if state.bodies.carried is None:
        state.bodies.carried = np.flatnonzero(state.parts.owner == Owner.BODY)
    bodies, parts = state.world.bodies, state.bodies.carried
    moves = bodies.state[state.parts.body[parts]] >= BodyState.AWAKE
    rows = parts[moves | state.parts.moved[parts]]
    state.parts.moved[parts] = moves
    expand(bodies.poses, bodies.velocities, state.parts.body[rows], state.parts.local[rows], rows,
           state.parts.poses, state.parts.velocities)


def _enter(state: State, body: int, parts: np.ndarray, local: np.ndarray) -> None:
    columns, known = state.parts, state.bodies
    columns.owner[parts] = Owner.BODY
    columns.body[parts] = body
    columns.local[parts] = local
    columns.moved[parts] = True
    known.members[body] = np.asarray(parts, np.intp)
    known.carried = None
    if body >= len(known.drag_area):
        more = 2 * body + 1 - len(known.drag_area)
        known.drag_area = np.concatenate([known.drag_area, np.zeros(more)])
        known.size = np.concatenate([known.size, np.zeros(more, np.intp)])
    known.drag_area[body] = _drag_area(state, parts, local)
    known.size[body] = len(parts)


def _drag_area(state: State, parts: np.ndarray, local: np.ndarray) -> float:
    """
    Return the mean drag area of a body [m²]: of its boxes no more than that of a box about them.

    :param local: poses of the parts in the body, (P, 7).
    """
    columns = state.parts
    area = columns.drag_area[parts]
    boxes = np.flatnonzero(columns.shape[parts] == Shape.BOX)
    if len(boxes) < 2:
        return float(area.sum())
    largest = boxes[np.argmax(area[boxes])]  # axes of inertia may lie askew
    poses = rotation.relative(local[largest], local[boxes])
    reach = 0.5 * np.einsum('nij,nj->ni', np.abs(rotation.to_matrix(poses[:, 3:])),
                            columns.solid_size[parts[boxes]])
    extent = (poses[:, :3] + reach).max(axis=0) - (poses[:, :3] - reach).min(axis=0)
    return float(area.sum() - max(area[boxes].sum() - box_drag(*extent), 0.0))


def wake_in_wind(model: Model, state: State, dt: float) -> None:
    """Wake resting bodies that the wind can move; writes bodies."""
    if int(state.time / _WIND_INTERVAL + 1e-6) == int((state.time + dt) / _WIND_INTERVAL + 1e-6):
        return
    bodies = state.world.bodies
    resting = np.flatnonzero(bodies.state == BodyState.RESTING)
    resting = resting[resting < len(state.bodies.drag_area)]
    least = holding_wind(bodies.mass[resting] * model.gravity, bodies.friction[resting],
                         bodies.bounds[resting], state.bodies.drag_area[resting])
    light = least < _FASTEST
    resting, least = resting[light], least[light]
    if not len(resting):
        return
    air = state.wind.velocity(bodies.poses[resting, :3], state.time)
    state.world.thaw(resting[norm(air, axis=1) > least])


def holding_wind(weight: np.ndarray, friction: np.ndarray, bounds: np.ndarray,
                 drag_area: np.ndarray) -> np.ndarray:
    """
    Return the wind speed at which bodies on level ground begin to slide or topple [m/s], (K,).

    The drag ½ ρ Cd A v² acts at half the height, and the weight at the middle of the base.

    :param weight: [N], (K,).
    :param friction: Coulomb coefficient, (K,).
    :param bounds: axis-aligned [m], (K, 6).
    :param drag_area: Cd A [m²], (K,).
    """
    extent = bounds[:, 3:] - bounds[:, :3]
    slender = extent[:, :2].min(axis=1) / np.maximum(extent[:, 2], 1e-9)
    most = weight * np.minimum(friction, slender)
    return np.sqrt(most / np.maximum(0.5 * AIR_DENSITY * drag_area, 1e-12))
