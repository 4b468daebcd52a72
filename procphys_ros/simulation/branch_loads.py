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


"""Branch loads: contact loads of branches on standing walls."""

import numpy as np

from procphys_ros.elementary import expm1
from procphys_ros.linear import norm
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.impact import contact_time
from procphys_ros.simulation import fragments, masonry
from procphys_ros.simulation.contact_pairs import TreeContacts
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_HEAVY = 200.0    # [N] on one brick; lighter pushes, such as of twigs in the wind, load no wall
_SMOOTHING = 0.1  # [s] over which pushes count as a steady load, as for debris
_CHANGE = 0.25    # of the largest load: smaller changes are not worth new stresses
_LEAST = 1.0      # [N] below which a push is forgotten
_LAYER = 'branches'


def break_out(model: Model, state: State, contacts: TreeContacts, dt: float) -> bool:
    """
    Break bricks out where branches press harder in a step than their bonds withstand.

    The branch feels the bonds until they have broken, for the contact time of the brick; what
    holds then is only the brick.

    :param contacts: of all trees in the step.
    :param dt: [s].
    :returns: whether any brick came out.
    """
    broke = False
    for part, total in zip(*_per_part(contacts.part, contacts.impulse)):
        size = float(norm(total))
        if size < _HEAVY * dt:
            continue
        chosen, direction = np.array([part]), -total / size
        resistance = masonry.resist(state, chosen, direction)
        if size / dt <= resistance.force:
            continue
        mass = float(state.parts.mass[part])
        withstood = resistance.force * float(contact_time(mass))
        touching = contacts.part == part
        share = contacts.impulse[touching] * (withstood / size)
        state.forest.push(contacts.row[touching], contacts.point[touching], share)
        masonry.apply_impulse_around(state, resistance.bonds, chosen, withstood * direction,
                                     size / mass)
        fragments.release(model, state, [chosen], np.zeros((1, 6)), Cause.IMPACT,
                          size / dt / max(resistance.force, masonry.NO_FORCE))
        broke = True
    return broke


def update(model: Model, state: State, dt: float) -> None:
    """
    Load standing bricks with branches that press on them; writes `state.branch_loads`, loads.

    What a branch presses with over some time is a load that lasts as long as it does; what goes
    far beyond that in one step is a blow.
    """
    own = state.branch_loads
    if not (len(state.contacts) or len(own.parts)):
        return
    chosen, total = _per_part(state.contacts.part, state.contacts.impulse)
    if not len(chosen) and not len(own.parts):
        return
    before, standing = len(own.parts), state.standing
    both, place = np.unique(np.concatenate([own.parts, chosen]), return_inverse=True)
    mean, now = np.zeros((2, len(both), 3))
    mean[place[:before]] = own.mean
    now[place[before:]] = -total / dt
    beyond = now - mean
    size = norm(beyond, axis=1)
    struck = ((size > np.maximum(_HEAVY, norm(mean, axis=1)))
              & now.any(axis=1) & standing[both])
    if struck.any():
        masonry.apply_impulses(state, both[struck], beyond[struck] * dt, 1.0 / dt)
    mean -= expm1(-dt / _SMOOTHING) * beyond
    felt = norm(mean, axis=1) > _LEAST
    own.parts, own.mean = both[felt], mean[felt]
    _hand_over(state, standing)


def _hand_over(state: State, standing: np.ndarray) -> None:
    """Apply the lasting loads to the walls if they have changed."""
    own = state.branch_loads
    heavy = standing[own.parts] & (norm(own.mean, axis=1) > _HEAVY)
    now = dict(zip(own.parts[heavy].tolist(), own.mean[heavy]))
    none = np.zeros(3)
    change = max((norm(now.get(part, none) - own.given.get(part, none))
                  for part in now.keys() | own.given.keys()), default=0.0)
    largest = max((norm(force) for force in now.values()), default=0.0)
    if change > max(_CHANGE * largest, 0.5 * _HEAVY):
        own.given = now
        wrenches = np.zeros((len(now), 6))
        wrenches[:, :3] = own.mean[heavy]
        state.loads.set_layer(_LAYER, own.parts[heavy], wrenches)


def _per_part(parts: np.ndarray, impulses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum up impulses on each brick."""
    on_brick = parts >= 0
    chosen, place = np.unique(parts[on_brick], return_inverse=True)
    total = np.zeros((len(chosen), 3))
    np.add.at(total, place, impulses[on_brick])
    return chosen, total
