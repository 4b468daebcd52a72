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


"""Page: the sections of the report as Markdown."""

import math
from pathlib import Path

import plots
from results import Figure, Section

INTRODUCTIONS = {
    'laws': ('Laws', 'Closed forms of mechanics: beams, poles, falls, joints, walls and arches.'),
    'nature': ('Nature', 'Published measurements and standards: wind, trees, blasts, streams.'),
    'flaws': ('Flaws', 'What Baxter et al. (2010) list as flaws of their animations, as '
              '[measures](../flaws.md). The baseline is their way, rebuilt: a joint of the engine '
              'per bond.'),
    'convergence': ('Convergence', 'How errors shrink with the time step, the segments of a '
                    'branch, and the iterations of the solver.'),
}


def write_section(key: str, section: Section, folder: Path) -> str:
    """
    Write a section as Markdown, and its plots as files.

    :param key: name of the section.
    :param section: its figures.
    :param folder: for the plots.
    """
    title, introduction = INTRODUCTIONS[key]
    rows = [_row(figure) for figure in section.figures if figure.cases]
    baselines = any(figure.baseline is not None for figure in section.figures)
    if baselines:
        rows = [f'{row} {"–" if f.baseline is None else _number(f.baseline, f.unit)} |'
                for row, f in zip(rows, (f for f in section.figures if f.cases))]
    head = ['what', 'cases', 'expected', 'got', 'tolerance', 'test', *['baseline'] * baselines]
    alone = [f'{figure.what}: {_number(figure.baseline, figure.unit)}.'
             for figure in section.figures if not figure.cases and figure.baseline is not None]
    parts = [f'## {title}\n', f'{introduction}\n', f'| {" | ".join(head)} |',
             '|' + len(head) * '---|', *rows, '']
    if alone:
        parts += ['Baselines beside: ' + ' '.join(alone), '']
    return '\n'.join([*parts, *(f'![{path.stem.replace("_", " ")}]({path.name})'
                                for path in _plots(title, section, folder)), ''])


def _plots(title: str, section: Section, folder: Path) -> list[Path]:
    found = []
    tolerated = [f for f in section.figures if any(map(math.isfinite, f.deviations()))
                 and any(case.get('tolerance') for case in f.cases)]
    if len(tolerated) > 2:
        found.append(plots.draw_deviations(f'{title}: deviations', tolerated, folder))
    bounded = [f for f in section.figures if plots.has_upper_bound(f)]
    if any(f.baseline is not None for f in bounded):
        found.append(plots.draw_bounds(f'{title}: bounds', bounded, folder))
    return found + [plots.draw_curves(name, curves, folder)
                    for name, curves in section.curves.items()]


def _row(figure: Figure) -> str:
    case = figure.worst()
    if case['kind'] == 'value':
        yes_or_no = case['yes_or_no']
        expected, got = (('no', 'yes')[int(v)] if yes_or_no else _number(v, figure.unit)
                         for v in (case['expected'], case['got']))
        tolerance = ('–' if not case['tolerance'] else _number(
            100.0 * case['tolerance'] / abs(case['expected']), '%') if case['relative'] else
            f'±{_number(case["tolerance"], figure.unit)}')
    else:
        low, high = case['low'], case['high']
        got = _number(case['got'], figure.unit)
        expected = (f'at most {_number(high, figure.unit)}' if low in (0.0, -math.inf)
                    else f'at least {_number(low, figure.unit)}' if high == math.inf
                    else f'{_number(low)} to {_number(high, figure.unit)}')
        tolerance = 'bound'
    return (f'| {figure.what} | {len(figure.cases)} | {expected} | {got} | {tolerance} | '
            f'`{figure.test}` |')


def _number(value: float, unit: str = '') -> str:
    shown = f'{value:.4g}'.replace('e-0', 'e-').replace('e+0', 'e')
    return f'{shown} {unit}'.strip()
