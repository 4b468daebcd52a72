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


"""Run the node as a process: start it, serve ROS, and shut it down cleanly."""

from contextlib import suppress
import os
import signal
import sys
import warnings

import rclpy
from rclpy.exceptions import NotInitializedException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.signals import uninstall_signal_handlers

from procphys_ros.errors import ProcPhysError
from procphys_ros.ros.node import SimNode
from procphys_ros.ros.starting import overruled, start_ros
from procphys_ros.terminal.warning_lines import told_to

_SWITCH = 0.001  # [s] after which a computing thread lets another run (Python: 0.005)


def run(args: list[str] | None, kind: type[SimNode] = SimNode) -> int:
    """
    Run the node until it is stopped.

    :param args: command line, with ROS arguments; None = the process's own.
    :param kind: class of the node.
    :returns: exit code: 0 when stopped, 1 if the scene cannot be read.
    """
    sys.setswitchinterval(_SWITCH)
    code = 0
    try:
        start_ros(args)
        with told_to(get_logger('sim').warning):
            _spin(kind, sys.argv[1:] if args is None else args)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ProcPhysError, ParameterException) as error:
        code = _complain(error)
    except (RuntimeError, NotInitializedException):
        if rclpy.ok():
            raise  # else a signal has ended the context while it was in use
    finally:
        with suppress(RuntimeError):  # a signal may shut the context down at the same moment
            rclpy.try_shutdown()
        uninstall_signal_handlers()  # ends their thread, which must not outlive the interpreter
    return code


def _spin(kind: type[SimNode], words: list[str]) -> None:
    # A signal may come between the creation of a handler and its run, and rclpy drops it then.
    warnings.filterwarnings('ignore', "coroutine 'Executor._make_handler", RuntimeWarning)
    executor = SingleThreadedExecutor()  # first: it cannot be made after a signal
    node = kind()
    node.has_told_end = True  # `_complain` will
    for line in overruled(words, node.parameters.given()):
        node.get_logger().warning(line)
    executor.add_node(node)
    code = 0
    try:
        _serve(executor, node)
    except (KeyboardInterrupt, ExternalShutdownException, SystemExit):
        pass  # SIGTERM raises SystemExit; threads must end before the interpreter does
    except ProcPhysError as error:
        code = _complain(error)
    if not node.destroy_node():
        # A thread that compiles or computes cannot be stopped, and the interpreter must not be
        # finalised while it runs.
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # None after >&-
                stream.flush()
        os._exit(code)
    if code:
        sys.exit(code)


def _serve(executor: SingleThreadedExecutor, node: SimNode) -> None:
    """Serve ROS until the node has ended; unreadable messages and requests do not end it."""
    while not node.loop.ended.done():
        try:
            executor.spin_until_future_complete(node.loop.ended)
        except ExternalShutdownException:
            raise
        except Exception as error:
            if not rclpy.ok():
                raise ExternalShutdownException from error
            node.report_defect(error)
    node.loop.ended.result()


def _complain(error: Exception) -> int:
    """Report in one line why the node ends, and return the exit code; ignore Ctrl-C meanwhile."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the first line of a log takes rclpy a while
    if rclpy.ok():
        get_logger('sim').fatal(str(error))
    else:
        print(f'sim: {error}', file=sys.stderr)
    return 1
