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


"""The page on the data flow of a step names the stages that there are."""

from pathlib import Path
import re

from procphys_ros.simulation.stages import STAGES

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'step.md'


def test_the_table_lists_all_stages_in_order():
    """Read the first column of the table."""
    rows = re.findall(r'^\| ([a-z ]+) \|', PAGE.read_text('utf-8'), re.MULTILINE)
    assert rows == ['stage', *(stage.name for stage in STAGES)]
