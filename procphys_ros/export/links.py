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

"""Links: trees as chains of revolute joints, as URDF and SDF know them."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.export.articulation import Articulation, CLAMPED, LOOSE
from procphys_ros.export.content import Content
from procphys_ros.export.markup import text
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import write_hulls

WORLD = 'world'
_X, _Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
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
    :ivar axis: of the hinge, in that frame, (3,); None = fixed.
    :ivar reach: from the joint to the centre of mass, along z [m].
    :ivar mass: [kg].
    :ivar inertia: about the centre of mass, in that frame [kg·m²], (3,).
    :ivar part: part for visual and collision; -1 = none.
    :ivar owner: name of its object.
    :ivar limits: smallest and largest angle from the present one [rad].
    :ivar stiffness: [N·m/rad].
    :ivar damping: [N·m·s/rad].
    :ivar rest: angle from the present one of the unloaded spring [rad].
    """

    name: str
    parent: str
    frame: np.ndarray
    axis: np.ndarray | None
    reach: float
    mass: float
    inertia: np.ndarray
    part: int
    owner: str
    limits: tuple[float, float] = (0.0, 0.0)
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0


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

    Tapered segments become cylinders of their middle diameter, along z.

    :param mesh: its file, see `meshes`; '' = none.
    """
    size = content.blueprint.visual_size[part]
    if mesh:
        return 'mesh', {'filename': mesh}
    if content.blueprint.shape[part] == Shape.BOX:
        return 'box', {'size': text(*size)}
    if content.balls[part]:
        return 'sphere', {'radius': text(0.5 * content.blueprint.size[part, 0])}
    return 'cylinder', {'radius': text(0.25 * (size[0] + size[1])), 'length': text(size[2])}


def tree_links(content: Content, joints: Articulation) -> Iterator[Link]:
    """
    Yield the links of all trees, two hinges per segment, parents first.

    Angles are relative to the present bends of the joints. Broken-off segments, and joints that
    the kernel does not bend, are fixed.
    """
    names = [content.full_names[part].replace('/', '_') for part in joints.part]
    for row, (part, parent) in enumerate(zip(joints.part.tolist(), joints.parent)):
        pose = content.poses[part]
        point = pose[:3] - joints.reach[row] * rotation.rotate(pose[3:], np.array([0., 0., 1.]))
        frame = np.concatenate([point, pose[3:]])
        above = WORLD if parent in (CLAMPED, LOOSE) else names[parent]
        owner = content.objects[content.owner[part]].name
        mass, inertia = content.blueprint.mass[part], content.blueprint.inertia[part]
        if parent == LOOSE or np.isinf(joints.bend_x.stiffness[row]):
            yield Link(names[row], above, frame, None, joints.reach[row], mass, inertia, part,
                       owner)
            continue
        for middle in (True, False):
            springs = joints.bend_x if middle else joints.bend_y
            now = springs.value[row]
            share = _MIDDLE_SHARE if middle else 1.0 - _MIDDLE_SHARE
            yield Link(
                f'{names[row]}_middle' if middle else names[row],
                above if middle else f'{names[row]}_middle', frame,
                _first_axis(joints, row) if middle else _Y, joints.reach[row], share * mass,
                share * inertia, -1 if middle else part, owner,
                (-joints.limit[row] - now, joints.limit[row] - now), springs.stiffness[row],
                springs.damping[row], springs.rest[row] - now)


def _first_axis(joints: Articulation, row: int) -> np.ndarray:
    """Return the axis of the first hinge in the frame rotated by the second."""
    back = rotation.from_axis_angle(_Y, -joints.bend_y.value[row])
    return rotation.rotate(back, _X)


def static_parts(content: Content, joints: Articulation) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name of every object with its parts (K,) that are not branches of trees."""
    rigid = content.exists.copy()
    rigid[joints.part] = False
    for number, owner in enumerate(content.objects):
        parts = np.flatnonzero(rigid & (content.owner == number))
        if len(parts):
            yield owner.name, parts
