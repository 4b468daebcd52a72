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


"""
The services of the package `simulation_interfaces`, for tools that drive any simulator.

Entities are the objects of the scene and what is launched later. What the package calls with names
of its own is read from it, so that nothing here depends on the numbers that it gives its codes.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from geometry_msgs.msg import Vector3
import numpy as np
from rclpy.action import ActionServer, CancelResponse
from rclpy.node import Node

from procphys_ros import messages
from procphys_ros.errors import CommandError
from procphys_ros.ros.entities import Entities
from procphys_ros.ros.entity_services import BeginSpawn, EntityServer, FORMATS
from procphys_ros.ros.posix_pattern import PosixPattern
from procphys_ros.ros.services import Answers
from procphys_ros.ros.session import Session
from procphys_ros.schema import short

PACKAGE = 'simulation_interfaces'
# Supported features, and their services; those that the installed package lacks are omitted.
FEATURES = {'ENTITY_TAGS': 'get_entities', 'ENTITY_BOUNDS_BOX': 'get_entities',
            'ENTITY_CATEGORIES': 'get_entities', 'ENTITY_STATE_GETTING': 'get_entity_state',
            'ENTITY_INFO_GETTING': 'get_entity_info', 'SIMULATION_RESET': 'reset_simulation',
            'SIMULATION_STATE_GETTING': 'get_simulation_state',
            'SIMULATION_STATE_SETTING': 'set_simulation_state',
            'SIMULATION_STATE_PAUSE': 'set_simulation_state',
            'STEP_SIMULATION_SINGLE': 'step_simulation',
            'STEP_SIMULATION_MULTIPLE': 'step_simulation',
            'STEP_SIMULATION_ACTION': 'simulate_steps', 'SPAWNING': 'spawn_entity',
            'SPAWNING_ENTITIES': 'spawn_entities', 'ENTITY_BOUNDS': 'get_entity_bounds',
            'SPAWNING_RESOURCE_STRING': 'spawn_entity', 'SPAWNABLES': 'get_spawnables',
            'DELETING': 'delete_entity', 'ENTITY_STATE_SETTING': 'set_entity_state',
            'SIMULATION_RESET_SPAWNED': 'reset_simulation'}
_SERVICES = ('get_simulator_features', 'get_simulation_state', 'set_simulation_state',
             'step_simulation', 'reset_simulation', 'get_entities', 'get_entity_state',
             'get_entities_states', 'get_entity_info', 'get_spawnables', 'get_entity_bounds',
             'spawn_entity', 'spawn_entities', 'delete_entity', 'set_entity_state')
_ACTIONS = ('simulate_steps',)


def _kind(name: str) -> str:
    """Return the name of the type of a service or action."""
    return name.title().replace('_', '')


def offer(node: Node, answers: Answers, session: Session, begin_spawn: BeginSpawn) -> list[str]:
    """
    Offer the services and actions as `~/simulation_interfaces/…`, if their package is installed.

    :param node: the node that offers them.
    :param answers: waits for the results of commands.
    :param session: executes commands.
    :param begin_spawn: builds an object that joins the scene.
    :returns: their names; none if the package cannot be used.
    """
    made: list[Any] = []
    try:
        return _create(node, answers, session, begin_spawn, made)
    except Exception as error:  # each missing file raises another exception
        if isinstance(error, ModuleNotFoundError) and error.name == PACKAGE:
            return []
        if not node.context.ok():
            raise
        for service in made:
            node.destroy_service(service)
        node.get_logger().warning(
            f'the services of {PACKAGE} are not offered, because the package cannot be used '
            f'({type(error).__name__}: {short(str(error))}); install it anew')
        return []


def _create(node: Node, answers: Answers, session: Session, begin_spawn: BeginSpawn,
            made: list[Any]) -> list[str]:
    """Create services and actions; the former are appended to `made`."""
    types, kinds = import_module(f'{PACKAGE}.msg'), import_module(f'{PACKAGE}.srv')
    try:
        actions: Any = import_module(f'{PACKAGE}.action')
    except ImportError:
        actions = None
    services = [name for name in _SERVICES if hasattr(kinds, _kind(name))]
    courses = [name for name in _ACTIONS if hasattr(actions, _kind(name))]
    frame = node.get_parameter('world_frame').value
    server = SimulationInterfacesServer(types, answers, begin_spawn, session, frame,
                                        [*services, *courses])
    for name in services:
        serve = getattr(server, name, None) or getattr(server.entities, name)
        made.append(node.create_service(getattr(kinds, _kind(name)), f'~/{PACKAGE}/{name}',
                                        serve, callback_group=answers.group))
    for name in courses:
        ActionServer(node, getattr(actions, _kind(name)), f'~/{PACKAGE}/{name}',
                     getattr(server, name), callback_group=answers.group,
                     cancel_callback=lambda handle: CancelResponse.ACCEPT)
    return [*services, *courses]


class SimulationInterfacesServer:
    """
    Handle the service requests.

    :param types: the package's module `msg`.
    :param replies: waits for commands in the thread of the simulation.
    :param begin_spawn: builds an object that joins the scene.
    :param session: executes commands.
    :param frame: of poses.
    :param offered: names of the available services and actions.
    :ivar entities: handles requests that add, remove and move entities.
    """

    def __init__(self, types: Any, replies: Answers, begin_spawn: BeginSpawn, session: Session,
                 frame: str, offered: Sequence[str] = (*_SERVICES, *_ACTIONS)):
        self._types = types
        self._result, self._state = types.Result, types.SimulationState
        self._replies = replies
        self.entities = EntityServer(types, replies, begin_spawn, session, frame)
        self._session = session
        self._frame = frame
        self._offered = offered
        self._is_held = False  # paused on demand before the first step: not stopped

    async def get_simulator_features(self, request: Any, response: Any) -> Any:
        """List the supported features."""
        known = self._types.SimulatorFeatures
        response.features.features = [
            getattr(known, feature) for feature, service in FEATURES.items()
            if service in self._offered and hasattr(known, feature)]
        if 'spawn_entity' in self._offered:
            response.features.spawn_formats = list(FORMATS)
        response.features.custom_info = 'procphys_ros; entities are objects, such as oak_0, and ' \
            'their parts, such as oak_0/17'
        return response

    async def get_simulation_state(self, request: Any, response: Any) -> Any:
        """Return whether time passes; paused, undamaged and at time 0 counts as stopped."""
        response.state.state = self._present_state()
        return self._done(response)

    async def set_simulation_state(self, request: Any, response: Any) -> Any:
        """Play, pause, or stop, which means reset and pause."""
        wanted, state = request.state.state, self._state
        if wanted not in (state.STATE_STOPPED, state.STATE_PLAYING, state.STATE_PAUSED):
            return self._failed(response, self._result.RESULT_FEATURE_UNSUPPORTED,
                                'end the node by a signal' if wanted == state.STATE_QUITTING
                                else f'there is no state {wanted}')
        if wanted == self._present_state():
            return self._failed(response, response.ALREADY_IN_TARGET_STATE, 'it is so already')

        def change() -> str:
            if wanted == state.STATE_STOPPED:
                self._session.revert()
            self._is_held = wanted == state.STATE_PAUSED
            return self._session.set_pause(wanted != state.STATE_PLAYING)
        return await self._carry_out(response, 'set_simulation_state', change,
                                     response.STATE_TRANSITION_ERROR)

    async def step_simulation(self, request: Any, response: Any) -> Any:
        """Run some steps while paused; other commands are executed between them."""
        if not self._session.paused:
            return self._failed(response, self._result.RESULT_OPERATION_FAILED,
                                'the simulation is running; pause it first')
        for _ in range(request.steps):
            await self._carry_out(response, 'step_simulation', self._session.step_simulation)
            if response.result.result != self._result.RESULT_OK:
                return response
        return self._done(response)

    async def simulate_steps(self, handle: Any) -> Any:
        """Run some steps while paused, with feedback on each; cancelling ends between two."""
        kind = import_module(f'{PACKAGE}.action').SimulateSteps
        response, feedback = kind.Result(), kind.Feedback()
        steps = handle.request.steps
        if not self._session.paused:
            handle.abort()
            return self._failed(response, self._result.RESULT_OPERATION_FAILED,
                                'the simulation is running; pause it first')
        for done in range(steps):
            if handle.is_cancel_requested:
                handle.canceled()
                return self._failed(response, self._result.RESULT_OPERATION_FAILED,
                                    f'cancelled after {done} of {steps} steps')
            await self._carry_out(response, 'simulate_steps', self._session.step_simulation)
            if response.result.result != self._result.RESULT_OK:
                handle.abort()
                return response
            feedback.completed_steps, feedback.remaining_steps = done + 1, steps - done - 1
            handle.publish_feedback(feedback)
        handle.succeed()
        return self._done(response)

    async def reset_simulation(self, request: Any, response: Any) -> Any:
        """Reset everything to the start, or remove spawned entities; no other scope works."""
        state = request.SCOPE_TIME | request.SCOPE_STATE
        acts = {request.SCOPE_DEFAULT: self._session.revert,
                request.SCOPE_ALL: self._session.revert,
                state | request.SCOPE_SPAWNED: self._session.revert,
                state: self._session.reset_simulation,
                request.SCOPE_SPAWNED: self._session.remove_added}
        if request.scope not in acts:
            return self._failed(response, self._result.RESULT_FEATURE_UNSUPPORTED,
                                'time and state can only be reset together; what was spawned '
                                'also by itself')
        return await self._carry_out(response, 'reset_simulation', acts[request.scope])

    async def get_entities(self, request: Any, response: Any) -> Any:
        """List the objects that match the filters."""
        def look() -> str:
            response.entities = self._fitting(request.filters)
            return ''
        return await self._search(request, response, 'get_entities', look)

    async def get_entities_states(self, request: Any, response: Any) -> Any:
        """Return the objects that match the filters and still have parts, and their states."""
        def look() -> str:
            entities = self._entities()
            response.entities = [name for name in self._fitting(request.filters)
                                 if entities.is_left(name)]
            response.states = [self._state_of(entities, name) for name in response.entities]
            return ''
        return await self._search(request, response, 'get_entities_states', look)

    async def get_entity_state(self, request: Any, response: Any) -> Any:
        """Return pose and twist of an object or a part."""
        def look() -> str:
            response.state = self._state_of(self._entities(), request.entity)
            return ''
        return await self._carry_out(response, 'get_entity_state', look,
                                     self._result.RESULT_NOT_FOUND)

    async def get_entity_info(self, request: Any, response: Any) -> Any:
        """Describe the parts of an object; its tags are their kinds."""
        def look() -> str:
            entities = self._entities()
            response.info.category.category = self._types.EntityCategory.CATEGORY_OBJECT
            response.info.description = entities.describe(request.entity)
            response.info.tags = entities.kinds(request.entity)
            return ''
        return await self._carry_out(response, 'get_entity_info', look,
                                     self._result.RESULT_NOT_FOUND)

    async def get_entity_bounds(self, request: Any, response: Any) -> Any:
        """Return the box around the remaining parts of an object, in the frame of its state."""
        def look() -> str:
            low, high = self._entities().bounds(request.entity)
            response.bounds.type = self._types.Bounds.TYPE_BOX
            response.bounds.points = [Vector3(**dict(zip('xyz', corner.tolist())))
                                      for corner in (high, low)]
            return ''
        return await self._carry_out(response, 'get_entity_bounds', look,
                                     self._result.RESULT_NOT_FOUND)

    def _entities(self) -> Entities:
        return Entities(self._session.simulation)

    def _present_state(self) -> int:
        if not self._session.paused:
            return self._state.STATE_PLAYING
        if not self._session.has_scene:
            return self._state.STATE_STOPPED
        simulation = self._session.simulation
        is_new = not (simulation.time > 0.0 or simulation.added or simulation.removed)
        return (self._state.STATE_STOPPED if is_new and not self._is_held
                else self._state.STATE_PAUSED)

    def _fitting(self, filters: Any) -> list[str]:
        """
        List the objects that match all filters.

        :raises CommandError: if a filter is invalid.
        """
        entities = self._entities()
        pattern = PosixPattern(filters.filter)
        category = self._types.EntityCategory.CATEGORY_OBJECT
        if len(filters.categories) and category not in [c.category for c in filters.categories]:
            return []
        found = [name for name in entities.names if pattern.is_in(name)]
        tags = set(filters.tags.tags)
        if tags:
            fits = (tags.issubset if filters.tags.filter_mode == filters.tags.FILTER_MODE_ALL
                    else lambda kinds: not tags.isdisjoint(kinds))
            found = [name for name in found if fits(entities.kinds(name))]
        return self._within(entities, found, filters.bounds) if filters.bounds.points else found

    def _within(self, entities: Entities, names: list[str], bounds: Any) -> list[str]:
        """Select the objects whose boxes overlap a box or a sphere."""
        points = np.array([[p.x, p.y, p.z] for p in bounds.points])
        if len(points) != 2:
            raise CommandError(f'bounds have {len(points)} points; a box or a sphere has two')
        if bounds.type == bounds.TYPE_SPHERE:
            return [n for n in names if entities.near(n, points[0], points[1, 0])]
        return [n for n in names if entities.overlaps(n, points.min(axis=0), points.max(axis=0))]

    def _state_of(self, entities: Entities, name: str) -> Any:
        pose, twist = entities.state(name)
        state = self._types.EntityState()
        at = messages.stamp(self._session.simulation.time)
        state.header.stamp.sec, state.header.stamp.nanosec = at
        state.header.frame_id = self._frame
        for target, values in ((state.pose.position, pose[:3]), (state.pose.orientation, pose[3:]),
                               (state.twist.linear, twist[:3]), (state.twist.angular, twist[3:])):
            for axis, value in zip('xyzw', values):
                setattr(target, axis, float(value))
        return state

    async def _search(self, request: Any, response: Any, name: str,
                      look: Callable[[], str]) -> Any:
        bounds = request.filters.bounds
        if bounds.points and bounds.type not in (bounds.TYPE_BOX, bounds.TYPE_SPHERE):
            return self._failed(response, self._result.RESULT_FEATURE_UNSUPPORTED,
                                'bounds can be a box or a sphere')
        return await self._carry_out(response, name, look)

    async def _carry_out(self, response: Any, name: str, act: Callable[[], str],
                         otherwise: int | None = None) -> Any:
        success, message = await self._replies.ask(name, lambda: act)
        if success:
            return self._done(response)
        code = self._result.RESULT_OPERATION_FAILED if otherwise is None else otherwise
        return self._failed(response, code, message)

    def _done(self, response: Any) -> Any:
        response.result.result = self._result.RESULT_OK
        return response

    @staticmethod
    def _failed(response: Any, code: int, message: str) -> Any:
        response.result.result = code
        response.result.error_message = message
        return response
