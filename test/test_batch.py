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

"""Sweeps and batches of runs: what is varied, what a row says, and that no kill loses one."""

from contextlib import contextmanager, nullcontext
import csv
import errno
from functools import partial
from io import StringIO
import json
import logging
import math
from multiprocessing import get_context
import os
from pathlib import Path
import resource
import signal
import subprocess
import sys

from node_process import SAPLING
import numpy as np
from numpy.testing import assert_allclose
import pytest

from procphys_ros.batch import command, record, Run, run, Sweep, workers
from procphys_ros.batch.command import main
from procphys_ros.batch.table import Table
from procphys_ros.batch.workers import attempt
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.physics.loads import (
    sweep_box_boxes,
    sweep_box_capsules,
    sweep_boxes,
    sweep_capsules,
)
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

ROOT = Path(__file__).resolve().parents[1]
STRUCK = {
    'scene': {'objects': ['wall', 'post'],
              'cues': ['0.1 launch position=0.45,-3.0,0.3 velocity=0,25,0 size=0.2']},
    'projectile': {'mass': 20.0}, 'wind': {'turbulence_intensity': 0.0},
    'wall': {'grammar': 'garden_wall.wall', 'defines': ['length=0.89', 'height=0.6']},
    'post': {'grammar_text': SAPLING, 'origin': [5.0, 0.0, 0.0]}}
CALM = {'scene': {'objects': ['post']}, 'post': {'grammar_text': SAPLING}}


@pytest.fixture(autouse=True)
def cheap_processes(monkeypatch):
    """Fork processes from one that has imported everything."""
    context = get_context('forkserver')
    context.set_forkserver_preload(['test_batch'])
    monkeypatch.setattr(workers, 'get_context', lambda _: context)


@pytest.fixture
def scene(tmp_path):
    """Write a scene file of a tree in the wind, which takes no time to simulate."""
    path = tmp_path / 'calm.yaml'
    path.write_text(json.dumps({'/**': {'ros__parameters': CALM}}), 'utf-8')
    return path


def rows(path):
    """Read a table."""
    with path.open(encoding='utf-8') as file:
        return list(csv.DictReader(file))


def test_a_row_says_what_broke_and_fell():
    """Throw a ball at a wall: its bonds break by impact, its bricks fall, the tree stands."""
    told = run(Run(0, STRUCK, ROOT, 1.0))
    causes = {name: value for name, value in told.items() if name.startswith('broken_by_')}
    assert told['bonds_broken'] == sum(causes.values()) > 5
    assert causes['broken_by_impact'] > 0 and causes['broken_by_bending'] == 0
    assert 1 < told['parts_fallen'] < told['parts'] - 3
    assert 0.0 < told['mass_fallen_kg'] < told['mass_kg']
    assert 0.1 < told['first_break_s'] < 0.3 and told['first_break_s'] <= told['last_break_s'] <= 1
    again = run(Run(1, STRUCK, ROOT, 1.0))
    assert told | {'wall_time_s': 0.0} == again | {'wall_time_s': 0.0}


def test_a_branch_that_comes_off_has_fallen():
    """Blow a weak tree over: all that is beyond the break counts, and its mass."""
    weak = {'scene': {'objects': ['tree']}, 'wind': {'velocity': [60.0, 0.0, 0.0],
                                                     'turbulence_intensity': 0.0},
            'tree': {'grammar_text': 'axiom: Density(700) Modulus(8e9) Strength(2e5) '
                                     'DampingRatio(0.05) Width(0.08) F(1) F(1) F(1)'}}
    told = run(Run(0, weak, ROOT, 1.0))
    assert told['broken_by_bending'] >= 1 and 1 <= told['parts_fallen'] <= 3
    assert told['mass_fallen_kg'] == pytest.approx(told['mass_kg'] * told['parts_fallen'] / 3)


