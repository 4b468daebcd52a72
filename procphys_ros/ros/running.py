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


"""Run the node as a process: start it, say what runs, end it cleanly."""

import sys

import rclpy
from rclpy.exceptions import NotInitializedException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from procphys_ros.errors import ProcPhysError, SceneError
from procphys_ros.ros.diagnostics import status_line
from procphys_ros.ros.node import SimNode


def run(args: list[str] | None) -> int:
    """
    Run the node until it is told to stop.

    :param args: command line, with ROS arguments; None = the process's own.
    :returns: exit code: 0 when told to stop, 1 when the scene cannot be read.
    """
    try:
        _start_ros(args)
        _spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ProcPhysError, ParameterException) as error:
        print(f'sim: {error}', file=sys.stderr)
        return 1
    except (RuntimeError, NotInitializedException):
        if rclpy.ok():
            raise  # else a signal has ended the context under the hands of whoever used it
    finally:
        rclpy.try_shutdown()
    return 0


def _spin() -> None:
    executor = SingleThreadedExecutor()  # first of all: it cannot be made once a signal has come
    node = SimNode()
    print(banner(node), flush=True)
    node.create_timer(1.0, lambda: print(status_line(node.diagnostics.latest), flush=True),
                      clock=node.steady_clock)
    executor.add_node(node)
    try:
        _serve(executor, node)
        node.loop.ended.result()
    finally:
        node.destroy_node()


def _serve(executor: SingleThreadedExecutor, node: SimNode) -> None:
    """Serve ROS until the node has ended; no message or request that cannot be read ends it."""
    while not node.loop.ended.done():
        try:
            executor.spin_until_future_complete(node.loop.ended)
        except ExternalShutdownException:
            raise
        except Exception as error:
            if not rclpy.ok():
                raise
            node.report_defect(error)


def _start_ros(args: list[str] | None) -> None:
    """Start rclpy; it reads the command line and the parameter files."""
    try:
        rclpy.init(args=args)
    except RuntimeError as error:  # RCLError and UnknownROSArgsError: only their text tells
        reason = str(error).partition(': ')[2] or str(error)
        hint = ('; write the numbers of a list alike, [1.0, 2.5, 0.0]'
                if 'Sequence should be of same type' in reason else '')
        raise SceneError(reason.split(', at /')[0] + hint) from error


def banner(node: SimNode) -> str:
    """Say what runs and where to look."""
    name = node.get_fully_qualified_name()
    return '\n'.join((
        f'procphys_ros: {node.session.summary()}',
        f'  out  {name}/poses {name}/markers {name}/scene_description {name}/breaks '
        f'{name}/dust {name}/wind_info {name}/intruder_wrench /clock '
        '/diagnostics',
        f'  in   {name}/wind {name}/impulse {name}/wrench {name}/explosion '
        f'{name}/observer {name}/intruder',
        '  stop with Ctrl-C'))
