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

"""The services of `simulation_interfaces`, with stand-ins for its messages and package."""

import asyncio
import math
import random
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from procphys_ros.errors import CommandError, ProcPhysError
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.ros import simulation_interfaces
from procphys_ros.ros.pacing import Pacer
from procphys_ros.ros.posix_pattern import PosixPattern
from procphys_ros.ros.session import Session
from procphys_ros.ros.simulation_interfaces import FEATURES, SimulationInterfacesServer
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
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


@pytest.fixture
def server():
    """Make a server for one test."""
    return serve()


@pytest.fixture(scope='module')
def unchanged():
    """Make a server for all tests that change nothing."""
    return serve()


def test_features_are_those_that_the_package_knows(unchanged):
    """List what is offered, but for what the package at hand has no number for."""
    features = call(unchanged, 'get_simulator_features').features.features
    assert len(features) == len(FEATURES) - 1 and len(set(features)) == len(features)
    formats = call(unchanged, 'get_simulator_features').features.spawn_formats
    assert formats == ['lsys', 'wall', 'mech', 'urdf', 'l', 'lpy', 'csv', 'mtg', 'ply']


def test_features_are_those_of_the_services_that_are_there(unchanged):
    """List nothing of services that the package at hand does not define."""
    few = SimulationInterfacesServer(TYPES, Replies(), build_and_join, unchanged.session, 'world',
                                     ['reset_simulation', 'get_entities'])
    features = call(few, 'get_simulator_features').features
    assert features.features == [KNOWN.ENTITY_BOUNDS_BOX, KNOWN.ENTITY_CATEGORIES,
                                 KNOWN.SIMULATION_RESET, KNOWN.SIMULATION_RESET_SPAWNED]
    assert features.spawn_formats == []


def test_states_follow_each_other(server):
    """Play, pause, step, stop; what is so already, and what cannot be, is said."""
    def state():
        return call(server, 'get_simulation_state').state.state

    def change(to):
        answer = call(server, 'set_simulation_state', state__state=to).result
        return answer.result, answer.error_message
    assert state() == STATE.STATE_PLAYING
    assert change(STATE.STATE_PLAYING)[0] == 101
    assert call(server, 'step_simulation', steps=1).result.result == RESULT.RESULT_OPERATION_FAILED
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


def test_stopping_resets_everything_and_pausing_lasts(server):
    """Take out what was spawned when stopped; pause what is stopped, and let it stay paused."""
    def change(to):
        return call(server, 'set_simulation_state', state__state=to).result

    def state():
        return call(server, 'get_simulation_state').state.state
    assert change(STATE.STATE_PAUSED).result == 1
    assert state() == STATE.STATE_PAUSED
    assert call(server, 'spawn_entity', name='elm', entity_resource=resource(text=TREE),
                initial_pose=place(5.0, 5.0)).result.result == 1
    assert change(STATE.STATE_STOPPED).result == 1 and state() == STATE.STATE_STOPPED
    assert call(server, 'get_entities').entities == ['oak_0', 'oak_1']
    assert change(STATE.STATE_STOPPED).result == 101
    assert change(STATE.STATE_PAUSED).result == 1 and state() == STATE.STATE_PAUSED
    server.session.fail(RuntimeError('a step'))
    failed = change(STATE.STATE_PLAYING)
    assert failed.result == 102 and 'went wrong' in failed.error_message


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
    ({'filters__filter': '^[[:alpha:]]+_[^[:lower:][:space:]2-9]$'}, ['oak_0', 'oak_1']),
    ({'filters__filter': '[[:digit:]]{2}'}, []),
    ({'filters__filter': 'elm'}, []), ({'filters__tags__tags': ['segment']}, ['oak_0', 'oak_1']),
    ({'filters__tags__tags': ['segment', 'pane'], 'filters__tags__filter_mode': 1}, []),
    ({'filters__categories': [category(2)]}, []),
    ({'filters__categories': [category(2), category(1)]}, ['oak_0', 'oak_1']),
    ({'filters__bounds__type': 2, 'filters__bounds__points': [point(9, 0, 1), point(3, 0, 0)]},
     ['oak_1']),
    ({'filters__bounds__points': [point(1, 1, 3), point(-1, -1, 0)]}, ['oak_0']),
])
def test_entities_are_filtered(unchanged, fields, expected):
    """Find objects by name, tag, category and bounds; return as many states as names."""
    assert call(unchanged, 'get_entities', **fields).entities == expected
    answer = call(unchanged, 'get_entities_states', **fields)
    assert answer.entities == expected and len(answer.states) == len(expected)


