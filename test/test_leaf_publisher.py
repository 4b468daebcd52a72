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

"""The publisher of leaves, without ROS."""

from types import SimpleNamespace

import numpy as np

from procphys_ros.ros import leaf_publisher
from procphys_ros.ros.leaf_publisher import LeafPublisher
from procphys_ros.ros.pacing import RateLimiter


def test_the_last_poses_before_time_stands_still_go_out(monkeypatch):
    """Publish what moved between two turns of a slow topic, though nothing has moved since."""
    clock, sent = SimpleNamespace(now=0.0), []
    monkeypatch.setattr(leaf_publisher, 'RateLimiter',
                        lambda rate, early: RateLimiter(rate, early, lambda: clock.now))
    monkeypatch.setattr(leaf_publisher.qos, 'publisher', lambda *_, **__: SimpleNamespace(
        publish=sent.append, get_subscription_count=lambda: 1))
    publisher = LeafPublisher(None, 'world')
    simulation = SimpleNamespace(time=0.0, leaf_poses=lambda: np.zeros((1, 7)))
    for clock.now, has_moved in ((0.0, True), (0.1, True), (0.2, False), (1.0, False),
                                 (2.0, False)):
        publisher.publish(simulation, has_moved, 1.0)
    assert len(sent) == 2
