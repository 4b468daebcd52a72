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


"""Loading: build scenes and spawned objects, and hand them to the simulation thread."""

from collections.abc import Callable
from threading import Thread
from time import monotonic

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.files.file_bounds import within
from procphys_ros.ros.building import Builder
from procphys_ros.ros.commands import Answer, Command, CommandQueue, describe
from procphys_ros.ros.free_memory import return_free_memory
from procphys_ros.ros.parameters import Parameters
from procphys_ros.ros.session import Session
from procphys_ros.scene.spawn import Spawn
from procphys_ros.simulation import Simulation

RELOAD = 'reload_scene'
SPAWN = 'spawn'
_STAYS = '; the scene stays as it was'
_MOST_SPAWNS = 8  # grammars that are derived at once


class Loading:
    """
    Load the first scene, replacements, and objects that join.

    :param builder: builds scenes.
    :param queue: passes them to the simulation thread between two steps.
    :param parameters: describe them, as of the start of building.
    :param session: receives them.
    """

    def __init__(self, builder: Builder, queue: CommandQueue, parameters: Parameters,
                 session: Session):
        self._builder = builder
        self._queue = queue
        self._parameters = parameters
        self._session = session
        self._spawning: list[Thread] = []
        self._stopped = False
        self._is_first_needed = False

    def load_first(self, failed: Callable[[Exception], None],
                   answer: Answer | None = None) -> None:
        """
        Start loading the first scene.

        :param failed: called with ProcPhysError, in another thread, if it cannot be built.
        :param answer: called, in another thread, when it runs; such a load can be cancelled.
        """
        def fail(error: Exception) -> None:
            lasting = SceneError(describe(error))
            lasting.__cause__ = error
            failed(lasting)

        self._is_first_needed = answer is None
        told = answer or (lambda success, message: None)
        self._builder.build(self._parameters.nested(), self._parameters.bounds,
                            lambda simulation: self._hand_over(simulation, told), fail)

    def reload(self, answer: Answer) -> None:
        """
        Start loading the scene of the present parameters; on an error the old one is kept.

        :param answer: called, in another thread, with success, and the content or the reason.
        :raises CommandError: if another is being loaded, or none has been yet.
        """
        if not self._session.has_scene:
            raise CommandError('there is no scene yet to load another in place of')

        def hand_over(simulation: Simulation) -> None:
            self._hand_over(simulation, answer)

        def fail(error: Exception) -> None:
            answer(False, self._queue.reject(RELOAD, error, _STAYS))

        self._builder.build(self._parameters.nested(), self._parameters.bounds, hand_over, fail)

    def spawn(self, answer: Answer) -> None:
        """
        Start building the object of the `spawn.*` parameters; it joins the scene when it is built.

        :param answer: called, in another thread, with the result or the reason.
        :raises ProcPhysError: if the parameters are invalid.
        """
        wanted = Spawn.read(self._parameters.nested())
        self.begin_spawn(wanted, lambda made: self._session.spawn(wanted, made), answer)

    def begin_spawn(self, wanted: Spawn, join: Callable[[Blueprint], str],
                    answer: Answer) -> None:
        """
        Start building an object.

        :param wanted: its description.
        :param join: called with it between two steps; describes the result, or raises.
        :param answer: called, in another thread, with the result of `join`, or the error.
        :raises CommandError: if its name is not allowed, or many others are being built.
        """
        wanted.check_name()
        if not self._session.has_scene:
            raise CommandError(self._session.without_scene)
        self._spawning = [thread for thread in self._spawning if thread.is_alive()]
        if len(self._spawning) >= _MOST_SPAWNS:
            raise CommandError(f'{_MOST_SPAWNS} objects are being built already')

        def build() -> None:
            try:
                with within(self._parameters.bounds):
                    made = wanted.build()
            except Exception as error:
                if not self._stopped:
                    answer(False, self._queue.reject(SPAWN, error, _STAYS))
                return
            if not self._stopped:
                self._queue.call(Command(SPAWN, lambda: join(made), answer))

        self._spawning.append(Thread(target=build, name=SPAWN, daemon=True))
        self._spawning[-1].start()

    def stop(self, patience: float) -> bool:
        """Prevent further joining, and wait [s]; return whether all building has ended."""
        self._stopped = True
        end = monotonic() + patience
        for thread in self._spawning:
            thread.join(max(0.0, end - monotonic()))
        return not any(thread.is_alive() for thread in self._spawning)

    def cancel(self, answer: Answer) -> None:
        """
        Cancel the scene being loaded.

        :raises CommandError: if there is none.
        """
        if self._is_first_needed and not self._session.has_scene:
            raise CommandError('the first scene cannot be cancelled; end the node instead')
        self._builder.cancel()
        self._queue.take('cancel_reload')
        answer(True, 'cancelled' + (_STAYS if self._session.has_scene else ''))

    def _hand_over(self, simulation: Simulation, answer: Answer) -> None:
        def adopt() -> str:
            message = self._session.adopt(simulation)
            return_free_memory()
            return message
        self._queue.call(Command(RELOAD, adopt, answer))