@pytest.mark.parametrize('fields, reason, code', [
    ({'filters__filter': '('}, 'regular expression', RESULT.RESULT_OPERATION_FAILED),
    ({'filters__filter': '[[:digits:]]'}, 'xdigit', RESULT.RESULT_OPERATION_FAILED),
    ({'filters__filter': '(((a{99}){99}){99}){99}'}, 'too large', RESULT.RESULT_OPERATION_FAILED),
    ({'filters__bounds__points': [point(0, 0, 0)] * 4}, 'two', RESULT.RESULT_OPERATION_FAILED),
    ({'filters__bounds__type': 1, 'filters__bounds__points': [point(0, 0, 0)] * 4}, 'a sphere',
     RESULT.RESULT_FEATURE_UNSUPPORTED),
])
@pytest.mark.parametrize('service', ['get_entities', 'get_entities_states'])
def test_filters_that_make_no_sense_are_refused(unchanged, service, fields, reason, code):
    """Say what is wrong, and what is not supported with the code that stands for that."""
    answer = call(unchanged, service, **fields).result
    assert answer.result == code and reason in answer.error_message


@pytest.mark.timeout(60)
def test_no_filter_holds_the_simulation_up(server):
    """Answer at once to expressions and tags that would keep a naive search busy for years."""
    assert call(server, 'spawn_entity', name='a' * 60, entity_resource=resource(text=TREE),
                initial_pose=place(5.0, 5.0)).result.result == 1
    assert call(server, 'get_entities', filters__filter='^(a|a)*b').entities == []
    assert call(server, 'get_entities', filters__filter='^(a|a)*$').entities == ['a' * 60]
    tags = [f'tag_{i}' for i in range(500_000)]
    assert call(server, 'get_entities', filters__tags__tags=tags).entities == []


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


def test_what_has_gone_does_not_hide_the_states_of_others(server):
    """Return the states of the other objects when one has gone altogether, as by a blast."""
    server.session.simulation.state.parts.poses[:2] = np.nan
    answer = call(server, 'get_entities_states')
    assert answer.result.result == RESULT.RESULT_OK and answer.entities == ['oak_1']
    assert len(answer.states) == 1


def test_before_the_first_scene_requests_are_answered():
    """Say that nothing has begun, and refuse what needs a scene, while the first is built."""
    session = Session(Pacer(1.0 / 60.0, 1.0, budget=0.05))
    empty = SimulationInterfacesServer(TYPES, Replies(), build_and_join, session, 'world')
    assert call(empty, 'get_simulation_state').state.state == STATE.STATE_PLAYING
    assert session.set_pause(True) == 'paused once there is a scene'
    assert call(empty, 'get_simulation_state').state.state == STATE.STATE_STOPPED
    refused = call(empty, 'get_entities').result
    assert refused.result == RESULT.RESULT_OPERATION_FAILED
    assert 'still being built' in refused.error_message


