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

"""Skeleton: turn an explicit branch structure into bones and joints (paper, section 3.1)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush

import numpy as np

from procphys_ros.blueprint import (
    Blueprint,
    cylinder_inertia,
    GROUND,
    Hinges,
    Law,
    Leaves,
    Ornaments,
    Shape,
)
from procphys_ros.elementary import power
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm

# Fresh leaf mass per one-sided area [kg/m²]: about 75 g/m² dry for deciduous trees (Poorter et al.
# 2009, New Phytologist 182:565) at about 60 % water.
LEAF_AREAL_DENSITY = 0.2

_MOST_TAKEN = 0.25  # of a segment's mass, for those above it; it may give half to the one below
# Stiffness of green wood beyond its yield stress over that below: so its work in bending up to the
# greatest load is what the Wood Handbook has (FPL-GTR-282, table 5-3; docs/decisions/0107).
_TANGENT = 0.09

Values = float | np.ndarray
"""One number for all nodes, or one for each."""

_BARE = Leaves()
_PLAIN = Ornaments()


def _for_all(value: float):
    return field(default=value)  # made a column by `Branches`


@dataclass(frozen=True)
class Branches:
    """
    Segments of trees before they become parts; each parent comes before its children.

    :ivar parent: segment that this one grows from, -1 for the ground, (S,) int32.
    :ivar lateral: True where a segment starts a side branch of its parent, (S,) bool.
    :ivar base: start point [m], (S, 3).
    :ivar attitude: z along the segment, x and y as the turtle's left and up, xyzw, (S, 4).
    :ivar length: [m], (S,).
    :ivar width: diameter at the base [m], (S,).
    :ivar tip_width: diameter at the end; between the two a segment tapers evenly [m], (S,).
    :ivar density: [kg/m³], (S,).
    :ivar modulus: Young's modulus along the grain [Pa], (S,).
    :ivar strength: bending strength [Pa], (S,); inf = never breaks.
    :ivar bone_ratio: bone length over segment length, (S,).
    :ivar swing_limit: [rad], (S,).
    :ivar swing_stiffness: [N·m/rad], (S,); NaN = E·I/L.
    :ivar swing_damping: [N·m·s/rad], (S,); NaN = from damping_ratio.
    :ivar damping_ratio: of the lowest bending mode of the branch, (S,).
    :ivar twist_stiffness, stretch_stiffness: [N·m/rad], [N/m], (S,); NaN = locked.
    :ivar twist_damping, stretch_damping: [N·m·s/rad], [N·s/m], (S,); NaN = from damping_ratio.
    :ivar break_force, break_torque: [N], [N·m], (S,); inf = never.
    :ivar root_stiffness: of the root plate in the ground, in series with the joint's own
        [N·m/rad], (S,); NaN = rigid. It and root_moment apply to segments on the ground only.
    :ivar root_moment: moment that uproots the root plate [N·m], (S,); inf = never.
    :ivar preload: share of the weight that the shape allows for, 0 to 1, (S,).
    :ivar texture: index into the texture names, (S,) int16.
    :ivar cling: strength of the hold on the plant's support, per length [N/m], (S,); 0 = none.
    :ivar yield_stress: bending stress beyond which a part of the bend stays [Pa], (S,); inf =
        never.
    """

    parent: np.ndarray
    lateral: np.ndarray
    base: np.ndarray
    attitude: np.ndarray
    length: np.ndarray
    width: np.ndarray
    tip_width: np.ndarray
    density: np.ndarray
    modulus: np.ndarray
    strength: np.ndarray
    bone_ratio: np.ndarray
    swing_limit: np.ndarray
    damping_ratio: np.ndarray
    swing_stiffness: np.ndarray = _for_all(np.nan)
    swing_damping: np.ndarray = _for_all(np.nan)
    twist_stiffness: np.ndarray = _for_all(np.nan)
    twist_damping: np.ndarray = _for_all(np.nan)
    stretch_stiffness: np.ndarray = _for_all(np.nan)
    stretch_damping: np.ndarray = _for_all(np.nan)
    break_force: np.ndarray = _for_all(np.inf)
    break_torque: np.ndarray = _for_all(np.inf)
    root_stiffness: np.ndarray = _for_all(np.nan)
    root_moment: np.ndarray = _for_all(np.inf)
    preload: np.ndarray = _for_all(1.0)
    texture: np.ndarray = _for_all(0)
    cling: np.ndarray = _for_all(0.0)
    yield_stress: np.ndarray = _for_all(np.inf)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if np.ndim(value) == 0:
                object.__setattr__(self, name, np.full(len(self.parent), value))

    def __len__(self) -> int:
        return len(self.parent)


def build(branches: Branches, leaves: Leaves = _BARE, ornaments: Ornaments = _PLAIN,
          textures: Sequence[str] = (), material: str = 'wood',
          polygons: np.ndarray | float = 0.0) -> Blueprint:
    """
    Turn segments into capsule bones joined by elastic hinges; part i is segment i.

    A part's frame and centre of mass lie in the middle of its segment. Its mass is that of its
    wood, see `wood_mass`, plus its leaves, which count as spread along the segment. Polygons have
    the weight and the wind load of leaves of their area, but are not shed.

    :param branches: segments, each parent before its children.
    :param leaves: with `part` = segment and poses in the frame of the part.
    :param ornaments: likewise.
    :param textures: names that the texture indices refer to.
    :param material: name of the wood.
    :param polygons: area of the polygons on each segment [m²], (S,).
    :raises SceneError: when a segment is impossible; names the first one.
    """
    _check(branches, leaves, ornaments)
    count = len(branches)
    axis = rotation.rotate(branches.attitude, np.array([0.0, 0.0, 1.0]))
    middle = branches.base + 0.5 * branches.length[:, None] * axis
    area = 0.25 * np.pi * (branches.width * branches.width)
    leaf_area = np.asarray(polygons, float) + np.bincount(
        leaves.part, leaves.size * leaves.size, minlength=count)
    mass = wood_mass(branches) + LEAF_AREAL_DENSITY * leaf_area
    mean_width = 0.5 * (branches.width + branches.tip_width)
    bone = branches.bone_ratio * branches.length
    thickness = np.minimum(branches.width, bone)
    return Blueprint(
        shape=np.full(count, Shape.CAPSULE, np.uint8),
        size=np.column_stack([thickness, thickness, bone]),
        visual_size=np.column_stack([branches.width, branches.tip_width, branches.length]),
        density=branches.density, mass=mass,
        inertia=cylinder_inertia(mass, mean_width, branches.length),
        poses=np.column_stack([middle, branches.attitude]),
        kind=np.zeros(count, np.int16), material=np.zeros(count, np.int16),
        texture=branches.texture.astype(np.int16), leaf_area=leaf_area,
        bonds=np.column_stack([branches.parent, np.arange(count)]).astype(np.int32),
        bond_law=np.full(count, Law.HINGE, np.uint8),
        bond_frame=np.column_stack([branches.base, branches.attitude]),
        bond_extent=np.column_stack([branches.width, branches.width]), bond_area=area,
        hinges=_hinges(branches), leaves=leaves, ornaments=ornaments,
        kinds=('segment',), materials=(material,), textures=tuple(textures))


def bending_stiffness(branches: Branches) -> np.ndarray:
    """
    Compute the swing stiffness of every joint, given or from beam theory [N·m/rad], (S,).

    A joint stands for the bending of the two half segments beside it, in series: E·I/L between
    equal segments. Where a segment starts clamped (at the ground, or sideways on its parent) only
    its own half bends, so 2·E·I/L; with it a ten-segment cantilever's first frequency is within
    0.5 % of the Euler-Bernoulli beam, without it 9 % low. The bending of tapered halves is
    integrated along them; the root plate is one more spring in series.
    """
    given, wood = ~np.isnan(branches.swing_stiffness), _wood_flexibility(branches)
    rooted = (branches.parent < 0) & ~np.isnan(branches.root_stiffness)
    series = 1.0 / (wood + np.where(rooted, 1.0 / branches.root_stiffness, 0.0))
    return np.where(given & ~rooted, branches.swing_stiffness, series)


def _wood_flexibility(branches: Branches) -> np.ndarray:
    """Compute the bend of every joint without the root plate per moment [rad/(N·m)], (S,)."""
    middle = 0.5 * (branches.width + branches.tip_width)
    # Nothing bends at a tip that tapers to a point.
    tip = np.where(branches.tip_width > 0.0, branches.tip_width, middle)
    near, far = (_bend_of_half(branches, first, last)
                 for first, last in ((branches.width, middle), (middle, tip)))
    follows = (branches.parent >= 0) & ~branches.lateral
    return np.where(np.isnan(branches.swing_stiffness),
                    near + np.where(follows, far[branches.parent], 0.0),
                    1.0 / branches.swing_stiffness)


def wood_mass(branches: Branches) -> np.ndarray:
    """
    Compute the mass of every segment's wood, a frustum [kg], (S,).

    The centre of mass of a tapered segment lies below its middle. A segment that continues a
    branch gives as much of its mass to the segment below as keeps the branch's centre of mass:
    with it the first frequency of ten segments that taper to a tenth is 1.7 % low, without it
    3 %. One that widens takes as much from the segment below, at most a quarter of its mass.
    """
    first, last = branches.width, branches.tip_width
    square = first * first + first * last + last * last
    mass = branches.density * np.pi / 12.0 * branches.length * square
    # Of the length.
    below = 0.5 - (first * first + 2.0 * first * last + 3.0 * (last * last)) / (4.0 * square)
    follows = np.flatnonzero((branches.parent >= 0) & ~branches.lateral)
    parent = branches.parent[follows]
    apart = 0.5 * (branches.length[follows] + branches.length[parent])
    left = mass[follows] * below[follows] * branches.length[follows] / apart
    most = _MOST_TAKEN * mass
    taken = np.bincount(parent, np.maximum(-left, 0.0), len(mass))
    left *= np.where(left < 0.0, (most / np.maximum(taken, most))[parent], 1.0)
    mass[follows] -= left
    np.add.at(mass, parent, left)
    return mass


def _bend_of_half(branches: Branches, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Integrate 1/(E·I) over half a segment whose width goes from first to last [rad/(N·m)]."""
    # Of 1/d⁴.
    mean = (first * first + first * last + last * last) / (3.0 * power(first * last, 3.0))
    return 0.5 * branches.length * 64.0 / (np.pi * branches.modulus) * mean


