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
Blueprint: parts and bonds, written by every grammar and read by all of the physics.

A blueprint holds *parts* (rigid bodies) and *bonds* (between two parts, or a part and the ground)
as flat numpy arrays. Row i of every part array is part i, for life.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from procphys_ros.blueprint.column_table import ColumnTable
from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.geometry import rotation
from procphys_ros.physics.air import SHEDDING_SPEED, VOGEL_EXPONENT

GROUND = -1  # stands in `Blueprint.bonds` for the ground
FASTEST = 1e5  # [m/s], [degrees/s] of motors: 17 000 revolutions per minute
BALLS = ('projectile', 'ball')  # kinds of parts that are balls


class Shape(ArrayEnum):
    """Shape of a part; its frame sits at the centre of mass."""

    CAPSULE = 0  # axis along the part's z; size = diameter, diameter, length over the round ends
    BOX = 1      # size = full extents along the part's x, y, z; see also `Hexahedra`


class Law(ArrayEnum):
    """How a bond resists and fails."""

    HINGE = 0   # elastic branch joint, row of `Blueprint.hinges`
    MORTAR = 1  # rigid until it breaks, row of `Blueprint.mortar`


class JointType(ArrayEnum):
    """Degrees of freedom that a joint of a mechanism fixes; numbered as the engine's."""

    WELD = 1    # all
    HINGE = 2   # all but rotation about the axis
    SLIDER = 3  # all but translation along the axis
    BALL = 4    # translation
    ROPE = 5    # distances beyond its length


def _column(dtype: type = float, width: int = 0, default: float | None = None):
    """Declare a column; one with a default is filled with it where it is not given."""
    shape = (0, width) if width else (0,)
    return field(default_factory=lambda: np.zeros(shape, dtype), metadata={'default': default})


class _FilledTable(ColumnTable):
    """Table that fills columns with their defaults."""

    def __post_init__(self) -> None:
        for column in fields(self):
            default = column.metadata['default']
            if default is not None and len(getattr(self, column.name)) < len(self):
                object.__setattr__(self, column.name, np.full(len(self), default))


@dataclass(frozen=True)
class Hinges(_FilledTable):
    """
    Elastic joints, one row per bond whose law is `Law.HINGE`, in the order of the bonds.

    The joint frame is the bond's frame: z along the child segment at rest, x and y the swing axes.

    :ivar swing_limit: largest bend [rad], (H,).
    :ivar swing_stiffness: bending spring [N·m/rad], (H,).
    :ivar swing_damping: bending damper [N·m·s/rad], (H,); NaN = from `damping_ratio`.
    :ivar damping_ratio: damping ratio of the lowest bending mode of the branch, (H,).
    :ivar twist_stiffness: torsion spring [N·m/rad], (H,); inf = locked.
    :ivar twist_damping: torsion damper [N·m·s/rad], (H,).
    :ivar stretch_stiffness: axial spring [N/m], (H,); inf = locked.
    :ivar stretch_damping: axial damper [N·s/m], (H,).
    :ivar break_force: transmitted force that destroys the joint [N], (H,); inf = never.
    :ivar break_torque: twisting moment that destroys the joint [N·m], (H,); inf = never.
    :ivar strength: bending stress that breaks the wood [Pa], (H,); inf = never.
    :ivar yield_stress: bending stress beyond which a part of the bend stays [Pa], (H,); inf =
        never.
    :ivar hardening: moment that a joint beyond its yield stress gains per bend that stays
        [N·m/rad], (H,).
    :ivar root_moment: moment that turns a root plate out of the ground [N·m], (H,); inf = never.
    :ivar preload: share of the weight carried that the joint's shape at rest allows for, (H,); 1 =
        the part rests where it was put, 0 = it was put there unloaded and sags.
    :ivar cling: force that pulls the part off its support [N], (H,); 0 = it does not climb.
    """

    swing_limit: np.ndarray = _column()
    swing_stiffness: np.ndarray = _column()
    swing_damping: np.ndarray = _column()
    damping_ratio: np.ndarray = _column()
    twist_stiffness: np.ndarray = _column()
    twist_damping: np.ndarray = _column()
    stretch_stiffness: np.ndarray = _column()
    stretch_damping: np.ndarray = _column()
    break_force: np.ndarray = _column()
    break_torque: np.ndarray = _column()
    strength: np.ndarray = _column()
    yield_stress: np.ndarray = _column(default=np.inf)
    hardening: np.ndarray = _column(default=0.0)
    root_moment: np.ndarray = _column()
    preload: np.ndarray = _column()
    cling: np.ndarray = _column(default=0.0)


