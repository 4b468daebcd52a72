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
from procphys_ros.files.file_bounds import FileBounds, within
from procphys_ros.physics.wind import Wind
from procphys_ros.ros.activity import Activity
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import read_settings
from procphys_ros.simulation import Simulation

BUILDING = 'building the scene'


class Builder:
    """
    Build one scene at a time.

    :ivar activity: progress of the work.
    """

    def __init__(self) -> None:
        self.activity = Activity()
        self._job: _Job | None = None

    def build(self, parameters: Mapping[str, Any], bounds: FileBounds,
              done: Callable[[Simulation], None],
              failed: Callable[[Exception], None]) -> None:
        """
        Start building.

        :param parameters: nested mapping, the description of the scene.
        :param bounds: of the files in it.
        :param done: called with the simulation, in another thread.
        :param failed: called with the exception raised or, after cancelling, with CommandError.
        :raises CommandError: if another scene is being built.
        """
        if self._job is not None and self._job.is_wanted:
            raise CommandError('another scene is being built; ~/cancel_reload ends that')
        self._job = _Job(parameters, bounds, done, failed, self.activity, self._job)

    def cancel(self) -> None:
        """
        Cancel the scene being built.

        :raises CommandError: if there is none.
        """
        if self._job is None or not self._job.cancel():
            raise CommandError('no scene is being built')

    def stop(self, patience: float) -> bool:
        """Abandon the scene being built, wait some time [s], and return whether work has ended."""
        if self._job is None:
            return True
        self._job.abandon()
        return self._job.ended(patience)


class _Cancelled(BaseException):
    """Stops the work of an abandoned job; not caught by handlers of errors."""


class _Job:
    """
    The building of one scene.

    :param before: previous job, which may still be running after it was cancelled.
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
        """Cancel the building; return False if it is too late."""
        if not self.abandon():
            return False
        self._failed(CommandError('cancelled'))
        return True

    def abandon(self) -> bool:
        """Suppress the callbacks of the job; return False if one was called already."""
        with self._lock:
            first, self.is_wanted = self.is_wanted, False
        return first

    def ended(self, patience: float) -> bool:
        """Wait for the end, and return whether it was reached."""
        self._thread.join(patience)
        return not self._thread.is_alive()

    def begin(self, name: str, detail: str) -> None:
        """Record a stage, as a listener to progress."""
        # Not while numba compiles, which must not be interrupted.
        if not self.is_wanted and name != COMPILING:
            raise _Cancelled
        self._activity.begin(name, detail)

    def end(self) -> None:
        """Record the end of a stage, as a listener to progress."""
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
    """Precompute, beside the first steps, data for a first explosion near buildings."""
    masonry = simulation.model.masonry
    if masonry.members.any():
        _ = masonry.skin, scipy.ndimage, scipy.spatial


def _draw_eddies(parameters: Mapping[str, Any]) -> None:
    """Draw the eddies of a scene, which takes half a second; winds share them."""
    settings = read_settings(parameters)
    Wind(settings.wind, settings.seed).prepare()
