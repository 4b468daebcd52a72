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
MJCF: a scene as a MuJoCo model; trees hang on sprung hinges, masonry is welded.

Mechanisms are trees of bodies with their joints, and constraints that close loops.
"""

from pathlib import Path
import xml.etree.ElementTree as ElementTree

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.blueprint import GROUND, JointType, Law, Shape
from procphys_ros.export.articulation import articulate, Articulation, CLAMPED, LOOSE
from procphys_ros.export.content import Content, Report
from procphys_ros.export.markup import child, text, write
from procphys_ros.export.mechanism_tree import mechanism_tree, MechanismTree, tell_left_out
from procphys_ros.geometry import rotation
from procphys_ros.physics.terrain import Terrain

_TIME_STEP = 0.002  # [s] longest; MuJoCo's own default
_STEPS_PER_RADIAN = 4.0  # of the fastest joint: MuJoCo steps springs explicitly
# Mortar: time constant [s] and damping ratio, two time steps; impedance so high that a wall of 24
# courses sinks by 5 µm (MuJoCo's default 0.9 lets it sink by 5 mm).
_WELD = {'solref': '0.004 1', 'solimp': '0.9999 0.9999 0.001'}
_THINNEST = 0.1  # [m] of hills, and of the base below the lowest point of a height field
_HINGE_WIDTH = 0.1  # [m] between the points of a hinge that closes a loop
_TREE, _SOLID = '2', '1'  # contact types: trees collide with solids, but not with each other
_NOTE = 'Units: m, kg, s, rad. Bodies sit at centres of mass; springs are preloaded by weight.'


def write_mjcf(content: Content, path: Path, report: Report) -> None:
    """
    Write a MuJoCo model.

    :param content: to write.
    :param path: file that ends in .xml.
    :param report: called as bodies are written.
    """
    joints = articulate(content)
    root = ElementTree.Element('mujoco', model=path.stem)
    child(root, 'compiler', angle='radian', autolimits='true')
    child(root, 'option', gravity=text(0.0, 0.0, -content.gravity), integrator='implicitfast',
          timestep=text(_time_step(content, joints)))
    defaults = child(root, 'default')
    child(child(defaults, 'default', class_='tree'), 'geom', contype=_TREE, conaffinity=_SOLID)
    child(child(defaults, 'default', class_='mortar'), 'equality', **_WELD)
    solid = child(defaults, 'default', class_='solid')
    child(solid, 'geom', contype=_SOLID, conaffinity=str(int(_SOLID) + int(_TREE)))
    assets = child(root, 'asset')
    for name in dict.fromkeys(content.textures):
        child(assets, 'material', name=name, rgba=text(*rgba(name)))
    world = child(root, 'worldbody')
    hulls = _hulls(content, assets)
    child(world, 'light', pos='0 0 50', dir='0 0.3 -1', directional='true')
    _ground(content.terrain, assets, world)
    bodies = _trees(content, joints, world)
    machine = mechanism_tree(content)
    _bricks(content, np.append(joints.part, machine.parts), world, report, hulls)
    _mechanisms(content, machine, world)
    contact = child(root, 'contact')
    for row in np.flatnonzero(joints.parent == CLAMPED):
        child(contact, 'exclude', body1='world', body2=bodies[row].attrib['name'])
    equality = child(root, 'equality')
    _welds(content, equality)
    _close(content, machine, equality, contact)
    tell_left_out(content, machine.loops, path, (JointType.SLIDER, JointType.ROPE))
    _motors(content, machine, root)
    write(root, path, _NOTE)


def _ground(terrain: Terrain, assets: ElementTree.Element, world: ElementTree.Element) -> None:
    """Write a plane, or a height field about the middle of its grid, rows from +y down."""
    shape = {'type_': 'plane', 'size': '0 0 1'}
    if not terrain.is_flat:
        columns, rows = terrain.heights.shape
        half = 0.5 * terrain.edge * np.array([columns - 1, rows - 1])
        bottom, top = terrain.bounds()
        child(assets, 'hfield', name='ground', nrow=str(rows), ncol=str(columns),
              size=text(*half, max(top - bottom, _THINNEST), _THINNEST),
              elevation=text(*terrain.heights.T[::-1].ravel()))
        shape = {'type_': 'hfield', 'hfield': 'ground', 'pos': text(*(terrain.low + half), bottom)}
    child(world, 'geom', name='ground', class_='solid', rgba=text(*rgba('ground')), **shape)


def _time_step(content: Content, joints: Articulation) -> float:
    """Choose a step [s] that resolves the fastest joint, moving its own segment only."""
    blueprint = content.blueprint
    across = blueprint.inertia[joints.part, 0] + blueprint.mass[joints.part] * joints.reach ** 2
    fastest = np.sqrt(np.max(joints.bend_x.stiffness / across, initial=0.0))
    return min(_TIME_STEP, 1.0 / (_STEPS_PER_RADIAN * fastest)) if fastest else _TIME_STEP


def _trees(content: Content, joints: Articulation,
           world: ElementTree.Element) -> list[ElementTree.Element]:
    """Nest the bodies of all trees; return them in the order of the rows."""
    bodies: list[ElementTree.Element] = []
    poses = content.poses[joints.part]
    for row, (part, parent) in enumerate(zip(joints.part, joints.parent)):
        outer = world if parent < 0 else bodies[parent]
        pose = poses[row] if parent < 0 else rotation.relative(poses[parent], poses[row])
        body = _body(content, int(part), pose, outer)
        if parent == LOOSE:
            child(body, 'freejoint')
        else:
            _hinges(joints, row, body)
        _geom(content, int(part), 'tree', body)
        bodies.append(body)
    return bodies


def _hinges(joints: Articulation, row: int, body: ElementTree.Element) -> None:
    """Add the degrees of freedom of a joint at their present values, outermost first."""
    turn = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), -joints.twist.value[row])
    tilt = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), -joints.bend_y.value[row])
    axes = {'bend_x': rotation.rotate(rotation.multiply(turn, tilt), np.array([1.0, 0.0, 0.0])),
            'bend_y': rotation.rotate(turn, np.array([0.0, 1.0, 0.0])),
            'twist': np.array([0.0, 0.0, 1.0]), 'slide': np.array([0.0, 0.0, 1.0])}
    for kind, axis in axes.items():
        springs = getattr(joints, kind)
        if np.isinf(springs.stiffness[row]):
            continue
        limits = {}
        if kind.startswith('bend') and joints.limit[row] < np.pi:
            limits = {'range': text(-joints.limit[row], joints.limit[row])}
        child(body, 'joint', name=f'{body.attrib["name"]}/{kind}',
              type_='slide' if kind == 'slide' else 'hinge', axis=text(*axis),
              pos=text(0.0, 0.0, -joints.reach[row]), stiffness=text(springs.stiffness[row]),
              damping=text(springs.damping[row]), ref=text(springs.value[row]),
              springref=text(springs.rest[row]), **limits)


def _hulls(content: Content, assets: ElementTree.Element) -> dict[int, str]:
    """Write the corners of hexahedra as meshes; return the mesh of each such part."""
    solids = content.blueprint.hexahedra
    names = {part: f'hull_{part}' for part in solids.part.tolist()}
    for name, corners in zip(names.values(), solids.corners.round(9)):
        child(assets, 'mesh', name=name, vertex=text(*corners), inertia='exact')
    return names


def _mechanisms(content: Content, machine: MechanismTree, world: ElementTree.Element) -> None:
    """Nest the bodies of mechanisms; a body without joints is welded to its parent."""
    joints, bodies = content.blueprint.joints, {GROUND: world}
    for part, own in zip(machine.parts.tolist(), machine.joint.tolist()):
        outer = GROUND if own < 0 else int(joints.parts[own, 0])
        pose = content.poses[part]
        if outer != GROUND:
            pose = rotation.relative(content.poses[outer], pose)
        bodies[part] = body = _body(content, part, pose, bodies[outer])
        if own < 0:
            child(body, 'freejoint')
        elif joints.kind[own] == JointType.BALL:
            child(body, 'joint', name=content.joint_names[own], type_='ball',
                  pos=text(*machine.seats[own, :3]))
        elif joints.kind[own] != JointType.WELD:
            _along(content, machine, own, body)
        _geom(content, part, 'solid', body)


def _along(content: Content, machine: MechanismTree, joint: int,
           body: ElementTree.Element) -> None:
    """Add a hinge or a slider at its present displacement."""
    table = content.blueprint.joints
    low, high = float(table.low[joint]), float(table.high[joint])
    limits = {'range': text(low, high)} if np.isfinite([low, high]).all() else {}
    child(body, 'joint', name=content.joint_names[joint],
          type_='hinge' if table.kind[joint] == JointType.HINGE else 'slide',
          axis=text(*machine.axis(joint)), pos=text(*machine.seats[joint, :3]),
          stiffness=text(table.stiffness[joint]), damping=text(table.damping[joint]),
          frictionloss=text(table.friction[joint]), ref=text(machine.value[joint]),
          springref=text(table.rest[joint]), **limits)


def _close(content: Content, machine: MechanismTree, equality: ElementTree.Element,
           contact: ElementTree.Element) -> None:
    """
    Close the loops of mechanisms by constraints, and let jointed bodies pass through each other.

    Hinges keep two points of their axis together. Sliders and ropes in loops are left out.
    """
    names, joints = content.full_names, content.blueprint.joints
    for joint in machine.loops.tolist():
        first, second = joints.parts[joint].tolist()
        ends = {'body1': names[second]} | ({} if first == GROUND else {'body2': names[first]})
        name, seat = content.joint_names[joint], machine.seats[joint, :3]
        kind = joints.kind[joint]
        if kind == JointType.WELD:
            child(equality, 'weld', name=name, anchor=text(*seat), **ends)
        elif kind in (JointType.BALL, JointType.HINGE):
            child(equality, 'connect', name=name, anchor=text(*seat), **ends)
        if kind == JointType.HINGE:
            child(equality, 'connect', name=f'{name}_axis', **ends,
                  anchor=text(*(seat + _HINGE_WIDTH * machine.axis(joint))))
        if not joints.collides[joint] and first != GROUND:
            child(contact, 'exclude', body1=names[first], body2=names[second])


def _motors(content: Content, machine: MechanismTree, root: ElementTree.Element) -> None:
    """Add an actuator for each motor, whose control is a force or moment [N], [N·m]."""
    effort = content.blueprint.joints.effort
    driven = [joint for joint in machine.joint.tolist() if joint >= 0 and effort[joint] > 0.0]
    if driven:
        actuator = child(root, 'actuator')
        for joint in driven:
            name = content.joint_names[joint]
            child(actuator, 'motor', name=name, joint=name,
                  ctrlrange=text(-effort[joint], effort[joint]))


def _bricks(content: Content, others: np.ndarray, world: ElementTree.Element,
            report: Report, hulls: dict[int, str]) -> None:
    """Add every part that is neither a branch nor jointed as a free body."""
    mine = content.exists.copy()
    mine[others] = False
    parts = np.flatnonzero(mine)
    for done, part in enumerate(parts.tolist(), 1):
        body = _body(content, part, content.poses[part], world)
        child(body, 'freejoint')
        _geom(content, part, 'solid', body, hulls.get(part, ''))
        report(done, len(parts))


def _welds(content: Content, equality: ElementTree.Element) -> None:
    """Weld unbroken mortar bonds; a weld can be cut at run time by `eq_active`."""
    names, anchors = content.full_names, content.bond_seats[0, :, :3]
    whole = content.holds & (content.blueprint.bond_law == Law.MORTAR)
    for bond in np.flatnonzero(whole).tolist():
        first, second = content.blueprint.bonds[bond]
        other = {} if first == GROUND else {'body2': names[first]}
        child(equality, 'weld', name=f'bond_{bond}', body1=names[second], class_='mortar',
              anchor=text(*anchors[bond]), **other)


def _body(content: Content, part: int, pose: np.ndarray,
          outer: ElementTree.Element) -> ElementTree.Element:
    blueprint = content.blueprint
    body = child(outer, 'body', name=content.full_names[part], pos=text(*pose[:3]),
                 quat=text(*pose[[6, 3, 4, 5]]))
    child(body, 'inertial', pos='0 0 0', mass=text(blueprint.mass[part]),
          diaginertia=text(*blueprint.inertia[part]))
    return body


def _geom(content: Content, part: int, group: str, body: ElementTree.Element,
          hull: str = '') -> None:
    blueprint = content.blueprint
    x, y, z = blueprint.solid_size(np.array([part]))[0]
    if hull:
        shape = {'type': 'mesh', 'mesh': hull}
    elif blueprint.shape[part] == Shape.BOX:
        shape = {'type': 'box', 'size': text(0.5 * x, 0.5 * y, 0.5 * z)}
    elif z > x:
        shape = {'type': 'capsule', 'size': text(0.5 * x, 0.5 * (z - x))}
    else:
        shape = {'type': 'sphere', 'size': text(0.5 * x)}
    child(body, 'geom', class_=group, material=content.textures[blueprint.texture[part]],
          **shape)
