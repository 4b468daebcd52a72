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

"""Start rclpy, and report wrong ROS arguments in one line."""

from collections.abc import Mapping, Sequence
from typing import Any

import rclpy
import yaml

from procphys_ros.errors import SceneError
from procphys_ros.language import shorten
from procphys_ros.schema import short
from procphys_ros.terminal.argument_parser import split_words


def start_ros(args: list[str] | None, **options: Any) -> None:
    """
    Start rclpy with the command line and its parameter files.

    :param args: beginning with the name of the command; None = the process's own.
    :param options: of `rclpy.init`.
    :raises SceneError: if they are invalid.
    """
    try:
        rclpy.init(args=args, **options)
    except RuntimeError as error:  # RCLError and UnknownROSArgsError differ only in their text
        reason = str(error).partition(': ')[2] or str(error)
        hint = ('; write the numbers of a list alike, [1.0, 2.5, 0.0]'
                if 'Sequence should be of same type' in reason else '')
        raise SceneError(reason.split(', at /')[0] + hint) from error
    except UnicodeEncodeError as error:
        raise SceneError(f'arguments for ROS: "{shorten(error.object)}" is not UTF-8, which ROS '
                         'needs, in names of files, too') from error


def overruled(words: Sequence[str], given: Mapping[str, Any]) -> list[str]:
    """
    List the values of `-p` that have no effect.

    ROS keeps a value for each type of a parameter's values, and prefers integers: 2 in a file
    overrides a later 0.5.

    :param words: of the command line.
    :param given: values that the node was given, by name.
    """
    ros_words = split_words(words)[1]
    wanted = dict(word.split(':=', 1) for flag, word in zip(ros_words, ros_words[1:])
                  if flag in ('-p', '--param') and ':=' in word)
    return [f'-p {name}:={shorten(text)} does not hold: a file gives {short(given[name])}, of '
            'another type, and ROS keeps that; write it there alike, such as 2.0 for 2'
            for name, text in wanted.items()
            if name in given and _plain(_read(text)) != _plain(given[name])]


def _read(text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError):
        return text


def _plain(value: Any) -> Any:
    """Normalise values for which YAML readers have different types, such as 1e3."""
    if not isinstance(value, str) and hasattr(value, '__len__'):
        return [_plain(one) for one in value]
    try:
        return str(float(value))  # as text NaN equals itself
    except (TypeError, ValueError):
        return str(value)
