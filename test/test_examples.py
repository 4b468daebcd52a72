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


"""Examples run as they are, and show what they say."""

import numpy as np
import pytest

from procphys_ros.examples import fly_through_crown


def test_a_drone_feels_the_crown_that_it_flies_through(capsys, monkeypatch):
    """Be pushed back by branches that give way, and by nothing before the crown begins."""
    felt, fly = [], fly_through_crown.fly

    def watch(simulation, look):
        def look_too(simulation):
            look(simulation)
            felt.append((simulation.pose_of_intruder('drone')[0],
                         *simulation.wrench_on_intruder('drone')[:3]))
        fly(simulation, look_too)
    monkeypatch.setattr(fly_through_crown, 'fly', watch)
    fly_through_crown.main()
    said = capsys.readouterr().out
    place, force = np.array(felt)[:, 0], np.array(felt)[:, 1:]
    assert place[-1] == pytest.approx(fly_through_crown.END, abs=0.1)
    assert not force[place < -3.8].any()
    pushed = np.linalg.norm(force, axis=1).max()
    assert 10.0 < pushed < 1000.0 and force[:, 0].sum() < 0.0
    assert f'{pushed:6.1f} N' in said and 'momentum lost' in said
