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


"""Fill the cache of kernels while the node already runs."""

from collections.abc import Callable
import subprocess
import sys
from threading import Thread

from procphys_ros.compilation.folder import is_complete

_END = 0.3  # [s] in which the child must end before it is killed


class BackgroundCompilation:
    """
    Compile kernels in a child process, first those that the node itself waits for.

    The child shares the work before the first poses with the node, from the other end, at normal
    priority, and continues at low priority with kernels that no simulation has needed yet: the
    simulation does not wait for these, but compiles any missing one at its call. Nothing is
    started when the cache is complete.

    :param say: called when the child begins and when it has ended.
    :ivar progress: of the child, such as '17/120 physics.trees.passes.step'; '' = none.
    """

    def __init__(self, say: Callable[[str], None]):
        self._say = say
        self._child: subprocess.Popen | None = None
        self.progress = ''

    def start(self) -> None:
        """Start the child if any kernel is to be compiled."""
        if not is_complete():
            self._start()

    def close(self) -> None:
        """Terminate the child; kernels compiled so far are kept."""
        child, self._child = self._child, None
        if child is None:
            return
        child.terminate()
        try:
            child.wait(_END)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()

    def _start(self) -> None:
        command = [sys.executable, '-m', 'procphys_ros.warm', '--background']
        self._child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                       stderr=subprocess.DEVNULL, text=True)
        self.progress = 'starting'
        self._say('compiling kernels in the background; what is called before it is ready takes '
                  'seconds at its first use')
        Thread(target=self._follow, args=(self._child,), name='compilation', daemon=True).start()

    def _follow(self, child: subprocess.Popen) -> None:
        """Read the progress of the child until it ends."""
        assert child.stdout is not None
        last = ''
        for line in child.stdout:
            last = self.progress = line.strip()
        self.progress = ''
        if child.wait() == 0:
            self._say(last)
