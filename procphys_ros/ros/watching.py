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


"""Watching: the state of a simulation as lines for a terminal."""

from time import monotonic
from typing import TextIO

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from procphys_ros.command_line.description import Description
from procphys_ros.command_line.progress import break_line, status_line
from procphys_ros.messages.points import BREAK
from procphys_ros.ros.remote import Remote
from procphys_ros.terminal.progress_bar import draw_over

_MOST_BREAKS = 10  # lines for one message; a collapse breaks thousands of bonds at once


def watch(remote: Remote, seconds: float | None, out: TextIO) -> None:
    """
    Print a line on each change: the status each second, and bonds as they break.

    :param remote: the node.
    :param seconds: time until the end [s]; None = no limit.
    :param out: on a terminal the status line is overwritten, elsewhere each is a new line.
    """
    scenes: list[String] = []
    statuses: list[DiagnosticArray] = []
    breaks: list[PointCloud2] = []
    remote.follow(scenes, statuses, breaks)
    names: list[str] = []
    end = monotonic() + seconds if seconds else None
    rejected = None
    while end is None or monotonic() < end:
        remote.spin()
        if scenes:
            names = Description(scenes[-1].data).names
            scenes.clear()
        for message in breaks:
            _print_breaks(message, names, out)
        breaks.clear()
        for message in statuses:
            for status in message.status:
                if status.name == f'{remote.name}: simulation':
                    values = {v.key: v.value for v in status.values}
                    if rejected is not None and values['commands rejected'] != rejected:
                        _print(f'  rejected: {values["last rejection"]}', out)
                    rejected = values['commands rejected']
                    _print(status_line(status.message, values), out, stays=False)
        statuses.clear()


def _print(line: str, out: TextIO, stays: bool = True) -> None:
    if out.isatty() and not stays:
        draw_over(line, out)
    else:
        print(f'\r{line}\x1b[K' if out.isatty() else line, file=out, flush=True)


def _print_breaks(message: PointCloud2, names: list[str], out: TextIO) -> None:
    rows = np.frombuffer(bytes(message.data), BREAK)
    for row in rows[:_MOST_BREAKS]:
        _print(break_line({name: row[name].item() for name in row.dtype.names}, names), out)
    if len(rows) > _MOST_BREAKS:
        _print(f'  and {len(rows) - _MOST_BREAKS} more bonds', out)
