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


"""The services of `simulation_interfaces`, with stand-ins for its messages (no wheel has it)."""

import asyncio
import sys
from types import SimpleNamespace

import pytest

from procphys_ros.errors import CommandError
from procphys_ros.lsystem import LSystem
from procphys_ros.ros import simulation_interfaces
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
KNOWN = record(**{name: 10 + i for i, name in enumerate(FEATURES) if name != 'ENTITY_TAGS'})
TYPES = SimpleNamespace(Result=RESULT, SimulationState=STATE, SimulatorFeatures=KNOWN,
                        EntityCategory=CATEGORY, EntityState=STAMPED)
RESPONSE = record(result=RESULT, state=STATE, features=record(features=list, custom_info=''),
                  entities=list, states=list, info=record(category=CATEGORY, description='',
                                                          tags=list),
                  ALREADY_IN_TARGET_STATE=101)
REQUEST = record(state=STATE, steps=0, scope=0, filters=FILTERS, entity='',
                 SCOPE_DEFAULT=0, SCOPE_TIME=1, SCOPE_ALL=255)


class Session:
    """Two trees and what may be asked of them; as the node's session, without a node."""

    def __init__(self):
        scene = Scene()
        tree = LSystem.parse(TREE).build()
        scene.add(tree, (0.0, 0.0, 0.0), 0.0, 'oak_0')
        scene.add(tree, (9.0, 0.0, 0.0), 0.0, 'oak_1')
        self.simulation = Simulation(scene)
        self.paused = False

    def set_pause(self, paused):
        """Stop time or let it run."""
        self.paused = paused
        return ''

    def reset_simulation(self):
        """Go back to the start."""
        self.simulation.reset()
        return ''

    def step_simulation(self):
        """Run one step."""
        self.simulation.step()
        return ''


@pytest.fixture
def server():
    """Give a server whose commands are carried out at once."""
    async def ask(name, prepare):
        try:
            return True, prepare()()
        except CommandError as error:
            return False, str(error)
    session = Session()
    made = SimulationInterfacesServer(TYPES, ask, session, 'world')
    made.session = session
    return made


def call(server, name, **fields):
    """Send a request and give the response."""
    request = REQUEST()
    for path, value in fields.items():
        target = request
        *inner, last = path.split('__')
        for step in inner:
            target = getattr(target, step)
        setattr(target, last, value)
    return asyncio.run(getattr(server, name)(request, RESPONSE()))


def test_features_are_those_that_the_package_knows(server):
    """List what is offered, but for what the package at hand has no number for."""
    features = call(server, 'get_simulator_features').features.features
    assert len(features) == len(FEATURES) - 1 and len(set(features)) == len(features)


def test_features_are_those_of_the_services_that_are_there(server):
    """List nothing of services that the package at hand does not define."""
    server._offered = ['reset_simulation', 'get_entities']
    features = call(server, 'get_simulator_features').features.features
    assert features == [KNOWN.ENTITY_BOUNDS_BOX, KNOWN.ENTITY_CATEGORIES, KNOWN.SIMULATION_RESET]


def test_states_follow_each_other(server):
    """Play, pause, step, stop; what is so already, and what cannot be, is said."""
    def state():
        return call(server, 'get_simulation_state').state.state

    def change(to):
        answer = call(server, 'set_simulation_state', state__state=to).result
        return answer.result, answer.error_message
    assert state() == STATE.STATE_PLAYING
    assert change(STATE.STATE_PLAYING)[0] == 101
    assert call(server, 'step_simulation', steps=1).result.result == RESULT.RESULT_INCORRECT_STATE
    server.session.simulation.step()
    assert change(STATE.STATE_PAUSED) == (1, '') and state() == STATE.STATE_PAUSED
    assert call(server, 'step_simulation', steps=5).result.result == RESULT.RESULT_OK
    assert server.session.simulation.time == pytest.approx(6 / 60)
    assert change(STATE.STATE_STOPPED) == (1, '') and state() == STATE.STATE_STOPPED
    assert server.session.simulation.time == 0.0 and server.session.paused
    for wanted in (STATE.STATE_QUITTING, 77):
        code, reason = change(wanted)
        assert code == RESULT.RESULT_FEATURE_UNSUPPORTED and reason
    assert change(STATE.STATE_PLAYING) == (1, '') and not server.session.paused


def test_reset_is_all_or_nothing(server):
    """Reset everything; a part of it is not supported and changes nothing."""
    server.session.simulation.step(3)
    answer = call(server, 'reset_simulation', scope=REQUEST.SCOPE_TIME).result
    assert answer.result == RESULT.RESULT_FEATURE_UNSUPPORTED
    assert server.session.simulation.time > 0.0
    assert call(server, 'reset_simulation', scope=REQUEST.SCOPE_ALL).result.result == 1
    assert server.session.simulation.time == 0.0