class Goal:
    """A goal of the action: records what becomes of it, and may be cancelled after some steps."""

    def __init__(self, steps, cancelled_after=None):
        self.request = SimpleNamespace(steps=steps)
        self.feedback = []
        self.end = ''
        self._limit = cancelled_after

    @property
    def is_cancel_requested(self):
        """Return whether the goal is cancelled."""
        return len(self.feedback) == self._limit

    def publish_feedback(self, feedback):
        """Take up how far it is."""
        self.feedback.append((feedback.completed_steps, feedback.remaining_steps))

    def succeed(self):
        """End well."""
        self.end = 'succeeded'

    def abort(self):
        """End badly."""
        self.end = 'aborted'

    def canceled(self):
        """End by cancellation."""
        self.end = 'cancelled'


def test_an_action_steps_and_tells_of_each_step(server, monkeypatch):
    """Step while paused only, with feedback; a goal that is cancelled stops where it is."""
    course = SimpleNamespace(SimulateSteps=SimpleNamespace(
        Result=RESPONSE, Feedback=record(completed_steps=0, remaining_steps=0)))
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', SimpleNamespace())
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.action', course)

    def run(goal):
        return asyncio.run(server.simulate_steps(goal)).result.result
    running = Goal(3)
    assert run(running) == RESULT.RESULT_OPERATION_FAILED and running.end == 'aborted'
    server.session.set_pause(True)
    goal = Goal(3)
    assert run(goal) == RESULT.RESULT_OK and goal.end == 'succeeded'
    assert goal.feedback == [(1, 2), (2, 1), (3, 0)]
    assert server.session.simulation.time == pytest.approx(3 / 60)
    halted = Goal(1000, cancelled_after=2)
    assert run(halted) == RESULT.RESULT_OPERATION_FAILED and halted.end == 'cancelled'
    assert server.session.simulation.time == pytest.approx(5 / 60)


def test_entities_are_spawned_and_deleted(server):
    """Spawn from a shipped file with values, and from text; delete by name, once."""
    simulation = server.session.simulation
    found = call(server, 'get_spawnables').spawnables
    uris = [s.entity_resource.uri for s in found]
    assert 'package://procphys_ros/grammars/oak.lsys' in uris
    shrub = call(server, 'spawn_entity', name='hedge', initial_pose=place(3.0, 4.0, yaw=0.5),
                 entity_resource=resource('package://procphys_ros/grammars/shrub.lsys?seed=4'))
    assert shrub.result.result == RESULT.RESULT_OK and shrub.entity_name == 'hedge'
    again = call(server, 'spawn_entity', name='oak_0', allow_renaming=True,
                 entity_resource=resource(text=TREE), initial_pose=place(-6.0, 0.0))
    assert again.result.result == RESULT.RESULT_OK and again.entity_name == 'object_0'
    names = ['oak_0', 'oak_1', 'hedge', 'object_0']
    assert call(server, 'get_entities').entities == names
    assert simulation.poses[-2, 0] == pytest.approx(-6.0)
    assert call(server, 'delete_entity', entity='hedge').result.result == RESULT.RESULT_OK
    assert call(server, 'get_entities').entities == ['oak_0', 'oak_1', 'object_0']
    for name in ('hedge', 'elm'):
        answer = call(server, 'delete_entity', entity=name).result
        assert answer.result == RESULT.RESULT_NOT_FOUND and answer.error_message
    spawned = call(server, 'reset_simulation', scope=REQUEST.SCOPE_SPAWNED).result
    assert spawned.result == RESULT.RESULT_OK
    assert call(server, 'get_entities').entities == ['oak_0', 'oak_1']


