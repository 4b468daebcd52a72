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

"""Loads on standing walls that change while a scene runs: wind, and debris that rests on them."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.geometry.linear import cross
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.loads import exposed_faces, Skin, WallPressure
from procphys_ros.physics.masonry.standing_loads import TOGETHER
from procphys_ros.physics.world import Contacts
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State, WallWindState

_WIND_INTERVAL = 0.25   # [s] between checks of the wind
_BREEZE = 60.0          # [Pa] dynamic pressure, 10 m/s, that walls withstand without a check
_WIND_CHANGE = 0.25     # of the dynamic pressure that was last applied
_GONE = 0.02            # share of lost standing parts that requires a new survey of the faces
_WIND_LAYER = 'wind'
_TRACE = 1.0            # [N], [N·m] at which the load of a loose body has faded
DEBRIS_LAYER = 'debris'


def press_wind(model: Model, state: State, dt: float) -> None:
    """
    Apply the pressure of the wind to buildings; writes `state.wall_wind` and loads.

    Each building is loaded as a whole by the wind at its top (EN 1991-1-4, 7.2.2: the reference
    height of walls no higher than wide; it overestimates the load of lower storeys of towers).
    Eddies smaller than a building load parts of it at different times, which codes neglect as
    well. The pressure inside follows from its openings: missing panes, doors and walls.
    """
    own = state.wall_wind
    if state.time < own.next_look - 1e-9:
        return
    standing = state.standing[:len(model.blueprint)]
    if not standing.any():
        return
    own.next_look = state.time + _WIND_INTERVAL
    if state.wind.is_still(state.time):  # for any exposed faces
        _leave(state)
        return
    lost = bool(not len(own.parts)
                or np.count_nonzero(standing) < (1.0 - _GONE) * len(own.parts))
    if lost:
        _survey(model, state, standing)
    air = state.wind.open_velocity(own.tops, state.time)
    now, before = _pressure(air), _pressure(own.applied)
    if now.max(initial=0.0) < _BREEZE:
        _leave(state)
        return
    turned = AIR_DENSITY * np.sqrt(np.square(air - own.applied).sum(axis=1) * 2.0 * now
                                   / AIR_DENSITY)
    if lost or np.any(turned > _WIND_CHANGE * np.maximum(before, _BREEZE)):
        own.applied = air
        _press_faces(model, state, standing)


def _leave(state: State) -> None:
    """Remove the wind loads from all walls."""
    state.wall_wind.applied = np.zeros_like(state.wall_wind.applied)
    state.loads.remove_layer(_WIND_LAYER)  # even if a survey has just reset `applied`


def _survey(model: Model, state: State, standing: np.ndarray) -> None:
    """Find the exposed faces of standing parts, and the top of each building."""
    source, own = model.blueprint, state.wall_wind
    own.parts = np.flatnonzero(standing & (source.shape == Shape.BOX))
    poses = source.poses[own.parts]
    own.exposed = exposed_faces(poses, source.size[own.parts], terrain=model.terrain)
    _, own.structure = np.unique(state.solver.labels[own.parts], return_inverse=True)
    count = np.bincount(own.structure)
    own.tops = np.column_stack([np.bincount(own.structure, poses[:, axis]) / count
                                for axis in range(3)])
    np.maximum.at(own.tops[:, 2], own.structure, poses[:, 2])
    own.applied = np.zeros_like(own.tops)
    own.pressure = None


def _press_faces(model: Model, state: State, standing: np.ndarray) -> None:
    """Apply the pressure of the last wind, inside according to the present openings."""
    walls, own = model.masonry, state.wall_wind
    exposed = np.zeros((len(standing), 6), bool)
    exposed[own.parts] = own.exposed
    parts = np.flatnonzero((exposed | walls.skin).any(axis=1))
    if own.pressure is None:
        own.pressure = WallPressure(
            walls.face_poses[parts], walls.face_sizes[parts], exposed[parts],
            model.blueprint.poses[parts, :3], Skin(walls.skin[parts], walls.building[parts]))
    place = np.zeros(len(standing), np.intp)
    place[own.parts] = own.structure
    gone = ~standing
    place[gone] = _place_at_building(walls.building, own, gone)
    left = standing[parts]
    load = own.pressure.forces(own.applied, place[parts], walls.skin[parts].any(axis=1) & ~left)
    state.loads.set_layer(_WIND_LAYER, parts[left], load[left])


def _place_at_building(building: np.ndarray, own: WallWindState, gone: np.ndarray) -> np.ndarray:
    """Return the structure that lost parts belonged to, or its remains."""
    place = np.zeros(int(building.max(initial=0)) + 1, np.intp)
    place[building[own.parts]] = own.structure
    return place[building[gone]]


def _pressure(air: np.ndarray) -> np.ndarray:
    return 0.5 * AIR_DENSITY * np.einsum('ki,ki->k', air, air)


def press_debris(model: Model, state: State, dt: float) -> None:
    """
    Load what stands with the mean force of debris since the last look.

    Writes `state.rubble` and loads.
    """
    own, loaded = state.rubble, DEBRIS_LAYER in state.loads.sources
    if not ((state.bodies.members or loaded) and state.standing.any()):
        return
    standing = part_of_body(state)
    _press_parts(state, standing, state.world.contacts(), 1.0, own.given)
    _press_parts(state, standing, state.world.slept, dt, own.given)
    own.since += dt
    if own.since < TOGETHER - 1e-9:
        return
    load = own.given / own.since
    own.given, own.since = np.zeros_like(own.given), 0.0
    pressed = np.abs(load).max(axis=1) > _TRACE
    own.rocked[~pressed] = 0.0
    parts = np.flatnonzero(pressed)
    state.loads.follow(DEBRIS_LAYER, parts, load[parts])


def passing(state: State, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return what debris has given to parts that rock under it, and gives until the next look.

    :param parts: (K,).
    :returns: those that it presses, ascending, (P,), and its impulse on each [N·s], (P, 3).
    """
    loaded, wrenches = state.loads.layer(DEBRIS_LAYER)
    there = np.isin(loaded, parts)
    return loaded[there], (state.rubble.rocked[loaded[there]]
                           + TOGETHER * wrenches[there, :3])