@dataclass(frozen=True)
class Mortar(_FilledTable):
    """
    Brittle contacts, one row per bond whose law is `Law.MORTAR`, in the order of the bonds.

    The bond frame sits at the centroid of the contact patch, z along the normal from the first
    part to the second, x and y along the patch (`Blueprint.bond_extent`).

    :ivar tension: tensile strength [Pa], (K,).
    :ivar cohesion: shear strength without compression [Pa], (K,).
    :ivar friction: rise of shear strength with compression, (K,).
    :ivar compression: compressive strength [Pa], (K,).
    :ivar normal_stiffness: spring normal to the patch [Pa/m], (K,).
    :ivar shear_stiffness: spring along the patch [Pa/m], (K,).
    :ivar reinforcement: force at which the steel near one face of the section yields, over the
        area of the section [Pa], (K,); 0 = none.
    """

    tension: np.ndarray = _column()
    cohesion: np.ndarray = _column()
    friction: np.ndarray = _column()
    compression: np.ndarray = _column()
    normal_stiffness: np.ndarray = _column()
    shear_stiffness: np.ndarray = _column()
    reinforcement: np.ndarray = _column(default=0.0)


@dataclass(frozen=True)
class Leaves(_FilledTable):
    """
    Leaves fixed to parts: each is drawn as two crossed quads and takes wind by its area.

    :ivar part: part that carries the leaf, (L,) int.
    :ivar pose: petiole in the part's frame, z along the leaf, (L, 7).
    :ivar size: length of the quads [m], (L,).
    :ivar texture: index into `Blueprint.textures`, (L,) int.
    :ivar vogel: Vogel exponent V, drag goes with u^(2 + V) while leaves fold, (L,).
    :ivar shedding_speed: least wind that sheds the leaf, unless the scene changes it [m/s], (L,).
    """

    part: np.ndarray = _column(np.int32)
    pose: np.ndarray = _column(float, 7)
    size: np.ndarray = _column()
    texture: np.ndarray = _column(np.int16)
    vogel: np.ndarray = _column(default=VOGEL_EXPONENT)
    shedding_speed: np.ndarray = _column(default=SHEDDING_SPEED)


@dataclass(frozen=True)
class Ornaments(ColumnTable):
    """
    Triangles drawn with a part; the physics of polygons is in `leaf_area` and `mass`.

    :ivar part: part that carries the triangle, (T,) int.
    :ivar triangle: corners in the part's frame [m], (T, 9) as x y z three times.
    :ivar texture: index into `Blueprint.textures`, (T,) int.
    """

    part: np.ndarray = _column(np.int32)
    triangle: np.ndarray = _column(float, 9)
    texture: np.ndarray = _column(np.int16)


@dataclass(frozen=True)
class Hexahedra(ColumnTable):
    """
    Corners of boxes that are not rectangular: convex hexahedra, such as voussoirs.

    Code that ignores the corners treats the part as a box about its frame that contains it.

    :ivar part: the box, ascending, (H,) int.
    :ivar corners: in the part's frame [m], (H, 24) as x y z eight times; corner number i lies on
        the high side along x if i & 1, along y if i & 2, along z if i & 4. Some may coincide.
    """

    part: np.ndarray = _column(np.int32)
    corners: np.ndarray = _column(float, 24)

    def among(self, parts: np.ndarray) -> 'Hexahedra':
        """
        Select the hexahedra among some parts, renumbered by their places there.

        :param parts: indices, ascending, (K,).
        """
        if not len(self) or not len(parts):
            return Hexahedra()
        place = np.minimum(np.searchsorted(parts, self.part), len(parts) - 1)
        found = np.asarray(parts)[place] == self.part
        return Hexahedra(place[found].astype(np.int32), self.corners[found])

    def points(self, poses: np.ndarray) -> np.ndarray:
        """
        Compute the corners of placed parts [m], (H, 8, 3).

        :param poses: of all parts, (N, 7).
        """
        frames = poses[self.part, None]
        return frames[..., :3] + rotation.rotate(frames[..., 3:], self.corners.reshape(-1, 8, 3))