def test_a_series_is_recorded_of_each_run(scene, tmp_path, capsys):
    """Record a part and an object: files hold what a simulation records, and names."""
    path = tmp_path / 'table.csv'
    words = [str(scene), '--vary', 'wind.velocity=[[0, 0, 0], [9, 0, 0]]', '--duration', '0.5',
             '--out', str(path), '--jobs', '1', '--series', 'post/3', '--series', 'post',
             '--every', '7']
    assert main(words) == 0
    calm, windy = (dict(np.load(tmp_path / 'table.csv.series' / f'{number}.npz'))
                   for number in range(2))
    assert windy['names'].tolist() == [f'post/segment_{i}' for i in (3, 0, 1, 2, 3)]
    assert np.ptp(windy['poses'][:, 0, 0]) > 1e-4 > np.ptp(calm['poses'][:, 0, 0])
    simulation = Simulation(Scene.from_parameters(
        CALM | {'wind': {'velocity': [9.0, 0.0, 0.0]}}, ROOT))
    known = simulation.series(30, ['post/3', 'post'], 7)
    for name, column in vars(known).items():
        np.testing.assert_array_equal(windy[name], column)
    assert main(words[:-1] + ['6']) == 1 and 'another sweep' in capsys.readouterr().err


def test_numbers_are_varied_as_ros_writes_them(scene):
    """Take 1e1 for a number, as the node does."""
    sweep = Sweep.read(scene, ['gust.amplitude=1e1,2.5E1'], 1, 1.0)
    assert [run.parameters['gust']['amplitude'] for _, run in sweep.runs()] == [10.0, 25.0]


def test_a_series_without_a_row_is_refused(scene):
    """Ask for a row each 31 steps of a run that has 30."""
    assert len(Sweep.read(scene, [], 1, 0.5, ['post'], 30)) == 1
    with pytest.raises(SceneError, match='--every 31: no row is recorded, a run has 30 time'):
        Sweep.read(scene, [], 1, 0.5, ['post'], 31)


def test_a_series_does_not_change_the_row():
    """Throw the ball while parts are recorded, in large strides: the same breaks are counted."""
    told = run(Run(0, STRUCK, ROOT, 1.0))
    measured, series = record(Run(0, STRUCK, ROOT, 1.0, ('wall',), 25))
    assert measured | {'wall_time_s': 0} == told | {'wall_time_s': 0} and len(series.times) == 2
    with pytest.raises(CommandError, match='no part "wal"; did you mean wall'):
        run(Run(0, STRUCK, ROOT, 1.0, ('wal',)))


def test_nothing_that_happens_is_a_row_of_zeros():
    """Leave a tree in peace: no bond breaks, and there are no times of breaks."""
    told = run(Run(0, CALM, ROOT, 0.1))
    assert told['parts'] == 4 and told['bonds_broken'] == told['parts_fallen'] == 0
    assert math.isnan(told['first_break_s']) and math.isnan(told['last_break_s'])


def test_another_grammar_makes_another_sweep(scene, tmp_path):
    """Change the text of a grammar that is named or varied: its rows are others."""
    for name in ('a.lsys', 'b.lsys'):
        (tmp_path / name).write_text((ROOT / 'grammars' / 'palm.lsys').read_text('utf-8'), 'utf-8')
    read = CALM | {'post': {'grammar': 'a.lsys'}}
    scene.write_text(json.dumps({'/**': {'ros__parameters': read}}), 'utf-8')
    told = []
    for changed in (None, 'a.lsys', 'b.lsys'):
        if changed:
            with (tmp_path / changed).open('a', encoding='utf-8') as file:
                file.write('# another')
        told.append([Sweep.read(scene, vary, 1, 1.0).digest
                     for vary in ([], ['post.grammar=a.lsys,b.lsys'])])
    assert told[0][0] != told[1][0] == told[2][0]
    assert len({varied for _, varied in told}) == 3


@pytest.mark.parametrize(('name', 'texts'), [
    ('terrain.file', ['ncols 2\nnrows 2\ncellsize 9\n0 1\n1 {}\n', 'a.asc']),
    ('wind.file', ['time,speed,direction\n0,5,270\n9,{},270\n', 'a.csv']),
    ('wind.map', ['x,y,speed\n0,0,{}\n', 'a.csv'])])