def let_rock(state: State, parts: np.ndarray, impulses: np.ndarray) -> None:
    """
    Let debris move parts instead of loading them, until the next look.

    :param parts, impulses: see `passing`.
    """
    state.rubble.rocked[parts] = impulses
    loaded, wrenches = state.loads.layer(DEBRIS_LAYER)
    stays = ~np.isin(loaded, parts)
    state.loads.set_layer(DEBRIS_LAYER, loaded[stays], wrenches[stays])


def part_of_body(state: State) -> np.ndarray:
    """Return the standing part of each body, -1 for all others, (B,)."""
    standing = np.flatnonzero(state.parts.owner == Owner.STANDING)
    out = np.full(len(state.world.bodies.state), -1, np.intp)
    out[state.parts.body[standing]] = standing
    return out


def _press_parts(state: State, standing: np.ndarray, contacts: Contacts, rate: float,
                 out: np.ndarray) -> None:
    """
    Add impulses on standing parts to forces and moments.

    :param standing: see `part_of_body`.
    :param rate: factor [1/s].
    :param out: (N, 6).
    """
    side = standing[contacts.body_a]
    part = np.maximum(side, standing[contacts.body_b])
    rows = np.flatnonzero(part >= 0)
    sign = np.where(side[rows] >= 0, rate, -rate)
    force = sign[:, None] * contacts.impulse[rows]
    arm = contacts.point[rows] - state.parts.poses[part[rows], :3]
    np.add.at(out, part[rows], np.hstack([force, cross(arm, force)]))
