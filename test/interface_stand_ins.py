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

"""Stand-ins for the messages of `simulation_interfaces`, which no wheel has, and a server."""

import asyncio
import math
from types import SimpleNamespace

from procphys_ros.errors import CommandError, ProcPhysError
from procphys_ros.lsystem import LSystem
from procphys_ros.ros.pacing import Pacer
from procphys_ros.ros.session import Session
from procphys_ros.ros.simulation_interfaces import FEATURES, SimulationInterfacesServer
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

TREE = 'axiom: Width(0.1) Density(700) Modulus(8e9) DampingRatio(0.05) F(1) F(1)'


def record(**fields):
    """Make a class of messages with these constants and default values."""
    class Message(SimpleNamespace):

        def __init__(self):
            super().__init__(**{name: value() if callable(value) else value
                                for name, value in fields.items() if not name.isupper()})
    for name, value in fields.items():
        if name.isupper():
            setattr(Message, name, value)
    return Message


# Names and numbers as in the definitions of the package, version 1.
RESULT = record(result=0, error_message='', RESULT_FEATURE_UNSUPPORTED=0, RESULT_OK=1,
                RESULT_NOT_FOUND=2, RESULT_INCORRECT_STATE=3, RESULT_OPERATION_FAILED=4)
STATE = record(state=0, STATE_STOPPED=0, STATE_PLAYING=1, STATE_PAUSED=2, STATE_QUITTING=3)
VECTOR = record(x=0.0, y=0.0, z=0.0, w=1.0)
CATEGORY = record(category=0, CATEGORY_OBJECT=1)
STAMPED = record(header=record(stamp=record(sec=0, nanosec=0), frame_id=''),
                 pose=record(position=VECTOR, orientation=VECTOR),
                 twist=record(linear=VECTOR, angular=VECTOR))
FILTERS = record(filter='', categories=list,
                 tags=record(tags=list, filter_mode=0, FILTER_MODE_ANY=0, FILTER_MODE_ALL=1),
                 bounds=record(type=0, points=list, TYPE_BOX=0, TYPE_CONVEX_HULL=1,
                               TYPE_SPHERE=2))
BOUNDS = record(type=0, points=list, TYPE_BOX=1)
CODES = {'NAME_NOT_UNIQUE': 101, 'NAME_INVALID': 102, 'UNSUPPORTED_FORMAT': 103,
         'NO_RESOURCE': 104, 'NAMESPACE_INVALID': 105, 'RESOURCE_PARSE_ERROR': 106,
         'INVALID_POSE': 109}
KNOWN = record(**{name: 10 + i for i, name in enumerate(FEATURES) if name != 'ENTITY_TAGS'})
RESOURCE = record(uri='', resource_string='')
SPAWNABLE = record(entity_resource=RESOURCE, description='')
TYPES = SimpleNamespace(Result=RESULT, SimulationState=STATE, SimulatorFeatures=KNOWN,
                        EntityCategory=CATEGORY, EntityState=STAMPED, Spawnable=SPAWNABLE,
                        Bounds=BOUNDS, SpawnResult=record(result=RESULT, entity_name='', **CODES))
RESPONSE = record(result=RESULT, state=STATE,
                  features=record(features=list, spawn_formats=list, custom_info=''),
                  entities=list, states=list, info=record(category=CATEGORY, description='',
                                                          tags=list),
                  entity_name='', spawnables=list, results=list, bounds=BOUNDS,
                  ALREADY_IN_TARGET_STATE=101,
                  STATE_TRANSITION_ERROR=102, ENTITIES_SPAWN_FAILED=150, **CODES)
REQUEST = record(state=STATE, steps=0, scope=0, filters=FILTERS, entity='',
                 name='', allow_renaming=False, entity_resource=RESOURCE, entity_namespace='',
                 initial_pose=STAMPED, sources=list, spawn_requests=list,
                 set_pose=False, set_twist=False,
                 SCOPE_DEFAULT=0, SCOPE_TIME=1, SCOPE_STATE=2, SCOPE_SPAWNED=4, SCOPE_ALL=255)


class Replies:
    """Carries commands out at once; those that are begun are answered before they are awaited."""

    async def ask(self, name, prepare):
        """Carry a command out."""
        try:
            return True, prepare()()
        except CommandError as error:
            return False, str(error)

    async def wait_for(self, name, begin):
        """Begin with something, and give what it was answered."""
        answers = []
        begin(lambda *answer: answers.append(answer))
        return answers[0]


def build_and_join(wanted, join, answer):
    """Do what the node does in another thread."""
    try:
        answer(True, join(wanted.build()))
    except ProcPhysError as error:
        answer(False, str(error))


def serve(**settings):
    """Make a server on two trees whose commands are carried out at once."""
    scene = Scene.from_parameters(settings)
    tree = LSystem.parse(TREE).build()
    scene.add(tree, (0.0, 0.0, 0.0), 0.0, 'oak_0')
    scene.add(tree, (9.0, 0.0, 0.0), 0.0, 'oak_1')
    session = Session(Pacer(1.0 / 60.0, 1.0, budget=0.05))
    session.adopt(Simulation(scene))
    made = SimulationInterfacesServer(TYPES, Replies(), build_and_join, session, 'world')
    made.session = session
    return made


def call(server, service, /, **fields):
    """Send a request and give the response."""
    request = REQUEST()
    for path, value in fields.items():
        target = request
        *inner, last = path.split('__')
        for step in inner:
            target = getattr(target, step)
        setattr(target, last, value)
    serve = getattr(server, service, None) or getattr(server.entities, service)
    return asyncio.run(serve(request, RESPONSE()))


def resource(uri='', text=''):
    """Make a resource."""
    made = RESOURCE()
    made.uri, made.resource_string = uri, text
    return made


def place(x, y, yaw=0.0, roll=0.0):
    """Make a stamped pose on the ground."""
    made = STAMPED()
    made.pose.position.x, made.pose.position.y = x, y
    made.pose.orientation.z, made.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    made.pose.orientation.x = roll
    return made
