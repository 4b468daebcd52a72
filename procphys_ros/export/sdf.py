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

"""SDF: a scene as a Gazebo world; trees are chains of sprung joints, everything else is static."""

from pathlib import Path
import xml.etree.ElementTree as ElementTree

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.export.articulation import articulate
from procphys_ros.export.content import Content, Report
from procphys_ros.export.links import Link, meshes, solid, static_parts, tree_links, WORLD
from procphys_ros.export.markup import child, roll_pitch_yaw, text, unlike, write
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
    links = list(tree_links(content, joints))
    for done, link in enumerate(links, 1):
        if link.owner not in models:
            models[link.owner] = _tree_model(_new(link.owner, taken), world)
        _link(content, link, models[link.owner])
        _joint(link, models[link.owner])
        report(done, len(links))
    files = meshes(content, path)
    for name, parts in static_parts(content, joints):
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


def _tree_model(name: str, world: ElementTree.Element) -> ElementTree.Element:
    """
    Begin a model whose base is fixed to the world.

    The joint is in the world, because PyBullet has no joints to the world inside models.
    """
    model = child(world, 'model', name=name)
    inertial = child(child(model, 'link', name=_BASE), 'inertial')
    child(inertial, 'mass', text(_BASE_MASS))
    inertia = child(inertial, 'inertia')
    for key in ('ixx', 'iyy', 'izz'):
        child(inertia, key, text(_BASE_MASS))
    anchor = child(world, 'joint', name=f'{name}_anchor', type_='fixed')
    child(anchor, 'parent', WORLD)
    child(anchor, 'child', f'{name}::{_BASE}')
    return model


def _link(content: Content, link: Link, model: ElementTree.Element) -> None:
    element = child(model, 'link', name=link.name)
    _pose(link.frame, element)
    inertial = child(element, 'inertial')
    seat = np.concatenate([[0.0, 0.0, link.reach], rotation.IDENTITY])
    _pose(seat, inertial)
    child(inertial, 'mass', text(link.mass))
    inertia = child(inertial, 'inertia')
    values = zip(('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'),
                 (link.inertia[0], 0.0, 0.0, link.inertia[1], 0.0, link.inertia[2]))
    for key, value in values:
        child(inertia, key, text(value))
    if link.part >= 0:
        _shape(content, link.part, seat, element)


def _joint(link: Link, model: ElementTree.Element) -> None:
    joint = child(model, 'joint', name=f'{link.name}_joint',
                  type_='fixed' if link.axis is None else 'revolute')
    child(joint, 'parent', _BASE if link.parent == WORLD else link.parent)
    child(joint, 'child', link.name)
    if link.axis is None:
        return
    axis = child(joint, 'axis')
    child(axis, 'xyz', text(*link.axis))
    limit = child(axis, 'limit')
    child(limit, 'lower', text(link.limits[0]))
    child(limit, 'upper', text(link.limits[1]))
    dynamics = child(axis, 'dynamics')
    child(dynamics, 'damping', text(link.damping))
    child(dynamics, 'spring_reference', text(link.rest))
    child(dynamics, 'spring_stiffness', text(link.stiffness))


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