def test_other_data_make_another_sweep(scene, tmp_path, name, texts):
    """Change the file that the ground or the wind comes from, named by the scene or varied."""
    text, file = texts
    group, _, key = name.partition('.')
    named = tmp_path / 'named.yaml'
    named.write_text(json.dumps({'/**': {'ros__parameters': CALM | {group: {key: file}}}}))
    found = []
    for number in (3, 4, 3):
        (tmp_path / file).write_text(text.format(number))
        found.append((Sweep.read(named, [], 1, 1.0).digest,
                      Sweep.read(scene, [f'{name}={file}'], 1, 1.0).digest))
    assert found[0] == found[2] and not {*found[0]} & {*found[1]}
    (tmp_path / file).unlink()
    with pytest.raises(SceneError, match=f'{name}: there is no file "{file}"'):
        _ = Sweep.read(scene, [f'{name}={file}'], 1, 1.0).digest


def test_another_include_makes_another_sweep(scene, tmp_path):
    """Change what a grammar includes, and what that includes."""
    (tmp_path / 'a.lsys').write_text('include: b.lsys\naxiom: F(0.5)\n')
    (tmp_path / 'b.lsys').write_text('include: c.lsys\n')
    read = CALM | {'post': {'grammar': 'a.lsys'}}
    scene.write_text(json.dumps({'/**': {'ros__parameters': read}}), 'utf-8')
    found = []
    for length in (1, 2, 1):
        (tmp_path / 'c.lsys').write_text(f'include: a.lsys\ndefine: r = {length}\n')
        found.append(Sweep.read(scene, [], 1, 1.0).digest)
    assert found[0] == found[2] != found[1]


def test_a_table_goes_on_where_it_was_cut(tmp_path):
    """Cut the last row in half: it is done again; rows of another sweep are not taken over."""
    path = tmp_path / 'table.csv'
    told = run(Run(0, CALM, ROOT, 0.02))
    table = Table(path, ('wind.velocity', 'seed'), 'abc')
    for number in range(3):
        table.add(number, ([1.0, 0.0, 0.0], number), told)
    table.close(True)
    whole = path.read_bytes()
    path.write_bytes(whole[:-9])
    table = Table(path, ('wind.velocity', 'seed'), 'abc')
    assert table.done == {0, 1}
    table.add(2, ([1.0, 0.0, 0.0], 2), told)
    table.close(True)
    assert path.read_bytes() == whole and rows(path)[2]['wind.velocity'] == '[1.0, 0.0, 0.0]'
    for columns, digest in ((('wind.velocity', 'seed'), 'other'), (('seed',), 'abc')):
        with pytest.raises(SceneError, match='another sweep'):
            Table(path, columns, digest)
    with pytest.raises(SceneError, match='.csv or .parquet'):
        Table(tmp_path / 'table.xlsx', ('seed',), 'abc')


def test_a_row_may_be_cut_within_a_character(tmp_path):
    """Cut the last row of two at each of its bytes: the first stays, and is not another sweep."""
    told = run(Run(0, CALM, ROOT, 0.02))
    path = tmp_path / 'table.csv'
    ends = []
    for number in range(2):
        table = Table(path, ('post.grammar_text',), 'abc')
        table.add(number, ('name: \u00e9\U0001f333',), told)
        table.close(False)
        ends.append(len(path.read_bytes()))
    whole = path.read_bytes()
    for end in range(ends[0], ends[1]):
        path.write_bytes(whole[:end])
        table = Table(path, ('post.grammar_text',), 'abc')
        table.close(False)
        assert table.done == {0} and path.read_bytes() == whole[:ends[0]]


def test_texts_of_several_lines_are_cut_and_read_whole(tmp_path):
    """Cut half a row within a text with line ends, and make Parquet of more than one block."""
    told = run(Run(0, CALM, ROOT, 0.02))
    text = 'axiom: F(1)  # "one"\r\n' + 'so it goes on\n' * 5000
    path = tmp_path / 'table.csv'
    table = Table(path, ('post.grammar_text',), 'abc')
    table.add(0, (text,), told)
    table.close(False)
    whole = path.read_bytes()
    path.write_bytes(whole + whole[:2000].partition(b'\n')[2])
    table = Table(path, ('post.grammar_text',), 'abc')
    assert table.done == {0} and path.read_bytes() == whole
    table.close(True)

    parquet = pytest.importorskip('pyarrow.parquet')
    table = Table(tmp_path / 'table.parquet', ('post.grammar_text',), 'abc')
    for number in range(30):
        table.add(29 - number, (text,), told)
    table.close(True)
    assert parquet.read_table(tmp_path / 'table.parquet')['run'].to_pylist() == list(range(30))


