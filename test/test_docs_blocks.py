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

"""Every block of code in the docs runs, also the step by stages and an engine of one's own."""

from importlib import import_module
from pathlib import Path
import re
import shlex
import sys
from types import ModuleType

from node_process import ROOT
import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.command_line import words as command_words
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.world import engine, World
from procphys_ros.physics.world.bullet import BulletEngine
from procphys_ros.scene import Scene
from procphys_ros.scene.map_rules import read_rules
from procphys_ros.scene.parameter_table import GLOBAL
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.stages import STAGES
from procphys_ros.terminal.program import COMMANDS
from procphys_ros.wallgrammar import WallGrammar

PAGES = {str(path.relative_to(ROOT)): path.read_text('utf-8')
         for path in (ROOT / 'README.md', *sorted(ROOT.glob('docs/**/*.md')))}
EXECUTED = [page for page, text in PAGES.items() if '```python\n' in text
            and page not in ('README.md', 'docs/library.md')]  # tests of the README run these
SCRIPTS = {**dict(re.findall(r"'(\w+) = ([\w.]+):main'", (ROOT / 'setup.py').read_text('utf-8'))),
           **COMMANDS}
TESTS = {path.stem for path in ROOT.glob('test/test_*.py')}.union(*(
    re.findall(r'^def (test_\w+)', path.read_text('utf-8'), re.MULTILINE)
    for path in ROOT.glob('test/test_*.py')))
_SCENE_OF_A_PLAN = """
/**:
  ros__parameters: {scene: {objects: [street]}, street: {grammar: some.plan}}
"""
HOMES = ('docs/tutorials/own_house.md',)  # what later tutorials take up


def blocks(page: str, kind: str) -> list[str]:
    """Return the code blocks of one kind in a page; '' = grammars, tables and output."""
    return [body for found, body in re.findall(r'^```(\w*)\n(.*?)^```', PAGES[page],
                                               re.DOTALL | re.MULTILINE) if found == kind]


def grammars(page: str) -> dict[str, str]:
    """Return the grammars of a page by the names of their files."""
    named = {}
    for body in blocks(page, ''):
        if found := re.search(r'^building (\w+)', body, re.MULTILINE):
            named[f'{found[1]}.wall'] = body
        elif found := re.search(r'^name: (\w+)', body):
            named[f'{found[1]}.lsys'] = body
    return named


def scenes(page: str) -> dict[str, str]:
    """Return the whole scene files of a page by the names in the page."""
    whole = [body for body in blocks(page, 'yaml')
             if 'ros__parameters' in body and 'objects:' in body]
    names = re.findall(r'[Ss]ave this as `(\w+\.yaml)`', PAGES[page])
    assert len(names) == len(whole), page
    return dict(zip(names, whole))


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """Work where the shipped files, and those of the tutorials, are."""
    for name in ('grammars', 'config'):
        (tmp_path / name).symlink_to(ROOT / name)
    for page in HOMES:
        for name, text in grammars(page).items():
            (tmp_path / name).write_text(text, 'utf-8')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize('page', [page for page in PAGES if grammars(page)])
def test_grammars_grow(page):
    """Build what every grammar on a page writes."""
    for name, text in grammars(page).items():
        language = LSystem if name.endswith('.lsys') else WallGrammar
        assert len(language.parse(text, name).build()) > 5


@pytest.mark.parametrize('page, number', [(page, number) for page in PAGES
                                          for number in range(len(blocks(page, 'yaml')))])
def test_yaml_loads_as_it_stands(page, number, desk, caplog):
    """Load every block as a file: a plan, or parameters of which none is unknown or unused."""
    for name, text in grammars(page).items():
        (desk / name).write_text(text, 'utf-8')
    (desk / 'hills.asc').write_text('ncols 2\nnrows 2\ncellsize 90\n0 9\n4 2\n', 'utf-8')
    (desk / 'my_oak.csv').write_text('x1 y1 z1 x2 y2 z2 radius\n0 0 0 0 0 2 0.03\n', 'utf-8')
    body = blocks(page, 'yaml')[number]
    if body.startswith('streets:'):
        (desk / 'some.plan').write_text(body, 'utf-8')
        body = _SCENE_OF_A_PLAN
    if body.startswith('# saved as my.rules'):
        (desk / 'my.rules').write_text(body, 'utf-8')
        assert read_rules(desk / 'my.rules').of('road', {'highway': 'path'}) is not None
        return
    (desk / 'some.yaml').write_text(body, 'utf-8')
    scene = Scene.from_yaml(desk / 'some.yaml')
    empty = ['scene.objects is empty: nothing stands in the scene']
    assert caplog.messages == ([] if len(scene.blueprint) else empty)
    assert len(scene.blueprint) > 0 or 'grammar' not in body


