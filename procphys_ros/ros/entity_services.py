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


"""The services of `simulation_interfaces` that put entities in, take them out and move them."""

from argparse import ArgumentTypeError
from collections.abc import Callable
from dataclasses import replace
import math
from typing import Any, TypeVar
from urllib.parse import parse_qsl, unquote

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import CommandError, ProcPhysError, SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.ros.commands import Act, Answer
from procphys_ros.ros.conversions import check_frame, pose
from procphys_ros.ros.entities import Entities
from procphys_ros.ros.services import Answers
from procphys_ros.ros.session import Session
from procphys_ros.scene.sources import GRAMMARS
from procphys_ros.scene.spawn import Spawn
from procphys_ros.simulation.commands import checked_rotation, checked_vector
from procphys_ros.terminal.argument_parser import whole

FORMATS = tuple(ending[1:] for ending in GRAMMARS)
_UPRIGHT = 1e-3  # [-] x or y of a quaternion from which on it is not a turn about the vertical

_Value = TypeVar('_Value')
# Begins to build an object that joins the scene, see `Loading.begin_spawn`.
BeginSpawn = Callable[[Spawn, Callable[[Blueprint], str], Answer], None]


class EntityServer:
    """
    Handle the service requests.

    :param types: module `msg` of `simulation_interfaces`.
    :param replies: waits for commands in the thread of the simulation.
    :param begin_spawn: builds an object that joins the scene.
    :param session: executes commands.
    :param frame: of poses.
    """

    def __init__(self, types: Any, replies: Answers, begin_spawn: BeginSpawn, session: Session,
                 frame: str):
        self._types, self._result = types, types.Result
        self._replies = replies
        self._begin_spawn = begin_spawn
        self._session = session
        self._frame = frame

    async def get_spawnables(self, request: Any, response: Any) -> Any:
        """List the grammars of the package."""
        for path in sorted((shared_folder() / 'grammars').iterdir()):
            if path.suffix[1:] in FORMATS:
                entry = self._types.Spawnable()
                _resource_of(entry).uri = f'package://procphys_ros/grammars/{path.name}'
                entry.description = f'grammar {path.stem}; ?seed=1&name=number sets its values'
                response.spawnables.append(entry)
        response.result.result = self._result.RESULT_OK
        if request.sources:
            response.result.error_message = f'not known: {", ".join(request.sources)}'
        return response

    async def spawn_entity(self, request: Any, response: Any) -> Any:
        """Add the object described by a grammar to the scene."""
        try:
            wanted = self._wanted(request)
        except _Refusal as refusal:
            return self._failed(response, refusal.code, str(refusal))
        built = []

        def join(blueprint: Blueprint) -> str:
            built.append(blueprint)
            message = self._session.spawn(wanted, blueprint)
            response.entity_name = self._session.simulation.added[-1]
            return message
        success, message = await self._replies.wait_for(
            'spawn_entity', lambda answer: self._begin_spawn(wanted, join, answer))
        if not success:
            return self._failed(response, '' if built else 'RESOURCE_PARSE_ERROR', message)
        response.result.result = self._result.RESULT_OK
        return response

    async def spawn_entities(self, request: Any, response: Any) -> Any:
        """Add several objects, one after the other; failures do not stop the others."""
        response.results = [await self.spawn_entity(one, self._types.SpawnResult())
                            for one in request.spawn_requests]
        failed = sum(one.result.result != self._result.RESULT_OK for one in response.results)
        if failed:
            return self._failed(response, 'ENTITIES_SPAWN_FAILED',
                                f'{failed} of {len(response.results)} were not spawned')
        response.result.result = self._result.RESULT_OK
        return response

    async def delete_entity(self, request: Any, response: Any) -> Any:
        """Remove an object from the scene."""
        name = _entity(request)
        return await self._carry_out(response, 'delete_entity', name,
                                     lambda: self._session.remove(name))

    async def set_entity_state(self, request: Any, response: Any) -> Any:
        """Set the pose or the velocity of a loose object."""
        name, state = _entity(request), request.state
        wanted = twist = None
        try:
            check_frame(state.header, self._frame)
            if getattr(request, 'set_pose', True):
                wanted = pose(state.pose)
                checked_vector('the position', wanted[:3])
                checked_rotation('the orientation', wanted[3:])
        except CommandError as error:
            return self._failed(response, 'INVALID_POSE', str(error))
        if getattr(request, 'set_twist', True):
            linear, angular = state.twist.linear, state.twist.angular
            twist = linear.x, linear.y, linear.z, angular.x, angular.y, angular.z
        return await self._carry_out(response, 'set_entity_state', name,
                                     lambda: self._session.move(name, wanted, twist))

    async def _carry_out(self, response: Any, service: str, name: str, act: Act) -> Any:
        """Execute a command on an entity; distinguish missing entities from failures."""
        known = []

        def look_and_act() -> str:
            Entities(self._session.simulation).describe(name)
            known.append(name)
            return act()
        success, message = await self._replies.ask(service, lambda: look_and_act)
        failed = (self._result.RESULT_OPERATION_FAILED if known
                  else self._result.RESULT_NOT_FOUND)
        response.result.result = self._result.RESULT_OK if success else failed
        response.result.error_message = '' if success else message
        return response

    def _failed(self, response: Any, code: str, message: str) -> Any:
        """Fill a failed response; code names a constant of it, which old versions may lack."""
        response.result.result = getattr(response, code, self._result.RESULT_OPERATION_FAILED)
        response.result.error_message = message
        return response

    def _wanted(self, request: Any) -> Spawn:
        """
        Read the description of an object to spawn.

        :raises _Refusal: if the request is invalid.
        """
        resource, name = _resource_of(request), request.name
        if not resource.uri and not resource.resource_string:
            raise _Refusal('NO_RESOURCE', 'give a grammar as uri or as resource_string')
        if getattr(request, 'entity_namespace', ''):
            raise _Refusal('NAMESPACE_INVALID', 'objects have no topics of their own here, and no '
                           'namespace')
        wanted = _or_refuse('UNSUPPORTED_FORMAT', lambda: _described(resource.uri,
                                                                     resource.resource_string))
        wanted = _or_refuse('INVALID_POSE', lambda: replace(
            wanted, name=name, **self._placed(request.initial_pose)))
        _or_refuse('NAME_INVALID', wanted.check_name)
        if any(known.name == name for known in list(self._session.simulation.objects)):
            if not request.allow_renaming:
                raise _Refusal('NAME_NOT_UNIQUE', f'there is, or was, an object called "{name}"')
            return replace(wanted, name='')
        if not name and not request.allow_renaming:
            raise _Refusal('NAME_INVALID', 'the name is empty; allow_renaming would find one')
        return wanted

    def _placed(self, stamped: Any) -> dict[str, Any]:
        """
        Read the pose of an object to spawn; its height is converted to that above the ground.

        A pose below the ground of a terrain, such as an empty one, means a position on the ground.

        :raises CommandError: if it is in another frame, or not upright.
        """
        check_frame(stamped.header, self._frame)
        x, y, z, qx, qy, qz, qw = pose(stamped.pose)
        length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        if not all(map(math.isfinite, (x, y, z, length))) or length == 0.0:
            raise CommandError('the initial pose is not finite, or its quaternion has no length')
        if math.hypot(qx, qy) > _UPRIGHT * length:
            raise CommandError('objects stand upright here: the initial pose may only turn about '
                               'the vertical')
        ground = float(self._session.simulation.model.terrain.height(np.array([[x, y]]))[0])
        above = z if ground == 0.0 else max(z - ground, 0.0)
        return {'position': (x, y, above), 'yaw': 2.0 * math.atan2(qz, qw)}


