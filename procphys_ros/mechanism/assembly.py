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

"""Assembly: from the parts and joints that rules wrote to a blueprint."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from procphys_ros.appearance.unit_meshes import round_skin
from procphys_ros.blueprint import (
    Blueprint,
    box_inertia,
    cylinder_inertia,
    Joints,
    JointType,
    Ornaments,
    Plates,
    Shape,
)
from procphys_ros.elementary import cos, sin
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.mechanism.derivation import WrittenJoint, WrittenPart
from procphys_ros.wallgrammar.materials import Material, texture_numbers

_USUAL = {'box': 'timber', 'plate': 'timber', 'rod': 'steel', 'ball': 'steel', 'wheel': 'timber'}
ACROSS = np.array([-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # z of a wheel's part along its axle
_CORE = 0.55  # of a ball's diameter, edge of the box drawn inside its round skin
_HIDDEN = 1e-3  # of a part's extents, those of the box drawn inside its own skin
_AXLE = 0.3  # of a wheel's diameter, that of the axle drawn inside its skin
_SIDES = 24  # of the skin of a wheel


def usual_material(part: WrittenPart) -> str:
    """Return the material of a part, that of its kind unless it names one."""
    return part.material or _USUAL[part.kind]


def assemble(parts: Sequence[WrittenPart], joints: Sequence[WrittenJoint],
             materials: Mapping[str, Material]) -> Blueprint:
    """
    Assemble the blueprint of a mechanism.

    :param materials: by name.
    """
    names, kinds = tuple(materials), tuple(dict.fromkeys(_kind(part) for part in parts))
    textures, texture = texture_numbers(materials)
    made = [materials[usual_material(part)] for part in parts]
    sizes = np.array([_size(part) for part in parts])
    drawn, density, mass, inertia = sizes.copy(), *_weights(parts, sizes, made)
    wheels = [i for i, part in enumerate(parts) if part.kind == 'wheel']
    balls = [i for i, part in enumerate(parts) if part.kind == 'ball']
    poses = np.array([part.pose for part in parts])
    poses[wheels, 3:] = rotation.multiply(poses[wheels, 3:], ACROSS)
    sizes[wheels, 2] = np.maximum(sizes[wheels, 0], sizes[wheels, 2])
    drawn[balls] *= _CORE
    drawn[[i for i, part in enumerate(parts) if part.skin is not None]] *= _HIDDEN
    drawn[wheels, :2] *= _AXLE
    material = np.array([names.index(usual_material(part)) for part in parts], np.int16)
    table, joint_names = _joints(joints)
    return Blueprint(
        shape=np.array([Shape.BOX if part.kind in ('box', 'plate') else Shape.CAPSULE
                        for part in parts], np.uint8),
        size=sizes, visual_size=drawn, density=density, mass=mass, inertia=inertia, poses=poses,
        kind=np.array([kinds.index(_kind(part)) for part in parts], np.int16), material=material,
        texture=texture[material], leaf_area=np.zeros(len(parts)),
        ornaments=_skins(parts, sizes, texture[material]), joints=table, plates=_plates(parts),
        kinds=kinds, materials=names, textures=textures, joint_names=joint_names)


def _kind(part: WrittenPart) -> str:
    """Return the kind of a part in its name; balls are known by theirs."""
    return part.kind if part.kind == 'ball' else part.name


def _size(part: WrittenPart) -> tuple[float, ...]:
    """Return its extents; of what is round the diameter twice and the length [m], (3,)."""
    numbers = part.numbers
    if 'size' in numbers:
        return numbers['size']
    diameter = numbers['diameter'][0]
    if part.kind == 'rod':
        return diameter, diameter, float(norm(np.subtract(numbers['to'], numbers['from'])))
    return diameter, diameter, numbers.get('width', (diameter,))[0]


def _weights(parts: Sequence[WrittenPart], sizes: np.ndarray,
             made: Sequence[Material]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute density [kg/m³], mass [kg] and principal moments [kg·m²] of solid parts."""
    volume = sizes.prod(axis=1)
    round_ = np.array([part.kind in ('rod', 'wheel') for part in parts])
    ball = np.array([part.kind == 'ball' for part in parts])
    volume[round_] *= 0.25 * np.pi
    volume[ball] *= np.pi / 6.0
    mass = np.array([material.density for material in made]) * volume
    for i, part in enumerate(parts):
        mass[i] = part.numbers.get('mass', (mass[i],))[0]
    inertia = box_inertia(mass, sizes)
    inertia[round_] = cylinder_inertia(mass[round_], sizes[round_, 0], sizes[round_, 2])
    inertia[ball] = (0.1 * mass[ball] * np.square(sizes[ball, 0]))[:, None]
    for i, part in enumerate(parts):
        inertia[i] = inertia[i] if part.inertia is None else part.inertia
    return mass / volume, mass, inertia


