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

"""URDF: a scene as one robot; trees are chains of revolute joints, everything else is fixed."""

from pathlib import Path
import xml.etree.ElementTree as ElementTree

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.export.articulation import articulate
from procphys_ros.export.content import Content, Report
from procphys_ros.export.links import Link, meshes, solid, static_parts, tree_links, WORLD
from procphys_ros.export.markup import child, roll_pitch_yaw, text, unlike, write
from procphys_ros.geometry import rotation

_UNLIMITED = 1e9  # [N·m], [rad/s]; URDF requires a bound
_NOTE = ('Units: m, kg, s, rad. Joint angles are 0 at the moment of the export. Springs stand in '
         'the gazebo elements; they are preloaded by weight.')


def write_urdf(content: Content, path: Path, report: Report) -> None:
    """
    Write a URDF robot with the world as root link.

    :param content: to write.
    :param path: file that ends in .urdf.
    :param report: called as links are written.
    """
    joints = articulate(content)
    robot = ElementTree.Element('robot', name=path.stem)
    for name in dict.fromkeys(content.textures):
        child(child(robot, 'material', name=name), 'color', rgba=text(*rgba(name)))
    child(robot, 'link', name=WORLD)
    frames = {WORLD: rotation.ORIGIN}
    links = list(tree_links(content, joints))
    for done, link in enumerate(links, 1):
        _link(content, link, robot)
        _joint(link, rotation.relative(frames[link.parent], link.frame), robot)
        frames[link.name] = link.frame
        report(done, len(links))
    files = meshes(content, path)
    for name, parts in static_parts(content, joints):
        name = unlike(name, frames)
        frames[name] = rotation.ORIGIN
        element = child(robot, 'link', name=name)
        for part in parts.tolist():
            _shape(content, part, content.poses[part], element, files.get(part, ''))
        _attach(name, rotation.ORIGIN, robot)
    write(robot, path, _NOTE)


def _link(content: Content, link: Link, robot: ElementTree.Element) -> None:
    element = child(robot, 'link', name=link.name)
    inertial = child(element, 'inertial')
    seat = np.concatenate([[0.0, 0.0, link.reach], rotation.IDENTITY])
    _origin(seat, inertial)
    child(inertial, 'mass', value=text(link.mass))
    child(inertial, 'inertia', ixy='0', ixz='0', iyz='0',
          **{key: text(value) for key, value in zip(('ixx', 'iyy', 'izz'), link.inertia)})
    if link.part >= 0:
        _shape(content, link.part, seat, element)


def _joint(link: Link, seat: np.ndarray, robot: ElementTree.Element) -> None:
    if link.axis is None:
        _attach(link.name, seat, robot, link.parent)
        return
    name = f'{link.name}_joint'
    joint = child(robot, 'joint', name=name, type_='revolute')
    _origin(seat, joint)
    child(joint, 'parent', link=link.parent)
    child(joint, 'child', link=link.name)
    child(joint, 'axis', xyz=text(*link.axis))
    child(joint, 'limit', lower=text(link.limits[0]), upper=text(link.limits[1]),
          effort=text(_UNLIMITED), velocity=text(_UNLIMITED))
    child(joint, 'dynamics', damping=text(link.damping), friction='0')
    spring = child(robot, 'gazebo', reference=name)  # read by sdformat's URDF parser
    child(spring, 'springStiffness', text(link.stiffness))
    child(spring, 'springReference', text(link.rest))


def _attach(name: str, seat: np.ndarray, robot: ElementTree.Element, parent: str = WORLD) -> None:
    """Fix a link to its parent."""
    joint = child(robot, 'joint', name=f'{name}_joint', type_='fixed')
    _origin(seat, joint)
    child(joint, 'parent', link=parent)
    child(joint, 'child', link=name)


def _shape(content: Content, part: int, pose: np.ndarray, link: ElementTree.Element,
           mesh: str = '') -> None:
    """Add visual and collision of a part at a pose in the frame of its link."""
    (form, sizes), name = solid(content, part, mesh), content.part_names[part]
    for use in ('visual', 'collision'):
        element = child(link, use, name=name)
        _origin(pose, element)
        child(child(element, 'geometry'), form, **sizes)
        if use == 'visual':
            blueprint = content.blueprint
            child(element, 'material', name=content.textures[blueprint.texture[part]])


def _origin(pose: np.ndarray, element: ElementTree.Element) -> None:
    child(element, 'origin', xyz=text(*pose[:3]), rpy=text(*roll_pitch_yaw(pose[3:])))
