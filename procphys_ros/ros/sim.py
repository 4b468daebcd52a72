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


"""Executable `sim`: runs the node."""

import os
import signal
import sys


def main(args: list[str] | None = None) -> int:
    """
    Run the node until it is told to stop.

    :param args: command line, with ROS arguments; None = the process's own.
    :returns: exit code: 0 when told to stop, 1 when the scene cannot be read.
    """
    # rclpy handles signals once it is started. Importing takes a second or more, and a signal
    # must end the process as cleanly in that time; so the imports come after this. Nothing is
    # open yet, and an exception might be swallowed by whatever it comes across.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    from procphys_ros.ros.running import run
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    return run(args)


if __name__ == '__main__':
    sys.exit(main())
