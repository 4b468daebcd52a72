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

"""The house in order: layers import downwards only, files stay small, nothing is left out."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
import pkgutil
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from procphys_ros import __version__
from procphys_ros.compilation import folder
from procphys_ros.files.resources import shared_folder
from procphys_ros.terminal.program import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'procphys_ros'
MODULES = sorted(PACKAGE.rglob('*.py'))
SOURCES = [*MODULES, *sorted((ROOT / 'test').glob('*.py')), *sorted((ROOT / 'bench').glob('*.py')),
           ROOT / 'setup.py']

# A module may import from its own layer's package and from layers with a smaller number.
LAYERS = {
    '': 0, 'errors': 0, 'progress': 0, 'files': 0, 'terminal': 0.5,
    'compilation': 1, 'schema': 1, 'warm': 1, '__main__': 1, 'physics.air': 1,
    'physics.gravity': 1,
    'elementary': 1.2, 'geometry': 1.4, 'blueprint': 2, 'physics.terrain': 2, 'physics.causes': 2,
    'physics.erosion': 2, 'physics.ground_motion': 2,
    'appearance': 3, 'language': 3, 'physics.fracture_energy': 3, 'physics.kinetic': 3,
    'physics.impact': 3, 'physics.skyline': 3, 'wallgrammar': 4,
    'physics': 4, 'physics.wind': 4, 'physics.trees': 4, 'physics.masonry': 4,
    'physics.loads': 4, 'physics.dust': 4, 'physics.foliage': 4, 'physics.touch': 4,
    'physics.rigid': 4, 'physics.lidar': 4, 'environment': 4.5, 'mechanism': 4.5, 'lsystem': 4.6,
    'scans': 4.6, 'maps': 4.6,
    'physics.world': 5, 'scene': 6, 'simulation': 7,
    'messages': 8, 'command_line': 8, 'render': 9, 'export': 10, 'recording': 10,
    'warming': 10.5, 'view': 10, 'ros': 11, 'batch': 12, 'examples': 13,
}
# Who may know a library that the rest of the house must not depend on.
ONLY_IN = {
    'numba': 'compilation', 'rclpy': 'ros',
    'moderngl': 'render', 'av': 'render', 'pxr': 'export', 'mcap': 'recording', 'viser': 'view',
    'shapely': 'maps', 'osmium': 'maps',
    'std_msgs': 'ros', 'std_srvs': 'ros', 'geometry_msgs': 'ros', 'sensor_msgs': 'ros',
    'visualization_msgs': 'ros', 'diagnostic_msgs': 'ros', 'rosgraph_msgs': 'ros',
    'rcl_interfaces': 'ros', 'builtin_interfaces': 'ros', 'simulation_interfaces': 'ros',
}


def layer_name(module: str) -> str:
    """Return the layer of a dotted module inside the package."""
    parts = module.split('.')
    depth = 2 if parts[0] == 'physics' else 1
    return '.'.join(parts[:depth])


def nodes(path: Path) -> Iterator[ast.AST]:
    """Yield all nodes of a file."""
    yield from ast.walk(ast.parse(path.read_text('utf-8')))


@cache
def named(path: Path) -> tuple[set[str], list[tuple[str, int]]]:
    """List what a file imports, wherever in it, and its classes with their lines."""
    imported, classes = set(), []
    for node in nodes(path):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f'{path} imports relatively'
            imported |= {f'{node.module}.{alias.name}' for alias in node.names}
        elif isinstance(node, ast.ClassDef):
            classes.append((node.name, node.lineno))
    return imported, classes


def imports(path: Path) -> set[str]:
    """List the dotted names that a file imports, wherever in it."""
    return named(path)[0]


def test_imports_go_downwards():
    """Import nothing from a higher layer, nor from a neighbour on the same floor."""
    for path in MODULES:
        own = layer_name('.'.join(path.relative_to(PACKAGE).with_suffix('').parts)
                         .removesuffix('.__init__').removesuffix('__init__'))
        for name in imports(path):
            top, _, inner = name.partition('.')
            if top == 'procphys_ros' and inner:
                other = layer_name(inner)
                if other not in LAYERS:
                    other = layer_name(inner.rpartition('.')[0])
                assert other == own or LAYERS[other] < max(LAYERS[own], 1), f'{path}: {name}'
            if top in ONLY_IN:
                assert own == ONLY_IN[top], f'{path}: {name}, only {ONLY_IN[top]} may'


def test_sources_are_all_that_is_imported():
    """Find by a search for names what Python's own parser finds, in every file of the package."""
    files = {module.name for module in pkgutil.walk_packages([str(PACKAGE)], 'procphys_ros.',
                                                             onerror=str)}
    assert len(files) > 400
    for name in files:
        found = imports(Path(folder._file(name)))
        found |= {member.rpartition('.')[0] for member in found}
        assert found & files <= folder.sources(name), name


def test_files_have_their_licence():
    """Begin with the Apache header."""
    for path in SOURCES:
        text = path.read_text('utf-8')
        assert text.startswith('# Copyright 2026 The procphys_ros authors\n'), path
        assert 'Licensed under the Apache License, Version 2.0' in text[:200], path


def test_docstrings_say_more_than_give():
    """Begin no docstring with a verb that names neither a computation nor what comes of it."""
    found = [path for path in SOURCES
             if re.search(r'^ *r?"""\s*Give ', path.read_text('utf-8'), re.MULTILINE)]
    assert not found


def test_no_two_classes_share_a_name():
    """Define each class name once in the package, nested classes too."""
    places: dict[str, list[str]] = {}
    for path in MODULES:
        for name, line in named(path)[1]:
            places.setdefault(name, []).append(f'{path.relative_to(ROOT)}:{line}')
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