def from_nodes(nodes: np.ndarray, parents: np.ndarray, radii: np.ndarray, *,
               density: Values = 900.0, modulus: Values = 8e9, strength: Values = 60e6,
               yield_stress: Values = np.inf, damping_ratio: Values = 0.05,
               swing_limit: Values = np.pi / 3.0,
               break_force: Values = np.inf, break_torque: Values = np.inf,
               bone_ratio: Values = 0.9, root_stiffness: Values = np.nan,
               root_moment: Values = np.inf, leaves: Leaves = _BARE, material: str = 'wood',
               textures: Sequence[str] = ('bark', 'leaf')) -> Blueprint:
    """
    Build a skeleton from points and their parents: one segment per node that has a parent.

    At a fork the thickest child continues the axis and starts as wide as the fork's node; every
    other child is a side branch and keeps its own width over its first segment. The physical
    values, see `Branches`, are those of green hardwood by default, each as one number or one per
    node, (K,), for the segment that ends there. `segments_of` returns the part of each node.

    :param nodes: points [m], (K, 3), in any order.
    :param parents: index of each node's parent, -1 for a node on the ground, (K,) int.
    :param radii: wood radius at the nodes [m], (K,).
    :param leaves: `part` is the node at the end of the segment that carries the leaf.
    :param textures: names that texture indices of leaves refer to; 0 is that of the wood.
    :raises SceneError: when a node is impossible; names the first one.
    """
    nodes, radii, parents = np.asarray(nodes, float), np.asarray(radii, float), np.asarray(parents)
    _check_nodes(nodes, parents, radii)
    segment = segments_of(parents)
    tip = np.argsort(segment, kind='stable')[np.count_nonzero(segment < 0):]
    wood = {name: _per_segment(name, value, tip, len(nodes)) for name, value in {
        'density': density, 'modulus': modulus, 'strength': strength,
        'yield_stress': yield_stress, 'bone_ratio': bone_ratio,
        'damping_ratio': damping_ratio, 'swing_limit': swing_limit, 'break_force': break_force,
        'break_torque': break_torque, 'root_stiffness': root_stiffness,
        'root_moment': root_moment}.items()}
    _demand((leaves.part >= 0) & (leaves.part < len(nodes)), 'leaf', 'node', leaves.part,
            f'from 0 to {len(nodes) - 1}')
    _demand(segment[leaves.part] >= 0, 'leaf', 'node', leaves.part, 'one that has a parent')
    return build(_grown(nodes, parents, radii, segment, tip, wood),
                 replace(leaves, part=segment[leaves.part].astype(np.int32)),
                 textures=textures, material=material)


