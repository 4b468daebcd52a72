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

"""How the node starts and ends: exit codes, one readable line, no traceback."""

from array import array
from math import nan
from pathlib import Path
import signal
from types import SimpleNamespace

from node_process import Client, NodeProcess, SCENE
import pytest
import rclpy
from std_srvs.srv import Trigger

from procphys_ros.ros import running
from procphys_ros.ros.starting import overruled


@pytest.fixture
def start(tmp_path):
    """Return a function that starts nodes, and kill them at the end."""
    started = []

    def run(parameters: dict | None, *arguments: str, forked: bool = True) -> NodeProcess:
        started.append(NodeProcess(tmp_path, parameters, *arguments, forked=forked))
        return started[-1]

    yield run
    for process in started:
        process.kill()


def with_(**changes) -> dict:
    """Return the scene with some top-level keys replaced."""
    return {**SCENE, **changes}


@pytest.mark.parametrize('how', [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_the_node_with_code_zero(start, how):
    """End quietly when told to."""
    process = start(SCENE, forked=how == signal.SIGINT)
    banner = process.wait_for_banner()
    assert '4 objects, 16 parts' in banner and '/sim/poses' in banner
    code, errors = process.finish(how)
    assert code == 0 and errors == ''


@pytest.mark.parametrize(('text', 'given', 'holds'), [
    ('0.5', 2, False), ('[7.0, 0.0]', array('q', [1, 0]), False), ('many', 3, False),
    ('3', 3, True), ('1e3', 1000.0, True), ('[1.0, 2.0]', array('d', [1, 2]), True),
    ('on', True, True), ('"5"', '5', True), ('[a, b]', ['a', 'b'], True), ('.nan', nan, True),
    ('[]', [], True), ('[ 1', '[ 1', True)])
def test_values_of_both_readers_are_compared(text, given, holds):
    """Take for the same what the YAML readers of ROS and of Python read differently."""
    words = ['--ros-args', '-p', f'x:={text}', '-p', 'sim:x:=4', '--', '-p', 'x:=5']
    assert bool(overruled(words, {'x': given})) is not holds


def test_node_ends_while_it_runs_as_fast_as_possible(start):
    """Hear a signal although there is always a step to compute; ROS takes both alike then."""
    process = start(with_(real_time_factor=0.0, status_line='on'))
    process.wait_for_banner()
    while 'real-time factor' not in process.next_line():
        pass
    assert process.finish(signal.SIGINT)[0] == 0


@pytest.mark.parametrize('library, how', [
    ('_rclpy_pybind11', signal.SIGTERM), ('libllvmlite', signal.SIGINT)])
def test_node_ends_while_it_is_still_starting(start, library, how):
    """Hear a signal as soon as a library is there: between imports, or as kernels load."""
    process = start(SCENE, forked=False)
    maps = Path(f'/proc/{process.process.pid}/maps')
    while library not in maps.read_text('utf-8'):
        assert process.process.poll() is None, f'the node ended before it loaded {library}'
    assert process.finish(how) == (0, '')


@pytest.fixture
def client():
    """Make a client."""
    rclpy.init()
    made = Client()
    yield made
    made.close()
    rclpy.try_shutdown()


def test_ctrl_c_does_not_keep_the_node_from_saying_why_it_ends(monkeypatch):
    """Press it while the first line of the log is made: the line comes, and code 1."""
    def fatal(text):
        signal.raise_signal(signal.SIGINT)
        told.append(text)

    told, heard = [], []
    monkeypatch.setattr(running, 'get_logger', lambda name: SimpleNamespace(fatal=fatal))
    monkeypatch.setattr(running.rclpy, 'ok', lambda: True)
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(1))
    try:
        assert running._complain(ValueError('no scene')) == 1
    finally:
        signal.signal(signal.SIGINT, before)
    assert (told, heard) == (['no scene'], [])


def test_node_ends_while_it_builds_the_first_scene(start, client):
    """End without a scene, as soon as it is told to."""
    process = start(with_(sapling={**SCENE['sapling'], 'count': 50_000}))
    client.diagnostics_where(lambda v: 'building the scene' in v['message'])
    assert process.finish(signal.SIGTERM) == (0, '')


def test_node_ends_during_a_reload_and_while_paused(start, client):
    """End with the scene half built, time standing still, and somebody waiting for an answer."""
    process = start(SCENE)
    process.wait_for_banner()
    assert client.switch('set_pause', True).success
    assert client.set_parameter('sapling.count', 50_000).successful
    reload = client.node.create_client(Trigger, '/sim/reload_scene')
    client.spin_until(reload.service_is_ready, 'the service')
    waiting = reload.call_async(Trigger.Request())
    client.diagnostics_where(lambda v: 'building the scene' in v['under way'])
    assert process.finish(signal.SIGINT) == (0, '')
    assert not waiting.done()


@pytest.fixture(scope='module')
def warned(tmp_path_factory):
    """Run a node with everything that is warned of until time passes; return lines of the log."""
    slip = 'axiom: Width(0.08) Density(700) F(1) W F(1)'
    process = NodeProcess(tmp_path_factory.mktemp('warned'), {
        'use_sim_time': True, 'status_line': 'on', 'real_time_factor': 2, 'gravity': 9.5,
        'scene': {'objects': ['sapling']},
        'sapling': {'grammar_text': slip, 'origin': [0.0, 0.0, -0.5], 'spacng': 3.0}},
        '-p', 'real_time_factor:=0.5', '-p', 'gravity:=3')
    process.wait_for_banner()
    while 'real-time factor' not in process.next_line():
        pass
    code, complaints = process.finish(signal.SIGTERM)
    lines = complaints.splitlines()
    assert code == 0 and [line for line in lines if '[WARN]' not in line] == []
    return lines


def lines_with(lines, *words):
    """Count the lines that contain all of some words."""
    return sum(all(word in line for word in words) for line in lines)


def test_a_value_that_ros_drops_is_told(warned):
    """Warn when a file has another type than -p, which ROS then does not see."""
    assert lines_with(warned, 'does not hold') == 1
    assert lines_with(warned, '-p real_time_factor:=0.5 does not hold: a file gives 2') == 1


def test_use_sim_time_does_not_stop_the_node(warned):
    """Run on the steady clock although told to wait for the clock that it publishes itself."""
    assert lines_with(warned, 'use_sim_time changes nothing') == 1


def test_unknown_parameter_is_warned_of(warned):
    """Name what is misspelt and what may be meant, and run."""
    assert lines_with(warned, 'sapling.spacng; did you mean sapling.spacing') == 1


def test_slips_of_grammars_and_scenes_are_warned_of_in_the_log(warned):
    """Log in a line each, by ROS, what the library warns of: a letter unknown, a wall too deep."""
    assert lines_with(warned, 'sapling.grammar_text:1:', 'module W') == 1
    assert lines_with(warned, 'sapling', 'below') == 1


def test_bad_scene_ends_the_process_with_one_line(start):
    """Exit with code 1 and one line that names the cause."""
    code, errors = start(with_(post={'grammar_text': 'axiom: F(1) [ F(1)'}), forked=False).finish()
    assert code == 1 and len(errors.splitlines()) == 1, errors
    assert '[FATAL]' in errors and 'post.grammar_text:1' in errors


REFUSED: dict[str, dict] = {
    'there is no grammar "oack.lsys"': with_(post={'grammar': 'oack.lsys'}),
    'post.grammar': with_(post={}),
    'scene.objects is empty': with_(scene={'objects': ['']}),
    'wind.velocity': with_(wind={'velocity': [5, 0]}),
    'wind.velocity is': with_(wind={'velocity': 'strong'}),
    'time_step': with_(time_step=5.0),
    'seed': with_(seed=1.5),
    'Width': with_(post={'grammar_text': 'axiom: Width(-1) F(1)'}),
}
MISREAD = {
    '/does/not/exist.yaml': ['--params-file', '/does/not/exist.yaml'],
    # a byte that is not UTF-8, as in names of old archives
    r'"b\udce4ume.yaml" is not UTF-8': ['--params-file', 'b\udce4ume.yaml'],
    '[1.0, 2.5, 0.0]': ['-p', 'wind.velocity:=[1, 2.5, 0]'],
}


@pytest.mark.parametrize('said', REFUSED)
def test_bad_scene_is_told_in_one_line(start, said):
    """End with code 1 and one line that names the cause, wherever it is found."""
    code, errors = start(REFUSED[said]).finish()
    assert code == 1 and len(errors.splitlines()) == 1, errors
    assert '[FATAL]' in errors and said in errors


@pytest.mark.parametrize('said', MISREAD)
def test_arguments_that_ros_cannot_read_are_told(start, said):
    """End with code 1 without a traceback, naming what it is or how to write it."""
    code, errors = start(None, *MISREAD[said]).finish()
    assert code == 1 and said in errors and 'Traceback' not in errors


def test_the_demo_runs_when_no_scene_is_given(start):
    """Start with the demo, and tell how to give another scene."""
    process = start(None)
    hint = process.next_line()
    while 'compiling' in hint:  # kernels, where no cache has them
        hint = process.next_line()
    assert '--params-file' in hint and 'demo' in hint
    assert 'oak' not in hint and 'objects' in process.wait_for_banner()
    assert process.finish(signal.SIGINT) == (0, '')
