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


"""Quality of service of every topic, in one place."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import (
    _declare_qos_parameters,
    InvalidQosOverridesError,
    QosCallbackResult,
    QoSOverridingOptions,
)
from rclpy.subscription import Subscription

from procphys_ros.errors import SceneError

_REFUSALS = RuntimeError, InvalidQosOverridesError
_DEEPEST = 1_000_000  # [messages]


def _checked(profile: QoSProfile) -> QosCallbackResult:
    """Refuse invalid profiles early, with a clearer message than that of the middleware."""
    if 0 <= profile.depth <= _DEEPEST:
        return QosCallbackResult(successful=True)
    return QosCallbackResult(
        successful=False, reason=f'depth must be from 0 to {_DEEPEST}, found {profile.depth}')


# Policies that parameters may override for each topic, qos_overrides./sim/poses.publisher.depth
# and so on. The others are omitted: there is no deadline, and no liveliness.
_OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY,
     QoSPolicyKind.DURABILITY), callback=_checked)


def _reliable(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    """Make a separate profile for each topic, because overrides are written into it."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability)


def arrays() -> QoSProfile:
    """
    Return the profile of large arrays.

    They are reliable: best effort loses most messages above some 0.8 MB, even on one machine,
    because a single lost fragment loses the whole message.
    """
    return _reliable(5)


def changes() -> QoSProfile:
    """Return the profile of changes: a subscriber that stalls for seconds still gets all."""
    return _reliable(100)


def latched() -> QoSProfile:
    """Return the profile of messages that late joiners need."""
    return _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)


def newest() -> QoSProfile:
    """Return the profile of topics of which only the newest message counts."""
    return _reliable(1)


def commands() -> QoSProfile:
    """Return the profile of commands: deep enough for a second of 10,000 commands."""
    return _reliable(10_000)


def publisher(node: Node, kind: type, topic: str, profile: QoSProfile,
              **options: Any) -> Publisher:
    """
    Create a publisher with a quality of service that parameters may override.

    :raises SceneError: if they are invalid.
    """
    try:
        return node.create_publisher(kind, topic, profile,
                                     qos_overriding_options=_OVERRIDABLE, **options)
    except _REFUSALS as error:
        raise _refusal(node.resolve_topic_name(topic), error) from error


def subscription(owner: Node, node: Node, kind: type, topic: str,
                 receive: Callable[[Any], None], profile: QoSProfile) -> Subscription:
    """
    Create a subscription with a quality of service that parameters may override; see `publisher`.

    :param owner: node of these parameters and remappings.
    :param node: of the subscription.
    """
    resolved = owner.resolve_topic_name(topic)
    try:
        _declare_qos_parameters(Subscription, owner, resolved, profile, _OVERRIDABLE)
        return node.create_subscription(kind, resolved, receive, profile)
    except _REFUSALS as error:
        raise _refusal(resolved, error) from error


def _refusal(topic: str, error: Exception) -> SceneError:
    reason = str(error).split(', at /')[0].rpartition('are not valid: ')[2]
    return SceneError(f'{topic} cannot have the quality of service that qos_overrides ask for: '
                      f'{reason}')
