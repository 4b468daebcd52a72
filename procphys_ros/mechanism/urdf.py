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

"""URDF: the links and joints of a robot, as parsed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path

import numpy as np

from procphys_ros.appearance.palette import LOOKS
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import eigen, norm, product
from procphys_ros.language import Place, shorten
from procphys_ros.language.mesh_file import read_mesh
from procphys_ros.mechanism.assembly import ACROSS
from procphys_ros.mechanism.elements import Element, read_xml

WORLD = 'world'  # name of a root link that is the ground
MOVING = ('revolute', 'continuous', 'prismatic')
_KINDS = (*MOVING, 'fixed', 'floating')
_SHAPES = ('box', 'cylinder', 'sphere', 'capsule', 'mesh')
_LEAST, _MOST = 1e-3, 1e3  # [m] of extents, as those of other mechanisms
_HEAVIEST = 1e7  # [kg]
_HARDEST = 1e12  # [N], [N·m]
_FREE = 1e5  # [m], [rad] limits beyond it are none
_SKIN = 5_000  # triangles of a mesh that are drawn; a larger one is drawn as its box
_MOMENTS = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


@dataclass(frozen=True)
class Inertial:
    """
    Mass of a link.

    :ivar mass: [kg].
    :ivar centre: in the frame of the link [m], (3,).
    :ivar tensor: about the centre, in the axes of the link [kg·m²], (3, 3).
    """

    mass: float
    centre: np.ndarray
    tensor: np.ndarray


@dataclass(frozen=True)
class Solid:
    """
    A shape of a link, as a part of a mechanism.

    :ivar kind: 'box', 'rod', 'ball' or 'wheel'.
    :ivar numbers: values of its keys.
    :ivar pose: of its centre in the frame of the link [m], (7,).
    :ivar texture: its look.
    :ivar skin: triangles that are drawn instead, in its frame [m], (T, 9); None = itself.
    """

    kind: str
    numbers: Mapping[str, tuple[float, ...]]
    pose: np.ndarray
    texture: str
    skin: np.ndarray | None = None


@dataclass(frozen=True)
class RobotLink:
    """A link: its mass, None = it has none, and its solids."""

    name: str
    element: Element
    inertial: Inertial | None
    solids: tuple[Solid, ...]


@dataclass(frozen=True)
class RobotJoint:
    """
    A joint.

    :ivar kind: one of those of URDF, or 'ball'.
    :ivar origin: in the frame of the parent at displacement 0 [m], (7,).
    :ivar axis: unit vector in its frame, (3,).
    :ivar limits: [rad], [m]; infinite ones are none.
    :ivar numbers: values of the keys of a joint of a mechanism.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray
    axis: np.ndarray
    limits: tuple[float, float]
    numbers: Mapping[str, tuple[float, ...]]
    element: Element


@dataclass(frozen=True)
class Robot:
    """Links and joints of a URDF, parents first; the first link is the root."""

    links: tuple[RobotLink, ...]
    joints: tuple[RobotJoint, ...]
    place: Place


def read_robot(text: str, source: str, folder: Path | None) -> Robot:
    """
    Read a URDF.

    :param source: name for errors.
    :param folder: of the file, for its meshes; None = there is none.
    :raises GrammarError: where the text is no URDF, or not one of ours.
    """
    root = read_xml(text, source)
    if root.tag != 'robot':
        raise root.error('a URDF begins with <robot>')
    _refuse_xacro(root)
    colours = {element.word('name'): element for element in root.all('material')}
    links = [_link(element, colours, folder) for element in root.all('link')]
    springs = _springs(root)
    joints = [_joint(element, springs) for element in root.all('joint')]
    _check_names(root, links, joints)
    return _in_order(root, links, joints)


def _refuse_xacro(root: Element) -> None:
    """Refuse a text that xacro has not been run on."""
    found = [root]
    while found:
        element = found.pop()
        found += element.children
        if element.tag.startswith('xacro:') or any('${' in word for word
                                                   in element.attributes.values()):
            raise element.error('is xacro, which is not read: run "xacro FILE > robot.urdf" first')


def _check_names(root: Element, links: Sequence[RobotLink], joints: Sequence[RobotJoint]) -> None:
    if not links:
        raise root.error('a robot needs a <link>')
    for things in (links, joints):
        seen: set[str] = set()
        for thing in things:
            if thing.name in seen:
                raise thing.element.error('there is another one of this name')
            seen.add(thing.name)
    known = {link.name for link in links}
    for joint in joints:
        for end in ('parent', 'child'):
            joint.element.need(end).choice('link', known, 'a link')


