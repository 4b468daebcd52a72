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

"""Robot: from a URDF to a blueprint of parts and joints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import cross, eigen, product
from procphys_ros.language import check_length, check_overrides, generator_of, GrammarFile, shorten
from procphys_ros.mechanism.assembly import ACROSS, assemble
from procphys_ros.mechanism.derivation import turned, WrittenJoint, WrittenPart
from procphys_ros.mechanism.tables import MATERIALS
from procphys_ros.mechanism.urdf import (
    Inertial,
    MOVING,
    read_robot,
    Robot,
    RobotJoint,
    RobotLink,
    Solid,
    WORLD,
)

MOST_PARTS = 10_000  # default bound on the parts of one robot
_FIXED = 'fixed'  # the define that fixes the root to the ground
# Of a link's mass, or its body's: what a solid weighs beside the part that holds mass and inertia.
_NEGLIGIBLE = 1e-6
_POINT = 1e-3  # [m] edge of a part that holds a mass apart from the solids of its link
_ALIKE = 1e-6  # of a solid's extent or of its moments: differences that do not count
_JOINTS = {'revolute': 'hinge', 'continuous': 'hinge', 'prismatic': 'slider', 'ball': 'ball'}


@dataclass(frozen=True)
class RobotGrammar(GrammarFile):
    """
    A URDF, ready to build.

    :ivar robot: its links and joints.
    :ivar source: name of the text, for errors.
    :ivar most_parts: bound on the parts.
    """

    robot: Robot
    source: str
    most_parts: int = MOST_PARTS

    @classmethod
    def parse(cls, text: str, source: str = '<text>', most_parts: int = MOST_PARTS,
              folder: Path | None = None) -> 'RobotGrammar':
        """
        Read a URDF.

        :param text: the URDF.
        :param source: name for errors.
        :param most_parts: bound on the parts.
        :param folder: in which its meshes are.
        :raises GrammarError: where the text is no URDF, or none that can be simulated.
        """
        check_length(text, source)
        return cls(read_robot(text, source, folder), source, most_parts)

    def build(self, /, seed: int = 0, **defines: float) -> Blueprint:
        """
        Put the robot together.

        :param seed: without effect, as that of a grammar without random numbers.
        :param defines: fixed = 1 fixes the root to the ground; the name of a joint sets its
            displacement at the start [rad], [m].
        :returns: parts and joints, in the coordinates of the root; a free robot that reaches
            below the ground is raised on it.
        :raises GrammarError: when links have no mass, or displacements are beyond their limits.
        """
        generator_of(seed, self.source)
        moving = [joint for joint in self.robot.joints if joint.kind in MOVING]
        check_overrides([_FIXED, *(joint.name for joint in moving)], defines, self.source)
        writer = RobotWriter(self.robot, defines, self.most_parts)
        writer.write()
        made = assemble(writer.parts, writer.joints, writer.materials)
        if GROUND in made.joints.parts:
            return made
        return made.placed((0.0, 0.0, max(0.0, -_lowest(made))))


@dataclass
class RobotWriter:
    """
    Writes a robot as a mechanism: links that fixed joints hold together are welded.

    :ivar bodies: by the first link of each body its main part, or `GROUND`.
    """

    robot: Robot
    defines: Mapping[str, float]
    most_parts: int
    parts: list[WrittenPart] = field(default_factory=list)
    joints: list[WrittenJoint] = field(default_factory=list)
    bodies: dict[str, int] = field(default_factory=dict)

    @property
    def materials(self):
        """Return a material for each look; masses of most parts are given."""
        return {part.material: replace(MATERIALS['steel'], texture=part.material)
                for part in self.parts}

    def write(self) -> None:
        """Write all parts, then the joints between them."""
        links, joints = _with_balls(self.robot)
        frames = self._frames(links, joints)
        first = {links[0].name: links[0].name}
        for joint in joints:
            first[joint.child] = first[joint.parent] if joint.kind == _FIXED else joint.child
        for name in dict.fromkeys(first.values()):
            self._body([link for link in links if first[link.name] == name], frames)
        for joint in joints:
            if joint.kind in _JOINTS:
                self._joint(joint, (self.bodies[first[joint.parent]],
                                    self.bodies[first[joint.child]]), frames[joint.child])

    def _frames(self, links: list[RobotLink],
                joints: list[RobotJoint]) -> dict[str, np.ndarray]:
        """Compute the frames of all links at the start [m], (7,) each."""
        frames = {links[0].name: rotation.ORIGIN}
        for joint in joints:
            moved, start = np.array([0.0, 0.0, 0.0, *rotation.IDENTITY]), self._start(joint)
            if joint.kind == 'prismatic':
                moved[:3] = start * joint.axis
            else:
                moved[3:] = rotation.from_axis_angle(joint.axis, np.array(start))
            frames[joint.child] = rotation.compose(
                rotation.compose(frames[joint.parent], joint.origin), moved)
        return frames

    def _start(self, joint: RobotJoint) -> float:
        """Return the displacement of a joint at the start: the nearest to 0, or as defined."""
        low, high = joint.limits
        start = float(self.defines.get(joint.name, np.clip(0.0, low, high)))
        if not low <= start <= high:
            raise joint.element.error(f'the define is {start:g}, limits are {low:g} to {high:g}')
        return start

    def _body(self, links: list[RobotLink], frames: Mapping[str, np.ndarray]) -> None:
        """Write the links of one body, and weld them together, or to the ground."""
        name, begin = links[0].name, len(self.parts)
        grounded = links[0] is self.robot.links[0] and (
            name == WORLD or self.defines.get(_FIXED, 0.0) != 0.0)
        total = sum(link.inertial.mass for link in links if link.inertial is not None)
        if total == 0.0 and not grounded:
            raise links[0].element.error(
                f'it moves and has no mass: give it <inertial> with <mass>{self._advice(name)}')
        for link in links:
            self._link(link, frames[link.name], total)
        if len(self.parts) > self.most_parts:
            raise links[0].element.error(f'the robot has more than {self.most_parts} parts')
        if begin == len(self.parts):
            self.bodies[name] = GROUND
            return
        self.bodies[name] = begin
        if grounded:
            self._weld(GROUND, begin)
        for part in range(begin + 1, len(self.parts)):
            self._weld(begin, part)

    def _advice(self, name: str) -> str:
        if name != self.robot.links[0].name:
            return ''
        return f', call it "{WORLD}", or set the define {_FIXED}=1 to hold it on the ground'

    def _link(self, link: RobotLink, frame: np.ndarray, total: float) -> None:
        """
        Write the parts of a link.

        A solid whose centre and axes are those of the mass has it, else a point has: parts have
        theirs in their middle.
        """
        carrier, moments, masses = -1, None, [_NEGLIGIBLE * total] * len(link.solids)
        if link.inertial is not None:
            carrier, moments = _carrier(link.solids, link.inertial)
            if carrier < 0:
                self._point(link, link.inertial, frame)
            else:
                masses[carrier] = link.inertial.mass
        for i, solid in enumerate(link.solids):
            numbers = dict(solid.numbers)
            if total > 0.0:
                numbers['mass'] = (masses[i],)
            self.parts.append(WrittenPart(
                solid.kind, _part_name(link), rotation.compose(frame, solid.pose), numbers,
                solid.texture, link.element.place, moments if i == carrier else None, solid.skin))

    def _point(self, link: RobotLink, inertial: Inertial, frame: np.ndarray) -> None:
        """Write a small part that has the mass and the inertia of a link."""
        values, vectors = eigen(inertial.tensor[None])
        axes = vectors[0].copy()
        axes[:, 0] = cross(axes[:, 1], axes[:, 2])  # right-handed
        pose = np.array([*inertial.centre, *rotation.from_matrix(axes)])
        self.parts.append(WrittenPart(
            'box', _part_name(link), rotation.compose(frame, pose),
            {'size': (_POINT,) * 3, 'mass': (inertial.mass,)}, 'steel', link.element.place,
            values[0]))

    def _weld(self, first: int, second: int) -> None:
        part = self.parts[second]
        taken = {joint.name for joint in self.robot.joints}
        name = f'{part.name}_weld'
        while name in taken:
            name += '_'
        self.joints.append(WrittenJoint('weld', name, (first, second), part.pose, part.pose[:3],
                                        {}, part.place))

    def _joint(self, joint: RobotJoint, parts: tuple[int, int], frame: np.ndarray) -> None:
        axis = rotation.rotate(frame[3:], joint.axis)
        start, numbers = self._start(joint), dict(joint.numbers)
        unit = np.degrees(1.0) if _JOINTS[joint.kind] == 'hinge' else 1.0
        if joint.kind in MOVING:
            numbers['zero'] = (start * unit,)
            numbers['limits'] = tuple((bound - start) * unit for bound in joint.limits)
        if 'motor' in numbers:
            speed, effort, fastest = numbers['motor']
            numbers['motor'] = (speed, effort, fastest * unit)
        if 'spring' in numbers:
            numbers['spring'] = (numbers['spring'][0], (numbers['spring'][1] - start) * unit)
        self.joints.append(WrittenJoint(
            _JOINTS[joint.kind], joint.name, parts,
            np.array([*frame[:3], *turned(np.eye(3)[0], axis)]), frame[:3], numbers,
            joint.element.place))


def _part_name(link: RobotLink) -> str:
    """Return the kind of the parts of a link; balls are known by theirs."""
    name = shorten(link.name.replace('/', '_'), 80)
    return f'{name}_' if name in ('ball', 'projectile') else name


def _carrier(solids: Sequence[Solid], inertial: Inertial) -> tuple[int, np.ndarray | None]:
    """Find the solid whose middle and axes are those of a mass, and its moments, (3,)."""
    for i, solid in enumerate(solids):
        pose = solid.pose
        if solid.kind == 'wheel':
            pose = np.array([*pose[:3], *rotation.multiply(pose[3:], ACROSS)])
        size = max(solid.numbers.get('size', solid.numbers.get('diameter', (0.0,))))
        turn = rotation.to_matrix(pose[3:])
        own = product(product(turn.T, inertial.tensor), turn)
        apart = np.abs(pose[:3] - inertial.centre).max()
        skew = np.abs(own - np.diag(np.diag(own))).max()
        if apart <= _ALIKE * size and skew <= _ALIKE * np.trace(own):
            return i, np.diag(own)
    return -1, None


def _with_balls(robot: Robot) -> tuple[list[RobotLink], list[RobotJoint]]:
    """Replace three hinges in series at one point, across each other, by a ball joint."""
    links = {link.name: link for link in robot.links}
    above = {joint.child: joint for joint in robot.joints}
    below: dict[str, list[RobotJoint]] = {}
    for joint in robot.joints:
        below.setdefault(joint.parent, []).append(joint)
    joints = {joint.name: joint for joint in robot.joints}
    for last in robot.joints:
        middle = above.get(last.parent)
        first = above.get(middle.parent) if middle else None
        if middle is None or first is None or not _turn_about_a_point(first, middle, last):
            continue
        if any(links[j.child].solids or len(below[j.child]) > 1 for j in (first, middle)):
            continue
        gone = [links.pop(first.child), links.pop(middle.child)]
        links[last.child] = _heavier(links[last.child], gone)
        joints.pop(first.name)
        joints.pop(middle.name)
        joints[last.name] = replace(last, kind='ball', parent=first.parent, origin=first.origin,
                                    numbers={})
        above[last.child] = joints[last.name]
    return list(links.values()), list(joints.values())


def _turn_about_a_point(*hinges: RobotJoint) -> bool:
    """Return whether joints are mere hinges at one point, at right angles to each other."""
    axes = np.array([joint.axis for joint in hinges])
    free = all(joint.kind == 'continuous' and not any(
        any(values[1:2] if key == 'motor' else values) for key, values in joint.numbers.items())
        for joint in hinges)
    together = all(np.abs(joint.origin - rotation.ORIGIN).max() < _ALIKE for joint in hinges[1:])
    return free and together and np.abs(product(axes, axes.T) - np.eye(3)).max() < _ALIKE


def _heavier(link: RobotLink, others: list[RobotLink]) -> RobotLink:
    """Add the masses of links without extent, in the same frame, to one."""
    known = [one.inertial for one in (link, *others) if one.inertial is not None]
    if len(known) < 2:
        return link
    mass = sum(one.mass for one in known)
    centre = sum((one.mass * one.centre for one in known), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for one in known:
        arm = one.centre - centre
        tensor += one.tensor + one.mass * ((arm * arm).sum() * np.eye(3) - np.outer(arm, arm))
    return replace(link, inertial=Inertial(mass, centre, tensor))


def _lowest(blueprint: Blueprint) -> float:
    """Return the height of the lowest point of all parts [m]."""
    up = np.abs(rotation.to_matrix(blueprint.poses[:, 3:])[:, 2])
    size = blueprint.size
    half = np.where(blueprint.shape == Shape.BOX, (up * size).sum(axis=1),
                    size[:, 0] + up[:, 2] * (size[:, 2] - size[:, 0]))
    return float((blueprint.poses[:, 2] - 0.5 * half).min())
