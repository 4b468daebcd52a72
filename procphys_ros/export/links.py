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

"""Links: trees as chains of revolute joints and mechanisms with theirs, for URDF and SDF."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from procphys_ros.blueprint import GROUND, JointType, Shape
from procphys_ros.export.articulation import Articulation, CLAMPED, LOOSE
from procphys_ros.export.content import Content
from procphys_ros.export.markup import text
from procphys_ros.export.mechanism_tree import MechanismTree
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import write_hulls

WORLD = 'world'
_X, _Y, _Z = np.eye(3)
_KINDS = {JointType.WELD: 'fixed', JointType.HINGE: 'revolute', JointType.SLIDER: 'prismatic',
          JointType.BALL: 'ball'}
SPRUNG = ('revolute', 'continuous', 'prismatic')  # kinds of joints with one displacement
# Of the link between the two hinges of a joint, over its segment: no parser accepts links without
# mass, and the effect on a solver must be negligible.
_MIDDLE_SHARE = 1e-3


@dataclass(frozen=True)
class Link:
    """
    The link moved by one joint.

    :ivar name: unique in the scene.
    :ivar parent: name of the parent link, or `WORLD`.
    :ivar frame: present joint frame, world [m], (7,); the origin of the link.
    :ivar reach: centre of mass in that frame [m], (3,).
    :ivar mass: [kg].
    :ivar inertia: about the centre of mass, in that frame [kg·m²], (3,).
    :ivar part: part for visual and collision; -1 = none.
    :ivar owner: name of its object.
    :ivar joint: name of the joint.
    :ivar kind: of the joint in URDF, or 'ball'; those in `SPRUNG` have what follows.
    :ivar axis: in the joint frame, (3,).
    :ivar limits: smallest and largest displacement from the present one [rad], [m].
    :ivar stiffness: [N·m/rad], [N/m].
    :ivar damping: [N·m·s/rad], [N·s/m].
    :ivar rest: displacement from the present one of the unloaded spring [rad], [m].
    :ivar friction: [N·m], [N].
    :ivar effort: greatest moment or force of a motor [N·m], [N]; 0 = it has none.
    :ivar velocity: greatest speed of the motor [rad/s], [m/s].
    """

    name: str
    parent: str
    frame: np.ndarray
    reach: np.ndarray
    mass: float
    inertia: np.ndarray
    part: int
    owner: str
    joint: str
    kind: str = 'fixed'
    axis: np.ndarray = field(default_factory=lambda: _X)
    limits: tuple[float, float] = (-np.inf, np.inf)
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0
    friction: float = 0.0
    effort: float = np.inf
    velocity: float = np.inf

    @property
    def seat(self) -> np.ndarray:
        """Pose of its part in the joint frame [m], (7,)."""
        return np.concatenate([self.reach, rotation.IDENTITY])


def meshes(content: Content, path: Path) -> dict[int, str]:
    """
    Write existing hexahedra as mesh files in a folder, one for equal ones.

    :param path: of the exported file.
    :returns: mesh file of each such part, relative to the folder of `path`.
    """
    solids = content.blueprint.hexahedra
    folder = path.parent / f'{path.stem}_meshes'
    known: dict[bytes, str] = {}
    out = {}
    for part, corners in zip(solids.part.tolist(), solids.corners.round(6)):
        if not content.exists[part]:
            continue
        key = corners.tobytes()
        if key not in known:
            known[key] = f'{folder.name}/hexahedron_{len(known)}.obj'
            folder.mkdir(exist_ok=True)
            (path.parent / known[key]).write_text(write_hulls(corners.reshape(1, 8, 3)))
        out[part] = known[key]
    return out


def solid(content: Content, part: int, mesh: str = '') -> tuple[str, dict[str, str]]:
    """
    Return the shape of a part, 'mesh', 'box', 'sphere' or 'cylinder', and its sizes [m].

    Tapered segments become cylinders of their middle diameter, wheels flat ones, along z.

    :param mesh: its file, see `meshes`; '' = none.
    """
    size, width = content.blueprint.visual_size[part], content.blueprint.size[part, 0]
    if mesh:
        return 'mesh', {'filename': mesh}
    if content.blueprint.shape[part] == Shape.BOX:
        return 'box', {'size': text(*size)}
    if content.balls[part]:
        return 'sphere', {'radius': text(0.5 * width)}
    middle = 0.5 * (size[0] + size[1])  # of wheels their axle, which is drawn inside their skin
    return 'cylinder', {'radius': text(0.5 * (middle if middle >= 0.5 * width else width)),
                        'length': text(size[2])}


def tree_links(content: Content, joints: Articulation) -> Iterator[Link]:
    """
    Yield the links of all trees, two hinges per segment, parents first.

    Angles are relative to the present bends of the joints. Broken-off segments, and joints that
    the kernel does not bend, are fixed.
    """
    names = [content.full_names[part].replace('/', '_') for part in joints.part]
    for row, (part, parent) in enumerate(zip(joints.part.tolist(), joints.parent)):
        reach = np.array([0.0, 0.0, joints.reach[row]])
        above = WORLD if parent in (CLAMPED, LOOSE) else names[parent]
        whole = _link(content, part, reach, above, f'{names[row]}_joint')
        if parent == LOOSE or np.isinf(joints.bend_x.stiffness[row]):
            yield whole
            continue
        for middle in (True, False):
            springs = joints.bend_x if middle else joints.bend_y
            now = springs.value[row]
            hinge = replace(
                whole, kind='revolute', axis=_first_axis(joints, row) if middle else _Y,
                limits=(-joints.limit[row] - now, joints.limit[row] - now),
                stiffness=springs.stiffness[row], damping=springs.damping[row],
                rest=springs.rest[row] - now)
            if middle:
                yield massless(hinge, f'{names[row]}_middle')
            else:
                yield replace(hinge, parent=f'{names[row]}_middle', **_less(whole, 1))


def _link(content: Content, part: int, reach: np.ndarray, parent: str, joint: str) -> Link:
    """Make the link of a part, fixed at a point; its frame has the attitude of the part."""
    pose, blueprint = content.poses[part], content.blueprint
    frame = np.concatenate([pose[:3] - rotation.rotate(pose[3:], reach), pose[3:]])
    return Link(content.full_names[part].replace('/', '_'), parent, frame, reach,
                blueprint.mass[part], blueprint.inertia[part], part,
                content.objects[content.owner[part]].name, joint)


def massless(link: Link, name: str) -> Link:
    """Return a link of negligible mass between the hinges of a joint."""
    return replace(link, name=name, joint=f'{name}_joint', part=-1,
                   mass=_MIDDLE_SHARE * link.mass, inertia=_MIDDLE_SHARE * link.inertia)


def _less(link: Link, middles: int) -> dict[str, Any]:
    """Return what is left of mass and inertia beside the links between its hinges."""
    share = 1.0 - middles * _MIDDLE_SHARE
    return {'mass': share * link.mass, 'inertia': share * link.inertia}


def in_series(link: Link) -> Iterator[Link]:
    """Yield three hinges about x, y and z for a ball joint, and any other link as it is."""
    if link.kind != 'ball':
        yield link
        return
    hinge = replace(link, kind='continuous', effort=0.0)
    first, second = f'{link.name}_x', f'{link.name}_y'
    yield replace(massless(hinge, first), axis=_X)
    yield replace(massless(hinge, second), parent=first, axis=_Y)
    yield replace(hinge, parent=second, axis=_Z, **_less(link, 2))


def mechanism_links(content: Content, machine: MechanismTree) -> Iterator[Link]:
    """
    Yield the links of mechanisms, parents first; parts without a joint to an earlier one float.

    What hangs on masonry hangs on the world, as masonry is static.
    """
    standing = content.blueprint.bonds
    mine = ~np.isin(machine.parts, standing)
    for part, own in zip(machine.parts[mine].tolist(), machine.joint[mine].tolist()):
        if own < 0:
            link = _link(content, part, np.zeros(3), WORLD, '')
            yield replace(link, joint=f'{link.name}_joint', kind='floating')
        else:
            yield _jointed(content, machine, own)


def loop_links(content: Content, machine: MechanismTree) -> Iterator[Link]:
    """Yield the joints of mechanisms that close loops, but ropes, on the frames of their own."""
    for joint in machine.loops.tolist():
        if content.blueprint.joints.kind[joint] != JointType.ROPE:
            yield _jointed(content, machine, joint)


def _jointed(content: Content, machine: MechanismTree, row: int) -> Link:
    """Return the link of the second part of a joint, at that joint."""
    joints = content.blueprint.joints
    first, second = joints.parts[row].tolist()
    static = first == GROUND or (content.blueprint.bonds == first).any()
    above = WORLD if static else content.full_names[first].replace('/', '_')
    link = _link(content, second, -machine.seats[row, :3], above,
                 content.joint_names[row].replace('/', '_'))
    low, high = joints.low[row], joints.high[row]
    kind = _KINDS[joints.kind[row]]
    if kind == 'revolute' and np.isinf([low, high]).all():
        kind = 'continuous'
    if kind not in SPRUNG:
        return replace(link, kind=kind)
    now = machine.value[row]
    return replace(
        link, kind=kind, axis=machine.axis(row), limits=(low - now, high - now),
        stiffness=joints.stiffness[row], damping=joints.damping[row],
        rest=joints.rest[row] - now, friction=joints.friction[row], effort=joints.effort[row],
        velocity=joints.fastest[row])


def _first_axis(joints: Articulation, row: int) -> np.ndarray:
    """Return the axis of the first hinge in the frame rotated by the second."""
    back = rotation.from_axis_angle(_Y, -joints.bend_y.value[row])
    return rotation.rotate(back, _X)


def static_parts(content: Content, links: Sequence[Link]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name of every object with its parts (K,) that are no links of their own."""
    rigid = content.exists.copy()
    rigid[[link.part for link in links if link.part >= 0]] = False
    for number, owner in enumerate(content.objects):
        parts = np.flatnonzero(rigid & (content.owner == number))
        if len(parts):
            yield owner.name, parts
