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


"""Followed node: a running `sim` node as a source of the page, from its topics alone."""

from dataclasses import replace
import json
import os
from threading import Event, Thread
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from procphys_ros.appearance.joints import Seats
from procphys_ros.appearance.torn_wood import BrokenWood
from procphys_ros.blueprint import BALLS, Hexahedra, Leaves, Shape
from procphys_ros.geometry import rotation
from procphys_ros.messages.ground import ground_of
from procphys_ros.messages.leaves import LEAF, leaves_of
from procphys_ros.messages.points import BREAK, DUST
from procphys_ros.messages.poses import read_pose_array
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.dust import Puffs
from procphys_ros.ros.page_commands import PageCommands
from procphys_ros.ros.topics import follow
from procphys_ros.view.source import Frame, PageContent, Status

_TURN = 0.05  # [s] between checks for its end
_SILENCE = 5.0  # [s] without diagnostics, which come each second: then a node counts as dead


class FollowedNode:
    """
    Subscribe to the topics of a node; find the node again after a restart.

    :param name: of the node, such as /sim.
    :param patience: time to wait for its answer to a command [s].
    :ivar watched: whether poses are subscribed to; otherwise only description and status.
    """

    can_undo = False  # states of a node are files, and it has other clients, too

    def __init__(self, name: str, patience: float = 5.0):
        self.name = '/' + name.strip('/')
        self.watched = True
        self._node: Node = rclpy.create_node(f'view_{os.getpid()}', start_parameter_services=False)
        self._state = _SceneState()
        self._heard, self._diagnosis = -np.inf, Status()
        self._moving: list[Subscription] = []
        for topic, take in (('scene_description', self._describe), ('leaves', self._take_leaves),
                            ('broken_bonds', self._take_breaks), ('/diagnostics', self._diagnose)):
            follow(self._node, self.name, topic, take)
        self._commands = PageCommands(self.name, patience)
        self._ended = Event()
        self._thread = Thread(target=self._spin, name='follow', daemon=True)

    def start(self) -> None:
        """Start receiving."""
        self._thread.start()
        self._commands.start()

    def close(self) -> None:
        """Leave the graph."""
        self._ended.set()
        self._commands.close()
        if self._thread.is_alive():
            self._thread.join()
        self._node.destroy_node()

    def frame(self) -> Frame | None:
        """Return the newest frame."""
        return self._state.frame()

    def status(self) -> Status:
        """Describe the state of the node, or report that it is silent."""
        silence = monotonic() - self._heard
        if silence > _SILENCE:
            since = '' if np.isinf(silence) else f' for {silence:.0f} s'
            return Status(False, f'{self.name} does not answer{since}')
        known = self._commands.known
        return Status(True, self._diagnosis.text, self._diagnosis.time, self._diagnosis.paused,
                      self._diagnosis.factor, known, self._commands.scene)

    def say(self, command: Any) -> None:
        """Send a command to the node."""
        self._commands.put(command)

    def answer(self) -> str:
        """Return the answer to the last command."""
        return self._commands.answer

    def _spin(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            while not self._ended.is_set():
                self._watch()
                executor.spin_once(timeout_sec=_TURN)
        except ExternalShutdownException:  # ROS was shut down meanwhile
            pass
        executor.shutdown()

    def _watch(self) -> None:
        """Subscribe to moving topics while a page is open; the node skips unused ones."""
        if self.watched and not self._moving:
            state = self._state
            self._moving = [
                follow(self._node, self.name, 'poses', state.take_poses, raw=True),
                follow(self._node, self.name, 'leaf_poses', state.take_leaf_poses, raw=True),
                follow(self._node, self.name, 'dust', self._take_dust)]
        elif not self.watched and self._moving:
            for subscription in self._moving:
                self._node.destroy_subscription(subscription)
            self._moving.clear()

    def _describe(self, message: String) -> None:
        self._state.describe(message.data)
        self._commands.find_scene()

    def _take_leaves(self, message: PointCloud2) -> None:
        self._state.take_leaves(leaves_of(np.frombuffer(bytes(message.data), LEAF)))

    def _take_breaks(self, message: PointCloud2) -> None:
        rows = np.frombuffer(bytes(message.data), BREAK)
        self._state.take_breaks(np.stack([rows['part_a'], rows['part_b']], axis=-1),
                                rows['cause'])

    def _take_dust(self, message: PointCloud2) -> None:
        rows = np.frombuffer(bytes(message.data), DUST)
        self._state.take_dust(Puffs(np.stack([rows['x'], rows['y'], rows['z']], axis=-1),
                                    rows['size'], rows['opacity'], np.zeros(len(rows))))

    def _diagnose(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name != f'{self.name}: simulation':
                continue
            values = {v.key: v.value for v in status.values}
            time = float(values.get('simulation time [s]', 0.0))
            broken = values.get('bonds broken', '0')
            self._heard = monotonic()
            self._diagnosis = Status(
                True, f'{time:.1f} s, {status.message}, {values.get("parts", "0")} parts, '
                f'{broken} bonds broken', time, status.message.startswith('paused'),
                float(values.get('real-time factor wanted', 1.0)))


class _SceneState:
    """Received content of a scene: from the ROS thread, for the thread of the page."""

    def __init__(self) -> None:
        self._content: PageContent | None = None
        self._leaves = Leaves()
        self._scene = 0
        self._poses = self._leaf_poses = np.zeros((0, 7))
        self._dust = Puffs.none()
        self._breaks = np.zeros((0, 2), int), np.zeros(0, int)
        self._newest: Frame | None = None
        self._is_stale = False

    def frame(self) -> Frame | None:
        """Return the newest frame, the same object while nothing new was received."""
        content, poses = self._content, self._poses
        # Poses may be ahead of the description; fewer poses than parts are of another scene.
        if self._is_stale and content is not None and 0 < len(content) <= len(poses):
            self._is_stale = False
            self._newest = self._make(content, poses[:len(content)])
        return self._newest

    def describe(self, text: str) -> None:
        """Store a description of the scene; an extension of the last keeps the scene number."""
        content = content_of(json.loads(text), self._leaves, self._scene)
        old = self._content
        if old is not None and not _continues(old, content):
            self._begin(content)
        else:
            self._content = content
        self._is_stale = True

    def take_leaves(self, leaves: Leaves) -> None:
        """Store leaves, which may come before or after their description."""
        self._leaves = leaves
        if self._content is not None:
            self._begin(self._content)

    def take_poses(self, data: bytes) -> None:
        """Store a geometry_msgs/PoseArray, CDR with its encapsulation."""
        self._poses, self._is_stale = read_pose_array(data), True

    def take_leaf_poses(self, data: bytes) -> None:
        """Store the poses of leaves; format as in `take_poses`."""
        self._leaf_poses, self._is_stale = read_pose_array(data), True

    def take_dust(self, puffs: Puffs) -> None:
        """Store dust."""
        self._dust, self._is_stale = puffs, True

    def take_breaks(self, pairs: np.ndarray, causes: np.ndarray) -> None:
        """Store the parts of all broken bonds, (K, 2), and the causes, (K,)."""
        self._breaks, self._is_stale = (pairs, causes), True

    def _begin(self, content: PageContent) -> None:
        self._scene += 1
        leaves = self._leaves
        if len(leaves) and leaves.part.max() >= len(content):  # leaves of another scene
            leaves = Leaves()
        self._content = replace(content, scene=self._scene, leaves=leaves)
        self._is_stale = True

    def _make(self, content: PageContent, poses: np.ndarray) -> Frame:
        leaf_poses = self._leaf_poses
        if len(leaf_poses) != len(content.leaves):
            leaf_poses = rotation.compose(poses[content.leaves.part], content.leaves.pose)
        pairs, causes = self._breaks
        grown = causes != Cause.PULLED_OFF  # climbing plants are not torn by that
        wood = BrokenWood(content.shape, content.size, pairs[grown],
                          causes[grown] == Cause.UPROOTING)
        return Frame(replace(content, wood=wood), poses, leaf_poses, self._dust, pairs)


def content_of(described: dict[str, Any], leaves: Leaves, scene: int) -> PageContent:
    """
    Read a scene description.

    :param described: content of `~/scene_description`.
    :param leaves: on its parts.
    :param scene: number of the scene.
    """
    parts, solids = described['parts'], described.get('hexahedra', {})
    shape = np.array([Shape[name.upper()] for name in parts['shape']], np.uint8)
    size = np.array(parts['size'], float).reshape(-1, 3)
    ball = np.isin(parts['kind'], BALLS) & (shape == Shape.CAPSULE)
    drawn = np.array(parts.get('visual_size', parts['size']), float).reshape(-1, 3)
    terrain, paving = ground_of(described)
    textures = list(dict.fromkeys([*described.get('textures', ()), *parts.get('texture', ())]))
    number = {name: i for i, name in enumerate(textures)}
    texture = np.array([number[name] for name in parts.get('texture', ())], int)
    if len(texture) != len(shape):
        texture = np.zeros(len(shape), int)
    if len(leaves) and leaves.part.max() >= len(shape):
        leaves = Leaves()
    cut = np.array(solids.get('part', ()), np.int32)
    first_piece = np.arange(len(shape))
    first_piece[cut] = solids.get('first_piece', cut)
    return PageContent(scene, parts['name'].__getitem__, shape,
                       np.where(ball[:, None], size, drawn), np.array(parts['mass'], float), ball,
                       texture, parts['material'].__getitem__, textures or [''], leaves,
                       first_piece,
                       Hexahedra(cut, np.array(solids.get('corners', ()), float).reshape(-1, 24)),
                       terrain, paving, mortar=_mortar_of(described))


def _mortar_of(described: dict[str, Any]) -> Seats | None:
    """Read the seats of mortar; nodes of earlier versions do not send them."""
    if 'mortar' not in described:
        return None
    bond = np.array(described['mortar']['bond'], int)
    pairs = np.array(described['bonds']['parts'], int).reshape(-1, 2)[bond]
    forms = np.array(described['mortar']['forms'], float).reshape(-1, 16)
    box, size, first, second = np.split(
        forms[np.array(described['mortar']['form'], int)], [7, 10, 13], axis=1)
    return Seats(bond, pairs[:, 0], pairs[:, 1], box, np.stack([first, second]), size)


def _continues(old: PageContent, new: PageContent) -> bool:
    """Return whether a content has the ground and parts of another, and possibly more."""
    count = len(old)
    return (len(new) >= count and _ground(new) == _ground(old)
            and np.array_equal(old.size, new.size[:count])
            and all(old.name(i) == new.name(i) for i in range(count)))


def _ground(content: PageContent) -> list[str | bytes]:
    """Return data that identify the ground of a scene."""
    return [repr(content.terrain), *(one.texture for one in content.paving),
            *(one.points.tobytes() for one in content.paving)]