def test_several_entities_are_spawned_at_once(unchanged):
    """Answer for each; those that can join do, whatever becomes of the others."""
    requests = []
    for name, text in (('fir', TREE), ('fir', TREE), ('wreck', 'axiom: F(1'), ('elm', TREE)):
        request = REQUEST()
        request.name, request.entity_resource = name, resource(text=text)
        request.initial_pose = place(-5.0 * len(requests), 30.0)
        requests.append(request)
    answer = call(unchanged, 'spawn_entities', spawn_requests=requests)
    assert answer.result.result == 150 and '2 of 4' in answer.result.error_message
    assert [one.result.result for one in answer.results] == [RESULT.RESULT_OK, 101, 106,
                                                             RESULT.RESULT_OK]
    assert call(unchanged, 'get_entities').entities[2:] == ['fir', 'elm']
    assert call(unchanged, 'reset_simulation').result.result == RESULT.RESULT_OK
    one = call(unchanged, 'spawn_entities', spawn_requests=requests[:1])
    assert one.result.result == RESULT.RESULT_OK and one.results[0].entity_name == 'fir'
    assert call(unchanged, 'reset_simulation').result.result == RESULT.RESULT_OK


def test_bounds_hold_all_of_an_entity(unchanged):
    """Return a box in the frame of the entity that contains the ends of all of its parts."""
    simulation = unchanged.session.simulation
    answer = call(unchanged, 'get_entity_bounds', entity='oak_1')
    assert answer.result.result == RESULT.RESULT_OK and answer.bounds.type == BOUNDS.TYPE_BOX
    high, low = (np.array([p.x, p.y, p.z]) for p in answer.bounds.points)
    parts = slice(simulation.objects[1].first, None)
    poses, length = simulation.poses[parts], simulation.blueprint.size[parts, 2]
    ends = [poses[:, :3] + rotation.rotate(poses[:, 3:], np.outer(sign * 0.5 * length, [0, 0, 1]))
            for sign in (-1.0, 1.0)]
    own = rotation.rotate(rotation.conjugate(poses[0, 3:]), np.concatenate(ends) - poses[0, :3])
    assert (own >= low).all() and (own <= high).all()
    assert (high - low < np.ptp(own, axis=0) + 2.0 * length.max()).all()
    assert call(unchanged, 'get_entity_bounds', entity='elm').result.result == \
        RESULT.RESULT_NOT_FOUND


def test_poses_of_what_is_spawned_on_a_terrain_are_those_of_the_world():
    """Put roots at the height of the pose, and on the ground when that is below it."""
    server = serve(terrain={'noise': 8.0, 'wavelength': 30.0, 'extent': 60.0, 'seed': 2})
    simulation = server.session.simulation
    ground = simulation.model.terrain.height(np.array([[5.0, 6.0]]))[0]
    assert ground > 1.0
    for z, root in ((0.0, ground), (ground, ground), (ground + 2.0, ground + 2.0)):
        pose = place(5.0, 6.0)
        pose.pose.position.z = z
        answer = call(server, 'spawn_entity', allow_renaming=True, initial_pose=pose,
                      entity_resource=resource(text=TREE))
        assert answer.result.result == RESULT.RESULT_OK
        first = simulation.objects[-1].first
        bond = np.flatnonzero(simulation.blueprint.bonds[:, 1] == first)[0]
        assert simulation.blueprint.bond_frame[bond, 2] == pytest.approx(root)
        call(server, 'delete_entity', entity=answer.entity_name)


def test_reset_scopes_differ_in_what_was_spawned(server):
    """Reset time and state together with what was spawned kept; all brings back the scene."""
    simulation = server.session.simulation
    call(server, 'spawn_entity', name='new', entity_resource=resource(text=TREE),
         initial_pose=place(5.0, 5.0))
    call(server, 'delete_entity', entity='oak_1')
    simulation.step(3)
    answer = call(server, 'reset_simulation', scope=REQUEST.SCOPE_TIME | REQUEST.SCOPE_STATE)
    assert answer.result.result == RESULT.RESULT_OK and simulation.time == 0.0
    assert call(server, 'get_entities').entities == ['oak_0', 'new']
    assert call(server, 'reset_simulation').result.result == RESULT.RESULT_OK
    assert call(server, 'get_entities').entities == ['oak_0', 'oak_1']


