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

"""Words of the executable `command`: reading, completing, listing; without ROS."""

import json
import subprocess

import pytest

from procphys_ros.command_line import answers, Description, read, script
from procphys_ros.command_line.completion import memory, remember
from procphys_ros.command_line.progress import break_line, status_line
from procphys_ros.command_line.values import parse, show
from procphys_ros.command_line.words import options, verbs
from procphys_ros.errors import CommandError
from procphys_ros.simulation import Cause

SCENE = Description(json.dumps({
    'frame': 'world',
    'objects': [{'name': 'oak_0', 'first': 0, 'count': 2}, {'name': 'house', 'first': 2,
                                                            'count': 3}],
    'parts': {'name': ['oak_0/segment_0', 'oak_0/segment_1', 'house/brick_0', 'house/brick_1',
                       'house/pane_2'],
              'kind': ['segment', 'segment', 'brick', 'brick', 'pane'],
              'shape': ['capsule'] * 2 + ['box'] * 3, 'size': [[0.2, 0.2, 1.0]] * 5,
              'mass': [300.0, 1500.0, 2.7, 2.7, 0.25], 'material': ['wood'] * 2 + ['brick'] * 3},
    'bonds': {'parts': [], 'law': []}}))


@pytest.mark.parametrize('words, expected', [
    ('wind -3 0.5 -1e1', {'verb': 'wind', 'velocity': [-3.0, 0.5, -10.0]}),
    ('wind off', {'velocity': [False]}),
    ('impulse house/12 -300 0 0', {'part': 'house/12', 'x': -300.0, 'angular': (0.0, 0.0, 0.0)}),
    ('impulse 12 1 2 3 --angular -4 5 6', {'angular': [-4.0, 5.0, 6.0]}),
    ('explode 3 -2 .5 --charge 5', {'y': -2.0, 'z': 0.5, 'charge': 5.0}),
    ('launch --from 0 -20 2 --velocity 0 25 0', {'position': [0.0, -20.0, 2.0], 'mass': None}),
    ('--node /a/sim --timeout 2 step 3', {'node': '/a/sim', 'timeout': 2.0, 'count': 3}),
    ('step 3 --node /a/sim', {'node': '/a/sim', 'timeout': 5.0, 'count': 3}),
    ('--node /a/sim list', {'node': '/a/sim', 'pattern': ''}),
])
def test_words_are_read(words, expected):
    """Take numbers of either sign wherever a number is meant."""
    said = vars(read(words.split()))
    assert {name: said[name] for name in expected} == expected


@pytest.mark.parametrize('words, complaint', [
    ('', 'VERB'), ('wnd 1 2 3', 'invalid choice'), ('wind 1 2', 'three numbers'),
    ('wind on off', 'three numbers'), ('wind nan 0 0', 'not finite'),
    ('wind 1e999 0 0', 'not finite'), ('impulse oak_0/1 0 0', 'required'),
    ('impulse oak_0/1 a 0 0', '"a" is not a number'), ('explode 0 0 0 --charge -1', 'above 0'),
    ('launch --shape cone', 'invalid choice'), ('step 0', 'whole number above 0'),
    ('step ٣', 'whole number above 0'), ('step ' + 5000 * '9', 'whole number above 0'),
    ('spawn oak.lsys --seed ' + 5000 * '9', 'whole number, 0 or more'),
    ('--timeout 0 list', 'above 0'),
], ids=lambda value: value[:30])
def test_words_that_make_no_sense_end_with_two(words, complaint, capsys):
    """Say what is wrong, and nothing on standard output."""
    with pytest.raises(SystemExit) as ended:
        read(words.split())
    assert ended.value.code == 2
    out, err = capsys.readouterr()
    assert complaint in err and err.count('\n') == 1 and not out


@pytest.mark.parametrize('verb', ['', *verbs()])
def test_every_verb_has_help(verb, capsys):
    """Explain each verb, and end with 0."""
    with pytest.raises(SystemExit) as ended:
        read([*verb.split(), '--help'])
    assert ended.value.code == 0
    assert f'usage: command {verb}'.strip() in capsys.readouterr().out