@pytest.mark.parametrize('page', EXECUTED)
def test_python_runs(page, desk):
    """Execute all Python of a page in one go, beside the files that the page has."""
    for name, text in {**grammars(page), **scenes(page)}.items():
        (desk / name).write_text(text, 'utf-8')
    names = {}
    if ' = Simulation(' not in ''.join(blocks(page, 'python')):
        scene = Scene.from_parameters({'scene': {'objects': ['shrub']},
                                       'shrub': {'grammar': 'shrub.lsys'}})
        names.update(scene=scene, simulation=Simulation(scene))
    for body in blocks(page, 'python'):
        exec(compile(body, page, 'exec'), names)


def commands(page: str) -> list[list[str]]:
    """Split the shell of a page into commands, comments left out."""
    found = []
    for body in blocks(page, 'sh'):
        for line in body.replace('\\\n', ' ').splitlines():
            try:
                words = shlex.split(line, comments=True)
            except ValueError:
                continue  # a program of another language, over several lines
            while words:
                end = next((i for i, word in enumerate(words) if word in ('&&', ';')), len(words))
                found.append(words[:end])
                words = words[end + 1:]
    return [words for words in found if words]


def called(words: list[str]) -> tuple[str, list[str]]:
    """Return the executable of ours that a command calls, and its words; '' = of others."""
    if words[:3] == ['ros2', 'run', 'procphys_ros']:
        return words[3], words[4:]
    name = Path(words[0]).name
    return (name, words[1:]) if name in SCRIPTS and words[0] != 'export' else ('', words)


@pytest.mark.parametrize('page', [page for page in PAGES if blocks(page, 'sh')])
def test_commands_exist(page, capsys):
    """Know every executable, its options, every make target, and shipped file in shell blocks."""
    targets = re.findall(r'^([\w ]+):', (ROOT / 'Makefile').read_text('utf-8'), re.MULTILINE)
    for words in commands(page):
        name, arguments = called(words)
        if name:
            check_options(name, arguments, capsys)
        elif words[0] == 'make':
            assert words[1] in targets
        for word in words:
            if re.match(r'(config|bench|grammars)/\S+$', word):
                assert (ROOT / word).exists(), word


def check_options(name: str, arguments: list[str], capsys) -> None:
    """Read the words of one of our executables as it would, or find its options in its help."""
    assert name in SCRIPTS, name
    if name == 'command':
        command_words.read(arguments)
        return
    if name in ('sim', 'managed_sim'):
        known = {parameter.name for parameter in GLOBAL}
        assert arguments[0] == '--ros-args'
        assert {word.partition(':=')[0] for flag, word in zip(arguments, arguments[1:])
                if flag == '-p'} <= known
        return
    with pytest.raises(SystemExit) as ended:
        import_module(SCRIPTS[name]).main(['--help'])
    told = capsys.readouterr().out
    assert ended.value.code == 0
    for word in arguments:
        if word.startswith('--') and word != '--ros-args':
            assert re.search(rf'{re.escape(word)}\b', told), f'{name} has no {word}'


def test_files_and_tests_that_are_named_exist():
    """Find every test, module and shipped file that stands in backquotes."""
    inside = {path.name for path in (ROOT / 'procphys_ros').iterdir() if path.is_dir()}
    outside = {'procphys_ros', 'test', 'bench', 'config', 'grammars', 'docs', 'scripts'}
    tokens = [(page, token) for page, text in PAGES.items() for token in re.findall(
        r'`([^`\s]+)`', re.sub(r'^```.*?^```', '', text, flags=re.DOTALL | re.MULTILINE))]
    for page, token in tokens:
        for name in re.findall(r'\btest_\w*[a-z]\b', token):
            assert name in TESTS, (page, name)
        folder = token.partition('/')[0]
        if '/' in token and folder in inside | outside:
            place = re.sub(r'[<{].*', '', token).rstrip('/')  # a choice of files begins alike
            base = ROOT if folder in outside else ROOT / 'procphys_ros'
            assert [*base.glob(f'{place}*')], (page, token)


PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'step.md'


def test_the_table_lists_all_stages_in_order():
    """Read the first column of the table."""
    rows = re.findall(r'^\| ([a-z ]+) \|', PAGE.read_text('utf-8'), re.MULTILINE)
    assert rows == ['stage', *(stage.name for stage in STAGES)]


def test_an_engine_is_a_class_in_a_module_and_a_row_of_the_table(monkeypatch):
    """Add an engine that counts its steps, and let a body fall with it."""
    class CountingEngine(BulletEngine):
        steps = 0

        def step(self, *arguments) -> None:
            CountingEngine.steps += 1
            super().step(*arguments)

    module = ModuleType('procphys_ros.physics.world.counting')
    module.CountingEngine = CountingEngine
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(engine.ENGINES, 'counting', 'pybullet')
    assert 'counting' in engine.installed_engines()
    with World(engine='counting') as world:
        body = world.add_body(Shape.BOX, [0.2, 0.1, 0.1], 4.0, np.array([0, 0, 30, 0, 0, 0, 1.0]))
        for _ in range(30):
            world.step(1.0 / 60.0)
        fallen = 30.0 - world.poses([body])[0, 2]
    assert CountingEngine.steps >= 30
    assert fallen == pytest.approx(0.5 * 9.81 * 0.5 ** 2, rel=0.002)
