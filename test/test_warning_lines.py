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

"""Warnings of the commands: a line each, that begins with file and line of the grammar."""

import logging
import warnings

import pytest

from procphys_ros.batch.command import main as batch
from procphys_ros.export.command import main as export
from procphys_ros.terminal.warning_lines import told_to

_SLIP = 'axiom: Width(0.08) Density(700) F(1) W F(1)\n'
_SCENE = """
/**:
  ros__parameters:
    scene.objects: [sapling]
    sapling.grammar: slip.lsys
    sapling.origin: [0.0, 0.0, -0.5]
"""


@pytest.fixture
def scene(tmp_path):
    """Write a scene whose grammar has a letter that means nothing, and that stands too deep."""
    (tmp_path / 'slip.lsys').write_text(_SLIP)
    path = tmp_path / 'slip.yaml'
    path.write_text(_SCENE)
    return path


@pytest.mark.parametrize('command', [
    lambda scene: export([str(scene), '--out', str(scene.with_suffix('.urdf'))]),
    lambda scene: batch([str(scene), '--out', str(scene.with_suffix('.csv')), '--seeds', '2',
                         '--duration', '0.1', '--jobs', '1']),
], ids=['export', 'batch'])
def test_commands_warn_in_a_line_each(scene, capfd, command):
    """Name the place of a slip in one line, once, without a line of Python."""
    assert command(scene) == 0
    said = [line for line in capfd.readouterr().err.splitlines() if 'arning' in line]
    assert all(line.startswith('warning: ') for line in said)
    assert sum('slip.lsys:1:' in line and 'module W' in line for line in said) == 1
    assert len(said) == len(set(said)) <= 2


def test_other_warnings_stay_as_they_are():
    """Tell of grammars and of the library's log only, and only while it lasts."""
    lines = []
    log = logging.getLogger('procphys_ros.scene')
    with pytest.warns(UserWarning, match='another') as others:
        with told_to(lines.append):
            log.warning('%d are too deep', 2)
            warnings.warn('another', stacklevel=1)
        log.warning('later')
    assert lines == ['2 are too deep'] and len(others) == 1