def _skins(parts: Sequence[WrittenPart], sizes: np.ndarray, texture: np.ndarray) -> Ornaments:
    """Cover balls and wheels by triangles, as blueprints have neither; parts by their skins."""
    part, triangles = [np.zeros(0, np.int32)], [np.zeros((0, 9))]
    for i, written in enumerate(parts):
        if written.skin is not None:
            triangles.append(written.skin)
        elif written.kind == 'ball':
            triangles.append(0.5 * sizes[i, 0] * round_skin())
        elif written.kind == 'wheel':
            triangles.append(_drum(0.5 * sizes[i, 0], 0.5 * written.numbers['width'][0]))
        else:
            continue
        part.append(np.full(len(triangles[-1]), i, np.int32))
    rows = np.concatenate(part)
    return Ornaments(rows, np.concatenate(triangles), texture[rows])


def _drum(radius: float, half: float) -> np.ndarray:
    """Return the triangles of a drum about z, (4 `_SIDES`, 9)."""
    turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    rim = np.column_stack([radius * cos(turn), radius * sin(turn)])
    low, high = (np.column_stack([rim, np.full(_SIDES, z)]) for z in (-half, half))
    after, above = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    foot, top = (np.tile([0.0, 0.0, z], (_SIDES, 1)) for z in (-half, half))
    return np.concatenate([np.hstack(corners) for corners in (
        (low, after, above), (low, above, high), (top, high, above), (foot, after, low))])


def _plates(parts: Sequence[WrittenPart]) -> Plates:
    rows = [(i, int(np.argmin(part.numbers['size'])), part.numbers) for i, part
            in enumerate(parts) if part.kind == 'plate']
    area = [numbers['area'][0] if 'area' in numbers
            else np.prod(np.delete(numbers['size'], normal)) for _, normal, numbers in rows]
    return Plates(np.array([i for i, _, _ in rows], np.int32),
                  np.array([normal for _, normal, _ in rows], np.uint8), np.array(area, float))


def _joints(joints: Sequence[WrittenJoint]) -> tuple[Joints, tuple[str, ...]]:
    """Return the joints, and their names; equal ones are numbered."""
    if not joints:
        return Joints(), ()
    count, seen, names = Counter(joint.name for joint in joints), Counter[str](), []
    for joint in joints:
        several = count[joint.name] > 1
        names.append(f'{joint.name}_{seen[joint.name]}' if several else joint.name)
        seen[joint.name] += 1
    rows = [_row(joint) for joint in joints]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    anchor = [rotation.relative(joint.frame, np.array([*joint.end, *rotation.IDENTITY]))[:3]
              for joint in joints]
    common = tuple(dict.fromkeys(names))
    return Joints(
        kind=np.array([JointType[joint.kind.upper()] for joint in joints], np.uint8),
        parts=np.array([joint.parts for joint in joints], np.int32).reshape(-1, 2),
        frame=np.array([joint.frame for joint in joints]), anchor=np.array(anchor),
        name=np.array([common.index(name) for name in names], np.int32), **columns), common


def _row(joint: WrittenJoint) -> dict[str, float | bool]:
    """Return the values of a joint in SI units, radians for degrees."""
    numbers, rope = joint.numbers, joint.kind == 'rope'
    unit = float(np.radians(1.0)) if joint.kind == 'hinge' else 1.0
    low, high = numbers.get('limits', (-np.inf, np.inf))
    if rope:
        span = float(norm(joint.frame[:3] - joint.end))
        low, high = -np.inf, numbers.get('length', (span,))[0]
    stiffness, rest = (*numbers.get('spring', (0.0,)), 0.0)[:2]
    speed, effort, fastest = (*numbers.get('motor', (0.0, 0.0)), np.inf)[:3]
    zero = numbers.get('zero', (0.0,))[0]
    force, moment = (*numbers.get('strength', (np.inf,)), np.inf)[:2]
    return {'low': low * unit, 'high': high * unit, 'stiffness': stiffness, 'rest': rest * unit,
            'damping': numbers.get('damper', (0.0,))[0],
            'friction': numbers.get('friction', (0.0,))[0], 'speed': speed * unit,
            'fastest': fastest * unit, 'effort': effort, 'force': force, 'moment': moment,
            'zero': zero * unit, 'collides': numbers.get('collides', (0.0,))[0] != 0.0}
