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

"""Build scenes in a thread of their own, while commands are answered and time goes on."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from threading import Lock, Thread
from typing import Any

import scipy

from procphys_ros import progress
from procphys_ros.compilation.progress import COMPILING
from procphys_ros.errors import CommandError
from procphys_ros.file_bounds import FileBounds, within
from procphys_ros.physics.wind import Wind
from procphys_ros.ros.activity import Activity
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import read_settings
from procphys_ros.simulation import Simulation

BUILDING = 'building the scene'


class Builder:
    """
    Builds one scene at a time.

    :ivar activity: what is being done, and how far it is.
    """

    def __init__(self) -> None:
        self.activity = Activity()
        self._job: _Job | None = None

    def build(self, parameters: Mapping[str, Any], bounds: FileBounds,
              done: Callable[[Simulation], None],
              failed: Callable[[Exception], None]) -> None:
        """
        Start building.

        :param parameters: nested mapping that describes the scene.
        :param bounds: of the files that it names.
        :param done: called with the simulation, in another thread.
        :param failed: called with what was raised or, when it is cancelled, with CommandError.
        :raises CommandError: when another scene is being built.
        """
        if self._job is not None and self._job.is_wanted:
            raise CommandError('another scene is being built; ~/cancel_reload ends that')
        self._job = _Job(parameters, bounds, done, failed, self.activity, self._job)

    def cancel(self) -> None:
        """
        Give up what is being built.

        :raises CommandError: when nothing is.
        """
        if self._job is None or not self._job.cancel():
            raise CommandError('no scene is being built')

    def stop(self, patience: float) -> bool:
        """Give up what is being built, wait some time [s], and say whether it has ended."""
        if self._job is None:
            return True
        self._job.abandon()
        return self._job.ended(patience)


class _Cancelled(BaseException):
    """Ends the work of a job nobody waits for any more; passes what catches errors."""


class _Job:
    """
    The building of one scene.

    :param before: a job that may not have noticed yet that it was cancelled.
    """

    def __init__(self, parameters: Mapping[str, Any], bounds: FileBounds,
                 done: Callable[[Simulation], None], failed: Callable[[Exception], None],
                 activity: Activity, before: '_Job | None'):
        self._parameters = parameters
        self._bounds = bounds
        self._done = done
        self._failed = failed
        self._activity = activity
        self._lock = Lock()
        self.is_wanted = True
        self._thread = Thread(target=self._run, args=(before,), name='builder', daemon=True)
        self._thread.start()

    def cancel(self) -> bool:
        """Cancel the building; False when it is too late for that."""
        if not self.abandon():
            return False
        self._failed(CommandError('cancelled'))
        return True

    def abandon(self) -> bool:
        """Have nobody told of the scene; False when somebody was already."""
        with self._lock:
            first, self.is_wanted = self.is_wanted, False
        return first

    def ended(self, patience: float) -> bool:
        """Wait for the end, and say whether it has come."""
        self._thread.join(patience)
        return not self._thread.is_alive()

    def begin(self, name: str, detail: str) -> None:
        """Take up a stage, as a listener to progress."""
        # Not while numba compiles: it would be left half way.
        if not self.is_wanted and name != COMPILING:
            raise _Cancelled
        self._activity.begin(name, detail)

    def end(self) -> None:
        """Take up the end of a stage, as a listener to progress."""
        self._activity.end()

    def _run(self, before: '_Job | None') -> None:
        if before is not None:
            before._thread.join()
        try:
            with (within(self._bounds), progress.reported_to(self), progress.stage(BUILDING),
                  ThreadPoolExecutor(1, 'eddies') as other):
                drawn = other.submit(_draw_eddies, self._parameters)
                scene = Scene.from_parameters(self._parameters)
                with progress.stage('setting it up'):
                    simulation = Simulation(scene)
                    drawn.result()
        except _Cancelled:
            return
        except Exception as error:
            if self.abandon():
                self._failed(error)
            return
        if self.abandon():
            self._done(simulation)
            _prepare(simulation)
        else:
            simulation.close()


def _prepare(simulation: Simulation) -> None:
    """Compute beside the first steps what a first explosion near buildings would wait for."""
    masonry = simulation.model.masonry
    if masonry.members.any():
        _ = masonry.skin, scipy.ndimage, scipy.spatial


def _draw_eddies(parameters: Mapping[str, Any]) -> None:
    """Draw the eddies of a scene, half a second that no step is to take; winds share them."""
    settings = read_settings(parameters)
    Wind(settings.wind, settings.seed).prepare()
