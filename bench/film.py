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


"""
What a picture of a film costs in a large scene, beside the work of the rasteriser; and memory.

Run: python bench/film.py [COPIES [WIDTHxHEIGHT]] (8 cottages of 13,092 parts; some 60 s of CPU)
"""

from resource import getrusage, RUSAGE_SELF
import sys
from time import process_time

import numpy as np

from procphys_ros.blueprint import chain
from procphys_ros.geometry import rotation
from procphys_ros.render import camera
from procphys_ros.render.drawing import Moment
from procphys_ros.render.picture import Renderer, scene_points
from procphys_ros.scene.sources import load_grammar

_SHARES = (0.0, 0.1, 1.0)  # of the parts that move from picture to picture
_PICTURES = 3  # of each


def main(copies: int, size: tuple[int, int]) -> None:
    """Print processor time per picture, and the largest memory so far."""
    cottage = load_grammar('cottage.wall', 'grammar').build()
    rows = [cottage.placed((12.0 * (i % 4), 12.0 * (i // 4), 0.0)) for i in range(copies)]
    blueprint = chain(rows)
    print(f'{len(blueprint)} parts, {len(blueprint.bonds)} bonds, '
          f'{_megabytes()} MB before anything is drawn')
    begin = process_time()
    first = Moment(blueprint, blueprint.poses)
    view = camera.frame(scene_points(first), size)
    renderer = Renderer(first, size)
    renderer.draw(first, view)
    print(f'first picture: {process_time() - begin:.2f} s, {_megabytes()} MB')
    rng = np.random.default_rng(0)
    for share in _SHARES:
        poses, ours, theirs = blueprint.poses.copy(), 0.0, 0.0
        for _ in range(_PICTURES):
            moving = rng.random(len(blueprint)) < share
            poses[moving, :3] += rng.normal(0.0, 0.002, (moving.sum(), 3))
            poses[moving, 3:] = rotation.multiply(
                rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), 0.001), poses[moving, 3:])
            moment = Moment(blueprint, poses.copy())
            begin = process_time()
            renderer.prepare(moment)
            ours += process_time() - begin
            renderer.draw(moment, view)
            theirs += process_time() - begin
        print(f'{100 * share:3.0f} % of the parts move: {ours / _PICTURES:.2f} s per picture to '
              f'move the meshes, {(theirs - ours) / _PICTURES:.2f} s to rasterise, '
              f'{_megabytes()} MB')


def _megabytes() -> int:
    return getrusage(RUSAGE_SELF).ru_maxrss // 1024


if __name__ == '__main__':
    width, height = (int(v) for v in (sys.argv[2] if len(sys.argv) > 2 else '640x360').split('x'))
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8, (width, height))