def segments_of(parents: np.ndarray) -> np.ndarray:
    """
    Find the segment, and so the part, that ends at each node in `from_nodes`.

    Segments are in the order of these nodes, but after the segment that they grow from.

    :param parents: index of each node's parent, -1 for a node on the ground, (K,) int.
    :returns: segments, -1 for nodes without a parent, (K,).
    :raises SceneError: when nodes are their own ancestors; names the first one.
    """
    children: list[list[int]] = [[] for _ in parents]
    ready: list[int] = []
    for node, parent in enumerate(np.asarray(parents).tolist()):
        (ready if parent == GROUND else children[parent]).append(node)
    segment, count = np.full(len(children), GROUND), 0
    reached = np.zeros(len(children), bool)
    while ready:
        node = heappop(ready)
        reached[node] = True
        if parents[node] != GROUND:
            segment[node], count = count, count + 1
        for child in children[node]:
            heappush(ready, child)
    _demand(reached, 'node', 'parent', parents, 'a node that the ground is reached from')
    return segment


def _per_segment(name: str, value: Values, tip: np.ndarray, count: int) -> np.ndarray:
    """Return a value for each segment, from one for all or one for each node."""
    column = np.asarray(value, float)
    if column.shape not in ((), (count,)):
        raise SceneError(f'{name} has the shape {column.shape}; it must be one number, or one for '
                         f'each of the {count} nodes')
    return column[tip] if column.ndim else np.full(len(tip), column)


