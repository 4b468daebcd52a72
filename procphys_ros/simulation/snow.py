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
Snow and ice on a scene: mass on the segments of trees, and a load on what stands.

Where they lie is found when they change, on the scene as it stands then. What comes off sheds
them.
"""

import numpy as np

from procphys_ros.physics.loads import snow
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_LAYER = 'snow'
_NOTICED = 0.05  # of a change, at which buildings get the load that has come: each asks for new
#                  stresses; trees get it in every step


def begin(model: Model, state: State, wish: SnowLoad) -> None:
    """Begin a change of the snow and ice that lie on the scene; writes `state.snow`."""
    own, count = state.snow, len(state.parts)
    own.before = on_ground(state)
    own.snow, own.ice, own.ramp = wish.snow, wish.ice, wish.ramp
    own.began, own.share, own.told, own.acts = state.time, 0.0, 0.0, True
    crowns, roofs = _distribution(model, state)
    own.on_crowns = np.stack([state.forest.snow, crowns])
    parts, wrenches = state.loads.layer(_LAYER)
    before = np.zeros((count, 6))
    before[parts] = wrenches
    own.parts = np.flatnonzero(before[:, 2] + roofs[:, 2])
    own.on_parts = np.stack([before[own.parts], roofs[own.parts]])


def lay(model: Model, state: State, wish: SnowLoad) -> None:
    """Lay snow and ice on a scene at rest; writes what `step` does."""
    if wish.snow or wish.ice:
        begin(model, state, wish)
        _change(state, 1.0)


def join(model: Model, state: State, row: int, part: int) -> None:
    """
    Lay the snow and ice of the scene on what has joined it, at rest.

    :param row: its first row of the forest.
    :param part: its first part; all others are older.
    """
    own = state.snow
    if not (own.snow or own.ice):
        return
    crowns, roofs = _distribution(model, state)
    rows = np.arange(row, len(state.forest))
    own.on_crowns = np.concatenate(
        [own.on_crowns[:, :row], np.broadcast_to(crowns[rows], (2, len(rows)))], axis=1)
    state.forest.carry_snow(rows, crowns[rows])
    fresh = part + np.flatnonzero(roofs[part:, 2])
    own.parts = np.concatenate([own.parts, fresh])
    own.on_parts = np.concatenate(
        [own.on_parts, np.broadcast_to(roofs[fresh], (2, len(fresh), 6))], axis=1)
    _press(state, own.told)


def step(model: Model, state: State, dt: float) -> None:
    """Let snow and ice become more or less; writes `state.snow`, the forest and loads."""
    own = state.snow
    if own.acts:
        since = state.time + dt - own.began
        _change(state, 1.0 if since >= own.ramp else since / own.ramp)
        if state.trees.lod is not None:
            state.trees.lod.wake(np.arange(len(state.trees.lod.held)))
    elif len(own.parts):
        _press(state, own.told)


def on_ground(state: State) -> float:
    """Return the snow that lies on open ground now [kg/m²]."""
    own = state.snow
    return own.before + own.share * (own.snow - own.before)


def masses(model: Model, state: State) -> np.ndarray:
    """Return the mass of snow and ice on each part as it is borne now [kg], (N,)."""
    out = np.zeros(len(state.parts))
    grows = np.flatnonzero(state.parts.owner == Owner.TREE)
    out[grows] = state.forest.snow[state.parts.row[grows]]
    parts, wrenches = state.loads.layer(_LAYER)
    out[parts] = -wrenches[:, 2] / model.gravity
    return out


def _change(state: State, share: float) -> None:
    """Set a share of the change, 0 to 1."""
    own, forest = state.snow, state.forest
    rows = np.flatnonzero(forest.active & ~forest.is_free(forest.plan.root))
    if own.on_crowns[:, rows].any():
        first, last = own.on_crowns[:, rows]
        forest.carry_snow(rows, first + share * (last - first))
    own.share, own.acts = share, share < 1.0
    if share >= min(own.told + _NOTICED, 1.0):
        own.told = share
    _press(state, own.told)


def _press(state: State, share: float) -> None:
    """Load what still stands with a share of the change, 0 to 1."""
    own = state.snow
    stands = state.parts.owner[own.parts] == Owner.STANDING
    first, last = own.on_parts[:, stands]
    wrenches = first + share * (last - first)
    loaded = wrenches[:, 2] != 0.0
    state.loads.set_layer(_LAYER, own.parts[stands][loaded], wrenches[loaded])


def _distribution(model: Model, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Return the masses of snow and ice on rows of the forest, and wrenches on standing parts."""
    forest, parts, own = state.forest, state.parts, state.snow
    standing = np.flatnonzero(state.standing)
    tops = snow.Tops.over(parts.poses[standing], parts.size[standing])
    lengths, widths = parts.visual_size[forest.parts, 2], parts.visual_size[forest.parts, 0]
    leaves = state.leaves.left[forest.parts]
    plan = np.where(forest.active, snow.plan_areas(forest.poses, lengths, widths, leaves), 0.0)
    segment, points, count = snow.segment_points(forest.poses, lengths)
    spread = plan[segment] / count[segment]
    area = np.bincount(segment, snow.caught(points, spread, tops), len(forest))
    crowns = own.snow * area + snow.glaze(own.ice, lengths, widths, leaves)
    box, places = tops.points()
    force = -model.gravity * own.snow * tops.areas() * snow.passed(places, points, spread)
    arms = places - parts.poses[standing[box], :3]
    roofs = np.zeros((len(parts), 6))
    for axis, amount in ((2, force), (3, arms[:, 1] * force), (4, -arms[:, 0] * force)):
        roofs[:, axis] = np.bincount(standing[box], amount, len(parts))
    return crowns, roofs