def _in_order(root: Element, links: Sequence[RobotLink], joints: Sequence[RobotJoint]) -> Robot:
    """Put parents before children; raise GrammarError unless the joints make one tree."""
    above: dict[str, RobotJoint] = {}
    below: dict[str, list[RobotJoint]] = {link.name: [] for link in links}
    for joint in joints:
        if joint.child in above:
            raise joint.element.error(f'the link "{shorten(joint.child, 80)}" is the child of '
                                      f'"{shorten(above[joint.child].name, 80)}" already')
        above[joint.child] = joint
        below[joint.parent].append(joint)
    roots = [link for link in links if link.name not in above]
    if len(roots) != 1:
        shown = ', '.join(shorten(link.name, 80) for link in roots[:5]) or 'none'
        raise root.error(f'a robot has one link that is no child of a joint, this one has '
                         f'{len(roots)}: {shown}')
    order, ordered = [roots[0].name], []
    for name in order:  # grows
        ordered += below[name]
        order += [joint.child for joint in below[name]]
    if len(order) < len(links):
        lost = next(link for link in links if link.name not in order)
        raise lost.element.error(f'no chain of joints leads to it from "{order[0]}"')
    by_name = {link.name: link for link in links}
    return Robot(tuple(by_name[name] for name in order), tuple(ordered), root.place)


def _link(element: Element, colours: Mapping[str, Element], folder: Path | None) -> RobotLink:
    shapes = element.all('collision') or element.all('visual')
    look = next((_look(visual.first('material'), colours) for visual in element.all('visual')),
                'steel')
    return RobotLink(element.word('name'), element, _inertial(element.first('inertial')),
                     tuple(_solid(shape, look, folder) for shape in shapes))


def _look(material: Element | None, colours: Mapping[str, Element]) -> str:
    """Return the texture called like a material, else the one nearest to its colour."""
    if material is None:
        return 'steel'
    name = material.attributes.get('name', '')
    if name in LOOKS:
        return name
    colour = material.first('color') or (colours[name].first('color') if name in colours else None)
    if colour is None:
        return 'steel'
    wanted = colour.numbers('rgba', 4)[:3]
    even = [name for name, look in LOOKS.items()
            if look.rgba[3] == 1.0 and look.pattern in ('plain', 'grain')]
    return min(even, key=lambda name: float(np.abs(wanted - LOOKS[name].rgba[:3]).sum()))


def _inertial(element: Element | None) -> Inertial | None:
    if element is None:
        return None
    mass = element.need('mass').number('value', 0.0, _HEAVIEST)
    if mass == 0.0:
        return None
    place, given = origin(element), element.need('inertia')
    xx, xy, xz, yy, yz, zz = (given.number(key, -_HARDEST, _HARDEST, 0.0 if len(set(key)) == 3
                                           else None) for key in _MOMENTS)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if eigen(tensor[None])[0].min() <= 0.0:
        raise given.error('its principal moments must be above 0')
    turn = rotation.to_matrix(place[3:])
    return Inertial(mass, place[:3], product(product(turn, tensor), turn.T))


def origin(element: Element) -> np.ndarray:
    """Return the pose of the `<origin>` of an element, (7,)."""
    found = element.first('origin')
    if found is None:
        return rotation.ORIGIN
    place = found.numbers('xyz', 3, 0.0)
    if np.abs(place).max() > _MOST:
        raise found.error(f'xyz="{found.word("xyz")}" must be from {-_MOST:g} to {_MOST:g} m')
    roll, pitch, yaw = (rotation.from_axis_angle(axis, angle) for axis, angle
                        in zip(np.eye(3), found.numbers('rpy', 3, 0.0)))
    return np.array([*place, *rotation.multiply(yaw, rotation.multiply(pitch, roll))])


def _solid(element: Element, look: str, folder: Path | None) -> Solid:
    """Read a visual or a collision."""
    place, geometry = origin(element), element.need('geometry')
    if len(geometry.children) != 1 or geometry.children[0].tag not in _SHAPES:
        raise geometry.error(f'needs one of {", ".join(f"<{shape}>" for shape in _SHAPES)}')
    shape = geometry.children[0]
    if shape.tag == 'mesh':
        return _mesh(shape, place, look, folder)
    if shape.tag == 'box':
        size = shape.numbers('size', 3)
        _check_size(shape, 'size', size)
        return Solid('box', {'size': tuple(size)}, place, look)
    diameter = 2.0 * shape.number('radius', 0.5 * _LEAST, 0.5 * _MOST)
    if shape.tag == 'sphere':
        return Solid('ball', {'diameter': (diameter,)}, place, look)
    length = shape.number('length', 0.0 if shape.tag == 'capsule' else _LEAST, _MOST)
    if shape.tag == 'capsule':
        length += diameter
    if length >= diameter:
        return Solid('rod', {'diameter': (diameter,), 'from': (0.0, 0.0, 0.0),
                             'to': (0.0, 0.0, length)}, place, look)
    upright = np.array([*place[:3], *rotation.multiply(place[3:], rotation.conjugate(ACROSS))])
    return Solid('wheel', {'diameter': (diameter,), 'width': (length,)}, upright, look)


def _check_size(element: Element, key: str, size: np.ndarray) -> None:
    if not ((size >= _LEAST) & (size <= _MOST)).all():
        shown = ' '.join(f'{x:g}' for x in size)
        raise element.error(f'{key}="{shown}" must be from {_LEAST:g} to {_MOST:g} m each')