@dataclass(frozen=True)
class Joints(_FilledTable):
    """
    Joints between the loose parts of mechanisms, a row each; they are no bonds.

    Displacements are those of the second part against the first, along the axis [m] or about it
    [rad], 0 at rest; of a rope, its length.

    :ivar kind: `JointType`, (J,) uint8.
    :ivar parts: pairs of parts, (J, 2) int32; `GROUND` (-1) may stand first.
    :ivar frame: on the second part, in the frame of `Blueprint.poses`, x along the axis, (J, 7).
    :ivar anchor: the same point on the first part, in this frame [m], (J, 3); only ropes span a
        distance.
    :ivar low, high: least and greatest displacement [m], [rad], (J,); of ropes the second one.
    :ivar stiffness: of a spring [N/m], [N·m/rad], (J,).
    :ivar damping: [N·s/m], [N·m·s/rad], (J,).
    :ivar rest: displacement at which the spring is slack [m], [rad], (J,).
    :ivar friction: force or moment that friction bears [N], [N·m], (J,).
    :ivar speed: of a motor until it is driven [m/s], [rad/s], (J,).
    :ivar fastest: speed at which the motor approaches a displacement [m/s], [rad/s], (J,).
    :ivar effort: greatest force or moment of the motor [N], [N·m], (J,); 0 = it has none.
    :ivar force: that breaks the joint [N], (J,); inf = never.
    :ivar moment: that breaks the joint, about its point [N·m], (J,); inf = never.
    :ivar collides: whether the two parts collide, (J,) bool.
    :ivar name: index into `Blueprint.joint_names`, (J,) int32.
    :ivar zero: what is told and commanded as the displacement at rest [m], [rad], (J,).
    """

    kind: np.ndarray = _column(np.uint8)
    parts: np.ndarray = _column(np.int32, 2)
    frame: np.ndarray = _column(float, 7)
    anchor: np.ndarray = _column(float, 3)
    low: np.ndarray = _column()
    high: np.ndarray = _column()
    stiffness: np.ndarray = _column()
    damping: np.ndarray = _column()
    rest: np.ndarray = _column()
    friction: np.ndarray = _column()
    speed: np.ndarray = _column()
    fastest: np.ndarray = _column()
    effort: np.ndarray = _column()
    force: np.ndarray = _column()
    moment: np.ndarray = _column()
    collides: np.ndarray = _column(bool)
    name: np.ndarray = _column(np.int32)
    zero: np.ndarray = _column(default=0.0)


@dataclass(frozen=True)
class Plates(ColumnTable):
    """
    Flat parts that take the wind by its component along their normal.

    :ivar part: ascending, (P,) int.
    :ivar normal: axis of the part's frame, 0 to 2, (P,) uint8.
    :ivar area: that takes the wind [m²], (P,).
    """

    part: np.ndarray = _column(np.int32)
    normal: np.ndarray = _column(np.uint8)
    area: np.ndarray = _column()


