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

"""Start rclpy, which says in one line what is wrong with the arguments for ROS."""

from typing import Any

import rclpy

from procphys_ros.errors import SceneError
from procphys_ros.language import shorten


def start_ros(args: list[str] | None, **options: Any) -> None:
    """
    Start rclpy; it reads the command line and the parameter files.

    :param args: with the name of the command first; None = the process's own.
    :param options: of `rclpy.init`.
    :raises SceneError: when they cannot be read.
    """
    try:
        rclpy.init(args=args, **options)
    except RuntimeError as error:  # RCLError and UnknownROSArgsError: only their text tells
        reason = str(error).partition(': ')[2] or str(error)
        hint = ('; write the numbers of a list alike, [1.0, 2.5, 0.0]'
                if 'Sequence should be of same type' in reason else '')
        raise SceneError(reason.split(', at /')[0] + hint) from error
    except UnicodeEncodeError as error:
        raise SceneError(f'arguments for ROS: "{shorten(error.object)}" is not UTF-8, which ROS '
                         'needs, in names of files, too') from error
