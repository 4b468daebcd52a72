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


"""Canvas: lit meshes on their way into an image file, the only code that speaks to PyVista."""

from pathlib import Path

import numpy as np

from procphys_ros.render import light
from procphys_ros.render.backdrop import ground_colour, SHADOW, SKY_TOP
from procphys_ros.render.backend import load_pyvista
from procphys_ros.render.mesh import Mesh

_OVERSAMPLING = 2  # pixels drawn per pixel written, along each side
# Leaves are cut out instead of blended: blending would need sorting thousands of quads.
_CUT_OUT = '//VTK::TCoord::Impl\nif (gl_FragData[0].a < 0.4) { discard; }\n'


class Canvas:
    """
    An off-screen picture in the making.

    :param size: width and height [px].
    """

    def __init__(self, size: tuple[int, int]):
        self._pyvista = load_pyvista()
        self._size = size
        self._plotter = self._pyvista.Plotter(
            off_screen=True, window_size=[_OVERSAMPLING * side for side in size], lighting=None)
        self._plotter.set_background(tuple(SKY_TOP))

    def add(self, mesh: Mesh, colours: np.ndarray, image: np.ndarray | None = None,
            opacity: float = 1.0) -> None:
        """
        Draw a mesh in colours that are lit already.

        :param mesh: what to draw.
        :param colours: per vertex, each 0 to 1, (V, 3).
        :param image: multiplies the colours by `Mesh.uv`, (P, P, 4) uint8.
        :param opacity: below 1 for glass.
        """
        surface = self._pyvista.PolyData.from_regular_faces(mesh.points, mesh.triangles)
        surface.point_data['rgb'] = np.round(255.0 * colours).astype(np.uint8)
        surface.set_active_scalars('rgb')
        mapper = self._pyvista.DataSetMapper(surface)
        mapper.SetColorModeToDirectScalars()
        actor = self._pyvista.Actor(mapper=mapper)
        actor.prop.lighting = False
        actor.prop.opacity = opacity
        if image is not None:
            surface.active_texture_coordinates = mesh.uv
            picture = self._pyvista.Texture(image)
            picture.interpolate = True
            picture.mipmap = not _has_holes(image)
            picture.SetMaximumAnisotropicFiltering(1)  # more costs minutes in software OpenGL
            actor.texture = picture
            if _has_holes(image):
                actor.ForceOpaqueOn()
                actor.GetShaderProperty().AddFragmentShaderReplacement(
                    '//VTK::TCoord::Impl', True, _CUT_OUT, False)
        self._plotter.add_actor(actor, reset_camera=False)

    def add_shadow(self, mesh: Mesh, image: np.ndarray | None = None) -> None:
        """
        Draw the shadow that a mesh throws on the ground.

        :param mesh: what stands in the sun.
        :param image: cuts holes into it where it is transparent.
        """
        height = np.maximum(mesh.points[:, 2:], 0.0)
        fallen = mesh.points - height * light.SUN / light.SUN[2]
        fallen[:, 2] = 0.0
        dark = np.tile(SHADOW * ground_colour(), (len(fallen), 1))
        flat = Mesh(fallen, mesh.triangles, mesh.normals, mesh.uv, mesh.piece)
        if image is not None and _has_holes(image):
            self.add(flat, dark, np.where(np.arange(4) == 3, image, np.uint8(255)))
        else:
            self.add(flat, dark)

    def write(self, path: str | Path, place: tuple, field_of_view: float) -> None:
        """
        Write the picture.

        :param path: image file; its suffix chooses the format.
        :param place: camera position, focal point and up vector.
        :param field_of_view: vertical [degrees].
        """
        from PIL import Image

        self._plotter.camera_position = place
        self._plotter.camera.view_angle = field_of_view
        self._plotter.reset_camera_clipping_range()
        pixels = self._plotter.screenshot(return_img=True)
        self._plotter.close()
        Image.fromarray(pixels).resize(self._size, Image.Resampling.BOX).save(path)


def _has_holes(image: np.ndarray) -> bool:
    return bool((image[..., 3] < 255).any())
