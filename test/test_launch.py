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

"""The launch file, where there is `launch` (no wheel of it exists, a ROS machine has it)."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import re
from types import ModuleType

import pytest

FILE = Path(__file__).resolve().parents[1] / 'launch' / 'sim.launch.py'


@pytest.fixture
def module() -> ModuleType:
    """Load the file as `ros2 launch` does."""
    pytest.importorskip('launch_ros')
    spec = spec_from_file_location('sim_launch', FILE)
    loaded = module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def test_it_is_python():
    """Compile, also where it cannot be run."""
    compile(FILE.read_text('utf-8'), str(FILE), 'exec')


def test_it_takes_the_arguments_that_are_documented(module):
    """Declare the arguments that the docs name."""
    declared = {entity.name for entity in module.generate_launch_description().entities
                if hasattr(entity, 'default_value')}
    assert declared == {'scene', 'viewer', 'name', 'namespace'}


def test_every_topic_of_the_view_follows_the_name_of_the_node():
    """Remap all that the layout of RViz shows, for it names them as those of /sim."""
    layout = (FILE.parents[1] / 'config' / 'procphys.rviz').read_text('utf-8')
    shown = set(re.findall(r'Value: /sim/(\w+)', layout))
    remapped = re.search(r'topics = \((.*?)\)', FILE.read_text('utf-8'), re.DOTALL)
    assert remapped and set(re.findall(r"'(\w+)'", remapped[1])) == shown


def test_scenes_are_found_by_name_or_path(module, tmp_path):
    """Find a scene of the package with or without its ending, or a file; name them otherwise."""
    share = FILE.parents[1]
    garden = share / 'config' / 'garden.yaml'
    for given in ('garden', 'garden.yaml', str(garden)):
        assert module.scene_file(given, share) == garden
    with pytest.raises(FileNotFoundError, match='garden'):
        module.scene_file('no_such_scene', share)
