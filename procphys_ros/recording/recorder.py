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

"""Recorder: what the node would publish, from a simulation straight into a file."""

from pathlib import Path
from typing import Self

import numpy as np

from procphys_ros import messages
from procphys_ros.appearance.joints import seats
from procphys_ros.errors import RecordingError
from procphys_ros.messages.cdr import CdrWriter, ENCAPSULATION
from procphys_ros.messages.markers import MarkerStyle, SceneMarkers
from procphys_ros.messages.scene_description import SceneDescription
from procphys_ros.recording.recording import FULL_EVERY
from procphys_ros.recording.writer import McapWriter
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.schema import short
from procphys_ros.simulation import Simulation

_EARLY = 1e-6     # [s] rounding of simulated time


class Recorder:
    """
    Write the topics of the node `sim` to an MCAP file; its time is simulated time.

    :param simulation: to record; it is only read.
    :param path: file that ends in .mcap.
    :param rate: frames per simulated second.
    :param node: prefix of the topics.
    :param frame: `frame_id` of all messages.
    :raises RecordingError: if the file cannot be written.
    """

    def __init__(self, simulation: Simulation, path: str | Path, rate: float = 30.0,
                 node: str = '/sim', frame: str = 'world'):
        if not isinstance(simulation, Simulation):
            raise RecordingError(f'{short(simulation)} is no simulation; Simulation(scene) is one')
        if not 0.0 < rate <= 1e4:
            raise RecordingError(f'the rate is {rate:g} 1/s, it must lie above 0 and not exceed '
                                 '10000')
        self._simulation, self._node, self._frame = simulation, node, frame
        self._writer = McapWriter(path)
        self._period = 1.0 / rate
        self._due = self._full_due = self._seen = simulation.time
        self._last_poses = np.empty((0, 7))
        self._events = simulation.log.total
        self._markers: SceneMarkers | None = None
        self._terrain, self._paving = simulation.model.terrain, simulation.scene.paving
        self._description = SceneDescription(frame, self._terrain, self._paving, seats)
        self._described: tuple[int, int] | None = None
        self._content: tuple[tuple[str, ...], int] = (), 0
        self._had_dust = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Finish the file; may be called again."""
        self._writer.close()

    def record(self) -> bool:
        """
        Write the present state of the simulation, if a frame is due; to be called after each step.

        :returns: whether a frame was written.
        :raises RecordingError: if the disk is full, or time has jumped back.
        """
        simulation = self._simulation
        if simulation.time < self._seen - _EARLY:
            raise RecordingError('the simulation was reset; a recording holds one run')
        self._seen = simulation.time
        if simulation.time < self._due - _EARLY:
            return False
        is_full = simulation.time > self._full_due - _EARLY
        self._due = max(self._due + self._period, simulation.time)
        if is_full:
            self._full_due = max(self._full_due + FULL_EVERY, simulation.time)
        at = messages.stamp(simulation.time)
        self._put('/clock', 'rosgraph_msgs/msg/Clock', messages.clock(at), at)
        self._put_ground(at)
        self._put_description(at, is_full)
        self._put_poses(at, is_full)
        self._put_markers(at, is_full)
        self._put_breaks(at)
        self._put_dust(at)
        self._put_wind(at)
        self._put_wrenches(at)
        return True

    def _put(self, topic: str, kind: str, data: bytes, at: messages.Stamp) -> None:
        name = topic if topic.startswith('/') else f'{self._node}/{topic}'
        self._writer.write(name, kind, data, at[0] * 10**9 + at[1])

    def _put_ground(self, at: messages.Stamp) -> None:
        """Write the ground, which is constant, with the first frame."""
        if self._markers is None:
            self._put('ground', 'visualization_msgs/msg/MarkerArray', messages.ground_markers(
                self._terrain, self._paving, at, self._frame), at)

    def _put_description(self, at: messages.Stamp, is_full: bool) -> None:
        """Write the scene description; parts that join later are described within a second."""
        simulation = self._simulation
        content = len(simulation.blueprint), len(simulation.removed)
        if content != self._described and (not self._described or is_full):
            self._described = content
            if simulation.layouts:  # of plants that have grown, all parts have other sizes
                self._description = SceneDescription(self._frame, self._terrain, self._paving,
                                                     seats)
            text = self._description.write(simulation.state.blueprint, simulation.objects,
                                           simulation.removed)
            writer = CdrWriter()
            writer.string(text)
            self._put('scene_description', 'std_msgs/msg/String',
                      ENCAPSULATION + writer.getvalue(), at)

    def _put_poses(self, at: messages.Stamp, is_full: bool) -> None:
        """Write all poses; at standstill, once a second."""
        poses = self._simulation.state.shown_poses()
        if is_full or not np.array_equal(poses, self._last_poses, equal_nan=True):
            self._last_poses = poses.copy()
            self._put('poses', 'geometry_msgs/msg/PoseArray',
                      messages.pose_array(poses, at, self._frame), at)

    def _put_markers(self, at: messages.Stamp, is_full: bool) -> None:
        simulation, markers = self._simulation, self._markers
        content = simulation.added, simulation.layouts  # what is added or grows may have leaves
        if markers is None or content != self._content:
            self._content, is_full = content, True
            markers = self._markers = SceneMarkers(simulation.state.blueprint, simulation.objects,
                                                   self._frame, MarkerStyle())
        elif len(markers) < len(simulation.poses):
            markers.grow(simulation.blueprint, simulation.objects)
        if simulation.layouts:
            markers.resize(simulation.blueprint)
        leaves = simulation.leaf_poses() if markers.shows_leaf_poses else None
        write = markers.whole if is_full else markers.changes
        data = write(simulation.state.shown_poses(), at, leaves, simulation.dust)
        if data is not None:
            self._put('markers', 'visualization_msgs/msg/MarkerArray', data, at)

    def _put_breaks(self, at: messages.Stamp) -> None:
        new = min(self._simulation.log.total - self._events, len(self._simulation.events))
        self._events = self._simulation.log.total
        if new > 0:
            rows = messages.break_rows(self._simulation.events[-new:])
            self._put('breaks', 'sensor_msgs/msg/PointCloud2',
                      messages.point_cloud(rows, at, self._frame), at)

    def _put_dust(self, at: messages.Stamp) -> None:
        dust = self._simulation.dust
        if len(dust.sizes) or self._had_dust:
            rows = messages.dust_rows(dust)
            self._put('dust', 'sensor_msgs/msg/PointCloud2',
                      messages.point_cloud(rows, at, self._frame), at)
        self._had_dust = len(dust.sizes) > 0

    def _put_wind(self, at: messages.Stamp) -> None:
        wind = np.sum(self._simulation.wind.at_reference(self._simulation.time), axis=0)
        self._put('wind_info', 'geometry_msgs/msg/Vector3Stamped',
                  messages.stamped_numbers(wind, at, self._frame), at)

    def _put_wrenches(self, at: messages.Stamp) -> None:
        """Write the wrench on each intruder that has been placed."""
        for name in self._simulation.intruders:
            if self._simulation.pose_of_intruder(name) is not None:
                self._put('intruder_wrench' if name == INTRUDER else f'intruders/{name}/wrench',
                          'geometry_msgs/msg/WrenchStamped', messages.stamped_numbers(
                              self._simulation.wrench_on_intruder(name), at, self._frame), at)