@pytest.fixture(scope='module')
def loaded() -> set[str]:
    """Build a tree without ROS in a new process, and list what that has loaded."""
    code = ('import sys, procphys_ros.simulation, procphys_ros.messages; '
            'from procphys_ros.scene import Scene; Scene.from_parameters({"scene": {"objects": '
            '["pole"]}, "pole": {"grammar_text": "axiom: Width(0.1) F(1)"}}); print(*sys.modules)')
    return set(subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True,
                              capture_output=True, text=True).stdout.split())


def test_core_runs_without_ros(loaded):
    """Find no rclpy loaded below the ROS edge, nor, of a forest, the language of walls."""
    assert 'procphys_ros.lsystem' in loaded
    assert not {'rclpy', 'procphys_ros.wallgrammar'} & loaded


def test_version_is_the_same_everywhere():
    """Say one version in package.xml and in the code, and begin the changelog."""
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert manifest.findtext('version') == __version__
    assert manifest.findtext('name') == 'procphys_ros'
    assert manifest.findtext('license') == 'Apache-2.0'
    assert 'Forthcoming' in (ROOT / 'CHANGELOG.rst').read_text('utf-8')


def test_manifest_names_every_ros_package_that_is_imported():
    """Depend in package.xml on each message package that the node uses."""
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    declared = {d.text for d in manifest.findall('exec_depend')}
    used = {name.split('.')[0] for path in (PACKAGE / 'ros').glob('*.py')
            for name in imports(path)}
    assert used & ONLY_IN.keys() <= declared
    started = {name.split('.')[0] for path in (ROOT / 'launch').glob('*.py')
               for name in imports(path)}
    assert started - sys.stdlib_module_names <= declared


def test_apt_brings_all_that_the_package_needs():
    """Name in package.xml what pip installs on Ubuntu's Python 3.12, so that nothing needs pip."""
    setup = (ROOT / 'setup.py').read_text('utf-8')
    required = re.search(r'install_requires=\[(.*?)\]', setup, re.DOTALL)[1]
    keys = {'lark': 'python3-lark-parser', 'pyyaml': 'python3-yaml'}
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert {keys.get(name, f'python3-{name}')
            for name, version in re.findall(r"'([a-z0-9]+)([^']*)'", required)
            if name != 'setuptools' and 'python_version < "3.12"' not in version} == {
        depend.text for depend in manifest.findall('exec_depend')
        if depend.text.startswith('python3-')}
    for page in ('README.md', '.ci/colcon'):
        assert not re.search(r'\bpip3? install', (ROOT / page).read_text('utf-8')), page


def test_executables_call_modules_that_exist():
    """Start a module with a main from each script that `ros2 run` finds."""
    for script in sorted((ROOT / 'scripts').iterdir()):
        started, name = re.search(r'-m (procphys_ros[\w.]*) (\w*)',
                                  script.read_text('utf-8')).groups()
        module = COMMANDS[name] if name else started
        path = ROOT / Path(*module.split('.')).with_suffix('.py')
        assert '\ndef main(' in path.read_text('utf-8'), script
        assert script.stat().st_mode & 0o111, f'{script} is not executable'


def test_data_and_the_mark_of_type_hints_are_installed(tmp_path):
    """Build the package: every file that is no module is there, `py.typed` too."""
    subprocess.run([sys.executable, 'setup.py', '-q', 'build_py', '--build-lib', tmp_path],
                   cwd=ROOT, check=True)
    data = {path.relative_to(ROOT) for path in (ROOT / 'procphys_ros').rglob('*')
            if path.is_file() and path.suffix not in ('.py', '.pyc')}
    assert Path('procphys_ros/py.typed') in data
    assert {path for path in data if not (tmp_path / path).is_file()} == set()


def test_shared_files_are_found():
    """Find the grammars and the demo scene next to the code."""
    assert (shared_folder() / 'config' / 'demo.yaml').is_file()
    assert list((shared_folder() / 'grammars').glob('*.lsys'))


def last_names(node: ast.expr) -> tuple[str, ...]:
    """List the last two names of a dotted expression: `state.log.record` gives log, record."""
    inner = node.value if isinstance(node, ast.Attribute) else None
    return (getattr(inner, 'attr', getattr(inner, 'id', '')), getattr(node, 'attr', ''))


def test_one_module_breaks_things():
    """Let nobody but `breaking` cut bonds, record breaks, end bodies or change owners."""
    breaks = {('log', 'record'), ('solver', 'cut'), ('graph', 'cut'),
              ('forest', 'cut_anchors'), ('loose_bonds', 'take_over'), ('world', 'remove')}
    users: dict[tuple[str, ...], set[str]] = {}
    for path in (PACKAGE / 'simulation').glob('*.py'):
        for node in nodes(path):
            if isinstance(node, ast.Call) and last_names(node.func) in breaks:
                users.setdefault(last_names(node.func), set()).add(path.stem)
            for target in node.targets if isinstance(node, ast.Assign) else []:
                if isinstance(target, ast.Subscript) and last_names(target.value)[1] == 'owner':
                    users.setdefault(('owner', ''), set()).add(path.stem)
    owners = users.pop(('owner', ''))
    assert users == {name: {'breaking'} for name in breaks}
    assert owners == {'breaking', 'fragments'}  # the second makes bodies for the first


def test_engines_are_loaded_when_they_are_chosen(loaded):
    """Keep the libraries of engines in their modules, and load none before it is chosen."""
    users = [path.stem for path in MODULES
             if 'pybullet' in {name.split('.')[0] for name in imports(path)}
             or "find_spec('pybullet')" in path.read_text('utf-8')]
    assert users == ['bullet']
    assert 'procphys_ros.physics.world.bullet' not in loaded