def _mesh(element: Element, place: np.ndarray, look: str, folder: Path | None) -> Solid:
    """Return the box around a mesh, drawn as the mesh."""
    name = element.word('filename')
    path = _mesh_file(element, name, folder)
    try:
        corners = read_mesh(str(path), 'filename')
    except SceneError as problem:
        raise element.error(str(problem)) from None
    corners = corners * element.numbers('scale', 3, 1.0)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = np.maximum(high - low, _LEAST)
    _check_size(element, 'scale', size)
    middle = 0.5 * (low + high)
    skin = (corners - middle).reshape(-1, 9) if len(corners) <= _SKIN else None
    return Solid('box', {'size': tuple(size)},
                 rotation.compose(place, np.array([*middle, *rotation.IDENTITY])), look, skin)


def _mesh_file(element: Element, name: str, folder: Path | None) -> Path:
    """Find the file of a mesh: beside the URDF, or in the ROS package that it names."""
    if folder is None and not os.path.isabs(name.removeprefix('file://')):
        raise element.error(f'filename="{shorten(name)}": a robot given as text has no meshes')
    if not name.startswith('package://'):
        return Path(folder or '/', name.removeprefix('file://'))
    package, _, inside = name.removeprefix('package://').partition('/')
    above = [one for one in (folder, *folder.parents) if one.name == package] if folder else []
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    shares = [Path(prefix, 'share', package) for prefix in prefixes if prefix]
    candidates = [one / inside for one in (*above, *shares)]
    if not candidates:
        raise element.error(f'filename="{shorten(name)}": there is no package '
                            f'"{shorten(package, 80)}" above this file or in AMENT_PREFIX_PATH')
    return next((path for path in candidates if path.is_file()), candidates[0])


def _springs(root: Element) -> dict[str, tuple[float, float]]:
    """Read the springs of joints, stiffness and rest, which stand in elements for Gazebo."""
    out = {}
    for element in root.all('gazebo'):
        stiffness = element.first('springStiffness')
        if 'reference' in element.attributes and stiffness is not None:
            rest = element.first('springReference')
            out[element.word('reference')] = (
                _content(stiffness), 0.0 if rest is None else _content(rest))
    return out


def _content(element: Element) -> float:
    """Return the number that an element holds."""
    inner = Element(element.tag, {'its content': element.text}, element.place)
    return inner.number('its content', -_HARDEST, _HARDEST)


def _joint(element: Element, springs: Mapping[str, tuple[float, float]]) -> RobotJoint:
    name, kind = element.word('name'), element.word('type')
    if kind == 'planar':
        raise element.error(f'planar joints are not there ({", ".join(_KINDS)})')
    element.choice('type', _KINDS, 'a type of joints')
    parent, child = (element.need(end).word('link') for end in ('parent', 'child'))
    if kind == 'floating' and parent != WORLD:
        raise element.error('a floating joint is there between "world" and a link only: a robot '
                            'without it is free')
    if (mimic := element.first('mimic')) is not None:
        mimic.place.warn(f'mimic is left out: the joint "{shorten(name, 80)}" moves by itself')
    axis = np.array([1.0, 0.0, 0.0])
    if kind in MOVING and (given := element.first('axis')) is not None:
        axis = given.numbers('xyz', 3)
        if norm(axis) < 1e-9:
            raise given.error(f'xyz="{given.word("xyz")}" has no direction')
        axis = axis / norm(axis)
    limits, numbers = _dynamics(element, kind)
    spring = springs.get(name, (0.0, 0.0))
    if kind in MOVING and spring[0]:
        numbers['spring'] = spring
    return RobotJoint(name, kind, parent, child, origin(element), axis, limits, numbers, element)


def _dynamics(element: Element, kind: str) -> tuple[tuple[float, float],
                                                    dict[str, tuple[float, ...]]]:
    """Read limits, damping, friction and motor of a joint."""
    low, high = -np.inf, np.inf
    numbers: dict[str, tuple[float, ...]] = {}
    limit, dynamics = element.first('limit'), element.first('dynamics')
    if kind in ('revolute', 'prismatic'):
        limit = element.need('limit')
        low = limit.number('lower', -_HARDEST, _HARDEST, 0.0)
        high = limit.number('upper', -_HARDEST, _HARDEST, 0.0)
        if low > high:
            raise limit.error(f'lower="{low:g}" must not be above upper="{high:g}"')
    if kind in MOVING and limit is not None:
        numbers['motor'] = (0.0, limit.number('effort', 0.0, _HARDEST),
                            limit.number('velocity', 0.0, _HARDEST))
    if kind in MOVING and dynamics is not None:
        numbers['damper'] = (dynamics.number('damping', 0.0, _HARDEST, 0.0),)
        numbers['friction'] = (dynamics.number('friction', 0.0, _HARDEST, 0.0),)
    bounds = (low if low > -_FREE else -np.inf, high if high < _FREE else np.inf)
    return bounds, numbers
