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

"""The node as a process of its own, and a client that talks to it over loopback."""

from collections.abc import Callable, Iterator
import json
import os
from pathlib import Path
from queue import Queue
import re
import signal
import subprocess
import sys
from threading import Thread
from time import monotonic, sleep
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from forked import ForkedProcess
from rcl_interfaces.srv import GetParameters, SetParameters
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from single_thread import as_for_users
from std_srvs.srv import SetBool, Trigger

os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)  # own domain: sessions do not meet
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
ROOT = Path(__file__).resolve().parents[1]
# What is lost while processes find each other is repeated within 0.2 s, else within 3 s.
os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(ROOT / 'config/quick_discovery.xml')

PATIENCE = 180.0  # [s] far more than is ever needed, also where a second's work takes a minute
_COLD_START = 1200.0  # [s] a node that starts for the first time compiles kernels first
# Lines of the log about nothing bad, the rest of the banner, and the status line; ROS cannot
# publish what is said while a signal ends it.
_GOOD_NEWS = re.compile(r'\[(INFO|DEBUG)\]|  |t +\d|starting|building the scene'
                        '|Failed to publish log message to rosout')
_AGAIN = 10.0  # [s] after which a message or a subscription that had no effect is repeated
SAPLING = """
axiom: Width(0.08) Density(700) Modulus(8e9) DampingRatio(0.05) F(1) F(1) [ +(40) F(0.8) ] F(1)
"""
EVEN = {'turbulence_intensity': 0.0}  # to draw eddies takes a third of what a node's start takes
SCENE: dict[str, Any] = {
    'scene': {'objects': ['sapling', 'post']}, 'wind': EVEN,
    'sapling': {'grammar_text': SAPLING, 'count': 3, 'layout': 'row', 'spacing': 4.0},
    'post': {'grammar_text': SAPLING, 'origin': [0.0, 6.0, 0.0]},
}
PARTS = 16


