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

"""Argument parser whose errors are one line, and readers of argument values."""

import argparse
from collections.abc import Sequence
import math
import re
from typing import Any, NoReturn

from procphys_ros import __version__

_MOST_DIGITS = 18  # what fits into 64 bits
_LAST_PORT = 65535
_NODE = re.compile(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z')


class OneLineParser(argparse.ArgumentParser):
    """Parser that reports invalid usage in one line with exit code 2, without its usage text."""

    def __init__(self, **keywords: Any):
        super().__init__(**keywords)
        if ' ' not in self.prog:  # as in those of the verbs of `command`
            self.add_argument('--version', action='version',
                              version=f'procphys_ros {__version__}')

    def error(self, message: str) -> NoReturn:
        """Print an error and exit."""
        self.exit(2, f'{self.prog}: {message}\n')


def split_words(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split words into a command's own and those for ROS: from --ros-args to -- or the end."""
    own: list[str] = []
    for_ros: list[str] = []
    is_for_ros = False
    for word in words:
        if word == '--ros-args' or word == '--' and is_for_ros:
            is_for_ros = word == '--ros-args'
            for_ros.append(word)
        else:
            (for_ros if is_for_ros else own).append(word)
    return own, for_ros


def add_grammar_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a scene that is one grammar; `define` becomes a list of pairs."""
    parser.add_argument('--seed', type=whole, help='of a grammar, 0 when not given')
    parser.add_argument('--define', type=define, action='append', default=[],
                        metavar='name=value', help='of a grammar, may be repeated')


def number(text: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'"{text}" is not a number') from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'"{text}" is not finite')
    return value


def positive(text: str) -> float:
    """Read a finite number above 0."""
    value = number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f'"{text}" is not above 0')
    return value


def whole(text: str) -> int:
    """Read a whole number, 0 or more."""
    if not text.isascii() or not text.isdigit() or len(text) > _MOST_DIGITS:
        raise argparse.ArgumentTypeError(f'"{text[:99]}" is not a whole number, 0 or more')
    return int(text)


def count(text: str) -> int:
    """Read a whole number above 0."""
    if not text.strip('0') or not text.isascii() or not text.isdigit() or len(text) > _MOST_DIGITS:
        raise argparse.ArgumentTypeError(f'"{text[:99]}" is not a whole number above 0')
    return int(text)


def node(text: str) -> str:
    """Read the name of a node."""
    if not _NODE.match(text):
        raise argparse.ArgumentTypeError(f'"{text}" cannot name a node, such as /sim or /east/sim')
    return text


def port(text: str) -> int:
    """Read the number of a TCP port."""
    value = count(text)
    if value > _LAST_PORT:
        raise argparse.ArgumentTypeError(f'"{text}" is not a port from 1 to {_LAST_PORT}')
    return value


def define(text: str) -> tuple[str, float]:
    """Read a name and its number."""
    name, equals, value = text.partition('=')
    if not name.isidentifier() or not equals:
        raise argparse.ArgumentTypeError(f'"{text}" is not like height=15')
    if name == 'seed':
        raise argparse.ArgumentTypeError('a grammar has no value "seed"; say --seed')
    return name, number(value)