def _grown(nodes: np.ndarray, parents: np.ndarray, radii: np.ndarray, segment: np.ndarray,
           tip: np.ndarray, wood: dict[str, np.ndarray]) -> Branches:
    """Make the segments that end at nodes: `tip` of each, (S,), `segment` of each node, (K,)."""
    start = parents[tip]
    thickest_first = np.lexsort((tip, -radii[tip], start))
    lateral = np.ones(len(tip), bool)
    lateral[thickest_first[np.unique(start[thickest_first], return_index=True)[1]]] = False
    along = nodes[tip] - nodes[start]
    return Branches(
        parent=segment[start], lateral=lateral, base=nodes[start],
        attitude=shortest_turn(along), length=norm(along, axis=1),
        width=2.0 * radii[np.where(lateral, tip, start)], tip_width=2.0 * radii[tip], **wood)


def _hinges(branches: Branches) -> Hinges:
    def default(given: np.ndarray, value: np.ndarray | float) -> np.ndarray:
        return np.where(np.isnan(given), value, given)

    return Hinges(
        swing_limit=branches.swing_limit,
        swing_stiffness=bending_stiffness(branches),
        swing_damping=branches.swing_damping, damping_ratio=branches.damping_ratio,
        twist_stiffness=default(branches.twist_stiffness, np.inf),
        twist_damping=branches.twist_damping,
        stretch_stiffness=default(branches.stretch_stiffness, np.inf),
        stretch_damping=branches.stretch_damping, break_force=branches.break_force,
        break_torque=branches.break_torque, strength=branches.strength,
        yield_stress=branches.yield_stress,
        hardening=_TANGENT / (1.0 - _TANGENT) / _wood_flexibility(branches),
        root_moment=np.where(branches.parent < 0, branches.root_moment, np.inf),
        preload=branches.preload, cling=branches.cling * branches.length)


def shortest_turn(direction: np.ndarray) -> np.ndarray:
    """Compute the attitudes (S, 4) that rotate z to directions (S, 3) by the least angle."""
    x, y, z = (direction / norm(direction, axis=1, keepdims=True)).T
    q = np.column_stack([-y, x, np.zeros_like(x), 1.0 + z])
    q[1.0 + z < 1e-12] = (1.0, 0.0, 0.0, 0.0)  # straight down: any half turn will do
    return q / norm(q, axis=1, keepdims=True)