@dataclass(frozen=True)
class Blueprint:
    """
    Parts and bonds of one or many objects, at rest.

    :ivar shape: `Shape` of each part, (N,) uint8.
    :ivar size: collision extents in the part's frame [m], (N, 3); for a capsule the bone.
    :ivar visual_size: drawn extents [m], (N, 3): for a capsule base diameter, tip diameter and
        full segment length; for a box its extents. Hexahedra are drawn by their corners.
    :ivar density: [kg/m³], (N,).
    :ivar mass: [kg], (N,).
    :ivar inertia: principal moments about the centre of mass, in the part's axes [kg·m²], (N, 3).
    :ivar poses: centre of mass and attitude, x y z qx qy qz qw [m], (N, 7).
    :ivar kind: index into `kinds`, (N,) int16.
    :ivar material: index into `materials`, (N,) int16.
    :ivar texture: index into `textures`, (N,) int16.
    :ivar leaf_area: one-sided area of leaves and polygons that catches wind [m²], (N,).
    :ivar bonds: pairs of parts, (M, 2) int32; `GROUND` (-1) may stand first. Branch joints name
        the parent first.
    :ivar bond_law: `Law` of each bond, (M,) uint8.
    :ivar bond_frame: contact pose in the frame of `poses` [m], (M, 7); see `Hinges`, `Mortar`.
    :ivar bond_extent: patch along the bond frame's x and y [m], (M, 2); hinges: diameter twice.
        Of a patch that is not rectangular, the sides of one with its second moments over its area.
    :ivar bond_area: [m²], (M,).
    :ivar hinges: one row per hinge bond, in bond order.
    :ivar mortar: one row per mortar bond, in bond order.
    :ivar leaves: leaves fixed to parts.
    :ivar ornaments: triangles drawn with parts.
    :ivar hexahedra: corners of boxes that are not rectangular.
    :ivar joints: between the parts of mechanisms.
    :ivar plates: flat parts of mechanisms.
    :ivar kinds, materials, textures, joint_names: names that the index columns refer to.
    """

    shape: np.ndarray = _column(np.uint8)
    size: np.ndarray = _column(float, 3)
    visual_size: np.ndarray = _column(float, 3)
    density: np.ndarray = _column()
    mass: np.ndarray = _column()
    inertia: np.ndarray = _column(float, 3)
    poses: np.ndarray = _column(float, 7)
    kind: np.ndarray = _column(np.int16)
    material: np.ndarray = _column(np.int16)
    texture: np.ndarray = _column(np.int16)
    leaf_area: np.ndarray = _column()
    bonds: np.ndarray = _column(np.int32, 2)
    bond_law: np.ndarray = _column(np.uint8)
    bond_frame: np.ndarray = _column(float, 7)
    bond_extent: np.ndarray = _column(float, 2)
    bond_area: np.ndarray = _column()
    hinges: Hinges = field(default_factory=Hinges)
    mortar: Mortar = field(default_factory=Mortar)
    leaves: Leaves = field(default_factory=Leaves)
    ornaments: Ornaments = field(default_factory=Ornaments)
    hexahedra: Hexahedra = field(default_factory=Hexahedra)
    joints: Joints = field(default_factory=Joints)
    plates: Plates = field(default_factory=Plates)
    kinds: tuple[str, ...] = ()
    materials: tuple[str, ...] = ()
    textures: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for names, rows, what in ((_PART_COLUMNS, self.shape, 'parts'),
                                  (_BOND_COLUMNS, self.bonds, 'bonds')):
            for name in names:
                if len(getattr(self, name)) != len(rows):
                    raise ValueError(f'{name} has {len(getattr(self, name))} rows for '
                                     f'{len(rows)} {what}')
        for law, table in ((Law.HINGE, self.hinges), (Law.MORTAR, self.mortar)):
            if np.count_nonzero(self.bond_law == law) != len(table):
                raise ValueError(f'{len(table)} {law.name.lower()} rows for '
                                 f'{np.count_nonzero(self.bond_law == law)} bonds of that law')

    def __len__(self) -> int:
        return len(self.shape)

    @property
    def balls(self) -> np.ndarray:
        """Mark balls, capsules as long as wide, (N,) bool."""
        round_ = np.array([kind in BALLS for kind in self.kinds] or [False])
        return round_[self.kind] & (self.shape == Shape.CAPSULE)

    def solid_size(self, parts: np.ndarray) -> np.ndarray:
        """
        Return the extents of parts in collisions with others [m], (K, 3), as `size`.

        Bones end before the joints, so that neighbours in a branch are free to bend. Other bodies
        must not find these gaps: here capsules reach from joint to joint.

        :param parts: indices, (K,).
        """
        out = self.size[parts]
        round_ = self.shape[parts] == Shape.CAPSULE
        out[round_, 2] = np.maximum(out[round_, 2], self.visual_size[parts][round_, 2])
        return out

    def placed(self, position: Sequence[float], yaw: float = 0.0) -> 'Blueprint':
        """
        Move the whole blueprint.

        :param position: of its origin [m], (3,).
        :param yaw: turn about the vertical [rad].
        """
        frame = np.concatenate([np.asarray(position, float), rotation.from_yaw(yaw)])
        joints = replace(self.joints, frame=rotation.compose(frame, self.joints.frame))
        return replace(self, poses=rotation.compose(frame, self.poses), joints=joints,
                       bond_frame=rotation.compose(frame, self.bond_frame))