def point(x, y, z):
    """Make a point."""
    made = VECTOR()
    made.x, made.y, made.z = x, y, z
    return made


def category(number):
    """Make a category."""
    made = CATEGORY()
    made.category = number
    return made


@pytest.mark.parametrize('fields, expected', [
    ({}, ['oak_0', 'oak_1']), ({'filters__filter': '_1$'}, ['oak_1']),
    ({'filters__filter': 'elm'}, []), ({'filters__tags__tags': ['segment']}, ['oak_0', 'oak_1']),
    ({'filters__tags__tags': ['segment', 'pane'], 'filters__tags__filter_mode': 1}, []),
    ({'filters__categories': [category(2)]}, []),
    ({'filters__categories': [category(2), category(1)]}, ['oak_0', 'oak_1']),
    ({'filters__bounds__type': 2, 'filters__bounds__points': [point(9, 0, 1), point(3, 0, 0)]},
     ['oak_1']),
    ({'filters__bounds__points': [point(1, 1, 3), point(-1, -1, 0)]}, ['oak_0']),
])
def test_entities_are_filtered(server, fields, expected):
    """Find objects by name, tag, category and bounds; give as many states as names."""
    assert call(server, 'get_entities', **fields).entities == expected
    answer = call(server, 'get_entities_states', **fields)
    assert answer.entities == expected and len(answer.states) == len(expected)


@pytest.mark.parametrize('fields, reason, code', [
    ({'filters__filter': '('}, 'regular expression', RESULT.RESULT_OPERATION_FAILED),
    ({'filters__bounds__points': [point(0, 0, 0)] * 4}, 'two', RESULT.RESULT_OPERATION_FAILED),
    ({'filters__bounds__type': 1, 'filters__bounds__points': [point(0, 0, 0)] * 4}, 'a sphere',
     RESULT.RESULT_FEATURE_UNSUPPORTED),
])
@pytest.mark.parametrize('service', ['get_entities', 'get_entities_states'])
def test_filters_that_make_no_sense_are_refused(server, service, fields, reason, code):
    """Say what is wrong, and what is not supported with the code that stands for that."""
    answer = call(server, service, **fields).result
    assert answer.result == code and reason in answer.error_message


def test_an_entity_has_a_state_and_a_description(server):
    """Tell pose, twist and time of an object or a part; refuse names that there are not."""
    server.session.simulation.apply_impulse('oak_1/1', (50.0, 0.0, 0.0))
    server.session.simulation.step()
    state = call(server, 'get_entity_state', entity='oak_1/1').state
    assert state.pose.position.x == pytest.approx(9.0, abs=0.3)
    assert state.pose.position.z == pytest.approx(1.5, abs=0.1)
    assert state.twist.linear.x > 0.1 and state.header.frame_id == 'world'
    assert state.header.stamp.nanosec == pytest.approx(1e9 / 60, rel=1e-3)
    root = call(server, 'get_entity_state', entity='oak_1').state.pose.position.z
    assert root == pytest.approx(0.5, abs=0.05)
    info = call(server, 'get_entity_info', entity='oak_1').info
    assert info.tags == ['segment'] and '2 segment' in info.description
    assert info.category.category == CATEGORY.CATEGORY_OBJECT
    for name in ('oak_7', 'oak_1/9', ''):
        for service in ('get_entity_state', 'get_entity_info'):
            answer = call(server, service, entity=name).result
            assert answer.result == RESULT.RESULT_NOT_FOUND and answer.error_message


def test_nothing_is_offered_without_the_package(monkeypatch):
    """Do without services when their package cannot be imported."""
    monkeypatch.setattr(simulation_interfaces, 'PACKAGE', 'no_such_package')
    assert simulation_interfaces.offer(None, None, None) == []


def test_services_are_offered_where_the_package_has_them(monkeypatch):
    """Offer each service that the package defines under its own name, and no other."""
    kinds = SimpleNamespace(GetEntities=object(), StepSimulation=object(), LoadWorld=object())
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', SimpleNamespace())
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.msg', TYPES)
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.srv', kinds)
    made = {}

    def create_service(kind, name, serve, callback_group):
        made[name] = kind, serve.__name__, callback_group
    node = SimpleNamespace(create_service=create_service,
                           get_parameter=lambda name: SimpleNamespace(value='world'))
    answers = SimpleNamespace(ask=None, group='group')
    offered = simulation_interfaces.offer(node, answers, Session())
    assert offered == ['step_simulation', 'get_entities']
    assert made == {f'~/simulation_interfaces/{name}': (kind, name, 'group') for name, kind in (
        ('get_entities', kinds.GetEntities), ('step_simulation', kinds.StepSimulation))}
