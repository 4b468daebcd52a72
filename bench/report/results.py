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


"""Results: the figures that the tests of the report have left, grouped."""

from collections.abc import Iterable
from dataclasses import dataclass, field
import json
import math
from pathlib import Path
import xml.etree.ElementTree as ElementTree


@dataclass
class Figure:
    """
    What was measured under one name, once or in several cases.

    :ivar what: was measured.
    :ivar test: `<file>::<function>` that did it.
    :ivar unit: of all numbers.
    :ivar cases: the records of the tests, see `test/measurement.py`.
    :ivar baseline: what the paper's way gives, None = not measured.
    """

    what: str
    test: str
    unit: str
    cases: list[dict] = field(default_factory=list)
    baseline: float | None = None

    def deviations(self) -> list[float]:
        """Compute the deviation of each case, as a share of its tolerance."""
        return [(case['got'] - case['expected']) / (case['tolerance'] or math.inf)
                for case in self.cases if case['kind'] == 'value']

    def worst(self) -> dict:
        """Return the case nearest to its tolerance or bound."""
        return max(self.cases, key=_closeness)


def _closeness(case: dict) -> float:
    if case['kind'] == 'value':
        return abs(case['got'] - case['expected']) / (case['tolerance'] or math.inf)
    span = case['high'] - case['low']
    if math.isfinite(span) and span > 0.0:
        return abs(2.0 * (case['got'] - case['low']) / span - 1.0)
    return case['got'] if math.isfinite(case['high']) else -case['got']


@dataclass
class Section:
    """
    One section of the report.

    :ivar figures: in the order of the tests.
    :ivar curves: of every plot, by its title.
    """

    figures: list[Figure] = field(default_factory=list)
    curves: dict[str, list[dict]] = field(default_factory=dict)


def read(path: Path) -> dict[str, Section]:
    """
    Read the figures of a run of the tests.

    :param path: JUnit XML that pytest wrote.
    :returns: sections by name.
    """
    records = (json.loads(found.get('value', '{}'))
               for found in ElementTree.parse(path).iter('property')
               if found.get('name') == 'measured')
    return group(records)


def group(records: Iterable[dict]) -> dict[str, Section]:
    """
    Sort records into sections, cases of one name together.

    :param records: as `test/measurement.py` leaves them.
    """
    sections: dict[str, Section] = {}
    figures: dict[tuple[str, str], Figure] = {}
    for record in records:
        section = sections.setdefault(record['section'], Section())
        if record['kind'] == 'curve':
            section.curves.setdefault(record['title'], []).append(record)
            continue
        key = record['section'], record['what']
        if key not in figures:
            figures[key] = Figure(record['what'], record['test'], record['unit'])
            section.figures.append(figures[key])
        if record['kind'] == 'baseline':
            figures[key].baseline = record['got']
        else:
            figures[key].cases.append(record)
    for section in sections.values():  # files that ran side by side come in turns
        section.figures.sort(key=lambda figure: figure.test.partition('::')[0])
        section.curves = dict(sorted(section.curves.items(), key=lambda plot: plot[1][0]['test']))
    return sections
