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


"""Canvas: the passes that make a picture of batches, ground, sky and dust."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from procphys_ros.appearance import texture
from procphys_ros.appearance.palette import rgba
from procphys_ros.appearance.paving import Paving
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.render.backend import open_context
from procphys_ros.render.camera import View
from procphys_ros.render.drawing import SceneBatches
from procphys_ros.render.light import Daylight
from procphys_ros.render.program import Programs, set_uniforms
from procphys_ros.scene.scenery import SkySettings, SunSettings

_SAMPLES = 4  # per pixel, at edges
_SHADOW_SIDE = 4096  # [px]
_FURTHEST = 4000.0  # [m] largest drawn depth, at least
_HIDING = 10.0  # [kg/m²] of snow that hide grass: 10 cm when it is fresh
_OCCLUSION_REACH = 0.7  # [m] within which surfaces occlude the sky for each other
_SPOKES, _RINGS = 48, np.array([0.0, 1.0, 4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0])  # [m]
_QUAD = np.array([[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]], 'f4')


@dataclass(frozen=True)
class Bounds:
    """A sphere around the shadow casters: middle [m], (3,), and radius [m]."""

    middle: np.ndarray
    radius: float

    @classmethod
    def of(cls, points: np.ndarray) -> 'Bounds':
        """Compute the sphere around the box of points [m], (P, 3)."""
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return cls(np.zeros(3), 2.0)
        low, high = points.min(axis=0), points.max(axis=0)
        return cls(0.5 * (low + high), max(2.0, 0.52 * float(np.linalg.norm(high - low)) + 2.0))


class Canvas:
    """
    Draw pictures off-screen.

    :param size: width and height [px].
    :param sun: its position.
    :param sky: its clarity.
    :param terrain: the surface of the ground.
    :param paving: of the ground.
    :ivar context: of OpenGL.
    :raises RenderUnavailableError: if ModernGL or OpenGL is not installed.
    """

    def __init__(self, size: tuple[int, int], sun: SunSettings, sky: SkySettings,
                 terrain: Terrain = FLAT, paving: Sequence[Paving] = ()):
        self.context = context = open_context()
        self._size = size
        self._daylight = Daylight.of(sun, sky)
        self._sky = sky
        self._terrain = terrain
        many = min(_SAMPLES, context.max_samples)
        self._many = context.framebuffer(
            [context.renderbuffer(size, 4, samples=many)],
            context.depth_renderbuffer(size, samples=many))
        self._picture, self._depth = context.texture(size, 4), context.depth_texture(size)
        self._depth.compare_func = ''
        self._depth.filter = context.NEAREST, context.NEAREST
        self._single = context.framebuffer([self._picture], self._depth)
        half = max(1, size[0] // 2), max(1, size[1] // 2)
        self._occlusion = context.texture(half, 1)
        self._half = context.framebuffer([self._occlusion])
        self._haze = context.texture(half, 4, dtype='f4')
        self._result = context.framebuffer([context.renderbuffer(size, 4)])
        self._shadow_map = context.depth_texture((_SHADOW_SIDE, _SHADOW_SIDE))
        self._shadow_map.repeat_x = self._shadow_map.repeat_y = False
        self._shadow = context.framebuffer(depth_attachment=self._shadow_map)
        self._noise = _load_noise(context)
        programs = Programs(context)
        self._passes = {name: _screen_pass(context, programs, name)
                        for name in ('sky.frag', 'occlusion.frag', 'compose.frag')}
        self._ground = _ground(context, programs, terrain)
        self._paving = [(one.texture, *_paving(context, programs, one)) for one in paving]
        self._dust = _DustPass(context, programs, self._haze)

    @property
    def towards(self) -> np.ndarray:
        """Return the unit vector to the sun, (3,)."""
        return self._daylight.towards

    def draw(self, drawing: SceneBatches, dust: Puffs, view: View, bounds: Bounds,
             snow: float = 0.0) -> np.ndarray:
        """
        Draw a picture.

        :param drawing: batches with their poses.
        :param dust: in the air.
        :param view: of the camera.
        :param bounds: of the shadow casters.
        :param snow: on open ground [kg/m²].
        :returns: rows from top to bottom, (H, W, 3) uint8.
        """
        drawing.single_out(view, self._size[1])
        context, batches = self.context, list(drawing.batches)
        to_shadow = _seen_from(self._daylight.towards, bounds)
        planes = self._nearest(view, bounds), max(_FURTHEST, 60.0 * bounds.radius)
        projection = view.projection(self._size[0] / self._size[1], planes)
        self._draw_shadow(batches, to_shadow)
        common = {**self._common(view, projection, to_shadow),
                  'texel_size': 2.0 * bounds.radius / _SHADOW_SIDE,
                  'snow': min(snow / _HIDING, 1.0)}
        self._many.use()
        self._many.clear(depth=1.0)
        context.enable_only(context.DEPTH_TEST)
        for batch in batches:
            if not batch.is_glass:
                batch.draw(common)
        context.enable_only(context.DEPTH_TEST)
        self._draw_ground(common)
        self._draw_sky(common, projection)
        context.enable_only(context.DEPTH_TEST | context.BLEND)
        self._many.depth_mask = False
        for batch in batches:
            if batch.is_glass:
                batch.draw(common)
        self._many.depth_mask = True
        context.copy_framebuffer(self._single, self._many)
        self._dust.draw(dust, self._depth, {**common, 'planes': planes}, view)
        self._darken(view, planes, len(dust.sizes) > 0)
        pixels = np.frombuffer(self._result.read(components=3, alignment=1), np.uint8)
        return pixels.reshape(self._size[1], self._size[0], 3)[::-1]

    def close(self) -> None:
        """Free all resources."""
        self.context.gc_mode = 'context_gc'
        self.context.release()

    def _nearest(self, view: View, bounds: Bounds) -> float:
        """Return a depth below that of all objects, and of the ground below the camera [m]."""
        away = float(np.linalg.norm(view.eye - bounds.middle)) - bounds.radius
        above = float(view.eye[2] - self._terrain.height(view.eye[None, :2])[0])
        return max(0.05, 0.3 * min(away, above))

    def _common(self, view: View, projection: np.ndarray, to_shadow: np.ndarray) -> dict[str, Any]:
        self._shadow_map.use(1)
        self._noise.use(2)
        day = self._daylight
        return {'projection': _column_major(projection), 'eye': tuple(view.eye),
                'to_shadow': _column_major(to_shadow), 'texel': 1.0 / _SHADOW_SIDE,
                'shadow_map': 1, 'noise': 2, 'sun': tuple(day.towards),
                'sunshine': tuple(day.sunshine), 'skylight': tuple(day.skylight),
                'bounce': tuple(day.bounce),
                'sky_low': tuple(day.low), 'sky_high': tuple(day.high),
                'clouds': self._sky.clouds, 'visibility': self._sky.visibility}

    def _draw_shadow(self, batches: Sequence[Any], to_shadow: np.ndarray) -> None:
        self._shadow.use()
        self._shadow.clear(depth=1.0)
        self.context.enable_only(self.context.DEPTH_TEST)
        for batch in batches:
            batch.draw_shadow(_column_major(to_shadow))

    def _draw_ground(self, common: dict[str, Any]) -> None:
        target, array = self._ground
        set_uniforms(target, {**common, 'grass': rgba('ground')[:3]})
        array.render()
        self.context.polygon_offset = -1.0, -8.0  # far away it is within the precision of depths
        for texture_name, target, array in self._paving:
            set_uniforms(target, {**common, 'paving': rgba(texture_name)[:3]})
            array.render()
        self.context.polygon_offset = 0.0, 0.0

    def _draw_sky(self, common: dict[str, Any], projection: np.ndarray) -> None:
        target, array = self._passes['sky.frag']
        set_uniforms(target, {**common, 'unproject': _column_major(np.linalg.inv(projection))})
        self.context.depth_func = '<='
        array.render(vertices=3)
        self.context.depth_func = '<'

    def _darken(self, view: View, planes: tuple[float, float], dusty: bool) -> None:
        """Apply ambient occlusion, and blend the dust over it."""
        self.context.enable_only(self.context.NOTHING)
        self._depth.use(0)
        slope = np.tan(np.radians(view.angle) / 2.0)
        target, array = self._passes['occlusion.frag']
        set_uniforms(target, {'depth': 0, 'planes': planes, 'reach': _OCCLUSION_REACH,
                              'slope': (slope * self._size[0] / self._size[1], slope)})
        self._half.use()
        array.render(vertices=3)
        self._picture.use(0)
        self._occlusion.use(3)
        self._haze.use(4)
        self._depth.use(5)
        target, array = self._passes['compose.frag']
        set_uniforms(target, {'picture': 0, 'occlusion': 3, 'haze': 4, 'depth': 5,
                              'planes': planes, 'dusty': dusty})
        self._result.use()
        array.render(vertices=3)


class _DustPass:
    """
    Accumulate dust, the farthest puffs first.

    Thousands of thin puffs add up, each less than a step of eight bits: they are summed as floats,
    premultiplied by their opacity, before they are blended over the picture. Dust has no edges, so
    that half the picture's size is sufficient.
    """

    def __init__(self, context: Any, programs: Programs, haze: Any):
        self._context = context
        self._target = context.framebuffer([haze])
        self._program = programs.get('dust.vert', 'dust.frag')
        self._quad = context.buffer(_QUAD.tobytes())

    def draw(self, dust: Puffs, depth: Any, common: dict[str, Any], view: View) -> None:
        if not len(dust.sizes):
            return
        away = np.linalg.norm(dust.positions - view.eye, axis=1)
        order = np.argsort(-away, kind='stable')
        thickness = -np.log1p(-np.minimum(dust.opacity, 1.0 - 1e-9))
        puffs = self._context.buffer(np.column_stack(
            [dust.positions, dust.sizes, thickness])[order].astype('f4').tobytes())
        array = self._context.vertex_array(
            self._program, [(self._quad, '2f', 'in_corner'),
                            (puffs, '3f 2f/i', 'in_position', 'in_puff')])
        lit = np.add(common['skylight'], 0.6 * np.asarray(common['sunshine']))
        depth.use(0)
        set_uniforms(self._program, {
            **common, 'depth': 0, 'side': tuple(view.side), 'up': tuple(view.up),
            'colour': tuple(np.clip(np.asarray(rgba('mortar')[:3]) * lit, 0.0, 1.0))})
        self._target.use()
        self._target.clear()
        self._context.enable_only(self._context.BLEND)
        self._context.blend_func = self._context.ONE, self._context.ONE_MINUS_SRC_ALPHA
        array.render(instances=len(order))
        self._context.blend_func = self._context.DEFAULT_BLENDING
        array.release()
        puffs.release()


def _seen_from(sun: np.ndarray, bounds: Bounds) -> np.ndarray:
    """Return the parallel projection from the sun to its shadow map, (4, 4)."""
    side = np.cross([0.0, 0.0, 1.0], sun) if abs(sun[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(sun, side), -sun]) / bounds.radius
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = -axes @ bounds.middle
    return matrix


def _column_major(matrix: np.ndarray) -> tuple[float, ...]:
    return tuple(matrix.T.ravel().tolist())


def _screen_pass(context: Any, programs: Programs, fragment: str) -> tuple[Any, Any]:
    target = programs.get('screen.vert', fragment)
    return target, context.vertex_array(target, [])


def _ground(context: Any, programs: Programs, terrain: Terrain) -> tuple[Any, Any]:
    """Build the ground up to the horizon."""
    target = programs.get('ground.vert', 'ground.frag')
    points, faces = _plain() if terrain.is_flat else terrain.mesh(_RINGS[-1])
    normals = (np.tile([0.0, 0.0, 1.0], (len(points), 1)) if terrain.is_flat
               else terrain.vertex_normals(_RINGS[-1]))
    return target, _lying(context, target, points, normals, faces)


def _paving(context: Any, programs: Programs, paving: Paving) -> tuple[Any, Any]:
    """Build the paving of the ground."""
    target = programs.get('ground.vert', 'paving.frag')
    return target, _lying(context, target, paving.points, paving.vertex_normals(), paving.faces)


def _lying(context: Any, target: Any, points: np.ndarray, normals: np.ndarray,
           faces: np.ndarray) -> Any:
    vertices = np.column_stack([points, normals])
    return context.vertex_array(
        target, [(context.buffer(vertices.astype('f4').tobytes()), '3f 3f', 'in_corner',
                  'in_normal')],
        context.buffer(faces.astype('u4').tobytes()), index_element_size=4)


def _plain() -> tuple[np.ndarray, np.ndarray]:
    """Return points and triangles of flat ground, finer towards the middle."""
    turn = np.linspace(0.0, 2.0 * np.pi, _SPOKES + 1)
    points = np.zeros((len(_RINGS), _SPOKES + 1, 3))
    points[..., :2] = _RINGS[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    grid = np.arange(points[..., 0].size).reshape(points.shape[:2])
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3),
                            np.stack([a, c, d], -1).reshape(-1, 3)])
    return points.reshape(-1, 3), faces


def _load_noise(context: Any) -> Any:
    pixels = texture.noise_image()
    noise = context.texture(pixels.shape[1::-1], 4, pixels.tobytes())
    noise.build_mipmaps()
    noise.filter = context.LINEAR_MIPMAP_LINEAR, context.LINEAR
    return noise