def test_a_full_disk_costs_the_last_row(tmp_path):
    """Name the file, end without another error, and do only the row again that had no room."""
    path = tmp_path / 'table.csv'
    told = run(Run(0, CALM, ROOT, 0.02))
    table = Table(path, ('seed',), 'abc')
    table.add(0, (0,), told)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 9, limits[1]))
    try:
        with pytest.raises(SceneError, match='table.csv: File too large'):
            table.add(1, (1,), told)
        table.close(False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    table = Table(path, ('seed',), 'abc')
    assert table.done == {0}
    table.add(1, (1,), told)
    table.close(True)
    assert [row['seed'] for row in rows(path)] == ['0', '1']


def test_types_of_a_parquet_file_do_not_depend_on_what_happened(tmp_path, monkeypatch):
    """Write times as numbers, NaN when nothing broke, and digests as texts; name a full disk."""
    parquet = pytest.importorskip('pyarrow.parquet')
    path = tmp_path / 'table.parquet'
    table = Table(path, ('seed',), '012345678901')
    table.add(0, (0,), run(Run(0, CALM, ROOT, 0.02)))
    with monkeypatch.context() as patched:
        patched.setattr(parquet, 'write_table', full_disk)
        with pytest.raises(SceneError, match='table.parquet: No space left'):
            table.close(True)
    assert [file.name for file in tmp_path.iterdir()] == ['table.parquet.rows.csv']
    Table(path, ('seed',), '012345678901').close(True)
    columns = parquet.read_table(path)
    assert columns.schema.field('first_break_s').type == 'double'
    assert math.isnan(columns['last_break_s'][0].as_py())
    assert Table(path, ('seed',), '012345678901').done == {0}


def full_disk(*arguments):
    """Fail as every function does that writes on a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_two_batches_do_not_write_one_table(tmp_path):
    """Refuse a table that another batch is writing, until that has ended."""
    path = tmp_path / 'table.csv'
    table = Table(path, ('seed',), 'abc')
    with pytest.raises(SceneError, match='another batch is writing it'):
        Table(path, ('seed',), 'abc')
    table.close(False)
    Table(path, ('seed',), 'abc').close(False)


def test_a_killed_batch_goes_on(scene, tmp_path, capsys):
    """Kill it after its first rows; said again, it does the others, with the same results."""
    path = tmp_path / 'table.parquet'
    parquet = pytest.importorskip('pyarrow.parquet')
    words = [str(scene), '--vary', 'wind.velocity=[[0, 0, 0], [9, 0, 0]]', '--seeds', '3',
             '--duration', '2', '--out', str(path), '--jobs', '1']
    process = subprocess.Popen([sys.executable, '-m', 'procphys_ros', 'batch', *words],
                               cwd=ROOT, stdout=subprocess.DEVNULL)
    early = tmp_path / 'table.parquet.rows.csv'
    while process.poll() is None and not (early.exists() and len(rows(early)) > 1):
        try:
            process.wait(0.02)
        except subprocess.TimeoutExpired:
            pass
    process.send_signal(signal.SIGKILL)
    process.wait()
    finished = rows(early)
    assert 1 < len(finished) < 6 and not path.exists()
    assert main(words) == 0
    assert '6 of 6 runs' in capsys.readouterr().out and not early.exists()
    table = parquet.read_table(path).to_pylist()
    assert [row['run'] for row in table] == list(range(6))
    assert [row['seed'] for row in table] == 2 * [0, 1, 2]
    assert table[5]['wind.velocity'] == '[9.0, 0.0, 0.0]' and table[5]['parts'] == 4
    assert [float(row['wall_time_s']) for row in finished] == [
        row['wall_time_s'] for row in table if str(row['run']) in {r['run'] for r in finished}]
    assert main(words) == 0  # nothing is left to be done
    assert parquet.read_table(path).num_rows == 6


def test_a_dask_cluster_gives_the_same_rows(scene, tmp_path, monkeypatch):
    """Ask a local cluster for a row, then kill its worker: that run fails, nothing is raised."""
    dask = pytest.importorskip('dask')
    pytest.importorskip('distributed')

    def attempt_or_die(what):
        if what.number == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return attempt(what)
    monkeypatch.setattr(workers, 'attempt', attempt_or_die)
    said = StringIO()
    monkeypatch.setattr(logging.getLogger('distributed'), 'handlers',
                        [logging.StreamHandler(said)])
    path = tmp_path / 'table.csv'
    with (dask.config.set({'distributed.scheduler.allowed-failures': 0}),
          workers.dask_cluster('', 1) as work):
        monkeypatch.setattr(command, 'dask_cluster', lambda address, _: nullcontext(work))
        assert main([str(scene), '--duration', '0.1', '--out', str(path), '--dask']) == 0
        (number, measures, reason, _), = work([Run(1, CALM, ROOT, 0.1)])
        logging.getLogger('distributed.nanny').warning('it takes long to end a worker')
    assert number == 1 and measures is None and 'KilledWorker' in reason
    assert 'it takes long' not in said.getvalue()
    row, = rows(path)
    told = run(Run(0, CALM, ROOT, 0.1)) | {'wall_time_s': float(row['wall_time_s'])}
    np.testing.assert_equal({name: float(row[name]) for name in told}, told)


def test_runs_that_fail_are_told_and_done_again(scene, tmp_path, capsys, monkeypatch):
    """Vary a define that there is not: the other rows are written, and the exit code is 1."""
    @contextmanager
    def here(count):
        yield lambda runs: map(attempt, runs)
    monkeypatch.setattr(command, 'processes', here)
    path = tmp_path / 'table.csv'
    words = [str(scene), '--vary', 'post.defines=[[], ["nothing=1"]]', '--duration', '0.1',
             '--out', str(path), '--jobs', '1']
    assert main(words) == 1
    said = capsys.readouterr()
    assert 'nothing' in said.err and '1 of 2 runs; say it again' in said.out
    assert "run 1: post.defines=['nothing=1'], seed=0" in said.err and 'run 0' not in said.err
    assert len(rows(path)) == 1


def test_many_runs_that_fail_are_told_in_few_lines(capsys):
    """Name the first of those that failed for the same reason, and count the others."""
    command._tell_failure('no room', [f'run {i}: seed={i}' for i in range(500)])
    said = capsys.readouterr().err.splitlines()
    assert said[0] == 'batch: no room (500 runs)' and said[1] == '  run 0: seed=0'
    assert len(said) < 30 and said[-1].endswith('480 more')


@pytest.mark.parametrize(('kills', 'count', 'processes'), [(1, 4, 1), (2, 3, 2)])
def test_a_killed_process_costs_one_run_at_most(scene, tmp_path, monkeypatch, kills, count,
                                                processes):
    """Kill the process of a run, once and twice: it is done again, or fails, and no other."""
    # Once while others wait, twice while another is under way; to start a process takes longest.
    monkeypatch.setattr(workers, 'attempt', partial(attempt_or_die, tmp_path, kills))
    runs = [what for _, what in Sweep.read(scene, [], count, 0.1).runs()]
    with workers.processes(processes) as work:
        outcomes = {number: (measures, reason) for number, measures, reason, _ in work(runs)}
    assert sorted(outcomes) == list(range(count))
    failed = [number for number, (measures, _) in outcomes.items() if measures is None]
    assert failed == ([1] if kills == 2 else [])
    assert all('killed' in outcomes[number][1] for number in failed)


def attempt_or_die(folder, kills, what):
    """Carry a run out; in the second one of a batch be killed at first."""
    if what.number == 1 and len(list(folder.glob('killed_*'))) < kills:
        (folder / f'killed_{os.getpid()}').touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return attempt(what)


@pytest.mark.parametrize('content', [
    b'a note', b'\xff\xfe\n', b'a,b\n1,2\n3', b'run,seed\n4', 140_000 * b'a' + b'\n'],
    ids=lambda content: content[:9])
def test_files_of_others_are_left_as_they_are(scene, tmp_path, content, capsys):
    """Refuse to go on in a file that no sweep has begun, and take nothing off its end."""
    path = tmp_path / 'notes.csv'
    path.write_bytes(content)
    assert main([str(scene), '--out', str(path), '--duration', '0.1', '--jobs', '1']) == 1
    assert 'holds another sweep' in capsys.readouterr().err
    assert path.read_bytes() == content


@pytest.mark.parametrize('text, reason', [
    ('seed: x', "seed is 'x'"), ('scene: hello', 'scene.objects'),
    ('wind: hello', 'wind'), ('scene: {objects: [post]}\n  post: shrub.lsys', 'post')])
def test_scenes_are_checked_before_anything_runs(tmp_path, text, reason):
    """Name the file and the key."""
    path = tmp_path / 'scene.yaml'
    path.write_text('/**:\n ros__parameters:\n  ' + text, 'utf-8')
    with pytest.raises(SceneError, match=rf'scene.yaml: .*{reason}'):
        Sweep.read(path, [], 1, 1.0)


@pytest.mark.parametrize('words', [
    ['no_such.yaml', '--out', 'a.csv'], ['{scene}', '--out', 'a.txt'],
    ['{scene}', '--out', '/no folder/a.csv'], ['{scene}', '--out', 'a.csv', '--vary', 'x=1']])
def test_mistakes_end_with_one_line(scene, tmp_path, monkeypatch, capsys, words):
    """Exit with code 1 and say what is wrong."""
    monkeypatch.chdir(tmp_path)
    assert main([word.format(scene=scene) for word in words]) == 1
    assert capsys.readouterr().err.count('\n') == 1
    assert os.listdir(tmp_path) == ['calm.yaml']


UPRIGHT = (0.0, 0.0, 0.0, 1.0)
BRICK = (2.0, 4.0, 6.0)
STICK = (0.4, 0.4, 3.0)  # radius 0.2, axis from -1.3 to 1.3


def _one(position=(0.0, 0.0, 0.0), attitude=UPRIGHT):
    return np.array([[*position, *attitude]])


def _random_scene(seed, count=40):
    """Scatter targets and ways through them."""
    rng = np.random.default_rng(seed)
    attitudes = rng.normal(size=(count, 4))
    attitudes /= np.linalg.norm(attitudes, axis=1, keepdims=True)
    poses = np.hstack([rng.uniform(-4, 4, (count, 3)), attitudes])
    sizes = rng.uniform(0.2, 2.0, (count, 3))
    ways = [(rng.uniform(-9, 9, 3), rng.uniform(-9, 9, 3)) for _ in range(12)]
    return poses, sizes, ways


def _distance_to_boxes(points, poses, sizes):
    """Return (points, boxes) distances by definition."""
    offset = points[:, None, :] - poses[None, :, :3]
    local = rotation.rotate(rotation.conjugate(poses[:, 3:])[None], offset)
    return np.linalg.norm(np.maximum(np.abs(local) - 0.5 * sizes, 0.0), axis=2)


def _distance_to_capsules(points, poses, sizes):
    """Return (points, capsules) distances by definition."""
    axes = rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    offset = points[:, None, :] - poses[None, :, :3]
    half = 0.5 * (sizes[:, 2] - sizes[:, 0])
    foot = np.clip(np.einsum('pni,ni->pn', offset, axes), -half, half)
    return np.linalg.norm(offset - foot[..., None] * axes, axis=2) - 0.5 * sizes[:, 0]


@pytest.mark.parametrize(('start', 'end', 'fraction', 'point', 'normal'), [
    # A face: 10 m of way, contact 1 + 0.5 m before the centre.
    ((-5.0, 1.0, 2.0), (5.0, 1.0, 2.0), 0.35, (-1.0, 1.0, 2.0), (-1.0, 0.0, 0.0)),
    # An edge, passed 0.3 m outside of it: contact 0.4 m before it.
    ((-5.0, 2.3, 0.0), (5.0, 2.3, 0.0), 0.36, (-1.0, 2.0, 0.0), (-0.8, 0.6, 0.0)),
    # A corner, along the diagonal.
    ((-4.0, -5.0, -6.0), (0.0, -1.0, -2.0), (3.0 - 0.5 / np.sqrt(3.0)) / 4.0, (-1.0, -2.0, -3.0),
     (-np.sqrt(1 / 3),) * 3),
    # From within.
    ((0.5, 0.0, 0.0), (5.0, 0.0, 0.0), 0.0, (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
])
def test_sphere_meets_a_box(start, end, fraction, point, normal):
    """Compare face, edge, corner and inside with geometry, and once more turned and moved."""
    for frame in ((0.0, 0.0, 0.0, *UPRIGHT), (7.0, -3.0, 2.0, 0.5, -0.1, 0.7, 0.5)):
        pose = np.array(frame)
        pose[3:] /= np.linalg.norm(pose[3:])
        moved = [pose[:3] + rotation.rotate(pose[3:], p) for p in (start, end, point)]
        hits = sweep_boxes(moved[0], moved[1], 0.5, pose[None], np.array([BRICK]))
        assert_allclose(hits.fraction, [fraction], atol=1e-9)
        assert_allclose(hits.point, [moved[2]], atol=1e-9)
        assert_allclose(hits.normal, [rotation.rotate(pose[3:], normal)], atol=1e-9)


def test_row_of_boxes_is_met_in_order():
    """Fly through a row of boxes and list them all, one left out as inactive."""
    poses = np.repeat(_one(), 6, axis=0)
    poses[:, 0] = [12.0, 2.0, 8.0, 4.0, 30.0, 6.0]
    active = np.array([True, True, False, True, True, True])
    hits = sweep_boxes((0.0, 0.0, 0.0), (20.0, 0.0, 0.0), 0.25, poses, np.ones((6, 3)), active)
    np.testing.assert_array_equal(hits.index, [1, 3, 5, 0])
    assert_allclose(hits.fraction * 20.0, [1.25, 3.25, 5.25, 11.25])


@pytest.mark.parametrize(('start', 'end', 'fraction', 'normal'), [
    ((-5.0, 0.0, 1.0), (5.0, 0.0, 1.0), 0.43, (-1.0, 0.0, 0.0)),                # the shaft
    ((-5.0, 0.42, 1.0), (5.0, 0.42, 1.0), 0.444, (-0.8, 0.6, 0.0)),             # its flank
    ((0.0, 0.0, 5.0), (0.0, 0.0, -5.0), 0.3, (0.0, 0.0, 1.0)),                  # the end
    ((-5.0, 0.0, 1.72), (5.0, 0.0, 1.72), 0.444, (-0.8, 0.0, 0.6)),             # its round
])
def test_sphere_meets_a_capsule(start, end, fraction, normal):
    """Compare shaft, flank and ends with geometry; both radii make 0.7 m."""
    hits = sweep_capsules(start, end, 0.5, _one(), np.array([STICK]))
    assert_allclose(hits.fraction, [fraction], atol=1e-9)
    assert_allclose(hits.normal, [normal], atol=1e-9)
    centre = np.array(start) + fraction * (np.array(end) - start)
    assert_allclose(hits.point, [centre - 0.5 * np.array(normal)], atol=1e-9)


def test_sphere_agrees_with_small_steps(seed=0):
    """Compare fractions and sets with distances sampled along many random ways."""
    poses, sizes, ways = _random_scene(seed)
    sticks = np.column_stack([sizes[:, 0], sizes[:, 0], sizes[:, 0] + sizes[:, 2]])
    t = np.linspace(0.0, 1.0, 4001)
    for start, end in ways:
        path = start + t[:, None] * (end - start)
        for sweep, shapes, distances in (
                (sweep_boxes, sizes, _distance_to_boxes),
                (sweep_capsules, sticks, _distance_to_capsules)):
            touching = distances(path, poses, shapes) <= 0.3
            hits = sweep(start, end, 0.3, poses, shapes)
            wanted = np.flatnonzero(touching.any(axis=0))
            np.testing.assert_array_equal(np.sort(hits.index), wanted)
            first = t[np.argmax(touching[:, hits.index], axis=0)]
            assert_allclose(hits.fraction, first, atol=2.6e-4)
            assert (np.diff(hits.fraction) >= 0.0).all()


def test_box_meets_a_box_face_to_face():
    """Compare with the gap between the faces, whichever side it comes from."""
    for axis in range(3):
        for side in (-1.0, 1.0):
            start = np.zeros(3)
            start[axis] = 10.0 * side
            hits = sweep_box_boxes(start, -start, UPRIGHT, (1.0, 1.0, 1.0), _one(),
                                   np.array([BRICK]))
            gap = 10.0 - 0.5 - 0.5 * BRICK[axis]
            assert_allclose(hits.fraction, [gap / 20.0])
            assert_allclose(hits.normal, [side * np.eye(3)[axis]], atol=1e-12)


def test_box_meets_a_box_edge_to_edge():
    """Turn two cubes by 45 degrees about crossed axes: their edges meet."""
    about_y = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.pi / 4)
    about_z = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.pi / 4)
    hits = sweep_box_boxes((-10.0, 0.0, 0.0), (10.0, 0.0, 0.0), about_z, (1.0, 1.0, 1.0),
                           _one(attitude=about_y), np.ones((1, 3)))
    assert_allclose(hits.fraction, [(10.0 - np.sqrt(2.0)) / 20.0])
    assert_allclose(hits.normal, [[-1.0, 0.0, 0.0]], atol=1e-12)
    assert_allclose(hits.point, [[-np.sqrt(0.5), 0.0, 0.0]], atol=1e-12)


def test_overlapping_boxes_part_on_the_shortest_way():
    """Start inside: touch at once, with the normal of the least overlap."""
    hits = sweep_box_boxes((0.9, 0.0, 0.0), (3.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), _one(),
                           np.array([BRICK]))
    assert_allclose(hits.fraction, [0.0])
    assert_allclose(hits.normal, [[1.0, 0.0, 0.0]], atol=1e-12)


def test_box_agrees_with_small_steps(seed=3):
    """Compare with distances of the points of a fine lattice in the moving box."""
    poses, sizes, ways = _random_scene(seed, count=15)
    sticks = np.column_stack([sizes[:, 0], sizes[:, 0], sizes[:, 0] + sizes[:, 2]])
    attitude = poses[0, 3:]
    extent = np.array([0.8, 0.5, 1.1])
    steps = [np.linspace(-0.5, 0.5, 9) * edge for edge in extent]
    lattice = np.stack(np.meshgrid(*steps, indexing='ij'), axis=-1).reshape(-1, 3)
    lattice = rotation.rotate(attitude, lattice)
    for start, end in ways[:5]:
        for sweep, shapes, distances in (
                (sweep_box_boxes, sizes, _distance_to_boxes),
                (sweep_box_capsules, sticks, _distance_to_capsules)):
            hits = sweep(start, end, attitude, extent, poses, shapes)
            for row, fraction in zip(hits.index, hits.fraction):
                one = poses[row:row + 1], shapes[row:row + 1]
                length = np.linalg.norm(end - start)
                for t, least, most in ((fraction, -1.0, 0.13), (fraction - 0.2 / length, 1e-9, 9)):
                    if t > 0.0:
                        near = distances(start + t * (end - start) + lattice, *one).min()
                        assert least < near < most
            missed = np.setdiff1d(np.arange(len(poses)), hits.index)
            for t in np.linspace(0.0, 1.0, 60):
                centre = start + t * (end - start)
                assert (distances(centre + lattice, poses[missed], shapes[missed]) > 0).all()


def test_box_meets_a_capsule():
    """Compare shaft, end and corner-on with geometry."""
    sizes = np.array([STICK])
    hits = sweep_box_capsules((-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), UPRIGHT, (1.0, 1.0, 1.0), _one(),
                              sizes)
    assert_allclose(hits.fraction, [0.43], atol=1e-8)
    assert_allclose(hits.normal, [[-1.0, 0.0, 0.0]], atol=1e-6)
    hits = sweep_box_capsules((0.0, 0.0, 5.0), (0.0, 0.0, -5.0), UPRIGHT, (1.0, 1.0, 1.0), _one(),
                              sizes)
    assert_allclose(hits.fraction, [0.3], atol=1e-8)
    turned = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.pi / 4)
    hits = sweep_box_capsules((-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), turned, (1.0, 1.0, 1.0), _one(),
                              sizes)
    assert_allclose(hits.fraction, [(5.0 - 0.2 - np.sqrt(0.5)) / 10.0], atol=1e-8)
    assert not len(sweep_box_capsules((-5.0, 0.71, 0.0), (5.0, 0.71, 0.0), UPRIGHT,
                                      (1.0, 1.0, 1.0), _one(), sizes))
