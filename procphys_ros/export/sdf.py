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
SDF: a scene as a Gazebo world; trees are chains of sprung joints, mechanisms have their joints.

Everything else is static.
"""

from dataclasses import replace
from pathlib import Path
import xml.etree.ElementTree as ElementTree

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.blueprint import JointType
from procphys_ros.export.articulation import articulate
from procphys_ros.export.content import Content, Report
from procphys_ros.export.links import (
    Link,
    loop_links,
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
from procphys_ros.physics.terrain import Terrain

_VERSION = '1.10'  # of Gazebo Garden and later: joints between a model and the world
_GROUND = 500.0  # [m] edge of the ground as drawn; collisions reach farther
_BASE = 'base'       # link of a model that its trees stand on, fixed to the world
_BASE_MASS = 1.0     # [kg], without any effect
_NOTE = 'Units: m, kg, s, rad. Joint angles are 0 at the moment of the export.'


def write_sdf(content: Content, path: Path, report: Report) -> None:
    """
    Write a world with one model per object, trees separate from rigid parts.

    :param content: to write.
    :param path: file that ends in .sdf.
    :param report: called as links are written.
    """
    joints = articulate(content)
    root = ElementTree.Element('sdf', version=_VERSION)
    world = child(root, 'world', name=path.stem)
    child(world, 'gravity', text(0.0, 0.0, -content.gravity))
    _ground(world, content.terrain, path)
    models: dict[str, ElementTree.Element] = {}
    taken = {WORLD, 'ground'}
    machine = mechanism_tree(content)
    tell_left_out(content, machine.loops, path, (JointType.ROPE,))
    links = [*tree_links(content, joints), *mechanism_links(content, machine)]
    frames = {link.name: link.frame for link in links}
    for done, link in enumerate(links, 1):
        if link.owner not in models:
            models[link.owner] = child(world, 'model', name=_new(link.owner, taken))
        _link(content, link, models[link.owner])
        report(done, len(links))
    names = {_BASE, *frames}  # links and joints of a model have different ones
    for link in (*links, *loop_links(content, machine)):
        seat = rotation.relative(frames[link.name], link.frame)
        joint = unlike(link.joint, names)
        names.add(joint)
        _joint(replace(link, joint=joint), seat, models[link.owner], world)
    files = meshes(content, path)
    for name, parts in static_parts(content, links):
        model = child(world, 'model',
                      name=_new(f'{name}_rigid' if name in models else name, taken))
        child(model, 'static', 'true')
        element = child(model, 'link', name='parts')
        for part in parts.tolist():
            _shape(content, part, content.poses[part], element, files.get(part, ''))
    write(root, path, _NOTE)


def _new(name: str, taken: set[str]) -> str:
    """Return an unused model name."""
    name = unlike(name, taken)
    taken |= {name, f'{name}_anchor'}
    return name


def _ground(world: ElementTree.Element, terrain: Terrain, path: Path) -> None:
    """Write a plane, or a mesh in a separate file."""
    model = child(world, 'model', name='ground')
    child(model, 'static', 'true')
    link = child(model, 'link', name='plane')
    for use in ('visual', 'collision'):
        element = child(link, use, name=use)
        if terrain.is_flat:
            plane = child(child(element, 'geometry'), 'plane')
            child(plane, 'normal', '0 0 1')
            child(plane, 'size', text(_GROUND, _GROUND))
        else:
            child(child(child(element, 'geometry'), 'mesh'), 'uri', _hills(terrain, path).name)
        if use == 'visual':
            _material('ground', element)


def _hills(terrain: Terrain, path: Path) -> Path:
    """Write the mesh of a terrain to a separate file, and return its path."""
    points, triangles = terrain.mesh()
    lines = [f'v {x:.6g} {y:.6g} {z:.6g}' for x, y, z in points.tolist()]
    lines += [f'f {a} {b} {c}' for a, b, c in (triangles + 1).tolist()]
    file = path.with_name(f'{path.stem}_ground.obj')
    file.write_text('\n'.join(lines) + '\n', encoding='ascii')
    return file


def _base(model: ElementTree.Element, world: ElementTree.Element) -> str:
    """
    Return the link of a model that is fixed to the world, made if there is none yet.

    The joint is in the world, because PyBullet has no joints to the world inside models.
    """
    name = model.attrib['name']
    if model[0].attrib['name'] != _BASE:  # roots come first
        link = ElementTree.Element('link', name=_BASE)
        model.insert(0, link)
        inertial = child(link, 'inertial')
        child(inertial, 'mass', text(_BASE_MASS))
        inertia = child(inertial, 'inertia')
        for key in ('ixx', 'iyy', 'izz'):
            child(inertia, key, text(_BASE_MASS))
        anchor = child(world, 'joint', name=f'{name}_anchor', type_='fixed')
        child(anchor, 'parent', WORLD)
        child(anchor, 'child', f'{name}::{_BASE}')
    return _BASE


def _link(content: Content, link: Link, model: ElementTree.Element) -> None:
    element = child(model, 'link', name=link.name)
    _pose(link.frame, element)
    inertial = child(element, 'inertial')
    _pose(link.seat, inertial)
    child(inertial, 'mass', text(link.mass))
    inertia = child(inertial, 'inertia')
    values = zip(('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'),
                 (link.inertia[0], 0.0, 0.0, link.inertia[1], 0.0, link.inertia[2]))
    for key, value in values:
        child(inertia, key, text(value))
    if link.part >= 0:
        _shape(content, link.part, link.seat, element)


def _joint(link: Link, seat: np.ndarray, model: ElementTree.Element,
           world: ElementTree.Element) -> None:
    """Write a joint at its pose in the frame of the link."""
    if link.kind == 'floating':
        return
    joint = child(model, 'joint', name=link.joint,
                  type_='revolute' if link.kind == 'continuous' else link.kind)
    if seat[:3].any():
        _pose(seat, joint)
    child(joint, 'parent', _base(model, world) if link.parent == WORLD else link.parent)
    child(joint, 'child', link.name)
    if link.kind not in SPRUNG:
        return
    axis = child(joint, 'axis')
    child(axis, 'xyz', text(*link.axis))
    limit = child(axis, 'limit')
    for key, value in (('lower', link.limits[0]), ('upper', link.limits[1]),
                       ('effort', link.effort or np.inf), ('velocity', link.velocity)):
        if np.isfinite(value):
            child(limit, key, text(value))
    dynamics = child(axis, 'dynamics')
    for key, value in (('damping', link.damping), ('friction', link.friction),
                       ('spring_reference', link.rest), ('spring_stiffness', link.stiffness)):
        child(dynamics, key, text(value))


def _shape(content: Content, part: int, pose: np.ndarray, link: ElementTree.Element,
           mesh: str = '') -> None:
    """Add visual and collision of a part at a pose in the frame of its link."""
    form, sizes = solid(content, part, mesh)
    for use in ('visual', 'collision'):
        element = child(link, use, name=f'{content.part_names[part]}_{use}')
        _pose(pose, element)
        shape = child(child(element, 'geometry'), form)
        for key, value in sizes.items():
            child(shape, 'uri' if key == 'filename' else key, value)
        if use == 'visual':
            _material(content.textures[content.blueprint.texture[part]], element)


def _material(texture: str, visual: ElementTree.Element) -> None:
    material = child(visual, 'material')
    for kind in ('ambient', 'diffuse'):
        child(material, kind, text(*rgba(texture)))


def _pose(pose: np.ndarray, element: ElementTree.Element) -> None:
    child(element, 'pose', text(*pose[:3], *roll_pitch_yaw(pose[3:])))