@pytest.mark.parametrize('fields, code, reason', [
    ({'name': 'a'}, 104, 'resource_string'),
    ({'name': 'a', 'entity_resource': resource('robot.sdf')}, 103, '.lsys or .wall or .mech'),
    ({'name': 'a', 'entity_resource': resource('oak.lsys?seed=x')}, 103, 'whole number'),
    ({'name': 'a', 'entity_resource': resource(f'oak.lsys?seed={"9" * 5000}')}, 103,
     'whole number'),
    ({'name': 'a', 'entity_resource': resource('no_such.lsys')}, 106, 'no grammar'),
    ({'name': 'a', 'entity_resource': resource(text='axiom: F(1')}, 106, 'spawn.grammar_text:1'),
    ({'name': '', 'entity_resource': resource(text=TREE)}, 102, 'allow_renaming'),
    ({'name': 'a b', 'entity_resource': resource(text=TREE)}, 102, 'cannot name'),
    ({'name': 'oak_0', 'entity_resource': resource(text=TREE)}, 101, 'oak_0'),
    ({'name': 'a', 'entity_namespace': '/b', 'entity_resource': resource(text=TREE)}, 105, ''),
    ({'name': 'a', 'entity_resource': resource(text=TREE), 'initial_pose': place(0, 0, 0, 0.5)},
     109, 'upright'),
    ({'name': 'a', 'entity_resource': resource(text=TREE),
      'initial_pose': place(math.nan, 0)}, 109, 'finite')])
def test_what_cannot_be_spawned_leaves_the_world_as_it_was(unchanged, fields, code, reason):
    """Answer with the code that stands for it, and why; nothing has joined."""
    answer = call(unchanged, 'spawn_entity', **fields)
    assert answer.result.result == code and reason in answer.result.error_message
    assert call(unchanged, 'get_entities').entities == ['oak_0', 'oak_1']


def test_states_of_loose_entities_can_be_set(server):
    """Put a ball elsewhere, and give it a velocity; a tree in the ground stays where it grows."""
    session = server.session
    session.simulation.launch(Projectile('sphere', 0.2, 5.0, (0.0, -9.0, 9.0), (0.0, 0.0, 0.0)))
    state = STAMPED()
    state.pose.position.x, state.pose.position.z = 4.0, 7.0
    state.twist.linear.z = 5.0

    def put(entity, **flags):
        return call(server, 'set_entity_state', entity=entity, state=state, **flags).result
    assert put('projectile_0', set_pose=True).result == RESULT.RESULT_OK
    np.testing.assert_allclose(session.simulation.poses[-1, :3], [4.0, 0.0, 7.0])
    assert session.simulation.velocities[-1, 2] == 0.0
    assert put('projectile_0', set_twist=True).result == RESULT.RESULT_OK
    assert session.simulation.velocities[-1, 2] == 5.0
    refused = put('oak_0', set_pose=True)
    assert refused.result == RESULT.RESULT_OPERATION_FAILED and 'loose' in refused.error_message
    assert put('elm', set_pose=True).result == RESULT.RESULT_NOT_FOUND
    state.pose.position.x = 1e8
    assert put('projectile_0', set_pose=True).result == 109
    state.pose.position.x = math.inf
    assert put('projectile_0', set_pose=True).result == 109
    assert put('projectile_0', set_twist=True).result == RESULT.RESULT_OK
    state.pose.position.x, state.twist.angular.y = 3.0, math.nan
    assert put('projectile_0', set_pose=True).result == RESULT.RESULT_OK
    assert put('projectile_0', set_twist=True).result == RESULT.RESULT_OPERATION_FAILED


def test_nothing_is_offered_without_the_package(monkeypatch):
    """Do without services when their package cannot be imported."""
    monkeypatch.setattr(simulation_interfaces, 'PACKAGE', 'no_such_package')
    assert simulation_interfaces.offer(None, None, None, None) == []


class BrokenKind:
    """A type of services whose library was not installed with it."""


