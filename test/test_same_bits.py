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

"""Nothing that changes the state of a simulation depends on what a processor can do."""

import ast
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'procphys_ros'
_SCENE = 'gust_and_ball'
# What writes scenes and what moves them.
STATE = sorted(path for pattern in ('geometry/*.py', 'blueprint/*.py', 'files/*.py',
                                    'appearance/pa*.py', 'appearance/torn_wood.py',
                                    'language/*.py', 'lsystem/*.py', 'wallgrammar/*.py',
                                    'scans/*.py', 'physics/**/*.py', 'scene/*.py',
                                    'simulation/*.py', '*.py')
               for path in PACKAGE.glob(pattern))
LIBM = {'sin', 'cos', 'tan', 'arcsin', 'arccos', 'arctan', 'arctan2', 'asin', 'acos', 'atan',
        'atan2', 'sinh', 'cosh', 'tanh', 'exp', 'exp2', 'expm1', 'log', 'log2', 'log10', 'log1p',
        'power', 'pow', 'float_power', 'cbrt', 'hypot', 'erf', 'gamma', 'sinc', 'geomspace',
        'logspace'}
BLAS = {'linalg', 'dot', 'vdot', 'inner', 'matmul', 'tensordot', 'convolve', 'correlate',
        'polyfit', 'cov', 'corrcoef'}
DRAWS = {'normal', 'standard_normal', 'exponential', 'standard_exponential', 'weibull',
         'lognormal', 'gamma', 'poisson'}
SORTS = {'argsort', 'argpartition', 'partition'}  # their order of what is alike may differ
COMPILED = {'kernel', 'subroutine', 'inlined'}
# SuperLU: an order of columns, which is a matter of whole numbers.
ALLOWED = {('physics/masonry/factor.py', 'linalg')}


def decorated(node: ast.AST) -> bool:
    """Return whether a function is compiled."""
    return isinstance(node, ast.FunctionDef) and any(
        ast.unparse(d).partition('(')[0] in COMPILED for d in node.decorator_list)


def faults(path: Path) -> Iterator[str]:
    """List what a module does that processors do differently."""
    tree = ast.parse(path.read_text('utf-8'))
    in_kernels = {id(inner) for node in ast.walk(tree) if decorated(node)
                  for inner in ast.walk(node)}
    name = str(path.relative_to(PACKAGE))
    for node in ast.walk(tree):
        what = _fault(node, id(node) in in_kernels)
        if what and (name, what) not in ALLOWED:
            yield f'{name}:{node.lineno}: {what}'


def _fault(node: ast.AST, compiled: bool) -> str:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        return '@'
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        whole = [isinstance(side, ast.Constant) and isinstance(side.value, int)
                 for side in (node.left, node.right)]
        return '' if whole[0] or compiled and whole[1] else '**'
    if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('scipy'):
        return 'linalg' if 'linalg' in node.module else ''
    if isinstance(node, ast.Attribute) and node.attr in LIBM | BLAS | DRAWS:
        owner = ast.unparse(node.value)
        drawn = owner.endswith(('rng', 'generator')) and node.attr in DRAWS
        if (node.attr in ('linalg', 'dot') or drawn
                or owner in ('np', 'math') and node.attr in LIBM | BLAS):
            return node.attr
    if isinstance(node, ast.Call):
        names = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords
                 if keyword.arg in ('fastmath', 'optimize', 'kind')}
        if 'fastmath' in names or names.get('optimize'):
            return 'fastmath or optimize'
        if (isinstance(node.func, ast.Attribute) and node.func.attr in SORTS and not compiled
                and isinstance(node.func.value, ast.Name) and node.func.value.id == 'np'
                and names.get('kind') not in ("'stable'", "'mergesort'")):
            return node.func.attr
    return ''


def test_state_is_worked_out_with_what_ieee_754_fixes():
    """Use `elementary` and `linear` instead of libm, BLAS and LAPACK, and stable sorts."""
    assert not [fault for path in STATE for fault in faults(path)]


@pytest.mark.parametrize('line, found', [
    ('a @ b', '@'), ('np.dot(a, b)', 'dot'), ('a.dot(b)', 'dot'), ('np.linalg.norm(a)', 'linalg'),
    ('a ** 0.5', '**'), ('a ** 2', '**'), ('2 ** a', ''), ('math.exp(a)', 'exp'),
    ('np.argsort(a)', 'argsort'), ("np.argsort(a, kind='stable')", ''), ('np.sqrt(a)', ''),
    ('self._rng.normal(0.0, 1.0)', 'normal'), ('kernel(fastmath=True)', 'fastmath or optimize')])
def test_what_processors_do_differently_is_found(line, found):
    """Show that the test above can fail."""
    told = [_fault(node, False) for node in ast.walk(ast.parse(line))]
    assert sorted(set(told) - {''}) == ([found] if found else [])


def test_a_scene_has_the_same_bits_on_a_poorer_processor(same_bits):
    """Take away what processors may lack; `bench/same_bits.py` does more, for all scenes."""
    plain = import_module('pose_hashes').simulate(_SCENE, 1)
    assert plain[0]['poses'] != plain[1]['poses']
    environment, threads = next(row[1:] for row in same_bits.poorest() if row[0] == same_bits.LIBM)
    own = {name: value for name, value in environment.items() if 'NUMBA' not in name}  # compiled
    assert not same_bits.difference(plain, same_bits.run(_SCENE, 1, own, threads))


@pytest.fixture(scope='module')
def same_bits() -> ModuleType:
    """Import the program that runs scenes with other instructions."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(PACKAGE.parent / 'bench'))
        return import_module('same_bits')