_ALLOWED: tuple[tuple[tuple[str, ...], Callable[[np.ndarray], np.ndarray], str], ...] = (
    (('length', 'width', 'density', 'modulus'), lambda v: np.isfinite(v) & (v > 0.0),
     'finite and above zero'),
    (('tip_width',), lambda v: v >= 0.0, 'zero or more'),
    (('bone_ratio',), lambda v: (v > 0.0) & (v <= 1.0), 'above 0 and at most 1'),
    (('strength', 'yield_stress', 'swing_limit', 'break_force', 'break_torque', 'root_moment'),
     lambda v: v > 0.0, 'above zero'),
    # NaN = derived from other values
    (('swing_stiffness',), lambda v: ~(v <= 0.0) & ~np.isinf(v), 'finite and above zero'),
    (('preload',), lambda v: (v >= 0.0) & (v <= 1.0), 'from 0 to 1'),
    (('twist_stiffness', 'stretch_stiffness', 'root_stiffness'), lambda v: ~(v <= 0.0),
     'above zero'),
    (('swing_damping', 'twist_damping', 'stretch_damping', 'damping_ratio'),
     lambda v: ~(v < 0.0) & ~np.isinf(v), 'finite and not below zero'),
    (('cling',), lambda v: np.isfinite(v) & (v >= 0.0), 'finite and not below zero'))


def _check(branches: Branches, leaves: Leaves, ornaments: Ornaments) -> None:
    """Check that values are physical, naming the first segment, leaf or ornament at fault."""
    index = np.arange(len(branches))
    _demand((branches.parent >= GROUND) & (branches.parent < index), 'segment', 'parent',
            branches.parent, 'an earlier segment, or -1 for the ground')
    for names, is_good, allowed in _ALLOWED:
        for name in names:
            value = getattr(branches, name)
            _demand(is_good(value), 'segment', name.replace('_', ' '), value, allowed)
    known = np.isnan(branches.swing_damping) & np.isnan(branches.damping_ratio)
    _demand(~known, 'segment', 'damping ratio', branches.damping_ratio,
            'given where swing damping is not')
    for name in ('base', 'attitude'):
        value = getattr(branches, name)
        _demand(np.isfinite(value).all(axis=1), 'segment', name, value, 'finite')
    _demand(np.isfinite(leaves.size) & (leaves.size >= 0.0), 'leaf', 'size', leaves.size,
            'finite and not below zero')
    _demand(np.isfinite(leaves.pose).all(axis=1), 'leaf', 'pose', leaves.pose, 'finite')
    for name, carried in (('leaf', leaves), ('ornament', ornaments)):
        _demand((carried.part >= 0) & (carried.part < len(branches)), name, 'part', carried.part,
                f'a segment, 0 to {len(branches) - 1}')


def _check_nodes(nodes: np.ndarray, parents: np.ndarray, radii: np.ndarray) -> None:
    if nodes.shape[1:] != (3,) or not nodes.shape[:1] == parents.shape == radii.shape:
        raise SceneError(f'nodes {nodes.shape}, parents {parents.shape} and radii {radii.shape} '
                         'do not fit; they must be (K, 3), (K,) and (K,)')
    _demand(np.isfinite(nodes).all(axis=1), 'node', 'position', nodes, 'finite')
    _demand(np.isfinite(radii) & (radii > 0.0), 'node', 'radius', radii, 'finite and above zero')
    if parents.dtype.kind not in 'iu':
        raise SceneError(f'parents are {parents.dtype} numbers, they must be whole ones')
    _demand((parents >= GROUND) & (parents < len(nodes)), 'node', 'parent', parents,
            f'a node, 0 to {len(nodes) - 1}, or -1 for the ground')
    apart = np.where(parents >= 0, norm(nodes - nodes[parents], axis=1), 1.0)
    _demand(apart > 0.0, 'node', 'distance from its parent', apart, 'above zero')


def _demand(good: np.ndarray, what: str, name: str, value: np.ndarray, allowed: str) -> None:
    if not good.all():
        first = int(np.argmin(good))
        raise SceneError(f'{what} {first}: {name} is {value[first]}, but must be {allowed}')