def test_listing_names_objects_and_parts():
    """Say what an object is made of; find parts by kind, name, index and wildcards."""
    oak, house = SCENE.overview()
    assert oak.split() == ['oak_0', '2', 'parts', '1.8', 't', '2', 'segment']
    assert '2 brick, 1 pane' in house
    for pattern, found in (('oak_0', 2), ('house/brick', 2), ('house/2', 1), ('house/pane_2', 1),
                           ('h*/b*', 2), ('*', 5), ('*/1', 2)):
        assert len(list(SCENE.listing(pattern))) == found, pattern
    assert '250.0 g' in next(SCENE.listing('house/pane'))


@pytest.mark.parametrize('pattern, words', [('oak_O', 'did you mean oak_0'),
                                            ('house/door', 'kinds are brick, pane')])
def test_unknown_names_are_answered_with_known_ones(pattern, words):
    """Offer what there is."""
    with pytest.raises(CommandError, match=words):
        list(SCENE.listing(pattern))


@pytest.mark.parametrize('name', ['4', 'house/brick_1', 'house/0', 'oak_0/segment_0'])
def test_parts_have_a_name_or_an_index(name):
    """Take what means one part."""
    SCENE.check_part(name)


@pytest.mark.parametrize('name, words', [
    ('house/brick', '"house/brick" means 2 parts.*house/brick_0'), ('oak_0/*', 'means 2 parts'),
    ('house/pane', 'house/pane_2'), ('house/7', 'kinds are'), ('5', 'from 0 to 4'),
    ('oak_O/0', 'did you mean oak_0'), ('house', 'object/index')])
def test_what_means_no_single_part_is_refused(name, words):
    """Refuse before it is sent on a topic, which gives no answer."""
    with pytest.raises(CommandError, match=words):
        SCENE.check_part(name)


@pytest.mark.parametrize('typed, expected', [
    ([''], verbs()), (['im'], ['impulse']), (['impulse', 'oa'], ['oak_0/']),
    (['impulse', 'house/p'], ['house/pane_2']), (['impulse', 'oak_0/1', ''], []),
    (['list', ''], ['oak_0/', 'house/']), (['wind', 'o'], ['on', 'off']),
    (['--node', '/a', 'wind', 'on', ''], []), (['launch', '--s'], ['--shape', '--size']),
    (['completion', ''], ['bash', 'zsh']), (['--no'], ['--node']), ([], verbs()),
])
def test_tab_offers_what_may_come_next(typed, expected, tmp_path):
    """Offer verbs, options, objects, then parts of the scene last seen."""
    remember(SCENE, tmp_path / 'names' / 'scene.json')
    assert answers(typed, tmp_path / 'names' / 'scene.json') == expected


def test_tab_offers_nothing_of_a_scene_never_seen(tmp_path):
    """Stay silent when there is no memory of a scene, or it is spoilt."""
    assert answers(['list', ''], tmp_path / 'none.json') == []
    (tmp_path / 'bad.json').write_text('{"oak', 'utf-8')
    assert answers(['list', ''], tmp_path / 'bad.json') == []


def test_memory_is_one_file_per_domain_and_node(monkeypatch):
    """Keep apart what simulations in other domains or of other names hold."""
    monkeypatch.setenv('XDG_CACHE_HOME', '/cache')
    files = set()
    for domain in ('', '7'):
        monkeypatch.setenv('ROS_DOMAIN_ID', domain)
        files |= {memory(node) for node in ('/sim', '/a/sim')}
    assert len(files) == 4 and all(str(f).startswith('/cache/procphys_ros/') for f in files)


