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


"""Plans: streets with plots and rows of trees, each with its grammar, from `*.plan` files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from procphys_ros.elementary import atan2, cos, sin
from procphys_ros.errors import SceneError
from procphys_ros.geometry.linear import norm
from procphys_ros.scene.keys import draw_defines, Keys
from procphys_ros.scene.yaml_file import BoundedLoader, parsed

MOST = 2000  # houses, or trees, of one row
_STREET = ('from', 'to', 'width', 'surface', 'pavement', 'pavement_surface')
_PLOTS = ('street', 'side', 'count', 'grammars', 'defines', 'gap', 'setback', 'start')
_TREES = ('street', 'side', 'grammars', 'defines', 'spacing', 'offset', 'start', 'end')
_SIDES = ('left', 'right')


@dataclass(frozen=True)
class Street:
    """
    Straight street.

    :ivar start: of its middle [m], (2,).
    :ivar end: likewise.
    :ivar width: from kerb to kerb [m].
    :ivar surface: texture of the road; '' = none.
    :ivar pavement: width of those on both sides [m]; 0 = none.
    :ivar pavement_surface: their texture.
    """

    start: np.ndarray
    end: np.ndarray
    width: float
    surface: str = ''
    pavement: float = 0.0
    pavement_surface: str = 'paving'

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(norm(self.end - self.start))

    @property
    def heading(self) -> float:
        """Direction from its start to its end [rad]."""
        return atan2(*(self.end - self.start)[::-1])

    def strip(self, right: float, left: float) -> np.ndarray:
        """
        Compute the corners of a strip along the street, counterclockwise [m], (4, 2).

        :param right: its lesser distance from the middle of the street, positive to the left [m].
        :param left: its larger one.
        """
        side = np.array([-sin(self.heading), cos(self.heading)])
        return np.array([self.start + right * side, self.end + right * side,
                         self.end + left * side, self.start + left * side])

    def place(self, along: float, beyond: float, left: bool) -> np.ndarray:
        """Locate a point by its distances along the street and beyond its kerb [m], (2,)."""
        way = np.array([cos(self.heading), sin(self.heading)])
        side = np.array([-way[1], way[0]]) * (1.0 if left else -1.0)
        return self.start + along * way + (0.5 * self.width + beyond) * side


@dataclass(frozen=True)
class Row:
    """
    Row of houses or trees along one side of a street.

    :ivar is_plots: whether these are houses.
    :ivar street: that they stand along.
    :ivar left: side, as seen from its start.
    :ivar grammars: files, of which each takes one.
    :ivar defines: least, largest value and step of each define; step 0 = any value between.
    :ivar count: of houses, or of trees.
    :ivar gap: between houses, or from tree to tree [m].
    :ivar beyond: distance of the fronts, or of the trees, from the kerb [m].
    :ivar first: where the row starts along the street [m].
    :ivar where: file and line, for messages.
    """

    is_plots: bool
    street: Street
    left: bool
    grammars: tuple[str, ...]
    defines: Mapping[str, tuple[float, float, float]]
    count: int
    gap: float
    beyond: float
    first: float
    where: str

    def choices(self, rng: np.random.Generator) -> Iterator[tuple[str, dict[str, float]]]:
        """
        Choose a grammar and defines for each in the row.

        Grammars take turns in an order that is shuffled anew each time.
        """
        order: list[str] = []
        for _ in range(self.count):
            order = order or [str(name) for name in rng.permutation(self.grammars)]
            yield order.pop(), draw_defines(self.defines, rng)


@dataclass(frozen=True)
class Plan:
    """
    Content of a plan file.

    :ivar streets: in its order.
    :ivar rows: of houses, then of trees.
    """

    streets: Sequence[Street]
    rows: Sequence[Row]

    @property
    def count(self) -> int:
        """Count the houses and trees."""
        return sum(row.count for row in self.rows)


def read_plan(path: Path) -> Plan:
    """
    Read a plan.

    :raises SceneError: naming file, line, key and what is allowed.
    """
    root = parsed(path, lambda text: yaml.compose(text, BoundedLoader))
    top = Keys(root, str(path), ('streets', 'plots', 'trees'))
    streets = {name: _street(Keys(node, str(path), _STREET))
               for name, node in top.mapping('streets')}
    rows = [_plots(Keys(node, str(path), _PLOTS), streets) for node in top.items('plots')]
    rows += [_trees(Keys(node, str(path), _TREES), streets) for node in top.items('trees')]
    if not rows:
        raise SceneError(f'{path}: a plan needs rows under "plots" or "trees"')
    return Plan(list(streets.values()), rows)


def _street(keys: Keys) -> Street:
    street = Street(keys.point('from'), keys.point('to'), keys.number('width', 0.0, 200.0, 8.0),
                    keys.texture('surface', ''), keys.number('pavement', 0.0, 50.0, 0.0),
                    keys.texture('pavement_surface', 'paving'))
    if not 1.0 <= street.length <= 1e5:
        raise keys.error('to', f'makes the street {street.length:g} m long, it must be 1 to '
                         '100000 m')
    return street


def _plots(keys: Keys, streets: Mapping[str, Street]) -> Row:
    street = streets[keys.choice('street', tuple(streets))]
    return Row(True, street, keys.choice('side', _SIDES) == 'left', keys.names('grammars'),
               keys.ranges('defines'), keys.count('count', MOST),
               keys.number('gap', 0.0, 1000.0, 2.0), keys.number('setback', 0.0, 1000.0, 2.0),
               keys.number('start', 0.0, street.length, 0.0), keys.where)


def _trees(keys: Keys, streets: Mapping[str, Street]) -> Row:
    street = streets[keys.choice('street', tuple(streets))]
    spacing = keys.number('spacing', 0.1, 1000.0, 8.0)
    start = keys.number('start', 0.0, street.length, 0.0)
    end = keys.number('end', start, street.length, street.length)
    count = int((end - start) / spacing + 1e-9) + 1
    if count > MOST:
        raise keys.error('spacing', f'makes {count} trees, {MOST} are allowed in a row')
    return Row(False, street, keys.choice('side', _SIDES) == 'left', keys.names('grammars'),
               keys.ranges('defines'), count, spacing, keys.number('offset', -100.0, 1000.0, 1.0),
               start, keys.where)
