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

"""Figures that tests compare with what is expected, and leave for the report (`make report`)."""

from collections.abc import Callable, Sequence
import json
import math


class Measured:
    """
    Compares figures of one test, and records them as properties of the test.

    `bench/report` reads them from the results that pytest writes as JUnit XML.
    """

    def __init__(self, section: str, test: str, record: Callable[[str, object], None]):
        """
        Start without figures.

        :param section: of the report.
        :param test: name of the test.
        :param record: takes a name and a value; pytest's `record_property`.
        """
        self._common = {'section': section, 'test': test}
        self._record = record

    def __call__(self, what: str, got: float, expected: float, unit: str = '', *,
                 rtol: float = 0.0, atol: float = 0.0) -> None:
        """
        Expect a value, within a tolerance.

        :param what: is measured.
        :param got: the figure.
        :param expected: by theory or observation.
        :param unit: of all of them.
        :param rtol, atol: tolerance, as a share of what is expected and in its unit.
        """
        yes_or_no = isinstance(expected, bool)
        got, expected = float(got), float(expected)
        tolerance = max(atol, rtol * math.fabs(expected))
        self._note(kind='value', what=what, got=got, expected=expected, tolerance=tolerance,
                   unit=unit, relative=rtol > 0.0, yes_or_no=yes_or_no)
        assert math.fabs(got - expected) <= tolerance, f'{what}: {got} instead of {expected}'

    def within(self, what: str, got: float, low: float = -math.inf, high: float = math.inf,
               unit: str = '') -> None:
        """
        Expect a value between two bounds, which it may reach.

        :param what: is measured.
        :param got: the figure.
        :param low, high: bounds.
        :param unit: of all of them.
        """
        self._note(kind='bounds', what=what, got=float(got), low=low, high=high, unit=unit)
        assert low <= got <= high, f'{what}: {got} is not from {low} to {high}'

    def instead(self, what: str, got: float, unit: str = '') -> None:
        """
        Note what the baseline does, the paper's way, which is only to be shown.

        :param what: is measured.
        :param got: the figure.
        :param unit: of it.
        """
        self._note(kind='baseline', what=what, got=float(got), unit=unit)

    def curve(self, title: str, label: str, x: Sequence[float], y: Sequence[float],
              axes: tuple[str, str], scales: tuple[str, str] = ('linear', 'linear')) -> None:
        """
        Leave a curve for a plot; curves of one title are drawn into one plot.

        :param title: of the plot.
        :param label: of the curve; one that ends in `expected` is drawn as a dashed line.
        :param x, y: points.
        :param axes: labels of x and y, with units.
        :param scales: of x and y, 'linear' or 'log'.
        """
        self._note(kind='curve', title=title, label=label, x=[float(v) for v in x],
                   y=[float(v) for v in y], axes=axes, scales=scales)

    def _note(self, **what: object) -> None:
        self._record('measured', json.dumps({**self._common, **what}))
