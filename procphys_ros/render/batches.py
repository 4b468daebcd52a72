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


"""Batches: pieces of one kind and texture, copies of one mesh that stay on the graphics side."""

from typing import Any

import numpy as np

from procphys_ros.appearance import texture
from procphys_ros.appearance.palette import Look
from procphys_ros.appearance.unit_meshes import Kind, unit_mesh
from procphys_ros.render.program import Programs, set_uniforms

_FIXED = '3f 3f 2f 1f'  # per copy: constant data
SIZE, THICKNESS, TONE, SHARE, MORE = 0, 2, 3, 6, 9  # first columns of these
_FIXED_NAMES = ('in_size', 'in_tone', 'in_share', 'in_offset')
_MORE = {Kind.LEAF: ('3f', ('in_outward',)), Kind.SPRAY: ('3f', ('in_outward',)),
         Kind.TRIANGLE: ('3f 3f 3f', ('in_a', 'in_b', 'in_c')),
         Kind.HEXAHEDRON: ('3f ' * 7 + '3f', tuple(f'in_c{corner}' for corner in range(8)))}
_AWAY = -1e5  # [m] height of pieces that are gone
_SWELL = 0.012  # [m] by which bricks grow in the sun's view, to cover the joints between them


class Batch:
    """
    Copies of one mesh.

    :param context: of OpenGL.
    :param programs: of this context.
    :param kind: of its pieces.
    :param look: of its pieces.
    """

    def __init__(self, context: Any, programs: Programs, kind: Kind, look: Look):
        self._context, self._kind, self.look = context, kind, look
        self._fixed = np.zeros((0, 0), 'f4')
        self._poses = np.zeros((0, 7), 'f4')
        self._surface = programs.get('instance.vert', 'surface.frag', kind.value)
        self._shadow = programs.get('instance.vert', 'shadow.frag', 'SHADOW', kind.value)
        self._image = None if kind is Kind.SPRAY else _image(context, look.pattern)
        self._buffers: list[Any] = []
        self._arrays: dict[Any, Any] = {}

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def lengths(self) -> np.ndarray:
        """Return the first extents of all pieces [m], (K,)."""
        return self._fixed[:, 0]

    @property
    def is_glass(self) -> bool:
        """Return whether it is transparent."""
        return self.look.rgba[3] < 1.0

    def append(self, rows: np.ndarray, size: np.ndarray | float, share: np.ndarray,
               offset: np.ndarray | float = 0.0, more: np.ndarray | None = None) -> None:
        """
        Add pieces, out of sight until they are moved.

        :param rows: that determine their colours, (K,).
        :param size: of a box or ball its extents, of a branch base and tip diameter and length, of
            a leaf length [m], aspect and relative thickness, (K, 3); 1 for others.
        :param share: sun and sky light transmitted by the surrounding leaves, 0 to 1, (K, 2); of
            branches the sky light at the base and at the tip.
        :param offset: of the image [m], (K,).
        :param more: of leaves the direction out of the crown in their frame, (K, 3); of triangles
            the corners in the frame of their part [m], (K, 9); of hexahedra likewise, (K, 24).
        """
        count = len(rows)
        table = np.column_stack([
            np.broadcast_to(size, (count, 3)), self.tones(rows), share,
            np.broadcast_to(offset, count), *([] if more is None else [more])]).astype('f4')
        self._fixed = np.concatenate([self._fixed.reshape(-1, table.shape[1]), table])
        poses = np.zeros((len(table), 7), 'f4')
        poses[:, 2], poses[:, 6] = _AWAY, 1.0
        self._poses = np.concatenate([self._poses, poses])
        self._build()

    def move(self, poses: np.ndarray, rows: slice | np.ndarray = slice(None)) -> None:
        """
        Set the poses of pieces.

        :param poses: world, (K, 7); not finite for pieces that are gone.
        :param rows: pieces to move; default all.
        """
        poses = poses.astype('f4')
        gone = ~np.isfinite(poses).all(axis=1)
        poses[gone] = (0.0, 0.0, _AWAY, 0.0, 0.0, 0.0, 1.0)
        if not np.array_equal(self._poses[rows], poses):
            self._poses[rows] = poses
            self._buffers[0].write(self._poses)

    def show(self, other: 'Batch', rows: np.ndarray, poses: np.ndarray) -> None:
        """
        Replace the pieces by some of another batch.

        :param rows: of the other batch, (K,).
        :param poses: world, (K, 7).
        """
        fixed = other._fixed[rows]
        if not np.array_equal(fixed, self._fixed):
            self._fixed, self._poses = fixed, np.zeros((len(rows), 7), 'f4')
            if len(rows):
                self._build()
        if len(rows):
            self.move(poses)

    def update(self, column: int, values: np.ndarray,
               rows: slice | np.ndarray = slice(None)) -> bool:
        """
        Change constant data of pieces; return whether any differs.

        :param column: `SIZE`, `THICKNESS`, `TONE`, `SHARE` or `MORE`, the first that is changed.
        :param values: see `append`, (K, n).
        :param rows: of the pieces; default all.
        """
        values, columns = values.astype('f4'), slice(column, column + values.shape[1])
        if np.array_equal(self._fixed[rows, columns], values):
            return False
        self._fixed[rows, columns] = values
        self._buffers[1].write(self._fixed)
        return True

    def tones(self, rows: np.ndarray) -> np.ndarray:
        """Return the colour of each piece by its row, (K, 3), constant over time."""
        rng = np.random.default_rng(1)
        last, own = int(rows.max()) + 1, self.look.variation
        tone = 1.0 + own * rng.uniform(-1.0, 1.0, last)[rows, None]
        warmth = rng.uniform(-1.0, 1.0, last)[rows, None] * [1.0, 0.0, -1.0]
        return (np.asarray(self.look.rgba[:3]) / texture.mean_light(self.look.pattern)
                * tone * (1.0 + 0.4 * own * warmth))

    def draw(self, uniforms: dict[str, Any]) -> None:
        """Draw the surface."""
        self._render(self._surface, {**uniforms, 'opacity': self.look.rgba[3], 'swell': 0.0})

    def draw_shadow(self, projection: bytes) -> None:
        """Draw the depth as seen from the sun."""
        if self._kind is not Kind.JOINT and not self.is_glass:
            self._render(self._shadow, {'projection': projection, 'swell': _SWELL})

    def _render(self, target: Any, uniforms: dict[str, Any]) -> None:
        if not len(self):
            return
        if self._image is not None:
            self._image.use(0)
        solid = self._kind not in (Kind.LEAF, Kind.SPRAY, Kind.TRIANGLE) and not self.is_glass
        (self._context.enable if solid else self._context.disable)(self._context.CULL_FACE)
        set_uniforms(target, {**uniforms, 'image': 0, 'plain': self._image is None,
                              'stony': self.look.pattern == 'grain'})
        self._arrays[target].render(instances=len(self))

    def _build(self) -> None:
        for old in (*self._arrays.values(), *self._buffers):
            old.release()
        vertices, layout, names, faces = unit_mesh(self._kind, self.look.pattern)
        more = _MORE.get(self._kind, ('', ()))
        moving, fixed, mesh, index = self._buffers = [
            self._context.buffer(np.ascontiguousarray(data))
            for data in (self._poses, self._fixed, vertices, faces)]
        content = [(mesh, layout, *names),
                   (moving, '3f 4f/i', 'in_position', 'in_turn'),
                   (fixed, f'{_FIXED} {more[0]}/i', *_FIXED_NAMES, *more[1])]
        self._arrays = {target: self._context.vertex_array(
            target, content, index, index_element_size=4, skip_errors=True)
            for target in (self._surface, self._shadow)}


def _image(context: Any, pattern: str) -> Any:
    """Load the image of a pattern, None for a plain one."""
    pixels = texture.image(pattern)
    if pixels is None:
        return None
    loaded = context.texture(pixels.shape[1::-1], 4, np.ascontiguousarray(pixels[::-1]).tobytes())
    loaded.build_mipmaps()
    loaded.filter = context.LINEAR_MIPMAP_LINEAR, context.LINEAR
    if (pixels[..., 3] < 255).any():
        loaded.repeat_x = loaded.repeat_y = False
    return loaded