@pytest.mark.parametrize('modules, reason', [
    ({'msg': None}, 'ModuleNotFoundError'), ({'srv': None}, 'ModuleNotFoundError'),
    ({'msg': SimpleNamespace()}, 'Result'), ({}, 'no library')])
def test_a_package_that_is_half_there_does_not_end_the_node(monkeypatch, modules, reason):
    """Warn, and offer nothing of it; services that could be created are taken back."""
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', SimpleNamespace())
    whole = {'msg': TYPES, 'srv': SimpleNamespace(GetEntities=object, StepSimulation=object,
                                                  SpawnEntity=BrokenKind), 'action': None}
    for name, module in (whole | modules).items():
        monkeypatch.setitem(sys.modules, f'simulation_interfaces.{name}', module)
    standing, said = [], []

    def create_service(kind, name, serve, callback_group):
        if kind is BrokenKind:
            raise RuntimeError('no library')
        standing.append(name)
        return name
    node = SimpleNamespace(create_service=create_service, destroy_service=standing.remove,
                           context=SimpleNamespace(ok=lambda: True),
                           get_logger=lambda: SimpleNamespace(warning=said.append),
                           get_parameter=lambda name: SimpleNamespace(value='world'))
    assert simulation_interfaces.offer(node, SimpleNamespace(group=''), None, None) == []
    assert not standing and len(said) == 1 and reason in said[0] and 'install it anew' in said[0]


def test_services_are_offered_where_the_package_has_them(monkeypatch):
    """Offer each service that the package defines under its own name, and no other."""
    kinds = SimpleNamespace(GetEntities=object(), StepSimulation=object(), LoadWorld=object(),
                            SpawnEntity=object())
    actions = SimpleNamespace(SimulateSteps=object())
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', SimpleNamespace())
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.msg', TYPES)
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.srv', kinds)
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.action', actions)
    made = {}

    def create_action(node, kind, name, serve, callback_group, cancel_callback):
        made[name] = kind, serve.__name__, callback_group
    monkeypatch.setattr(simulation_interfaces, 'ActionServer', create_action)

    def create_service(kind, name, serve, callback_group):
        made[name] = kind, serve.__name__, callback_group
    node = SimpleNamespace(create_service=create_service,
                           get_parameter=lambda name: SimpleNamespace(value='world'))
    answers = SimpleNamespace(group='group')
    offered = simulation_interfaces.offer(node, answers, None, None)
    assert offered == ['step_simulation', 'get_entities', 'spawn_entity', 'simulate_steps']
    assert made == {f'~/simulation_interfaces/{name}': (kind, name, 'group') for name, kind in (
        ('get_entities', kinds.GetEntities), ('step_simulation', kinds.StepSimulation),
        ('spawn_entity', kinds.SpawnEntity), ('simulate_steps', actions.SimulateSteps))}


NAMES = [*(f'oak_{i}' for i in range(2000)), 'a' * 60, 'ab' * 5000, *(
    'a' * i + 'b' * j + 'a' * k for i in range(0, 9, 2) for j in range(9) for k in range(0, 9, 2))]
HOSTILE = ['^(a|a)*b', '(a+)+b', '((a*)*)*b', '(a|aa)+$b', '(x?){30}x{30}', '([a-z0-9_]?){400}Z',
           '(a|b)*a(a|b){300}', '(a|b)*a(a|b){12}!', '(((a{250}){250}){250}){250}', '(){99999}',
           '(' * 499 + 'a' + ')' * 499, '(' * 1000, '(a' * 300 + ')*' * 300, '|' * 1000,
           '[' * 1000, f'a{{{"9" * 990}}}', 'a{255}{255}', '[' + 'a-z' * 300 + ']*!', 'a' * 10**6,
           '[[:' + 'a' * 900 + ':]]', '(a*)*' * 190 + '!', '.*' * 400 + '!']


