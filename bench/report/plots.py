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


"""Plots of the report, as SVG files that stay the same when the figures do."""

import math
from pathlib import Path
import re

import matplotlib as mpl
from matplotlib import pyplot as plt
from results import Figure

_MOST_POINTS = 300  # of a curve; more are not seen, and make large files
_SMALLEST = 1e-7    # share of a bound below which points are drawn at the edge

mpl.rcParams.update({'svg.hashsalt': 'procphys_ros', 'svg.fonttype': 'none', 'font.size': 9.0})


def draw_curves(title: str, curves: list[dict], folder: Path) -> Path:
    """
    Draw the curves of one title.

    :param title: of the plot; the file is named after it.
    :param curves: records of the kind `curve`.
    :param folder: for the file.
    :returns: the file.
    """
    _, axes = plt.subplots(figsize=(6.0, 3.4), layout='constrained')
    colours: dict[str, str] = {}
    for curve in curves:
        name, expected, _ = curve['label'].partition(', expected')
        thin = slice(None, None, max(1, len(curve['x']) // _MOST_POINTS))
        line, = axes.plot(curve['x'][thin], curve['y'][thin], '--' if expected else '-',
                          marker='' if expected or len(curve['x']) > 40 else '.',
                          color=colours.get(name, 'black' if expected else None), label=name
                          if name not in colours else None)
        colours[name] = line.get_color()
    (across, up), (xscale, yscale) = curves[0]['axes'], curves[0]['scales']
    axes.set(title=title, xlabel=across, ylabel=up, xscale=xscale, yscale=yscale)
    axes.legend()
    return _save(title, folder)


def draw_deviations(title: str, figures: list[Figure], folder: Path) -> Path:
    """
    Draw the deviation of each figure from its expected value, as a share of its tolerance.

    :param title: of the plot.
    :param figures: with at least one tolerance.
    :param folder: for the file.
    :returns: the file.
    """
    _, axes = plt.subplots(figsize=(8.0, 0.9 + 0.19 * len(figures)), layout='constrained')
    axes.axvspan(-1.0, 1.0, color='0.93')
    for row, figure in enumerate(figures):
        shares = figure.deviations()
        axes.plot(shares, [row] * len(shares), 'o', markersize=3.5, alpha=0.7)
    _label(axes, title, figures)
    axes.set(xlabel='deviation over tolerance', xlim=(-1.05, 1.05))
    return _save(title, folder)


def draw_bounds(title: str, figures: list[Figure], folder: Path) -> Path:
    """
    Draw figures beside the baseline, as shares of their upper bounds.

    :param title: of the plot.
    :param figures: with upper bounds above 0.
    :param folder: for the file.
    :returns: the file.
    """
    _, axes = plt.subplots(figsize=(8.0, 0.9 + 0.19 * len(figures)), layout='constrained')
    axes.axvspan(_SMALLEST, 1.0, color='0.93')
    for row, figure in enumerate(figures):
        high = figure.cases[0]['high']
        here = max(case['got'] for case in figure.cases)
        axes.plot(max(here / high, _SMALLEST), row, 'o', color='C0',
                  label='here' if row == 0 else None)
        if figure.baseline is not None:
            axes.plot(figure.baseline / high, row, 'x', color='C3')
    axes.plot([], [], 'x', color='C3', label="the paper's way")
    _label(axes, title, figures)
    axes.set(xlabel='figure over bound', xscale='log')
    axes.legend(loc='lower right')
    return _save(title, folder)


def has_upper_bound(figure: Figure) -> bool:
    """Return whether a figure has a place in `draw_bounds`."""
    return any(case['kind'] == 'bounds' and 0.0 < case['high'] < math.inf
               for case in figure.cases)


def _label(axes, title: str, figures: list[Figure]) -> None:
    axes.set(title=title, yticks=range(len(figures)), yticklabels=[f.what for f in figures],
             ylim=(len(figures) - 0.5, -0.5))
    axes.tick_params(axis='y', labelsize=7.0)


def _save(title: str, folder: Path) -> Path:
    path = folder / f'{re.sub("[^a-z0-9]+", "_", title.lower()).strip("_")}.svg'
    plt.savefig(path, metadata={'Date': None})
    plt.close()
    text = path.read_text('utf-8')  # no blanks at the ends of lines
    path.write_text('\n'.join(line.rstrip() for line in text.splitlines()) + '\n', 'utf-8')
    return path
