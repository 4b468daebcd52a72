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


"""What all tests share."""

import gc

from measurement import Measured
import pytest
import single_thread  # noqa: F401 (before anything imports numpy)

# Files that take longest; begun first, so that no process is left alone with them at the end.
# About every third one waits for nodes and leaves its core to others.
LONG = ('test_scenes', 'test_node', 'test_warm', 'test_flaws_walls', 'test_node_commands',
        'test_lint', 'test_terrain', 'test_view_node', 'test_growing', 'test_docs_blocks',
        'test_batch', 'test_wallgrammar_roofs', 'test_snapshot', 'test_command',
        'test_mechanism_grammar',
        'test_joints', 'test_view_browser', 'test_blasts', 'test_wallgrammar_buildings',
        'test_node_inside', 'test_random_grammars', 'test_loose_stacks', 'test_record_node',
        'test_hinged', 'test_threads', 'test_node_exit')


def pytest_collection_modifyitems(items):
    """Begin with the longest files."""
    order = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.path.stem, len(LONG)))


@pytest.hookimpl(hookwrapper=True)
def pytest_collection():
    """Look for no garbage while modules are read, nor later in them: they are there to the end."""
    gc.disable()
    yield
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def frees_what_refusals_hold():
    """Free simulations that the traceback of an expected error holds: each takes some 80 MB."""
    yield
    gc.collect(1)


@pytest.fixture
def measured(request, record_property):
    """Compare figures with what is expected of them, and leave them for `make report`."""
    section = request.node.get_closest_marker('report').args[0]
    return Measured(section, f'{request.path.name}::{request.node.originalname}', record_property)