def written(chance: random.Random, depth: int) -> str:
    """Write some expression that POSIX and Python read alike."""
    kind = chance.choice('llllgcabr' if depth else 'lllab')
    if kind == 'l':
        return chance.choice(['a', 'b', '_', '.', r'\.', '1'])
    if kind == 'a':
        return chance.choice('^$')
    if kind == 'b':
        return chance.choice(['[ab]', '[^a]', '[a-b1]', '[]b]', '[^]_]', '[b-]', r'\d', r'\W'])
    inner = [written(chance, depth - 1) for _ in range(chance.randint(1, 3))]
    if kind == 'r':
        times = chance.choice(['*', '+', '?', '{2}', '{0}', '{1,}', '{0,2}', '{,2}'])
        return f'({inner[0]}){times}'
    return f'({"|".join(inner)})' if kind == 'g' else ''.join(inner)


@pytest.mark.parametrize('seed', range(20))
def test_what_is_found_is_what_python_finds(seed):
    """Agree with `re` about random expressions in random names."""
    chance = random.Random(seed)
    for _ in range(150):
        text = '|'.join(written(chance, 3) for _ in range(chance.randint(1, 2)))
        pattern = PosixPattern(text)
        for _ in range(8):
            name = ''.join(chance.choices('ab_1.]-', k=chance.randint(0, 6)))
            assert pattern.is_in(name) == bool(re.search(text, name)), (text, name)


@pytest.mark.parametrize('text, fitting', [
    ('', ['oak_1', 'Fir 2']), ('[[:digit:]]$', ['oak_1', 'Fir 2']), ('[[:space:]]', ['Fir 2']),
    ('^[[:lower:]_[:digit:]]+$', ['oak_1']), ('[^[:alnum:]_]', ['Fir 2']), (r'\s\d', ['Fir 2']),
    ('[[:punct:]]', ['oak_1']), ('^o{1}a+k?_|F[h-j]r', ['oak_1', 'Fir 2']), ('^$', []),
    ('[[:xdigit:]]{2}', []), ('[[:upper:]]|[[:blank:]]', ['Fir 2'])])
def test_expressions_of_posix_are_read(text, fitting):
    """Take classes, sets, intervals, groups and anchors."""
    pattern = PosixPattern(text)
    assert [name for name in ('oak_1', 'Fir 2') if pattern.is_in(name)] == fitting


@pytest.mark.parametrize('text, reason', [
    ('(a', r'a \( is not closed'), ('a)', r'a \) closes nothing'), ('*a', r'nothing before a \*'),
    ('(|+)', r'nothing before a \+'), ('(?:a)', r'nothing before a \?'), ('a{', 'a } is missing'),
    ('a{x}', 'number of repetitions'), ('a{}', 'number of repetitions'),
    ('a{1,2,3}', 'number of repetitions'), ('a{3,2}', 'ends before it begins'),
    ('[a', 'a ] is missing'), ('[z-a]', 'ends before it begins'), (r'[\d]', 'no meaning'),
    ('[[:digits:]]', 'there is no class .*xdigit'), ('[[:digit]', ':] is missing'),
    ('a\\', 'means nothing'), (r'(a)\1', r'\\1 means nothing'), ('a{2001}', 'too large'),
    ('a' * 1001, 'longer than 1000 characters')])
def test_what_is_no_expression_is_refused(text, reason):
    """Say what is wrong."""
    with pytest.raises(CommandError, match=f'is no regular expression: .*{reason}'):
        PosixPattern(text)


@pytest.mark.timeout(60)  # none takes half a second; Python's `re` needs years for some
@pytest.mark.parametrize('text', HOSTILE, ids=lambda text: text[:30])
def test_no_expression_holds_anything_up(text):
    """Answer or refuse at once, for all patterns and names of objects."""
    try:
        pattern = PosixPattern(text)
        for name in NAMES:
            pattern.is_in(name)
    except CommandError as error:
        assert len(str(error)) < 250
