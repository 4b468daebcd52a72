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


"""Executable `managed_sim`: the node with the life cycle of managed nodes."""

import sys


def main(args: list[str] | None = None) -> int:
    """
    Run the node until it is stopped; see `sim`.

    :param args: command line, with ROS arguments; None = the process's own.
    :returns: exit code.
    """
    from procphys_ros.ros import sim
    return sim.main(args, 'procphys_ros.ros.managed:ManagedSimNode', 'managed_sim')


if __name__ == '__main__':
    sys.exit(main())