_PART_COLUMNS = ('size', 'visual_size', 'density', 'mass', 'inertia', 'poses', 'kind', 'material',
                 'texture', 'leaf_area')
_BOND_COLUMNS = ('bond_law', 'bond_frame', 'bond_extent', 'bond_area')


def box_inertia(mass: np.ndarray, size: np.ndarray) -> np.ndarray:
    """
    Compute the principal moments of solid boxes [kg·m²], (N, 3).

    :param mass: [kg], (N,).
    :param size: full extents [m], (N, 3).
    """
    square = np.square(np.asarray(size, float))
    return np.asarray(mass)[:, None] / 12.0 * (square.sum(axis=1, keepdims=True) - square)


def cylinder_inertia(mass: np.ndarray, diameter: np.ndarray, length: np.ndarray) -> np.ndarray:
    """
    Compute the principal moments of solid cylinders along z [kg·m²], (N, 3).

    :param mass: [kg], (N,).
    :param diameter: [m], (N,).
    :param length: [m], (N,).
    """
    radius_square = np.square(0.5 * np.asarray(diameter, float))
    across = mass * (3.0 * radius_square + np.square(np.asarray(length, float))) / 12.0
    return np.column_stack([across, across, 0.5 * mass * radius_square])


def chain(blueprints: Sequence[Blueprint]) -> Blueprint:
    """
    Concatenate blueprints: parts, bonds and names renumbered, nothing else changed.

    :param blueprints: already placed, in the order of their parts.
    """
    if not blueprints:
        return Blueprint()
    columns: dict = {}
    for name in ('shape', *_PART_COLUMNS, *_BOND_COLUMNS):
        columns[name] = np.concatenate([getattr(b, name) for b in blueprints])
    starts = np.cumsum([0] + [len(b) for b in blueprints[:-1]])
    columns['bonds'] = _renumbered([b.bonds for b in blueprints], starts)
    for name, table in (('hinges', Hinges), ('mortar', Mortar), ('leaves', Leaves),
                        ('ornaments', Ornaments), ('hexahedra', Hexahedra), ('joints', Joints),
                        ('plates', Plates)):
        columns[name] = table.stack([getattr(b, name) for b in blueprints])
    columns['joints'] = replace(columns['joints'], parts=_renumbered(
        [b.joints.parts for b in blueprints], starts))
    for name in ('leaves', 'ornaments', 'hexahedra', 'plates'):
        part = np.concatenate([getattr(b, name).part + start
                               for b, start in zip(blueprints, starts)]).astype(np.int32)
        columns[name] = replace(columns[name], part=part)
    return Blueprint(**_merge_names(blueprints, columns))


def _renumbered(pairs: Sequence[np.ndarray], starts: np.ndarray) -> np.ndarray:
    """Add the number of its first part to the pairs of parts of each blueprint, (K, 2)."""
    return np.concatenate([np.where(own == GROUND, GROUND, own + start).astype(np.int32)
                           for own, start in zip(pairs, starts)])


def _merge_names(blueprints: Sequence[Blueprint], columns: dict) -> dict:
    """Map the index columns of several blueprints to common name tuples."""
    for names, table, column in (
            ('kinds', '', 'kind'), ('materials', '', 'material'), ('textures', '', 'texture'),
            ('textures', 'leaves', 'texture'), ('textures', 'ornaments', 'texture'),
            ('joint_names', 'joints', 'name')):
        common = tuple(dict.fromkeys(n for b in blueprints for n in getattr(b, names)))
        lookup = {name: i for i, name in enumerate(common)}
        owners = [getattr(b, table) if table else b for b in blueprints]
        number = np.int32 if names == 'joint_names' else np.int16
        merged = np.concatenate([
            np.array([lookup[n] for n in getattr(b, names)] or [0], number)[getattr(own, column)]
            for b, own in zip(blueprints, owners)])
        columns[names] = common
        if table:
            columns[table] = replace(columns[table], **{column: merged})
        else:
            columns[column] = merged
    return columns
