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


"""Time of the wind per point, beside the same field interpolated by scipy, in one run."""

from statistics import median
from time import perf_counter

import numpy as np
from scipy import ndimage

from procphys_ros.physics.wind import eddies, spectra, Wind, WindSettings

TREES, SEGMENTS = 250, 44  # the forest of the paper, about 11,000 segments
SPEED, INTENSITY = 10.0, 0.2


def forest() -> np.ndarray:
    """Scatter segments like crowns over a stand of 200 x 200 m, (N, 3)."""
    rng = np.random.default_rng(0)
    trunks = np.repeat(rng.uniform(-100.0, 100.0, (TREES, 2)), SEGMENTS, axis=0)
    count = len(trunks)
    return np.column_stack([trunks + rng.normal(0.0, 1.5, (count, 2)),
                            rng.uniform(0.0, 15.0, count)])


def by_scipy(boxes: list, points: np.ndarray, time: float) -> np.ndarray:
    """Evaluate the same wind with numpy and map_coordinates (log profile, wind along x)."""
    out = np.zeros((len(points), 3))
    way = SPEED * time
    height = np.maximum(points[:, 2], 0.03)
    slowed = np.minimum(np.log(height / 0.03) / np.log(2.0 / 0.03), 1.0)  # near the ground
    for box in boxes:
        place = ((points - way * np.array([1.0, *eddies.DRIFT])) / box.spacing).T
        fraction = place - np.floor(place)
        for c in range(3):
            mean = ndimage.map_coordinates(box.field[..., c], place, order=1, mode='grid-wrap')
            kept = ndimage.map_coordinates(box.lags[c], 2 * fraction * (1 - fraction), order=1)
            out[:, c] += INTENSITY * SPEED * slowed * mean / np.sqrt(kept)
    out[:, 0] += SPEED * np.log(height / 0.03) / np.log(10.0 / 0.03)
    return out


def time_of(call, rounds: int) -> float:
    """Return the median time of `call(t)` [s] while t advances by frames."""
    call(0.0)
    times = []
    for i in range(rounds):
        start = perf_counter()
        call(i / 60.0)
        times.append(perf_counter() - start)
    return median(times)


def main() -> None:
    """Print the figures."""
    points = forest()
    start = perf_counter()
    wind = Wind(WindSettings((SPEED, 0.0, 0.0), turbulence_intensity=INTENSITY), seed=1)
    print(f'set-up                 {perf_counter() - start:6.2f} s')
    spectrum = spectra.make('kaimal', 10.0)
    rng = np.random.default_rng(1)
    boxes = eddies.make_boxes(spectrum, rng)
    megabytes = sum(box.field.nbytes for box in boxes) / 1e6
    out = np.empty_like(points)
    print(f'memory of the eddies   {megabytes:6.1f} MB')
    difference = np.abs(wind.velocity(points, 3.0) - by_scipy(boxes, points, 3.0)).max()
    print(f'largest difference     {difference:.1e} m/s')
    ours = time_of(lambda t: wind.velocity(points, t, out), 300)
    theirs = time_of(lambda t: by_scipy(boxes, points, t), 30)
    print(f'wind, {len(points)} points     {ours * 1e3:6.3f} ms, '
          f'{ours / len(points) * 1e9:.1f} ns/point')
    print(f'scipy map_coordinates  {theirs * 1e3:6.2f} ms, ratio {theirs / ours:.0f}')


if __name__ == '__main__':
    main()
