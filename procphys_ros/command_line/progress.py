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


"""Print the progress of a simulation as single lines."""

from collections.abc import Mapping, Sequence

from procphys_ros.physics.causes import Cause


def status_line(message: str, values: Mapping[str, str]) -> str:
    """
    Describe the state of a simulation in one line.

    :param message: of its diagnostic status.
    :param values: of that status; only few before there is a scene.
    """
    if 'simulation time [s]' not in values:
        return message
    stages = {name.removesuffix(' [ms/step]'): float(value) for name, value in values.items()
              if name.endswith(' [ms/step]')}
    line = (f't {float(values["simulation time [s]"]):8.2f} s   '
            f'x{values["real-time factor"]}   {sum(stages.values()):5.1f} ms/step   '
            f'{values["parts"]} parts, {values["awake bodies"]} awake, '
            f'{values["bonds broken"]} bonds broken')
    if message != 'running':
        line += f'   {message}'
    return line


def break_line(row: Mapping[str, float], names: Sequence[str] = ()) -> str:
    """
    Describe a broken bond in one line.

    :param row: of `~/breaks`.
    :param names: of known parts.
    """
    cause = int(row['cause'])
    name = Cause(cause).name.lower() if cause in set(Cause) else str(cause)
    parts = int(row['part_a']), int(row['part_b'])
    one, other = ('the ground' if part < 0 else
                  names[part] if part < len(names) else f'part {part}' for part in parts)
    return (f'  broken: {one} from {other} by {name} at '
            f'({row["x"]:.2f}, {row["y"]:.2f}, {row["z"]:.2f}), '
            f'load {row["load"]:.2f} of strength')
