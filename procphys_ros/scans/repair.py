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

"""Repair: what is wrong in scans is put right, and counted."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from procphys_ros.errors import GrammarError
from procphys_ros.geometry.linear import dot, norm
from procphys_ros.scans.cylinders import Cylinders, depths, least_on_the_way, lowest_of

_SHORTEST = 1e-4  # [m] below what scanners resolve
_THINNEST = 1e-5  # [m] radius of no wood
_GROUNDED = 0.05  # [m] stems of one tree may begin so much above or below the largest

Repaired = tuple[Cylinders, str]
"""Cylinders after a step, and what was put right; '' = nothing."""


def repair(cylinders: Cylinders, foot_diameter: float, source: str) -> tuple[Cylinders, list[str]]:
    """
    Make cylinders that a skeleton can be built from, parents before children, the foot at 0.

    :param cylinders: in metres.
    :param foot_diameter: of a tree whose file has no radii [m]; 0 = not given.
    :param source: name of the file, for errors.
    :returns: the cylinders, and what was put right.
    :raises GrammarError: when nothing is left, or there are no radii.
    """
    notes = []
    steps: tuple[Callable[[Cylinders], Repaired], ...] = (
        _bridge, _merge, _keep_standing, _order, _cap, _move)
    for step in steps:
        if step is _cap:
            cylinders = _with_radii(cylinders, foot_diameter, source)
        cylinders, note = step(cylinders)
        notes += [note] if note else []
        if not len(cylinders):
            raise GrammarError(f'no cylinder is longer than {_SHORTEST:g} m; is the unit right?',
                               source)
    return cylinders, notes


def _bridge(cylinders: Cylinders) -> Repaired:
    """Let cylinders that start outside of their parents start on the axes of these."""
    rows = np.flatnonzero(cylinders.parent >= 0)
    above, start = cylinders.parent[rows], cylinders.start[rows]
    foot, along = cylinders.start[above], cylinders.end[above] - cylinders.start[above]
    square = dot(along, along)
    part = np.clip(dot(start - foot, along) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = foot + part[:, None] * along
    gap = norm(start - nearest, axis=1)
    wide = gap > cylinders.radius[above]
    if cylinders.tapered or not wide.any():
        return cylinders, ''
    moved = cylinders.start.copy()
    moved[rows[wide]] = nearest[wide]
    return replace(cylinders, start=moved), (
        f'{np.count_nonzero(wide)} gaps bridged (up to {gap[wide].max():.3g} m)')


def _merge(cylinders: Cylinders) -> Repaired:
    """Let what grows from cylinders without a length grow from their parents."""
    long = cylinders.length >= _SHORTEST
    if long.all():
        return cylinders, ''
    above = np.append(lowest_of(cylinders.parent, long), -1)[cylinders.parent]
    foot = np.where(above >= 0, cylinders.foot, np.where(
        cylinders.parent >= 0, cylinders.radius[cylinders.parent], cylinders.foot))
    merged = replace(cylinders, parent=above, foot=foot).taken(np.flatnonzero(long))
    return merged, f'{np.count_nonzero(~long)} cylinders without a length merged'


def _keep_standing(cylinders: Cylinders) -> Repaired:
    """Keep the largest piece, and stems that start as low as it does."""
    feet = cylinders.parent < 0
    if not len(cylinders) or np.count_nonzero(feet) == 1:
        return cylinders, ''
    root = lowest_of(cylinders.parent, feet)
    known = not np.isnan(cylinders.radius).any()
    size = cylinders.volume if known else cylinders.length
    main = int(np.argmax(np.bincount(root, size, len(root))))
    level = np.abs(cylinders.start[:, 2] - cylinders.start[main, 2]) <= _GROUNDED
    kept = level[root]
    stems, loose = np.count_nonzero(feet & level), np.count_nonzero(feet & ~level)
    said = [f'{stems} stems stand on the ground'] if stems > 1 else []
    if loose:
        said.append(f'{loose} loose pieces left out ({size[~kept].sum() / size.sum():.1%} of the '
                    f'{"wood" if known else "length"})')
    return cylinders.taken(np.flatnonzero(kept)), ', '.join(said)


def _order(cylinders: Cylinders) -> Repaired:
    """Put parents before their children."""
    late = np.count_nonzero(cylinders.parent >= np.arange(len(cylinders)))
    if not late:
        return cylinders, ''
    order = np.argsort(depths(cylinders.parent), kind='stable')
    said = '' if cylinders.tapered else f'{late} cylinders put after their parents'
    return cylinders.taken(order), said  # points of skeletons come in any order


def _with_radii(cylinders: Cylinders, foot_diameter: float, source: str) -> Cylinders:
    """Where a file has no radii, keep the sum of squared diameters at forks (the pipe model)."""
    if not np.isnan(cylinders.radius).any():
        return cylinders
    if not foot_diameter:
        raise GrammarError('the file has no radii; give the diameter of the foot of the stem '
                           '[m], such as foot_diameter=0.3', source)
    count, above = len(cylinders), cylinders.parent
    tips = np.bincount(above[above >= 0], minlength=count) == 0
    carried = tips.astype(float)
    depth = depths(above)
    deepest_first = np.argsort(-depth, kind='stable')
    levels = np.split(deepest_first, np.flatnonzero(np.diff(depth[deepest_first])) + 1)
    for rows in levels[:-1]:  # those at the ground have nothing below
        np.add.at(carried, above[rows], carried[rows])
    radius = 0.5 * foot_diameter * np.sqrt(carried / carried[above < 0].max())
    return replace(cylinders, radius=radius, foot=radius)


def _cap(cylinders: Cylinders) -> Repaired:
    """Let no cylinder be thicker than those below; give those of none the least one."""
    radius, said = cylinders.radius, []
    if (thin := radius < _THINNEST).any():
        least = radius[~thin].min() if not thin.all() else _THINNEST
        radius = np.where(thin, least, radius)
        said.append(f'{np.count_nonzero(thin)} radii of about 0 taken as {least:.3g} m')
    capped = least_on_the_way(cylinders.parent, radius)
    if (wide := capped < radius).any():
        before = replace(cylinders, radius=radius).volume.sum()
        share = 1.0 - replace(cylinders, radius=capped).volume.sum() / before
        said.append(f'{np.count_nonzero(wide)} radii capped to those of parents ({share:.1%} of '
                    'the wood)')
    return (replace(cylinders, radius=capped, foot=np.maximum(cylinders.foot, capped)),
            ', '.join(said))


def _move(cylinders: Cylinders) -> Repaired:
    """Put the foot of the thickest stem at the origin."""
    feet = np.flatnonzero(cylinders.parent < 0)
    place = cylinders.start[feet[int(np.argmax(cylinders.radius[feet]))]].copy()
    said = f'moved by ({", ".join(f"{0.0 - x:.2f}" for x in place)}) m'
    return (replace(cylinders, start=cylinders.start - place, end=cylinders.end - place),
            said if norm(place) > _GROUNDED else '')
