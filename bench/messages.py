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


"""Cost of large messages: rclpy objects against bytes written from numpy, in one run."""

from statistics import median
from time import perf_counter
from types import SimpleNamespace

from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
import numpy as np
import rclpy
from visualization_msgs.msg import Marker, MarkerArray

from procphys_ros import messages
from procphys_ros.blueprint import Blueprint, Shape

PARTS = 15_196  # bricks of the paper's largest building


def milliseconds(action, repeats: int) -> float:
    """Run an action several times and give the median [ms]."""
    times = []
    for _ in range(repeats):
        start = perf_counter()
        action()
        times.append(1e3 * (perf_counter() - start))
    return median(times)


def bricks(poses: np.ndarray) -> Blueprint:
    """Make a blueprint of loose boxes."""
    count = len(poses)
    index = np.zeros(count, np.int16)
    return Blueprint(
        shape=np.full(count, Shape.BOX, np.uint8), size=np.ones((count, 3)),
        visual_size=np.ones((count, 3)), density=np.ones(count), mass=np.ones(count),
        inertia=np.ones((count, 3)), poses=poses, kind=index, material=index, texture=index,
        leaf_area=np.zeros(count), kinds=('brick',), materials=('clay',),
        textures=('brick_red',))


def main() -> None:
    """Print the cost of building and publishing, and the ratios."""
    rclpy.init()
    node = rclpy.create_node('bench_messages')
    pose_topic = node.create_publisher(PoseArray, '~/poses', 5)
    marker_topic = node.create_publisher(MarkerArray, '~/markers', 5)
    poses = np.random.default_rng(0).normal(size=(PARTS, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)

    def poses_by_objects() -> None:
        message = PoseArray()
        message.header.frame_id = 'world'
        message.poses = [
            Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=d))
            for x, y, z, a, b, c, d in poses.tolist()]
        pose_topic.publish(message)

    def poses_by_bytes() -> None:
        pose_topic.publish(messages.pose_array(poses, (1, 2), 'world'))

    def markers_by_objects() -> None:
        message = MarkerArray()
        for i, (x, y, z, a, b, c, d) in enumerate(poses.tolist()):
            marker = Marker(ns='house', id=i, type=Marker.CUBE)
            marker.header.frame_id = 'world'
            marker.pose = Pose(position=Point(x=x, y=y, z=z),
                               orientation=Quaternion(x=a, y=b, z=c, w=d))
            marker.scale.x = marker.scale.y = marker.scale.z = 1.0
            marker.color.a = 1.0
            message.markers.append(marker)
        marker_topic.publish(message)

    owner = SimpleNamespace(name='house', first=0, count=PARTS)
    scene = messages.SceneMarkers(bricks(poses), [owner], 'world')

    def markers_by_bytes() -> None:
        marker_topic.publish(scene.whole(poses, (1, 2)))

    print(f'{PARTS} parts, build and publish, nobody listening, median')
    for what, slow, fast in (('PoseArray', poses_by_objects, poses_by_bytes),
                             ('MarkerArray', markers_by_objects, markers_by_bytes)):
        objects, raw = milliseconds(slow, 5), milliseconds(fast, 50)
        print(f'{what:12} rclpy objects {objects:8.1f} ms   bytes {raw:7.3f} ms   '
              f'{objects / raw:6.0f} times cheaper')
    scene.whole(poses, (1, 2))
    still = milliseconds(lambda: scene.changes(poses, (1, 2)), 50)
    print(f'MarkerArray  when nothing moved {still:.3f} ms, 0 bytes')
    rclpy.shutdown()


if __name__ == '__main__':
    main()
