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
URDF: a scene as one robot; trees are chains of revolute joints, mechanisms have their joints.

Everything else is fixed.
"""

from pathlib import Path
import xml.etree.ElementTree as ElementTree

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.export.articulation import articulate
from procphys_ros.export.content import Content, Report
from procphys_ros.export.links import (
    in_series,
    Link,
    mechanism_links,
    meshes,
    solid,
    SPRUNG,
    static_parts,
    tree_links,
    WORLD,
)
from procphys_ros.export.markup import child, roll_pitch_yaw, text, unlike, write
from procphys_ros.export.mechanism_tree import mechanism_tree, tell_left_out
from procphys_ros.geometry import rotation

_UNLIMITED = 1e9  # [N·m], [N], [rad], [m], [rad/s], [m/s]; URDF requires a bound
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
    machine = mechanism_tree(content)
    tell_left_out(content, machine.loops, path)
    links = [*tree_links(content, joints),
             *(part for link in mechanism_links(content, machine) for part in in_series(link))]
    for done, link in enumerate(links, 1):
        _link(content, link, robot)
        _joint(link, rotation.relative(frames[link.parent], link.frame), robot)
        frames[link.name] = link.frame
        report(done, len(links))
    files = meshes(content, path)
    for name, parts in static_parts(content, links):
        name = unlike(name, frames)
        frames[name] = rotation.ORIGIN
        element = child(robot, 'link', name=name)
        for part in parts.tolist():
            _shape(content, part, content.poses[part], element, files.get(part, ''))
        _begin_joint(f'{name}_joint', 'fixed', rotation.ORIGIN, (WORLD, name), robot)
    write(robot, path, _NOTE)


def _link(content: Content, link: Link, robot: ElementTree.Element) -> None:
    element = child(robot, 'link', name=link.name)
    inertial = child(element, 'inertial')
    _origin(link.seat, inertial)
    child(inertial, 'mass', value=text(link.mass))
    child(inertial, 'inertia', ixy='0', ixz='0', iyz='0',
          **{key: text(value) for key, value in zip(('ixx', 'iyy', 'izz'), link.inertia)})
    if link.part >= 0:
        _shape(content, link.part, link.seat, element)


def _joint(link: Link, seat: np.ndarray, robot: ElementTree.Element) -> None:
    joint = _begin_joint(link.joint, link.kind, seat, (link.parent, link.name), robot)
    if link.kind not in SPRUNG:
        return
    child(joint, 'axis', xyz=text(*link.axis))
    low, high, effort, velocity = np.clip([*link.limits, link.effort, link.velocity], -_UNLIMITED,
                                          _UNLIMITED)
    bounds = {} if link.kind == 'continuous' else {'lower': text(low), 'upper': text(high)}
    child(joint, 'limit', effort=text(effort), velocity=text(velocity), **bounds)
    child(joint, 'dynamics', damping=text(link.damping), friction=text(link.friction))
    if link.stiffness > 0.0:
        spring = child(robot, 'gazebo', reference=link.joint)  # read by sdformat's URDF parser
        child(spring, 'springStiffness', text(link.stiffness))
        child(spring, 'springReference', text(link.rest))


def _begin_joint(name: str, kind: str, seat: np.ndarray, ends: tuple[str, str],
                 robot: ElementTree.Element) -> ElementTree.Element:
    """Join two links, parent and child."""
    joint = child(robot, 'joint', name=name, type_=kind)
    _origin(seat, joint)
    child(joint, 'parent', link=ends[0])
    child(joint, 'child', link=ends[1])
    return joint


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