class _Refusal(Exception):
    """
    An invalid request.

    :param code: name of the constant of the response for it.
    :param message: details.
    """

    def __init__(self, code: str, message: str):
        super().__init__(message)
        self.code = code


def _or_refuse(code: str, read: Callable[[], _Value]) -> _Value:
    """Read a value; raise errors as refusals with a code."""
    try:
        return read()
    except ProcPhysError as error:
        raise _Refusal(code, str(error)) from error


def _entity(request: Any) -> str:
    """Return the name in a request; the field had another name in the first version."""
    return request.entity if hasattr(request, 'entity') else request.name


def _resource_of(message: Any) -> Any:
    """Return the message with uri and resource_string; newer versions have it in a field."""
    return getattr(message, 'entity_resource', message)


def _described(uri: str, text: str) -> Spawn:
    """
    Read which grammar to use.

    :param uri: file in grammars/, path, file:// or package://, with values of the grammar after
        a question mark: oak.lsys?seed=3&height=5. '' = the text is used.
    :param text: the grammar itself.
    :raises SceneError: if it is not a grammar, or a value is invalid.
    """
    if not uri:
        return Spawn(grammar_text=text)
    path, _, query = uri.partition('?')
    path = unquote(path.removeprefix('file://'))
    if path.rpartition('.')[2] not in FORMATS:
        raise SceneError(f'"{uri}" is no grammar; their names end in .{" or .".join(FORMATS)}')
    values = dict(parse_qsl(query, keep_blank_values=True))
    seed = values.pop('seed', '0')
    try:
        number = whole(seed)
    except ArgumentTypeError as error:
        raise SceneError(f'"{uri}": the seed {error}') from error
    return Spawn(grammar=path, seed=number,
                 defines=tuple(f'{name}={value}' for name, value in values.items()))
