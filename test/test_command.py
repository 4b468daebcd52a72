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

"""The executable `command`, against a running node."""

import os
import signal
import subprocess
import sys
from time import monotonic
from types import SimpleNamespace

from forked import ForkedProcess
from geometry_msgs.msg import PointStamped
from node_process import Client, NodeProcess, PATIENCE, ROOT, SAPLING, SCENE
import pytest
import rclpy
from std_srvs.srv import Trigger

from procphys_ros.ros import command
from procphys_ros.ros.remote import NoNodeError, Remote

COMMAND = 'procphys_ros.ros.command'


@pytest.fixture(scope='module')
def node(tmp_path_factory):
    """Run one node for all tests; what they change they name themselves."""
    weak = SAPLING.replace('DampingRatio', 'Strength(1e6) DampingRatio')
    scene = {**SCENE, 'post': {**SCENE['post'], 'grammar_text': weak},
             'files': {'root': [str(tmp_path_factory.getbasetemp())]}}
    process = NodeProcess(tmp_path_factory.mktemp('node'), scene)
    process.wait_for_banner()
    yield process
    process.kill()


@pytest.fixture
def say(tmp_path, monkeypatch, capfd):
    """Return a function that runs one command line here: exit code, output, errors."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def carry_out(words):
        code = command.main(with_patience(words))
        out, err = capfd.readouterr()
        return code, out, err
    yield carry_out
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that runs one command line as a process: exit code, output, errors."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))

    def start(words):
        process = ForkedProcess(COMMAND, with_patience(words))
        out, err = process.communicate(5 * PATIENCE)
        assert 'Traceback' not in err
        return process.returncode, out, err
    return start


def with_patience(words):
    """Split a command line, and let it look for the node as long as it takes."""
    look = [] if words.startswith('__complete') else ['--timeout', str(PATIENCE)]
    return [*look, *words.split()]


@pytest.mark.parametrize('words, answer', [
    ('wind 4 0 0', 'wind [4, 0, 0] m/s'),
    ('wind off', 'wind off'),
    ('impulse sapling_0/2 0 -3 0', 'sent on ~/impulse'),
    ('joint crane/slew velocity -0.2', 'sent on ~/joint_command'),
    ('wrench sapling_1/segment_2 5 0 0', 'sent'),
    ('clear', 'ended'),
    ('explode 0 30 1 --charge 0.5', '0.5 kg TNT'),
    ('explode 0 40 1', 'sent on ~/explosion'),
    ('set scene.cues []', 'scene.cues  []'),
    ('launch --shape box --size 0.2 0.2 0.1 --mass 2 --from 40 0 3 --velocity 1 0 0', 'flies'),
    ('gust --amplitude 3 --duration 2 --direction 1 0 0', 'gust of 3 m/s for 2 s'),
    ('grow sapling --rate 0.5 --years 1', '3 plants grow on for 1 years, 0.5 a second'),
    ('load --snow 3 --ramp 0.5', 'snow 3 kg/m², ice 0 m, changes in 0.5 s'),
    ('set gust.duration 4', 'gust.duration  4'),
    ('set wind.zones ["size=4,4,4"]', 'wind.zones  [size=4,4,4]'),
    ('list', 'sapling_2'),
    ('list sapling_0/1', 'sapling_0/segment_1'),
    ('get wind.vel', '[4, 0, 0]'),
])
def test_what_is_said_happens(node, say, words, answer):
    """End with 0 and print what the node answered."""
    code, out, err = say(words)
    assert (code, err) == (0, '') and answer in out


def test_files_of_one_s_own_are_spawned_and_removed(node, say, tmp_path):
    """Say it in a sentence: text and definitions are sent, a scan the node reads itself."""
    path, scan = tmp_path / 'mine.lsys', tmp_path / 'oak.csv'
    path.write_text('define: long = 1\naxiom: Width(0.05) A(long)\nderivation length: 9\n'
                    'production:\nA(n) : n > 0 -> F(1) A(n - 1)\n', 'utf-8')
    scan.write_text('x1,y1,z1,x2,y2,z2,radius\n0,0,0,0,0,2,0.1\n', 'utf-8')
    for words, answer in [(f'spawn {path} 4 -2 --yaw -0.5 --define long=2',
                           'mine_0 stands at [4.0, -2.0, 0.0] m, 2 parts'),
                          ('remove mine_0', 'mine_0 is gone'),
                          (f'spawn {scan} 9', 'oak_0 stands at [9.0, 0.0, 0.0] m, 1 parts'),
                          ('remove oak_0', 'oak_0 is gone')]:
        code, out, err = say(words)
        assert (code, err) == (0, '') and out.startswith(answer)
    _, out, _ = say('list')
    assert 'sapling_0' in out and 'mine_0' not in out and 'oak_0' not in out


@pytest.mark.parametrize('words, reason', [
    ('wind 500 0 0', 'from -150 to 150'),
    ('impulse sapling_9/2 1 0 0', 'did you mean'),
    ('wrench saplin_0/2 1 0 0', 'did you mean'),
    ('wrench sapling_0/leaf_2 1 0 0', 'kinds are segment'),
    ('demolish', ''),
    ('cut sapling_0', 'takes a plane'),
    ('grow no_such_plant', 'there is no plant'),
    ('step', 'pause'),
    ('set gust.duratoin 3', 'did you mean gust.duration'),
    ('set gust.duration long', 'not a number'),
    ('set shard.count 2', ''),
    ('list nothing', 'no object'),
    ('impulse 999999999999999999999 1 0 0', 'no part 999'),
    ('impulse sapling_0 1 0 0', 'object/index'),
])
def test_what_is_refused_ends_with_one(node, say, words, reason):
    """Print the reason on the error stream, in one line, and nothing else."""
    code, out, err = say(words)
    assert code == 1 and not out and reason in err
    assert err.startswith('command: ') and err.count('\n') == 1


def test_a_process_ends_as_its_command_does(node):
    """Exit with 1 and the reason alone where the node refuses, as users start it."""
    done = subprocess.run([sys.executable, '-m', COMMAND, *with_patience('wind 500 0 0')],
                          cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr.startswith('command: ') and done.stderr.count('\n') == 1


def test_time_obeys(node, say):
    """Pause, step, go on, reset and reload."""
    assert say('pause')[0] == 0
    before = say('step')[1]
    after = say('step 30')[1]
    assert float(after.split()[-2]) - float(before.split()[-2]) == pytest.approx(0.5, abs=1e-3)
    assert say('resume')[0] == 0
    assert 'back at 0 s' in say('reset')[1]
    assert '16 parts' in say('reload')[1]


def test_tab_knows_the_scene_once_it_was_listed(node, say):
    """Complete names of the running scene."""
    say('list')
    code, out, _ = say('__complete impulse sapling_2/')
    assert code == 0 and 'sapling_2/segment_1' in out.split()


def test_watch_tells_time_and_breaks_until_it_is_stopped(node, say):
    """Print a status each second and a line for a bond that breaks; end with 0 on Ctrl-C."""
    watch = ForkedProcess(COMMAND, with_patience('watch'))
    try:
        assert 'ms/step' in watch.stdout.readline()
        end = monotonic() + 2 * PATIENCE
        told = False
        while not told:  # a break is told once, and who begins to listen may miss it
            assert monotonic() < end
            assert say('reset')[0] == 0
            assert say('wrench post/3 3000 0 0')[0] == 0
            told = any('broken: post/segment_' in watch.stdout.readline() for _ in range(5))
        watch.send_signal(signal.SIGINT)
        _, errors = watch.communicate(timeout=PATIENCE)
        assert watch.returncode == 0 and 'Traceback' not in errors
    finally:
        watch.kill()


def test_a_message_that_nobody_has_taken_is_told():
    """Raise what ends the command with 3 when the node has gone before it had the message."""
    remote, sent = Remote.__new__(Remote), []
    remote.name, remote.patience, remote._search = '/sim', 1.0, 10.0
    remote._node = SimpleNamespace(create_publisher=lambda *_: SimpleNamespace(
        publish=sent.append, get_subscription_count=lambda: 1,
        wait_for_all_acked=lambda _: False))
    with pytest.raises(NoNodeError, match='/sim has not taken it within 1 s'):
        remote.explode((0.0, 0.0, 0.0))
    assert len(sent) == 1


@pytest.mark.parametrize('words, patience', [
    (['--timeout', '300', 'list'], 300.0), (['list', '--timeout', '2'], 120.0), (['list'], 120.0)])
def test_the_timeout_holds_for_answers_as_well(monkeypatch, words, patience):
    """Wait as long as was asked for a node that is there and compiles, and two minutes else."""
    asked = []

    def find(name, timeout, patience):
        asked.append(patience)
        raise NoNodeError('none')
    monkeypatch.setattr('procphys_ros.ros.remote.Remote', find)
    monkeypatch.setattr(signal, 'signal', lambda *_: None)
    monkeypatch.setattr(rclpy, 'try_shutdown', lambda: None)
    monkeypatch.setattr('procphys_ros.ros.starting.start_ros', lambda *_, **__: None)
    assert command.main(words) == 3 and asked == [patience]


def test_no_node_ends_with_three(node, run):
    """Say where was looked and what is there."""
    for timeout in (0.5, 5.0, 30.0, PATIENCE):  # a busy machine may find the other node late
        code, out, err = run(f'--node /elsewhere --timeout {timeout} reset')
        assert code == 3 and not out
        assert '/elsewhere' in err and os.environ['ROS_DOMAIN_ID'] in err
        if '/sim' in err:
            break
    else:
        pytest.fail(err)


def test_the_profile_for_quick_discovery_is_not_needed(node, run, monkeypatch):
    """Find the node without it; with it, as in all other tests, nothing complains about it."""
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE')
    code, out, err = run('get seed')
    assert (code, out.split(), err) == (0, ['seed', '0'], '')


def test_what_is_remapped_is_told_and_found(run):
    """Name the topic that nobody listens to, and reach it under the name that ROS is given."""
    rclpy.init()
    client = Client()
    client.node.create_service(Trigger, '/far/reset_simulation', lambda _, answer: answer)
    received = client.listen(PointStamped, '/world/explosion', 10)
    remote = Remote('/far', PATIENCE, 0.5)
    with pytest.raises(NoNodeError, match='nobody listens to /far/explosion .* -r /far/explosion'):
        remote.explode((0.0, 0.0, 0.0))
    remote.close()
    assert run('--node /far explode 1 2 3 --ros-args -r /far/explosion:=/world/explosion')[0] == 0
    client.spin_until(lambda: received, 'the message')
    assert received[0].point.z == 3.0
    client.close()
    rclpy.shutdown()


def test_bad_words_for_ros_end_with_two(run):
    """Say in the words of ROS what cannot be read, also where no node would be found."""
    code, out, err = run('pause --ros-args -r a')
    assert code == 2 and not out and 'remap rule' in err


def test_completion_and_help_need_no_node(run, capsys):
    """Answer at once, without looking for a node."""
    code, out, _ = run('completion bash')
    assert code == 0 and '__complete' in out and 'complete -F' in out
    for words, ended, said in (
            ('--help', 0, 'usage'), ('impulse', 2, 'required'),
            *((f'--node {name} pause', 2, 'cannot name a node')
              for name in ('bad-name!', '/', '9', '/sim/', '//sim'))):
        with pytest.raises(SystemExit) as end:
            command.main(words.split())
        assert end.value.code == ended and said in ''.join(capsys.readouterr()), words