def test_nothing_is_remembered_where_nobody_has_a_home(tmp_path, monkeypatch):
    """Make no folder called ~ where neither HOME nor the users' table knows one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('XDG_CACHE_HOME', raising=False)
    monkeypatch.setattr('os.path.expanduser', lambda path: path)
    remember(SCENE, memory('/sim'))
    assert not list(tmp_path.iterdir())


def test_bash_completes_with_the_printed_lines(tmp_path):
    """Source the lines in bash and press TAB on half a name."""
    program = tmp_path / 'command'
    program.write_text('#!/bin/sh\n[ "$1 $2 $3" = "__complete impulse oak" ] && echo oak_0/\n')
    program.chmod(0o755)
    lines = (f'{script("bash", str(program))}\nCOMP_WORDS=({program} impulse oak); COMP_CWORD=2\n'
             '_procphys_command; echo "${COMPREPLY[@]}"; complete -p | grep -c procphys')
    answer = subprocess.run(['bash', '-c', lines], capture_output=True, text=True, check=True)
    assert answer.stdout.split()[0] == 'oak_0/' and not answer.stderr
    assert 'bashcompinit' in script('zsh', str(program))


@pytest.mark.parametrize('words, present, expected', [
    (['3'], 1.0, 3), (['0.5'], 1.0, 0.5), (['on'], False, True), (['eog'], 'cosine', 'eog'),
    (['1', '0', '-2.5'], [0.0], [1, 0, -2.5]), (['[1,', '0]'], [0.0], [1, 0]),
    (['oak', 'pine'], ['elm'], ['oak', 'pine']), (['7'], ['elm'], ['7']), (['a b'], '', 'a b'),
])
def test_values_are_read_in_the_type_of_the_present_one(words, present, expected):
    """Read numbers, truth, words and lists; write them so that they can be read again."""
    value = parse(words, present)
    assert value == expected and type(value) is type(expected)
    assert parse(show(value).split(), present) == value


@pytest.mark.parametrize('words, expected', [
    ([''], []), (['[]'], []), (['oak'], ['oak']), (['0 gust', '2 gust'], ['0 gust', '2 gust']),
    (['[oak, pine]'], ['oak', 'pine']), (['[oak,', 'pine]'], ['oak', 'pine']),
    (['["a, b", on, 12]'], ['a, b', 'on', '12']), (['size=[1'], ['size=[1'])])
def test_lists_of_texts_are_read(words, expected):
    """Take word by word, or the list that `get` prints and ROS takes."""
    assert parse(words, [], of_texts=True) == expected
    if not set(',[') & set(''.join(expected)):
        assert parse([show(expected)], [], of_texts=True) == expected


@pytest.mark.parametrize('text', ['[oak, [pine]]', '["oak]', '[{a: b}]'])
def test_lists_that_hold_no_texts_are_refused(text):
    """Say how a list is written."""
    with pytest.raises(CommandError, match='such as'):
        parse([text], [], of_texts=True)


@pytest.mark.parametrize('word, present', [('abc', 1.0), ('maybe', True)])
def test_values_of_another_type_are_refused(word, present):
    """Say what is wrong with the word."""
    with pytest.raises(CommandError, match=word):
        parse([word], present)


def test_lines_of_watch():
    """Tell time, pace and what broke; causes are those of the simulation."""
    values = {'simulation time [s]': '12.5', 'real-time factor': '0.40', 'trees [ms/step]': '1.5',
              'stress [ms/step]': '2.0', 'parts': '9', 'awake bodies': '1', 'bonds broken': '3'}
    line = status_line('overloaded', values)
    assert '12.50 s' in line and '3.5 ms/step' in line and line.endswith('overloaded')
    row = {'x': 1.0, 'y': 2.0, 'z': 3.0, 'bond': 4, 'part_a': -1, 'part_b': 6, 'load': 1.25}
    for cause in Cause:
        line = break_line({**row, 'cause': int(cause)})
        assert f'by {cause.name.lower()} ' in line and 'the ground from part 6' in line
    line = break_line({**row, 'cause': 0}, [f'oak/segment_{i}' for i in range(7)])
    assert 'broken: the ground from oak/segment_6 by force' in line


def test_watch_waits_for_a_scene():
    """Show what the status says while a first scene is built, which has no time yet."""
    assert status_line('growing objects for 3.0 s', {'commands rejected': '0'}) == (
        'growing objects for 3.0 s')


def test_options_of_no_verb_are_those_of_the_command():
    """Offer --node before a verb is typed."""
    assert {'--node', '--timeout', '--version'} <= set(options(''))
