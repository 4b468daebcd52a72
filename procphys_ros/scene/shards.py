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

"""Shards: the partition of a scene among several nodes."""

from dataclasses import dataclass

from procphys_ros.errors import SceneError
from procphys_ros.schema import declared, ParameterGroup


@dataclass(frozen=True)
class Shard(ParameterGroup, group='shard'):
    """
    One node's share of a scene; all shares together are the whole scene, each instance once.

    Seeds, places and names do not depend on the shares, so the union of the shares is the scene
    that one node would simulate.
    """

    index: int = declared(0, 'which share of the objects this node simulates', '', 0, 1000)
    count: int = declared(
        1, 'number of nodes that share the scene, each with another shard.index', '', 1, 1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.index < self.count:
            raise SceneError(f'shard.index is {self.index}, it must lie from 0 to '
                             f'{self.count - 1}, one less than shard.count ({self.count})')

    def members(self, first: int, count: int) -> range:
        """
        Select the instances that belong to this share.

        :param first: number of instances in the scene before these.
        :param count: number of these.
        :returns: indices among these.
        """
        return range((self.index - first) % self.count, count, self.count)

    def own(self, name: str) -> str:
        """Make a name unique among shares, for an object that only this share receives."""
        return name if self.count == 1 else f'{name}_shard_{self.index}'