class NodeProcess:
    """
    The executable `sim` in another process.

    :param folder: where its parameter file goes.
    :param parameters: nested mapping; None = no parameter file.
    :param arguments: further ROS arguments.
    :param forked: start it without delay, else as users do.
    """

    def __init__(self, folder: Path, parameters: dict | None = None, *arguments: str,
                 forked: bool = True):
        # Answers are to be definite, also where a step takes as long as it does on a busy machine.
        command = ['--ros-args', '-p', 'service_deadline:=3600.0', *arguments]
        if parameters is not None:
            path = folder / 'scene.yaml'  # JSON is YAML
            path.write_text(json.dumps({'/**': {'ros__parameters': parameters}}), 'utf-8')
            command += ['--params-file', str(path)]
        self.process: Any
        if forked:
            self.process = ForkedProcess('procphys_ros.ros.sim', command, errors=False)
        else:
            self.process = subprocess.Popen(
                [sys.executable, '-m', 'procphys_ros.ros.sim', *command], cwd=ROOT,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                env={**as_for_users(os.environ), 'PYTHONUNBUFFERED': '1'})
        self._lines: Queue = Queue()
        self._said: list[str] = []
        # Always read what it says: a pipe that is full would stop it.
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def next_line(self, patience: float = PATIENCE) -> str:
        """Return the next line that the node prints."""
        line = self._lines.get(timeout=patience)
        assert line is not None, f'the node ended: {self.complaints()}'
        return line

    def wait_for_banner(self) -> str:
        """Read what the node says until it runs."""
        lines = [self.next_line(_COLD_START)]
        while 'Ctrl-C' not in lines[-1]:
            lines.append(self.next_line(_COLD_START))
        return ''.join(lines)

    def finish(self, how: signal.Signals | None = None) -> tuple[int, str]:
        """Send a signal, wait for the end, and give the exit code and what the node complained."""
        if how is not None:
            self.process.send_signal(how)
        code = self.process.wait(timeout=_COLD_START)
        self._reader.join()
        return code, self.complaints()

    def kill(self) -> None:
        """End the process in any case."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()

    def _read(self) -> None:
        for line in self.process.stdout:
            self._said.append(line)
            self._lines.put(line)
        self._lines.put(None)

    def complaints(self) -> str:
        """Return the warnings and errors that the node has printed so far."""
        return ''.join(line for line in self._said if not _GOOD_NEWS.match(line))


def wait_until(done: Callable[[], Any], what: str) -> None:
    """Wait for something that other threads and processes do."""
    end = monotonic() + PATIENCE
    while not done():
        assert monotonic() < end, f'waited in vain for {what}'
        sleep(0.02)


def serve(folder: Path, parameters: dict) -> Iterator[NodeProcess]:
    """Run a node, with ROS in this process to talk to it, while a fixture lasts."""
    rclpy.init()
    process = NodeProcess(folder, parameters)
    process.wait_for_banner()
    yield process
    process.kill()
    rclpy.try_shutdown()


class Client:
    """A node in this process that listens to `sim`, sends to it and calls its services."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('test_client')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()

    def host(self, node: Any) -> None:
        """Serve a node of this process as well while this one waits."""
        self._executor.add_node(node)

    def spin_until(self, done: Callable[[], Any], what: str) -> None:
        """Handle what arrives until a condition holds."""
        assert self._spin(PATIENCE, done), f'waited in vain for {what}'

    def _spin(self, longest: float, done: Callable[[], Any]) -> bool:
        """Handle what arrives until a condition holds or time is up; say whether it holds."""
        end = monotonic() + longest
        while not done():
            if monotonic() > end:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def listen(self, kind: type, topic: str, profile: Any = 5, **options: Any) -> list:
        """Subscribe, and give the list that messages will be appended to."""
        received: list = []
        self.node.create_subscription(kind, topic, received.append, profile, **options)
        return received

    def next_message(self, kind: type, topic: str, profile: Any = 5,
                     fits: Callable[[Any], Any] = lambda message: True) -> Any:
        """Subscribe, give the first message that arrives and fits, and unsubscribe."""
        received: list = []

        def take(message: Any) -> None:
            if fits(message):
                received.append(message)

        end = monotonic() + PATIENCE
        while not received:  # who joins late, and is told once, may be told too early
            assert monotonic() < end, f'waited in vain for a message on {topic}'
            subscription = self.node.create_subscription(kind, topic, take, profile)
            self._spin(_AGAIN, lambda: received)
            self.node.destroy_subscription(subscription)
        return received[0]

    def publisher(self, kind: type, topic: str) -> Any:
        """Make a publisher and wait until the node has it."""
        publisher = self.node.create_publisher(kind, topic, 1000)
        self.spin_until(publisher.get_subscription_count, f'a subscriber of {topic}')
        return publisher

    def send_until(self, done: Callable[[], Any], what: str, *sent: tuple[Any, Any]) -> None:
        """
        Publish until that shows.

        A publisher knows its subscribers before they know it, so its first messages may be lost.

        :param sent: publishers, each with its message.
        """
        end = monotonic() + PATIENCE
        while True:
            assert monotonic() < end, f'waited in vain for {what}'
            for publisher, message in sent:
                publisher.publish(message)
            if self._spin(_AGAIN, done):
                return

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service and give its answer."""
        client = self.node.create_client(kind, service)
        self.spin_until(client.service_is_ready, f'the service {service}')
        future = client.call_async(request)
        self.spin_until(future.done, f'an answer of {service}')
        self.node.destroy_client(client)
        return future.result()

    def trigger(self, name: str) -> Any:
        """Call one of the Trigger services of `sim`."""
        return self.call(Trigger, f'/sim/{name}', Trigger.Request())

    def switch(self, name: str, on: bool) -> Any:
        """Call one of the SetBool services of `sim`."""
        return self.call(SetBool, f'/sim/{name}', SetBool.Request(data=on))

    def set_parameter(self, name: str, value: Any) -> Any:
        """Set a parameter of `sim`; return the result with `successful` and `reason`."""
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()])
        return self.call(SetParameters, '/sim/set_parameters', request).results[0]

    def get_parameter(self, name: str) -> Any:
        """Read a parameter of `sim`."""
        answer = self.call(GetParameters, '/sim/get_parameters',
                           GetParameters.Request(names=[name]))
        return Parameter.from_parameter_msg(
            Parameter(name).to_parameter_msg().__class__(name=name, value=answer.values[0])).value

    def diagnostics_where(self, fits: Callable[[dict[str, str]], bool]) -> dict[str, str]:
        """Wait for a status whose values fit, and give them; 'message' is among them."""
        return values_of(self.next_message(DiagnosticArray, '/diagnostics', 10,
                                           lambda array: fits(values_of(array))))

    def watch_status(self) -> Callable[[], dict[str, str]]:
        """Return a function that returns the newest status; 'message' is among its values."""
        received = self.listen(DiagnosticArray, '/diagnostics', 10)
        self.spin_until(lambda: received, 'a status')
        return lambda: values_of(received[-1])


def reset_client() -> Iterator[Client]:
    """Make a client to a node that has just been reset."""
    client = Client()
    assert client.trigger('reset_simulation').success
    yield client
    client.close()


def values_of(array: DiagnosticArray) -> dict[str, str]:
    """Read the values of a status, and its message."""
    status = array.status[0]
    return {'message': status.message, **{v.key: v.value for v in status.values}}
