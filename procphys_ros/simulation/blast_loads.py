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


"""Loads of an explosion on all parts of a scene: shock, gas in rooms, panes in the shadow."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.loads import (
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
from procphys_ros.simulation import wall_columns
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_FLAT = 0.7  # cosine between a normal and the vertical, from which on a face counts as horizontal


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
    flat = np.abs(axes[:, :, 2]) > _FLAT
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
    both = wall_columns.spread(state, linear, peak)[parts]
    result = Impulses(shock.linear.copy(), shock.angular, shock.arrival, shock.peak.copy())
    result.linear[rows], result.peak[rows] = both[:, :3], both[:, 3]
    return result


def _add(shock: Impulses, gas: Impulses | None) -> Impulses:
    """Add the loads of the gas, from the arrival of the shock on."""
    if gas is None:
        return shock
    return Impulses(shock.linear + gas.linear, shock.angular + gas.angular, shock.arrival,
                    shock.peak + gas.peak)
