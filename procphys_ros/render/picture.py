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


"""Pictures: any blueprint at any poses, drawn off-screen, once or again and again."""

from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path

import numpy as np

from procphys_ros.appearance.paving import Paving
from procphys_ros.blueprint import Blueprint
from procphys_ros.errors import SceneError
from procphys_ros.files.output_files import obstacle
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.render import camera as cameras
from procphys_ros.render.camera import View
from procphys_ros.render.canvas import Bounds, Canvas
from procphys_ros.render.drawing import Moment, SceneBatches
from procphys_ros.scene.scenery import SkySettings, SunSettings
from procphys_ros.schema import short

LARGEST_SIDE = 8192  # [px] that OpenGL in software can still allocate
_EMPTY_SCENE = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])  # [m] corners to look at
_ROOM = 1.25  # margin of the shadow bounds, so that they change seldom
_HANGING = 1e-6  # [m] tolerance for a petiole on its branch


class Renderer:
    """
    Draw one scene at successive moments; needs no display.

    Existing pieces are kept and only moved.

    :param first: first moment.
    :param size: width and height [px].
    :param sun: its position.
    :param sky: its clarity.
    :param terrain: the surface of the ground.
    :param paving: of the ground.
    :raises RenderUnavailableError: if ModernGL or OpenGL is not installed.
    """

    def __init__(self, first: Moment, size: tuple[int, int] = (1280, 720),
                 sun: SunSettings | None = None, sky: SkySettings | None = None,
                 terrain: Terrain = FLAT, paving: Sequence[Paving] = ()):
        self._canvas = Canvas(size, sun or SunSettings(), sky or SkySettings(), terrain, paving)
        self._drawing = SceneBatches(self._canvas.context, first, self._canvas.towards)
        self._bounds: Bounds | None = None

    def prepare(self, moment: Moment) -> None:
        """Move all pieces to a moment; also called by `draw`."""
        self._drawing.update(moment)

    def draw(self, moment: Moment, view: View) -> np.ndarray:
        """
        Draw a picture.

        :param moment: content; parts, leaves and bonds of earlier moments come first in it.
        :param view: of the camera.
        :returns: rows from top to bottom, (H, W, 3) uint8.
        """
        self.prepare(moment)
        return self._canvas.draw(self._drawing, moment.dust, view, self._shadowed(moment),
                                 moment.snow)

    def close(self) -> None:
        """Free the memory."""
        self._canvas.close()

    def _shadowed(self, moment: Moment) -> Bounds:
        """Return the bounds of the shadow casters, kept as long as these stay inside."""
        now = Bounds.of(moment.poses[moment.shown(), :3])
        old = self._bounds
        if old is None or now.radius + np.linalg.norm(now.middle - old.middle) > old.radius:
            self._bounds = now if old is None else Bounds(now.middle, _ROOM * now.radius)
        assert self._bounds is not None
        return self._bounds


def draw(blueprint: Blueprint, poses: np.ndarray, path: str | Path, *,
         camera: Sequence[float] | None = None, size: tuple[int, int] = (1280, 720),
         exists: np.ndarray | None = None, leaf_poses: np.ndarray | None = None,
         dust: Puffs | None = None, cracked: np.ndarray | None = None,
         sun: SunSettings | None = None, sky: SkySettings | None = None,
         terrain: Terrain = FLAT) -> None:
    """
    Draw a blueprint as a picture; needs no display.

    :param blueprint: to draw.
    :param poses: of its parts, world, (N, 7); not finite for missing parts.
    :param path: image file to write; its suffix selects the format.
    :param camera: position and target x y z tx ty tz [m]; default the whole scene.
    :param size: width and height [px].
    :param exists: parts to draw, (N,) bool; default all.
    :param leaf_poses: petioles of all leaves, world, (L, 7); default on their parts.
    :param dust: puffs of dust; default none.
    :param cracked: bonds that have cracked or broken, (K,), drawn dark; default none.
    :param sun: its position.
    :param sky: its clarity.
    :param terrain: the surface of the ground.
    :raises RenderUnavailableError: if ModernGL or OpenGL is not installed.
    :raises SceneError: if an argument does not match the blueprint, or the file cannot be written.
    """
    from PIL import Image

    _check_rows('poses', poses, (len(blueprint), 7))
    _check_rows('leaf_poses', leaf_poses, (len(blueprint.leaves), 7))
    _check_rows('exists', exists, (len(blueprint),))
    _check_view(camera, size)
    _check_file(Path(path), Image.registered_extensions())
    moment = Moment(blueprint, np.asarray(poses, float), leaf_poses, exists,
                    np.zeros(0, int) if cracked is None else cracked,
                    Puffs.none() if dust is None else dust)
    if camera is None:
        view = cameras.frame(scene_points(moment), size)
    else:
        view = View(np.asarray(camera[:3], float), np.asarray(camera[3:], float))
    renderer = Renderer(moment, size, sun, sky, terrain)
    pixels = renderer.draw(moment, view)
    renderer.close()
    Image.fromarray(pixels).save(path)


def _check_rows(name: str, given: np.ndarray | None, expected: tuple[int, ...]) -> None:
    if given is not None and np.shape(given) != expected:
        raise SceneError(f'{name}: the shape is {np.shape(given)}, this blueprint takes '
                         f'{expected}')


def _check_view(camera: Sequence[float] | None, size: Sequence[int]) -> None:
    if not (len(size) == 2 and all(isinstance(side, Integral) and 1 <= side <= LARGEST_SIDE
                                   for side in size)):
        raise SceneError(f'size is {short(size)}, it must be a width and a height within 1 to '
                         f'{LARGEST_SIDE} pixels')
    if camera is None:
        return
    if not (len(camera) == 6 and all(isinstance(value, Real) and abs(value) < 1e9
                                     for value in camera)):
        raise SceneError(f'camera is {short(camera)}, it must be six numbers: position and target')
    if tuple(camera[:3]) == tuple(camera[3:]):
        raise SceneError(f'camera is {short(camera)}: it stands where it looks')


def _check_file(path: Path, known: Mapping[str, str]) -> None:
    if path.suffix.lower() not in known:
        raise SceneError(f'"{path}": the suffix "{path.suffix}" names no format of pictures; use '
                         '.png or .jpg')
    if reason := obstacle(path, beside=False):
        raise SceneError(f'"{path}" cannot be written: {reason}')


def scene_points(moment: Moment) -> np.ndarray:
    """
    Return points [m] that a picture of the whole scene must show, (P, 3).

    They are the ends of all parts and their attached leaves.
    """
    shown = moment.shown()
    blueprint, poses = moment.blueprint, moment.poses[shown]
    if not len(poses):
        return _EMPTY_SCENE
    ends = cameras.corners(poses, blueprint.visual_size[shown])
    carried = Moment(blueprint, moment.poses).petioles()
    petioles = moment.petioles()
    hangs = shown[blueprint.leaves.part]
    moved = np.abs(petioles[:, :3] - carried[:, :3])
    hangs &= moved.max(axis=1, initial=0.0) < _HANGING
    size = blueprint.leaves.size[hangs, None]
    tips = cameras.corners(petioles[hangs], np.repeat(size, 3, axis=1),
                           np.array([[0.0, 0.0, 1.0]]))
    return np.concatenate([np.zeros((1, 3)), ends, tips])
